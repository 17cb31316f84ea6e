//! What is around everything: the light of the sky, fog and glow.

use std::sync::Arc;

use super::light::number;
use crate::colour::Panorama;
use crate::diag::{Diagnostic, Span};
use crate::formula::decode::Fields;
use crate::formula::value::{Value, ValueKind};
use crate::graph::objects::field;
use crate::graph::read::Reader;

/// Where light comes from that meets nothing: radiance by direction, linear.
#[derive(Clone, PartialEq, Debug)]
pub enum Environment {
    /// The sky of a look: brighter above, with a little of the sun's light from below. Its up direction is that of the file's own
    /// view.
    Dome {
        /// Colour times strength of the sky.
        sky: [f64; 3],
        /// Colour times strength of the sun, some of which comes back from below.
        sun: [f64; 3],
    },
    /// Three colours, mixed by height; up is the z axis.
    Gradient {
        /// Straight below.
        ground: [f64; 3],
        /// At the horizon.
        horizon: [f64; 3],
        /// Straight above.
        zenith: [f64; 3],
    },
    /// The clear sky of a sun (Preetham, Shirley and Smits, 1999); up is the z axis.
    Daylight {
        /// Unit vector towards the sun.
        sun: [f64; 3],
        /// How hazy the air is: 2 is clear, 10 is misty.
        turbidity: f64,
        /// Radiance of the zenith where the sun stands at 45 degrees, as a factor of everything.
        strength: f64,
        /// Radiance of the ground.
        ground: [f64; 3],
    },
    /// An equirectangular picture; up is the z axis.
    Picture {
        /// The picture.
        panorama: Arc<Panorama>,
        /// A factor of all of its light.
        strength: f64,
        /// How far it is turned around z, from x to y, in radians.
        turn: f64,
    },
}

/// What is between the camera and what it sees.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Atmosphere {
    /// Share of light lost per unit of distance, in units of the bounding radius; 0 is no fog.
    pub fog: f64,
    /// Radiance of the fog; that of the background where absent.
    pub fog_colour: Option<[f64; 3]>,
    /// Where fog lies on the ground: the height at which it has the density `fog`, and the height over which it
    /// thins by a factor of e, in world units along z.
    pub ground: Option<[f64; 2]>,
    /// Light around what rays pass closely.
    pub glow: Option<Glow>,
}

/// Light around what rays pass closely.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Glow {
    /// Radiance where a ray grazes the surface.
    pub colour: [f64; 3],
    /// Distance, as a share of the distance from the camera, at which it has faded to 1/e.
    pub width: f64,
}

/// How environments are written.
const FORMS: &str = "environments are: Uniform((1, 1, 1)), Gradient(ground: (0.1, 0.1, 0.1), horizon: (0.7, 0.8, 0.9), zenith: (0.2, 0.4, 0.8)), \
                     Daylight(sun: (0.5, -0.5, 0.6), turbidity: 3.0), Picture(file: \"studio.hdr\", strength: 1.0, turn: 30.0)";

impl Environment {
    /// The same with a factor on all of its light.
    #[must_use]
    pub fn times(self, factor: f64) -> Environment {
        let times = |colour: [f64; 3]| colour.map(|part| part * factor);
        match self {
            Environment::Dome { sky, sun } => Environment::Dome { sky: times(sky), sun: times(sun) },
            Environment::Gradient { ground, horizon, zenith } => {
                Environment::Gradient { ground: times(ground), horizon: times(horizon), zenith: times(zenith) }
            }
            Environment::Daylight { sun, turbidity, strength, ground } => {
                Environment::Daylight { sun, turbidity, strength: strength * factor, ground: times(ground) }
            }
            Environment::Picture { panorama, strength, turn } => {
                Environment::Picture { panorama, strength: strength * factor, turn }
            }
        }
    }
}

/// Reads `environment: Gradient(...)`.
pub(super) fn read_environment(reader: &mut Reader, value: &Value) -> Option<Environment> {
    let name = value.name().map(|name| name.text.clone());
    if let (Some("Uniform"), ValueKind::Tuple { items, .. }) = (name.as_deref(), &value.kind)
        && let [colour] = &items[..]
    {
        let colour = reader.vector(colour, 0.0, 1e6)?;
        return Some(Environment::Gradient { ground: colour, horizon: colour, zenith: colour });
    }
    let (Some(name @ ("Gradient" | "Daylight" | "Picture")), ValueKind::Struct { .. }) = (name.as_deref(), &value.kind)
    else {
        let message = format!("expected an environment, found {}", value.describe());
        reader.d.push(Diagnostic::error(message).label(value.span, "").help(FORMS));
        return None;
    };
    let mut fields = Fields::new(value, "an environment", reader.d)?;
    let strength = number(reader, &mut fields, "strength", 1.0, (0.0, 1e6));
    let mut colour = |reader: &mut Reader, name: &'static str, default: [f64; 3]| {
        fields.optional_value(name).map_or(Some(default), |v| reader.vector(v, 0.0, 1e6))
    };
    let found = match name {
        "Gradient" => {
            let ground = colour(reader, "ground", [0.10, 0.09, 0.08]);
            let horizon = colour(reader, "horizon", [0.62, 0.70, 0.80]);
            let zenith = colour(reader, "zenith", [0.16, 0.30, 0.62]);
            ground.zip(horizon).zip(zenith).map(|((ground, horizon), zenith)| Environment::Gradient {
                ground,
                horizon,
                zenith,
            })
        }
        "Picture" => read_picture(reader, &mut fields),
        _ => {
            let ground = colour(reader, "ground", [0.10, 0.09, 0.08]);
            let sun = fields.optional_value("sun").map_or(Some([0.5, -0.5, 0.7]), |v| reader.direction(v));
            let turbidity = number(reader, &mut fields, "turbidity", 3.0, (1.7, 10.0));
            ground.zip(sun).zip(turbidity).map(|((ground, sun), turbidity)| {
                let length = sun.iter().map(|x| x * x).sum::<f64>().sqrt();
                Environment::Daylight { sun: sun.map(|x| x / length), turbidity, strength: 1.0, ground }
            })
        }
    };
    fields.finish(reader.d);
    Some(found?.times(strength?))
}

/// Reads the fields of a picture. The file itself was read before ([`wanted_picture`]).
fn read_picture(reader: &mut Reader, fields: &mut Fields) -> Option<Environment> {
    let span = fields.span();
    let file = fields.optional_value("file");
    let turn = number(reader, fields, "turn", 0.0, (-3600.0, 3600.0));
    if !file.is_some_and(|file| matches!(file.kind, ValueKind::Str(_))) {
        let message = "a picture of surroundings needs a file";
        let diagnostic = Diagnostic::error(message).label(file.map_or(span, |file| file.span), "");
        reader.d.push(diagnostic.help("name it: `Picture(file: \"studio.hdr\")`"));
        return None;
    }
    let panorama = reader.panorama.clone()?;
    Some(Environment::Picture { panorama, strength: 1.0, turn: turn?.to_radians() })
}

/// The picture that a file's surroundings name, and the place of its name. What is wrong with it is told when the file is read.
pub fn wanted_picture(value: &Value) -> Option<(&str, Span)> {
    let environment = field(value, "environment").or_else(|| field(field(value, "scene")?, "environment"))?;
    environment.name().filter(|name| name.text == "Picture")?;
    let file = field(environment, "file")?;
    if let ValueKind::Str(name) = &file.kind { Some((name, file.span)) } else { None }
}

/// Reads `atmosphere: (fog: 0.2, fog_color: (0.6, 0.7, 0.8), ground_fog: (base, falloff), glow: (color: ..., width: 0.05))`.
pub(super) fn read_atmosphere(reader: &mut Reader, value: &Value) -> Option<Atmosphere> {
    let mut fields = Fields::new(value, "an atmosphere", reader.d)?;
    let fog = number(reader, &mut fields, "fog", 0.0, (0.0, 100.0));
    let fog_colour = fields.optional_value("fog_color").map(|v| reader.vector(v, 0.0, 1e6));
    let ground = fields.optional_value("ground_fog").map(|v| read_ground_fog(reader, v));
    let glow = fields.optional_value("glow").map(|v| read_glow(reader, v));
    fields.finish(reader.d);
    let whole = |part: Option<Option<_>>| part.map_or(Some(None), |part: Option<_>| part.map(Some));
    let (ground, glow) = (ground.map_or(Some(None), |g| g.map(Some))?, glow.map_or(Some(None), |g| g.map(Some))?);
    Some(Atmosphere { fog: fog?, fog_colour: whole(fog_colour)?, ground, glow })
}

fn read_ground_fog(reader: &mut Reader, value: &Value) -> Option<[f64; 2]> {
    let mut fields = Fields::new(value, "ground fog", reader.d)?;
    let base = number(reader, &mut fields, "base", 0.0, (-1e9, 1e9));
    let falloff = number(reader, &mut fields, "falloff", 0.5, (1e-6, 1e9));
    fields.finish(reader.d);
    Some([base?, falloff?])
}

fn read_glow(reader: &mut Reader, value: &Value) -> Option<Glow> {
    let mut fields = Fields::new(value, "a glow", reader.d)?;
    let colour = fields.optional_value("color").map_or(Some([1.0, 0.8, 0.5]), |v| reader.vector(v, 0.0, 1e6));
    let strength = number(reader, &mut fields, "strength", 1.0, (0.0, 1e6));
    let width = number(reader, &mut fields, "width", 0.02, (1e-6, 10.0));
    fields.finish(reader.d);
    let (colour, strength) = (colour?, strength?);
    Some(Glow { colour: colour.map(|part| part * strength), width: width? })
}

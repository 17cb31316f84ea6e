//! The lights of a scene.

use crate::diag::Diagnostic;
use crate::formula::decode::{Fields, entries};
use crate::formula::value::{Value, ValueKind};
use crate::graph::read::Reader;

/// A lamp, or the sun.
#[derive(Clone, PartialEq, Debug)]
pub struct Light {
    /// Name; `light.NAME.strength` sets a part of it.
    pub name: String,
    /// What shines, and from where.
    pub kind: LightKind,
    /// Linear colour times strength. A white matte surface that faces a sun of strength 1 has the radiance 1, and one that
    /// faces a lamp of strength 1 has it at distance 1; light of lamps fades with the square of the distance.
    pub colour: [f64; 3],
    /// Whether it casts shadows.
    pub shadows: bool,
}

/// What shines, and from where.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum LightKind {
    /// Far away: its rays are parallel.
    Sun {
        /// Unit vector towards it.
        direction: [f64; 3],
        /// What the direction is given in.
        space: Space,
        /// Angle across its disc, in radians.
        angle: f64,
    },
    /// A ball that shines to all sides; a point where the radius is 0.
    Lamp {
        /// Its centre.
        at: [f64; 3],
        /// What the centre is given in.
        space: Space,
        /// Its radius in world units.
        radius: f64,
        /// Where it shines only into a cone.
        cone: Option<Cone>,
    },
}

/// The cone of a spot.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Cone {
    /// Unit vector along its axis, away from the lamp.
    pub along: [f64; 3],
    /// Angle between the axis and the edge, in radians.
    pub angle: f64,
    /// Share of the angle over which the light fades towards the edge, from 0 to 1.
    pub soft: f64,
}

/// What directions and positions are given in.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Space {
    /// The world's axes.
    World,
    /// The camera's frame: right, up, back; positions are relative to it. The light moves with the camera.
    Camera,
    /// The frame of the view that the file itself shows; from there it stays in the world however the camera moves.
    Home,
}

/// The angle across the sun's disc as seen from the Earth, in radians.
pub const SUN_ANGLE: f64 = 0.0094;

/// How lights are written.
const FORMS: &str = "lights are: Sun(direction: (-0.6, -0.7, 0.5), strength: 2.0), Point(at: (0, 0, 1), strength: 1.0), \
                     Sphere(at: (0, 0, 1), radius: 0.1), Spot(at: (0, -2, 2), target: (0, 0, 0), cone: 40.0), Headlight(strength: 1.0)";

impl Light {
    /// The sun of a look: its direction is given in the frame of the file's own view.
    pub fn sun_of_look(direction: [f64; 3], colour: [f64; 3], shadows: bool) -> Light {
        let kind = LightKind::Sun { direction, space: Space::Home, angle: SUN_ANGLE };
        Light { name: "sun".into(), kind, colour, shadows }
    }

    /// Whether anything of it can be seen.
    pub fn shines(&self) -> bool {
        self.colour.iter().any(|part| *part > 0.0)
    }
}

/// Reads `light: {"key": Sun(...), "lamp": Point(...)}`.
pub(super) fn read_lights(reader: &mut Reader, value: &Value) -> Vec<Light> {
    let named = entries(value, "lights", reader.d);
    named.into_iter().filter_map(|(name, value)| read_light(reader, &name.text, value)).collect()
}

fn read_light(reader: &mut Reader, name: &str, value: &Value) -> Option<Light> {
    let kind = value.name().map(|name| name.text.clone());
    let (Some(kind), ValueKind::Struct { .. }) = (kind.as_deref(), &value.kind) else {
        let message = format!("expected a light, found {}", value.describe());
        reader.d.push(Diagnostic::error(message).label(value.span, "").help(FORMS));
        return None;
    };
    let mut fields = Fields::new(value, "a light", reader.d)?;
    let colour = fields.optional_value("color").map_or(Some([1.0; 3]), |v| reader.vector(v, 0.0, 1e6));
    let strength = number(reader, &mut fields, "strength", 1.0, (0.0, 1e9));
    let shadows = fields.or("shadows", true, reader.d);
    let space = fields.optional_value("space");
    let words = [("world", Space::World), ("camera", Space::Camera)];
    let space = space.map_or(Some(Space::World), |v| reader.word(v, "space of a light", &words));
    let kind = match kind {
        "Sun" => {
            let direction = fields.optional_value("direction");
            let direction = direction.map_or(Some([0.0, 0.0, 1.0]), |v| reader.direction(v));
            let angle = number(reader, &mut fields, "angle", SUN_ANGLE.to_degrees(), (0.0, 90.0));
            direction.zip(angle).zip(space).map(|((direction, angle), space)| LightKind::Sun {
                direction,
                space,
                angle: angle.to_radians(),
            })
        }
        "Point" | "Sphere" | "Spot" => read_lamp(reader, &mut fields, (kind, space?)),
        "Headlight" => {
            let radius = number(reader, &mut fields, "radius", 0.0, (0.0, 1e6));
            radius.map(|radius| LightKind::Lamp { at: [0.0; 3], space: Space::Camera, radius, cone: None })
        }
        other => {
            let diagnostic = Diagnostic::error(format!("there is no light `{other}`")).label(value.span, "");
            let names = ["Sun", "Point", "Sphere", "Spot", "Headlight"];
            reader.d.push(diagnostic.did_you_mean(other, names).help(FORMS));
            return None;
        }
    };
    fields.finish(reader.d);
    let (kind, colour, strength) = (kind?, colour?, strength?);
    Some(Light { name: name.to_string(), kind, colour: colour.map(|part| part * strength), shadows })
}

/// Reads the fields of a lamp, a ball or a spot.
fn read_lamp(reader: &mut Reader, fields: &mut Fields, (kind, space): (&str, Space)) -> Option<LightKind> {
    let span = fields.span();
    let Some(at) = fields.optional_value("at") else {
        let message = "a lamp needs a position";
        reader.d.push(Diagnostic::error(message).label(span, "").help("give it one: `at: (0.0, -1.0, 2.0)`"));
        return None;
    };
    let at = reader.vector(at, -1e9, 1e9);
    let default = if kind == "Sphere" { 0.1 } else { 0.0 };
    let radius = number(reader, fields, "radius", default, (0.0, 1e6));
    let cone = match kind {
        "Spot" => Some(read_cone(reader, fields, at?)?),
        _ => None,
    };
    Some(LightKind::Lamp { at: at?, space, radius: radius?, cone })
}

/// Reads where a spot shines: along a direction, or at a target.
fn read_cone(reader: &mut Reader, fields: &mut Fields, at: [f64; 3]) -> Option<Cone> {
    let (direction, target) = (fields.optional_value("direction"), fields.optional_value("target"));
    let angle = number(reader, fields, "cone", 40.0, (0.1, 180.0));
    let soft = number(reader, fields, "soft", 0.2, (0.0, 1.0));
    let along = match (direction, target) {
        (Some(direction), _) => reader.direction(direction)?,
        (None, target) => {
            let target = target.map_or(Some([0.0; 3]), |v| reader.vector(v, -1e9, 1e9))?;
            let off = [0, 1, 2].map(|i| target[i] - at[i]);
            let length = off.iter().map(|x| x * x).sum::<f64>().sqrt();
            if length == 0.0 {
                let message = "the spot stands at its target";
                reader.d.push(Diagnostic::error(message).label(fields.span(), "").help("move `at` or `target`"));
                return None;
            }
            off.map(|x| x / length)
        }
    };
    Some(Cone { along, angle: (angle? / 2.0).to_radians(), soft: soft? })
}

/// Reads a number within limits; one that is not given is the default.
pub(super) fn number(
    reader: &mut Reader,
    fields: &mut Fields,
    name: &'static str,
    default: f64,
    (least, most): (f64, f64),
) -> Option<f64> {
    fields.optional_value(name).map_or(Some(default), |v| reader.number(v, least, most))
}

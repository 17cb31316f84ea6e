//! The camera: where a picture is seen from, and which lens draws it.

use std::f64::consts::{PI, TAU};

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::diag::{Diagnostic, Span};
use crate::formula::decode::Fields;
use crate::formula::value::{Value, ValueKind};
use crate::graph::read::{Reader, cross, dot};

/// Where a picture is seen from, and how.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub struct Camera {
    /// Position in world units.
    pub position: [f64; 3],
    /// The point in the middle of the picture.
    pub target: [f64; 3],
    /// Roughly upwards.
    pub up: [f64; 3],
    /// Angle from the bottom to the top of the picture, in radians; of no meaning for orthographic pictures and cube maps.
    pub fov: f64,
    /// How directions become places of the picture.
    #[serde(default)]
    pub lens: Lens,
    /// Pictures for both eyes; `None` for one eye.
    #[serde(default)]
    pub stereo: Option<Stereo>,
    /// What is nearer is not seen, in world units: by a plane across the view direction, or by a sphere for lenses that see all around.
    #[serde(default)]
    pub near: f64,
    /// What is farther is not seen, by the same measure.
    #[serde(default)]
    pub far: Option<f64>,
    /// The opening of the lens, where pictures along paths of light have a depth of field.
    #[serde(default)]
    pub aperture: Option<Aperture>,
}

/// The opening of a lens: what is nearer or farther than the focus is blurred.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub struct Aperture {
    /// Its radius in world units, above 0.
    pub radius: f64,
    /// Distance of what is sharp, in world units, along the view direction; that of the target where absent.
    pub focus: Option<f64>,
    /// Edges of the opening, from 3; 0 is round.
    pub blades: u32,
}

/// How directions become places of the picture.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub enum Lens {
    /// Straight lines stay straight.
    Perspective {
        /// How far the lens is moved to the right and up, as shares of the picture's height: the picture moves with it, and
        /// parallel lines stay parallel.
        shift: [f64; 2],
    },
    /// Parallel rays from the plane through the camera's position: nothing shrinks with its distance.
    Orthographic {
        /// World units from the bottom to the top of the picture, above 0.
        height: f64,
    },
    /// The distance from the middle of the picture is the angle to the view direction (equidistant fisheye). Nothing lies beyond
    /// 360 degrees.
    Fisheye,
    /// Columns are longitudes, rows are latitudes; the picture holds `fov` of latitudes.
    Equirectangular {
        /// Longitudes of the whole picture, in radians.
        width: f64,
    },
    /// The six faces of a cube.
    CubeMap(CubeLayout),
}

impl Default for Lens {
    fn default() -> Lens {
        Lens::Perspective { shift: [0.0; 2] }
    }
}

impl Lens {
    /// The names of lenses, without their settings, and what each is with the defaults of those.
    pub const NAMES: [(&'static str, Lens); 6] = [
        ("perspective", Lens::Perspective { shift: [0.0; 2] }),
        ("orthographic", Lens::Orthographic { height: 0.0 }),
        ("fisheye", Lens::Fisheye),
        ("equirectangular", Lens::Equirectangular { width: TAU }),
        ("cube-strip", Lens::CubeMap(CubeLayout::Strip)),
        ("cube-cross", Lens::CubeMap(CubeLayout::Cross)),
    ];

    /// The lens's name.
    pub fn name(&self) -> &'static str {
        match self {
            Lens::Perspective { .. } => "perspective",
            Lens::Orthographic { .. } => "orthographic",
            Lens::Fisheye => "fisheye",
            Lens::Equirectangular { .. } => "equirectangular",
            Lens::CubeMap(CubeLayout::Strip) => "cube-strip",
            Lens::CubeMap(CubeLayout::Cross) => "cube-cross",
        }
    }

    /// The angle from the bottom to the top of a picture that states none, in radians.
    pub fn usual_fov(&self) -> f64 {
        match self {
            Lens::Fisheye | Lens::Equirectangular { .. } => PI,
            _ => 40f64.to_radians(),
        }
    }

    /// The widest angle from the bottom to the top of a picture, in degrees.
    pub fn most_fov(&self) -> f64 {
        match self {
            Lens::Fisheye => 360.0,
            Lens::Equirectangular { .. } => 180.0,
            _ => 175.0,
        }
    }
}

/// Where the faces of a cube map are.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub enum CubeLayout {
    /// Three columns and two rows: right, left, up; down, front, back.
    Strip,
    /// Four columns and three rows: left, front, right and back in the middle row, up above the front and down below it.
    Cross,
}

/// Pictures for both eyes.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub struct Stereo {
    /// Distance between the eyes, in world units.
    pub eyes: f64,
    /// How their pictures are put together.
    pub layout: StereoLayout,
}

/// How the pictures of two eyes are put together.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub enum StereoLayout {
    /// The left eye's in the left half of the picture, the right eye's in the right half.
    SideBySide,
    /// The left eye's in the upper half of the picture, the right eye's in the lower half.
    OverUnder,
    /// Red of the left eye's, green and blue of the right eye's.
    Anaglyph,
    /// The left eye's alone.
    Left,
    /// The right eye's alone.
    Right,
}

impl StereoLayout {
    /// The names of layouts.
    pub const NAMES: [(&'static str, StereoLayout); 5] = [
        ("side-by-side", StereoLayout::SideBySide),
        ("over-under", StereoLayout::OverUnder),
        ("anaglyph", StereoLayout::Anaglyph),
        ("left", StereoLayout::Left),
        ("right", StereoLayout::Right),
    ];

    /// The layout's name.
    pub fn name(self) -> &'static str {
        StereoLayout::NAMES.iter().find(|(_, layout)| *layout == self).map_or("", |(name, _)| name)
    }
}

impl Camera {
    /// A perspective camera.
    pub const fn new(position: [f64; 3], target: [f64; 3], up: [f64; 3], fov: f64) -> Camera {
        let lens = Lens::Perspective { shift: [0.0; 2] };
        Camera { position, target, up, fov, lens, stereo: None, near: 0.0, far: None, aperture: None }
    }

    /// Distance from the camera to its target.
    pub fn distance(&self) -> f64 {
        let away = [0, 1, 2].map(|i| self.target[i] - self.position[i]);
        dot(away, away).sqrt()
    }

    /// The height of what a perspective camera of this position sees at its target.
    pub fn height_at_target(&self) -> f64 {
        match self.lens {
            Lens::Orthographic { height } => height,
            Lens::Perspective { .. } => 2.0 * self.distance() * (self.fov / 2.0).tan(),
            _ => 2.0 * self.distance() * (Lens::default().usual_fov() / 2.0).tan(),
        }
    }

    /// The same camera with another lens. Where the new lens states no height or angle, the target keeps its size where that can be.
    #[must_use]
    pub fn with_lens(self, lens: Lens) -> Camera {
        let lens = match lens {
            Lens::Orthographic { height } if height <= 0.0 => Lens::Orthographic { height: self.height_at_target() },
            lens => lens,
        };
        let is_same = std::mem::discriminant(&self.lens) == std::mem::discriminant(&lens);
        let fov = match (self.lens, lens) {
            _ if is_same => self.fov,
            (Lens::Orthographic { height }, Lens::Perspective { .. }) => 2.0 * (height / 2.0 / self.distance()).atan(),
            (Lens::CubeMap(_), Lens::Perspective { .. }) | (_, Lens::Orthographic { .. } | Lens::CubeMap(_)) => {
                self.fov
            }
            (_, new) => new.usual_fov(),
        };
        Camera { lens, fov, ..self }
    }

    /// The perspective camera that sees about the same, for programs that have no other.
    #[must_use]
    pub fn flat(self) -> Camera {
        match self.lens {
            Lens::Perspective { .. } => Camera { lens: Lens::default(), stereo: None, ..self },
            _ => Camera { stereo: None, ..self.with_lens(Lens::default()) },
        }
    }

    /// Whether rays leave in parallel, so that nothing shrinks with its distance.
    pub fn is_parallel(&self) -> bool {
        matches!(self.lens, Lens::Orthographic { .. })
    }
}

/// Reads `camera: (position: (x, y, z), ...)`.
pub(super) fn read_camera(reader: &mut Reader, value: &Value) -> Option<Camera> {
    let mut fields = Fields::new(value, "a camera", reader.d)?;
    let position = fields.optional_value("position");
    let target = fields.optional_value("target").and_then(|v| reader.vector(v, -1e9, 1e9));
    let up = fields.optional_value("up").and_then(|v| reader.direction(v)).unwrap_or([0.0, 0.0, 1.0]);
    let orientation = read_orientation(reader, &mut fields)?;
    let lens = fields.optional_value("lens").map_or(Some((Lens::default(), None)), |v| read_lens(reader, v));
    let fov = fields.optional_value("fov");
    let stereo = fields.optional_value("stereo").map_or(Some(None), |v| read_stereo(reader, v).map(Some));
    let near = fields.optional_value("near").map_or(Some(0.0), |v| reader.number(v, 0.0, 1e9));
    let far = fields.optional_value("far").map_or(Some(None), |v| reader.number(v, 1e-300, 1e9).map(Some));
    let aperture = read_aperture(reader, &mut fields);
    let span = fields.span();
    fields.finish(reader.d);
    let Some(position) = position else {
        reader.d.push(Diagnostic::error("a camera needs a `position`").label(span, ""));
        return None;
    };
    let position = reader.vector(position, -1e9, 1e9)?;
    let (target, up) = match orientation {
        Some((forward, up)) => ([0, 1, 2].map(|i| position[i] + forward[i]), up),
        None => (target.unwrap_or([0.0; 3]), up),
    };
    let (lens, of_lens) = lens?;
    let fov = read_fov(reader, fov, (lens, of_lens))?;
    if is_on_one_line(position, target, up) {
        let message = "the camera's position, target and up direction lie on one line";
        bad(reader, value.span, message, "move the position, or choose another `up`");
        return None;
    }
    let camera = Camera {
        stereo: stereo?,
        near: near?,
        far: far?,
        aperture: aperture?,
        ..Camera::new(position, target, up, fov)
    };
    Some(match lens {
        Lens::Orthographic { height } if height <= 0.0 => camera.with_lens(lens),
        lens => Camera { lens, ..camera },
    })
}

/// Reads `orientation: (x, y, z, w), distance: 2.0`: the way to the target and the up direction of a camera that a unit quaternion turns, as in glTF: unturned
/// it looks along -z with y upwards. The outer option is that of errors.
#[expect(clippy::option_option)]
fn read_orientation(reader: &mut Reader, fields: &mut Fields) -> Option<Option<([f64; 3], [f64; 3])>> {
    let (turn, distance) = (fields.optional_value("orientation"), fields.optional_value("distance"));
    let others = ["target", "up"].map(|name| fields.optional_value(name));
    let Some(value) = turn else {
        if let Some(distance) = distance {
            bad(reader, distance.span, "`distance` belongs to `orientation`", "drop it: `target` says how far it is");
            return None;
        }
        return Some(None);
    };
    if let Some(other) = others.into_iter().flatten().next() {
        let help = "drop `target` and `up`; `distance` says how far the target is";
        bad(reader, other.span, "a camera has an `orientation`, or a `target` and `up`", help);
        return None;
    }
    let distance = distance.map_or(Some(1.0), |v| reader.number(v, 1e-300, 1e9))?;
    let (ValueKind::List(items) | ValueKind::Tuple { name: None, items }) = &value.kind else {
        bad(reader, value.span, "an orientation is a quaternion", "write (x, y, z, w), such as (0, 0, 0, 1)");
        return None;
    };
    let parts: Vec<f64> = items.iter().map(|item| reader.number(item, -1e6, 1e6)).collect::<Option<_>>()?;
    let turn = <[f64; 4]>::try_from(parts).ok().map(DQuat::from_array).filter(|turn| turn.length() > 1e-9);
    let Some(turn) = turn.map(DQuat::normalize) else {
        bad(reader, value.span, "an orientation has four numbers that are not all 0", "write (x, y, z, w)");
        return None;
    };
    Some(Some(((turn * DVec3::NEG_Z * distance).to_array(), (turn * DVec3::Y).to_array())))
}

/// Reads `aperture: 0.02, focus: 3.0, blades: 6`. The outer option is that of errors.
fn read_aperture(reader: &mut Reader, fields: &mut Fields) -> Option<Option<Aperture>> {
    let radius = fields.optional_value("aperture").map_or(Some(0.0), |v| reader.number(v, 0.0, 1e6));
    let focus = fields.optional_value("focus").map_or(Some(None), |v| reader.number(v, 1e-9, 1e9).map(Some));
    let blades = fields.or("blades", 0, reader.d);
    if blades == 1 || blades == 2 || blades > 64 {
        let message = "an aperture has from 3 to 64 blades, or none where it is round";
        bad(reader, fields.span(), message, "write `blades: 6`");
        return None;
    }
    let (radius, focus) = (radius?, focus?);
    Some((radius > 0.0).then_some(Aperture { radius, focus, blades }))
}

/// Whether a camera has no frame.
fn is_on_one_line(position: [f64; 3], target: [f64; 3], up: [f64; 3]) -> bool {
    let view = [0, 1, 2].map(|i| target[i] - position[i]);
    let side = cross(view, up);
    dot(side, side) <= 1e-12 * dot(view, view)
}

/// The angle of view: the camera's, that of its lens's focal length, or what is usual.
fn read_fov(reader: &mut Reader, fov: Option<&Value>, (lens, of_lens): (Lens, Option<f64>)) -> Option<f64> {
    match (fov, of_lens) {
        (Some(value), Some(_)) => {
            let message = "a camera has a `fov` or its lens a `focal_length`, not both";
            bad(reader, value.span, message, "drop one of them");
            None
        }
        (Some(value), None) => Some(reader.number(value, 0.001, lens.most_fov())?.to_radians()),
        (None, of_lens) => Some(of_lens.unwrap_or_else(|| lens.usual_fov())),
    }
}

/// How lenses are written.
const LENSES: &str = "lenses are: Perspective(shift: (0, 0.2)), Perspective(focal_length: 35, sensor: 24), Orthographic(height: 3), \
                      Fisheye, Equirectangular, Equirectangular(width: 180), CubeMap(\"strip\"), CubeMap(\"cross\")";

/// Reads a lens, and the angle that its focal length makes where it has one.
fn read_lens(reader: &mut Reader, value: &Value) -> Option<(Lens, Option<f64>)> {
    let name = value.name().map(|name| name.text.as_str());
    let is_bare = matches!(&value.kind, ValueKind::Variant(_));
    let lens = match (name, &value.kind) {
        (Some("Fisheye"), ValueKind::Variant(_)) => Lens::Fisheye,
        (Some("CubeMap"), ValueKind::Variant(_)) => Lens::CubeMap(CubeLayout::Strip),
        (Some("CubeMap"), ValueKind::Tuple { items, .. }) if items.len() == 1 => {
            let layouts = [("strip", CubeLayout::Strip), ("cross", CubeLayout::Cross)];
            Lens::CubeMap(reader.word(&items[0], "layout of a cube map", &layouts)?)
        }
        (Some("Perspective"), _) if is_bare => Lens::default(),
        (Some("Orthographic"), _) if is_bare => Lens::Orthographic { height: 0.0 },
        (Some("Equirectangular"), _) if is_bare => Lens::Equirectangular { width: TAU },
        (Some(name @ ("Perspective" | "Orthographic" | "Equirectangular")), ValueKind::Struct { .. }) => {
            return read_settings(reader, name, value);
        }
        _ => {
            bad(reader, value.span, &format!("expected a lens, found {}", value.describe()), LENSES);
            return None;
        }
    };
    Some((lens, None))
}

/// Reads a lens with settings, and the angle that its focal length makes where it has one.
fn read_settings(reader: &mut Reader, name: &str, value: &Value) -> Option<(Lens, Option<f64>)> {
    let mut fields = Fields::new(value, "a lens", reader.d)?;
    let mut number = |reader: &mut Reader, name: &'static str, default: f64, [least, most]: [f64; 2]| {
        fields.optional_value(name).map_or(Some(default), |v| reader.number(v, least, most))
    };
    let lens = match name {
        "Orthographic" => {
            let height = number(reader, "height", 0.0, [1e-300, 1e9]);
            height.map(|height| (Lens::Orthographic { height }, None))
        }
        "Equirectangular" => {
            let width = number(reader, "width", 360.0, [0.001, 360.0]);
            width.map(|width| (Lens::Equirectangular { width: width.to_radians() }, None))
        }
        _ => {
            let focal_length = number(reader, "focal_length", 0.0, [0.1, 1e5]);
            let sensor = number(reader, "sensor", SENSOR, [0.1, 1e4]);
            let shift = fields.optional_value("shift").map_or(Some([0.0; 2]), |v| read_pair(reader, v));
            let fov = focal_length.zip(sensor).map(|(focal, sensor)| {
                // The angle of a sensor behind a lens.
                (focal > 0.0).then(|| 2.0 * (sensor / 2.0 / focal).atan())
            });
            shift.zip(fov).map(|(shift, fov)| (Lens::Perspective { shift }, fov))
        }
    };
    fields.finish(reader.d);
    lens
}

/// Height of a sensor or film that states none, in millimetres: that of 36x24 film.
const SENSOR: f64 = 24.0;

/// Reads a shift to the right and up, in shares of the picture's height.
fn read_pair(reader: &mut Reader, value: &Value) -> Option<[f64; 2]> {
    match &value.kind {
        ValueKind::List(items) | ValueKind::Tuple { name: None, items } if items.len() == 2 => {
            let [x, y] = [0, 1].map(|i| reader.number(&items[i], -10.0, 10.0));
            Some([x?, y?])
        }
        _ => {
            bad(
                reader,
                value.span,
                "expected a shift such as (0, 0.25)",
                "write how far to the right and up, in shares of the height",
            );
            None
        }
    }
}

fn bad(reader: &mut Reader, span: Span, message: &str, help: &str) {
    reader.d.push(Diagnostic::error(message).label(span, "").help(help));
}

/// Reads `stereo: (eyes: 0.06, layout: "side_by_side")`.
fn read_stereo(reader: &mut Reader, value: &Value) -> Option<Stereo> {
    let mut fields = Fields::new(value, "a stereo camera", reader.d)?;
    let eyes = reader.required_number(&mut fields, "eyes", 1e-300, 1e9);
    let layout = fields.optional_value("layout");
    let layout = layout
        .map_or(Some(StereoLayout::SideBySide), |v| reader.word(v, "layout of two pictures", &StereoLayout::NAMES));
    fields.finish(reader.d);
    Some(Stereo { eyes: eyes?, layout: layout? })
}

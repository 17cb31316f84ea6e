//! The scene: what a picture shows of a formula, from where, and in which light.
//!
//! A fractal's file holds its default scene beside its nodes. In comes the file's value tree; out comes a [`Scene`], which the
//! expressions of pictures are composed from. Formulas, their tests and their estimates do not depend on it.

mod fields;
mod look;

pub use look::{Look, Palette, Part, TRAPS, Trap};

use serde::{Deserialize, Serialize};

use self::fields::{read_camera, read_plane};
use self::look::read_look;
use super::read::Reader;
use crate::formula::decode::Fields;

/// What a picture shows, from where, and in which light.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Scene {
    /// Where to look from; found automatically where absent.
    pub camera: Option<Camera>,
    /// The plane that pictures show; absent where they are seen through the camera.
    pub plane: Option<Plane>,
    /// Light and colour.
    pub look: Look,
}

/// A perspective camera.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub struct Camera {
    /// Position in world units.
    pub position: [f64; 3],
    /// The point in the middle of the picture.
    pub target: [f64; 3],
    /// Roughly upwards.
    pub up: [f64; 3],
    /// Angle from the bottom to the top of the picture, in radians.
    pub fov: f64,
}

/// A rectangle of a plane through space, which a picture shows instead of a camera's view.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Plane {
    /// The point in the middle of the picture.
    pub center: [f64; 3],
    /// From its bottom to its top, in world units.
    pub height: f64,
    /// Unit vector to the right of the picture.
    pub right: [f64; 3],
    /// Unit vector to its top, across `right`.
    pub up: [f64; 3],
}

/// Reads the fields of a scene from those of a file.
pub(super) fn read_scene(reader: &mut Reader, fields: &mut Fields) -> Scene {
    let camera = fields.optional_value("camera").and_then(|v| read_camera(reader, v));
    let plane = fields.optional_value("plane").and_then(|v| read_plane(reader, v));
    let look = fields.optional_value("look").and_then(|v| read_look(reader, v)).unwrap_or_default();
    Scene { camera, plane, look }
}

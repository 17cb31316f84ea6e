//! Moves of a camera, as a hand makes them.

use glam::DVec3;
use serde::Deserialize;

use crate::engine::{CameraChange, Error};
use crate::graph::{Camera, Lens};
use crate::shade::CameraFrame;

/// A move of the camera.
#[derive(Clone, Copy, PartialEq, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Movement {
    /// Around the target: to the right and upwards, in radians.
    Orbit([f64; 2]),
    /// Turns where it stands: to the right and up, in radians.
    Turn([f64; 2]),
    /// Turns clockwise about its view direction, in radians.
    Roll(f64),
    /// Moves with its target by shares of the picture's height at the target: to the right and up.
    Pan([f64; 2]),
    /// Multiplies the distance to the target, or the height of an orthographic picture; above 0.
    Dolly(f64),
    /// Flies to the right, up and forward, in distances to the surface.
    Fly([f64; 3]),
}

/// Least distance that a flight goes by, as a share of the distance to the target: near a surface a camera must still move.
const LEAST_FLIGHT: f64 = 1e-4;

impl Movement {
    /// The camera after the move; `distance` is that of the surface, in world units, where it is known.
    ///
    /// Errors: [`Error::Request`] where the camera would have no frame, as of numbers that are not finite.
    pub fn apply(self, camera: Camera, distance: Option<f64>) -> Result<Camera, Error> {
        let none = CameraChange::default();
        match self {
            Movement::Orbit([right, up]) => CameraChange { orbit: Some([right, up]), ..none }.apply(camera),
            Movement::Turn([right, up]) => CameraChange { yaw: Some(right), pitch: Some(up), ..none }.apply(camera),
            Movement::Roll(angle) => CameraChange { roll: Some(angle), ..none }.apply(camera),
            Movement::Dolly(share) => match camera.lens {
                Lens::Orthographic { height } => {
                    CameraChange { lens: Some(Lens::Orthographic { height: height * share }), ..none }.apply(camera)
                }
                _ => CameraChange { dolly: Some(share), ..none }.apply(camera),
            },
            Movement::Pan([right, up]) => {
                let height = camera.height_at_target();
                shifted(camera, [right * height, up * height, 0.0])
            }
            Movement::Fly(by) => {
                let reach = distance.unwrap_or(camera.distance()).max(LEAST_FLIGHT * camera.distance());
                shifted(camera, by.map(|share| share * reach))
            }
        }
    }

    /// Whether the move needs the distance to the surface.
    pub fn goes_by_distance(self) -> bool {
        matches!(self, Movement::Fly(_))
    }
}

/// The camera and its target to the right, up and forward.
fn shifted(camera: Camera, [right, up, forward]: [f64; 3]) -> Result<Camera, Error> {
    let frame = CameraFrame::new(&camera);
    let by = DVec3::from(frame.right) * right + DVec3::from(frame.up) * up + DVec3::from(frame.forward) * forward;
    let moved = |p: [f64; 3]| Some((DVec3::from(p) + by).to_array());
    // A dolly by 1 makes it a move, whose numbers are rounded to what can be written down.
    let change = CameraChange {
        position: moved(camera.position),
        target: moved(camera.target),
        dolly: Some(1.0),
        ..CameraChange::default()
    };
    change.apply(camera)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Camera = Camera::new([0.0, -4.0, 0.0], [0.0; 3], [0.0, 0.0, 1.0], 0.5);

    fn moved(movement: Movement, distance: Option<f64>) -> Camera {
        movement.apply(CAMERA, distance).expect("it moves")
    }

    #[test]
    fn flights_go_by_the_distance_to_the_surface() {
        let near = moved(Movement::Fly([0.0, 0.0, 1.0]), Some(0.01));
        assert!((near.position[1] + 3.99).abs() < 1e-6 && (near.target[1] - 0.01).abs() < 1e-6, "{near:?}");
        let unknown = moved(Movement::Fly([1.0, 0.0, 0.0]), None);
        assert!((unknown.position[0] - 4.0).abs() < 1e-6, "{unknown:?}");
        let touching = moved(Movement::Fly([0.0, 1.0, 0.0]), Some(0.0));
        assert!(touching.position[2] > 0.0, "a camera at the surface can leave it");
    }

    #[test]
    fn a_pan_by_a_picture_moves_what_is_seen_by_its_height() {
        let height = 8.0 * 0.25f64.tan();
        let up = moved(Movement::Pan([0.0, 1.0]), None);
        assert!((up.target[2] - height).abs() < 1e-6 && (up.position[2] - height).abs() < 1e-6, "{up:?}");
    }

    #[test]
    fn broken_numbers_are_refused() {
        assert!(Movement::Orbit([f64::NAN, 0.0]).apply(CAMERA, None).is_err());
        assert!(Movement::Fly([f64::INFINITY, 0.0, 0.0]).apply(CAMERA, None).is_err());
        assert!(Movement::Dolly(0.0).apply(CAMERA, None).is_err());
    }
}

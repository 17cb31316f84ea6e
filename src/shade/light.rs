//! Lights in world axes, and what of their light reaches a point.

use super::CameraFrame;
use crate::expr::{Arena, Expr};
use crate::graph::{Camera, Cone, Light, LightKind, Space};

/// The light in world axes, seen through a camera; `home` is the view that the file itself shows.
pub fn placed(light: &Light, camera: &Camera, home: &Camera) -> Light {
    let frame = |space| match space {
        Space::World => None,
        Space::Camera => Some((camera.position, CameraFrame::new(camera))),
        Space::Home => Some((home.position, CameraFrame::new(home))),
    };
    let kind = match light.kind {
        LightKind::Sun { direction, space, angle } => {
            let direction = frame(space).map_or(direction, |(_, frame)| frame.to_world(direction));
            LightKind::Sun { direction, space: Space::World, angle }
        }
        LightKind::Lamp { at, space, radius, cone } => match frame(space) {
            None => light.kind,
            Some((eye, frame)) => {
                let off = frame.to_world(at);
                let cone = cone.map(|cone| Cone { along: frame.to_world(cone.along), ..cone });
                LightKind::Lamp { at: [0, 1, 2].map(|i| eye[i] + off[i]), space: Space::World, radius, cone }
            }
        },
    };
    Light { kind, ..light.clone() }
}

/// What of a light reaches a point, if nothing stands between them.
pub struct Incoming<'g> {
    /// Unit vector towards the light.
    pub direction: Expr<'g>,
    /// Distance to its surface, in world units; nothing of a sun.
    pub distance: Option<Expr<'g>>,
    /// The radiance of a white matte surface that faces it.
    pub strength: Expr<'g>,
}

impl<'g> Incoming<'g> {
    /// What of a light in world axes reaches a point.
    pub fn new(arena: &'g Arena, light: &Light, point: Expr<'g>) -> Incoming<'g> {
        let colour = arena.v3(light.colour);
        match light.kind {
            LightKind::Sun { direction, .. } => {
                Incoming { direction: arena.v3(direction), distance: None, strength: colour }
            }
            LightKind::Lamp { at, radius, cone, .. } => {
                let off = arena.v3(at) - point;
                // A point in the middle of a lamp is as far from it as one on its surface.
                let least = arena.f((radius * radius).max(LEAST_SQUARE));
                let square = off.dot(off).max(least);
                let distance = square.sqrt();
                let direction = off / distance;
                let mut strength = colour / square;
                if let Some(cone) = cone {
                    strength = strength * within(arena, &cone, direction);
                }
                Incoming { direction, distance: Some((distance - radius).max(arena.f(0.0))), strength }
            }
        }
    }
}

/// Least square of a distance from a lamp.
const LEAST_SQUARE: f64 = 1e-12;

/// How much of a spot's light goes against `towards`, the unit vector towards it: smooth from the edge of its cone inwards.
fn within<'g>(arena: &'g Arena, cone: &Cone, towards: Expr<'g>) -> Expr<'g> {
    let cosine = -towards.dot(arena.v3(cone.along));
    let edge = cone.angle.cos();
    let full = (cone.angle * (1.0 - cone.soft)).cos().max(edge + 1e-6);
    cosine.smoothstep(arena.f(edge), arena.f(full))
}

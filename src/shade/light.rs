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

/// A light with soft edges as `count` lights without, spread evenly over its disc (a sun) or through its ball (a lamp), which share its
/// strength: for marches that tell no more than hit or miss.
pub fn in_points(light: &Light, count: usize) -> Vec<Light> {
    let share = 1.0 / count as f64;
    let point = |k: usize| {
        let (rank, turn) = ((k as f64 + 0.5) * share, k as f64 * GOLDEN_ANGLE);
        let kind = match light.kind {
            LightKind::Sun { direction, space, angle } => {
                let (right, up) = across(direction);
                let (sin, cos) = turn.sin_cos();
                let off = (angle / 2.0).tan() * rank.sqrt();
                let moved = [0, 1, 2].map(|i| direction[i] + (right[i] * cos + up[i] * sin) * off);
                let size = moved.iter().map(|x| x * x).sum::<f64>().sqrt();
                LightKind::Sun { direction: moved.map(|x| x / size), space, angle: 0.0 }
            }
            LightKind::Lamp { at, space, radius, cone } => {
                // Shells are as full as they are large, and heights as even as on a ball.
                let shell = radius * ((k * SHELLS % count) as f64 * share + 0.5 * share).cbrt();
                let height = 2.0 * rank - 1.0;
                let (sin, cos) = turn.sin_cos();
                let flat = (1.0 - height * height).sqrt();
                let off = [flat * cos, flat * sin, height].map(|x| x * shell);
                LightKind::Lamp { at: [0, 1, 2].map(|i| at[i] + off[i]), space, radius: 0.0, cone }
            }
        };
        Light { kind, colour: light.colour.map(|part| part * share), ..light.clone() }
    };
    (0..count).map(point).collect()
}

/// The turn by which points of a spiral fill a disc evenly, in radians.
const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;
/// Steps between the shells of neighbours in height: no divisor of the usual counts.
const SHELLS: usize = 5;

/// Two unit vectors across a third and each other (Duff et al., 2017).
fn across([x, y, z]: [f64; 3]) -> ([f64; 3], [f64; 3]) {
    let sign = 1f64.copysign(z);
    let (a, b) = (-1.0 / (sign + z), -x * y / (sign + z));
    ([1.0 + sign * x * x * a, sign * b, -sign * x], [b, sign + y * y * a, -y])
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

#[cfg(test)]
mod tests {
    use super::in_points;
    use crate::graph::{Light, LightKind, Space};

    #[test]
    fn points_of_a_light_lie_in_it_and_share_its_strength() {
        let light = |kind| Light { name: "a".into(), kind, colour: [2.0, 1.0, 0.5], shadows: true };
        let (direction, angle) = ([0.6, -0.48, 0.64], 0.2);
        let suns = in_points(&light(LightKind::Sun { direction, space: Space::World, angle }), 8);
        let lamp = LightKind::Lamp { at: [1.0, 2.0, 3.0], space: Space::World, radius: 0.5, cone: None };
        let lamps = in_points(&light(lamp), 8);
        let strength: f64 = suns.iter().chain(&lamps).map(|light| light.colour[0]).sum();
        assert!((strength - 4.0).abs() < 1e-12);
        let mut mean = [0.0; 3];
        for sun in &suns {
            let LightKind::Sun { direction: towards, angle: 0.0, .. } = sun.kind else { panic!("{sun:?}") };
            let cosine: f64 = (0..3).map(|i| towards[i] * direction[i]).sum();
            assert!((0.0..0.1).contains(&cosine.min(1.0).acos()));
            (0..3).for_each(|i| mean[i] += towards[i] / 8.0);
        }
        assert!((0..3).all(|i| (mean[i] - direction[i]).abs() < 0.02), "{mean:?}");
        for lamp in &lamps {
            let LightKind::Lamp { at, radius: 0.0, .. } = lamp.kind else { panic!("{lamp:?}") };
            assert!([1.0, 2.0, 3.0].iter().zip(at).map(|(a, b)| (a - b) * (a - b)).sum::<f64>() < 0.25);
        }
    }
}

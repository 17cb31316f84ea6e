//! Depth of field: rays through the opening of a lens instead of its middle.

use std::f64::consts::TAU;

use super::path::frame_of;
use super::{CameraFrame, range_within};
use crate::compose::Bounds;
use crate::expr::{Arena, Expr, Function, Inputs};
use crate::graph::{Aperture, Camera, Lens};
use crate::kernel::records::{LensPoint, Ray};

/// Rays through the middle of a lens to rays through a point of its opening that meet them in the focus.
pub fn compose_blur(arena: &Arena, camera: &Camera, aperture: &Aperture, bounds: &Bounds) -> Function {
    let mut inputs = Inputs::new(arena);
    let (ray, point) = (Ray::read(&mut inputs), LensPoint::read(&mut inputs));
    let mut function = inputs.function("blur");
    let frame = CameraFrame::new(camera);
    let off = [0, 1, 2].map(|i| camera.target[i] - camera.position[i]);
    let to_target = off.iter().map(|x| x * x).sum::<f64>().sqrt();
    let focus = arena.f(aperture.focus.unwrap_or(to_target));
    let (right, up, depth) = match camera.lens {
        // The focus is a plane.
        Lens::Perspective { .. } | Lens::Orthographic { .. } => {
            let cosine = ray.direction.dot(arena.v3(frame.forward)).max(arena.f(1e-3));
            (arena.v3(frame.right), arena.v3(frame.up), focus / cosine)
        }
        // It is a sphere, and the lens faces each ray.
        Lens::Fisheye | Lens::Equirectangular { .. } | Lens::CubeMap(_) => {
            let (right, up) = frame_of(ray.direction);
            (right, up, focus)
        }
    };
    let [x, y] = within(&point, aperture);
    let sharp = ray.origin + ray.direction * depth;
    let origin = ray.origin + right * x + up * y;
    let direction = (sharp - origin).normalize();
    let (near, far) = range_within(bounds, origin, direction, arena.f(0.0));
    Ray { origin, direction, t_near: near.max(arena.f(camera.near)), t_far: far }.write(&mut function);
    function
}

/// A point of the opening, evenly spread: of a disc, or of a polygon's triangles around the middle.
fn within<'g>(point: &LensPoint<Expr<'g>>, aperture: &Aperture) -> [Expr<'g>; 2] {
    let radius = point.u.sqrt() * aperture.radius;
    if aperture.blades == 0 {
        let angle = point.v * TAU;
        return [radius * angle.cos(), radius * angle.sin()];
    }
    let blades = f64::from(aperture.blades);
    let place = point.v * blades;
    let (blade, share) = (place.floor(), place - place.floor());
    let (first, second) = (blade * (TAU / blades), (blade + 1.0) * (TAU / blades));
    [first.cos().mix(second.cos(), share) * radius, first.sin().mix(second.sin(), share) * radius]
}

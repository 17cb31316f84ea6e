//! Pictures of a plane through space: each pixel is a point, coloured by the estimate of its distance from the set.

use super::{HitInputs, Size, output_ray, surface_ports};
use crate::compose::paint::{paint, usable_trap};
use crate::expr::{Arena, Function, Port, Type};
use crate::graph::{Camera, Look, Plane};
use crate::kernel::{march_output_ports, ray_ports};
use crate::math::Precision;

/// Share of the picture's height at which the colour outside is halfway from the palette's to the background's.
const HALFWAY: f64 = 0.03;
/// Field of view of a camera that faces a plane, in radians.
const FOV: f64 = 0.7;

/// Edge of a pixel in world units.
pub fn pixel_size(plane: &Plane, size: Size) -> f64 {
    plane.height / f64::from(size.height)
}

/// A camera that looks straight at a plane and sees the same rectangle of it.
pub fn facing(plane: &Plane) -> Camera {
    let away = plane.height / 2.0 / (FOV / 2.0).tan();
    let back = normal(plane);
    let position = [0, 1, 2].map(|i| plane.center[i] + back[i] * away);
    Camera { position, target: plane.center, up: plane.up, fov: FOV }
}

/// The direction out of the picture.
fn normal(plane: &Plane) -> [f64; 3] {
    glam::DVec3::from(plane.right).cross(glam::DVec3::from(plane.up)).into()
}

/// Pixel coordinates (`x` to the right, `y` down, centres at halves) to rays that start at points of the plane.
pub fn compose_plane_camera(arena: &Arena, plane: &Plane, size: Size) -> Function {
    let mut function = Function::new("plane", vec![Port::new("x", Type::F), Port::new("y", Type::F)]);
    let pixel = pixel_size(plane, size);
    let right = (arena.input(0, Type::F) - f64::from(size.width) / 2.0) * pixel;
    let up = (arena.input(1, Type::F) - f64::from(size.height) / 2.0) * -pixel;
    let point = arena.v3(plane.center) + (arena.v3(plane.right) * right + arena.v3(plane.up) * up);
    output_ray(&mut function, point, arena.v3(normal(plane).map(|x| -x)), arena.f(0.0), arena.f(1.0));
    function
}

/// Rays of [`compose_plane_camera`] and their ends to the points whose traps are looked at: those outside. Other pixels
/// get a negative `hit_eps`.
pub fn compose_plane_point(arena: &Arena, hit_eps: f64, precision: Precision) -> Function {
    let mut ports = ray_ports();
    ports.extend(march_output_ports());
    let mut function = Function::new("plane_point", ports);
    let ray = HitInputs::new(arena, 0);
    let size = ray.origin.length();
    function.output("p", ray.origin);
    function.output("d", ray.direction);
    function.output("h", size.max(arena.f(1.0)) * precision.min_difference());
    function.output("hit_eps", ray.is_hit.select(arena.f(-1.0), arena.f(hit_eps)));
    function
}

/// Point, estimate and surface to a linear colour between 0 and 1: the lower background colour in the set and on lines
/// about a pixel wide around what is thinner; outside the palette's colours, fading to the upper background colour.
pub fn compose_plane_colour(arena: &Arena, look: &Look, plane: &Plane, size: Size) -> Function {
    let mut ports = ray_ports();
    ports.extend(march_output_ports());
    let surface_at = ports.len() as u16;
    ports.extend(surface_ports(look));
    let mut function = Function::new("colour", ports);
    let ray = HitInputs::new(arena, 0);
    let (zero, one) = (arena.f(0.0), arena.f(1.0));
    // An estimate that is not a number is that of a point so near that derivatives overflow.
    let de = zero.le(ray.last_de).select(ray.last_de, zero);
    let fading = (de * (1.0 / (HALFWAY * plane.height))).min(arena.f(1e6)).sqrt();
    // An orbit that starts in a plane has come as near as can be to it, which tells nothing.
    let trap = || usable_trap(arena.input(surface_at + 1, Type::V4));
    let colours = match look.parts.is_empty() {
        true => paint(look, &look.palette, trap(), Some(normal(plane))),
        false => arena.input(surface_at + 2, Type::V3),
    };
    let outside = arena.v3(look.background[1]).mix(colours, one / (fading + 1.0));
    let apart = (de * (1.0 / pixel_size(plane, size))).min(one);
    let shown = ray.is_hit.select(zero, apart);
    let colour = arena.v3(look.background[0]).mix(outside, shown);
    function.output("colour", colour.clamp(zero, one));
    function
}

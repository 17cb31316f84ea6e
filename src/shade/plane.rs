//! Pictures of a plane through space: each pixel is a point, coloured by the estimate of its distance from the set.

use super::{Seen, Size, read_surface};
use crate::compose::paint::{paint, usable_trap};
use crate::expr::{Arena, Function, Inputs};
use crate::graph::{Camera, Plane, Scene};
use crate::kernel::records::{Colour, Pixel, Query, Ray};
use crate::math::Precision;

/// Share of the picture's height at which the colour outside is halfway from the palette's to the background's.
const HALFWAY: f64 = 0.03;
/// Colours of lines and of what is far from them, where a scene has no background: black on white.
const LINES: [[f64; 3]; 2] = [[0.0; 3], [1.0; 3]];
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
    Camera::new(position, plane.center, plane.up, FOV)
}

/// The direction out of the picture.
fn normal(plane: &Plane) -> [f64; 3] {
    glam::DVec3::from(plane.right).cross(glam::DVec3::from(plane.up)).into()
}

/// Pixel coordinates (`x` to the right, `y` down, centres at halves) to rays that start at points of the plane.
pub fn compose_plane_camera(arena: &Arena, plane: &Plane, size: Size) -> Function {
    let mut inputs = Inputs::new(arena);
    let Pixel { x, y } = Pixel::read(&mut inputs);
    let mut function = inputs.function("plane");
    let pixel = pixel_size(plane, size);
    let right = (x - f64::from(size.width) / 2.0) * pixel;
    let up = (y - f64::from(size.height) / 2.0) * -pixel;
    let point = arena.v3(plane.center) + (arena.v3(plane.right) * right + arena.v3(plane.up) * up);
    let direction = arena.v3(normal(plane).map(|x| -x));
    Ray { origin: point, direction, t_near: arena.f(0.0), t_far: arena.f(1.0) }.write(&mut function);
    function
}

/// Rays of [`compose_plane_camera`] and their ends to the points whose traps are looked at: those outside. Of other
/// pixels nothing is wanted.
pub fn compose_plane_point(arena: &Arena, hit_eps: f64, precision: Precision) -> Function {
    let mut inputs = Inputs::new(arena);
    let seen = Seen::read(&mut inputs);
    let mut function = inputs.function("plane_point");
    let Ray { origin: p, direction: d, .. } = seen.ray;
    let query = Query {
        p,
        d,
        h: p.length().max(arena.f(1.0)) * precision.min_difference(),
        hit_eps: seen.is_hit().select(arena.f(Query::NOT_WANTED), arena.f(hit_eps)),
    };
    query.write(&mut function);
    function
}

/// Point, estimate and surface to a linear colour between 0 and 1: the lower background colour in the set and on lines
/// about a pixel wide around what is thinner; outside the palette's colours, fading to the upper background colour.
pub fn compose_plane_colour(arena: &Arena, scene: &Scene, plane: &Plane, size: Size) -> Function {
    let (look, background) = (&scene.look, scene.backdrop.unwrap_or(LINES));
    let mut inputs = Inputs::new(arena);
    let seen = Seen::read(&mut inputs);
    let (surface, painted) = read_surface(&mut inputs, look);
    let mut function = inputs.function("colour");
    let (zero, one) = (arena.f(0.0), arena.f(1.0));
    // An estimate that is not a number is that of a point so near that derivatives overflow.
    let last = seen.march.last_de;
    let de = zero.le(last).select(last, zero);
    let fading = (de * (1.0 / (HALFWAY * plane.height))).min(arena.f(1e6)).sqrt();
    // An orbit that starts in a plane has come as near as can be to it, which tells nothing.
    let colours = match painted {
        None => paint(look, &look.paint.palette, usable_trap(surface.trap), Some(normal(plane))),
        Some(matter) => matter.base,
    };
    let outside = arena.v3(background[1]).mix(colours, one / (fading + 1.0));
    let apart = (de * (1.0 / pixel_size(plane, size))).min(one);
    let shown = seen.is_hit().select(zero, apart);
    let colour = arena.v3(background[0]).mix(outside, shown);
    Colour { colour: colour.clamp(zero, one) }.write(&mut function);
    function
}

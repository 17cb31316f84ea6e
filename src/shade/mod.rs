//! Shading: camera rays, surface points, shadow rays, light and colour, all as expressions.
//!
//! Nothing here loops or branches: each function is straight-line, specialised to the scene, and reaches every back end
//! the way formula steps do. Colours are radiance: linear, and developed by [`film`](crate::film).

mod air;
mod blur;
mod camera;
mod colour;
mod finish;
mod light;
mod lighting;
mod mirror;
mod panorama;
mod path;
mod plane;
mod secondary;
mod sky;

use air::Air;
pub use blur::compose_blur;
pub use camera::{
    CameraFrame, beam_radius, compose_background, compose_beam, compose_begin, compose_camera, frame_automatically,
    rays, threshold, turned,
};
pub use colour::compose_colour;
pub(crate) use colour::facing_normal;
pub use light::{Incoming, placed};
pub use lighting::Lighting;
pub use mirror::Mirrors;
pub use path::{Paths, compose_inner_ray, compose_join_ends, first_path};
pub use plane::{compose_plane_camera, compose_plane_colour, compose_plane_point, facing, pixel_size};
pub use secondary::{compose_corner_ray, compose_shadow_ray};
pub use sky::Irradiance;

use serde::{Deserialize, Serialize};

use crate::compose::matter::read_matter;
use crate::compose::paint::{paint, usable_trap};
use crate::compose::{Bounds, Sides};
use crate::expr::{Arena, Expr, Function, Inputs};
use crate::graph::Look;
use crate::kernel::Status;
use crate::kernel::records::{Colour, Marched, Matter, Query, Ray, Surface};
use crate::march::Threshold;
use crate::math::Precision;

/// Picture geometry.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Size {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// Where a ray is inside bounds that are larger by `wider`; an empty range where it misses them.
fn range_within<'g>(bounds: &Bounds, origin: Expr<'g>, direction: Expr<'g>, wider: Expr<'g>) -> (Expr<'g>, Expr<'g>) {
    let (near, far) = sphere_range(origin, direction, wider + bounds.radius);
    match &bounds.sides {
        Some(sides) => box_range(sides, origin, direction, wider, (near, far)),
        None => (near, far),
    }
}

/// The part of a range that lies inside a box that is larger by `wider`: between the later of each pair of planes that the ray
/// enters by and the earlier of each that it leaves by.
fn box_range<'g>(
    sides: &Sides,
    origin: Expr<'g>,
    direction: Expr<'g>,
    wider: Expr<'g>,
    (near, far): (Expr<'g>, Expr<'g>),
) -> (Expr<'g>, Expr<'g>) {
    let along = origin.components().into_iter().zip(direction.components());
    along.enumerate().fold((near, far), |(near, far), (axis, (from, step))| {
        // A ray along the planes meets them far away, on either side.
        let step = step.abs().lt(step.lift(PARALLEL)).select(step.lift(PARALLEL), step);
        let [low, high] = [-wider + sides.low[axis], wider + sides.high[axis]].map(|plane| (plane - from) / step);
        (near.max(low.min(high)), far.min(low.max(high)))
    })
}

/// Least component of a direction that planes across it are asked for.
const PARALLEL: f64 = 1e-15;

/// Where a ray is inside a ball around the origin; an empty range where it misses it.
fn sphere_range<'g>(origin: Expr<'g>, direction: Expr<'g>, radius: Expr<'g>) -> (Expr<'g>, Expr<'g>) {
    let arena = origin.arena;
    let zero = arena.f(0.0);
    let middle = -origin.dot(direction);
    // The closest point to the centre: exact where origin and radius are both large.
    let closest = origin + direction * middle;
    let half_sq = radius * radius - closest.dot(closest);
    let half = half_sq.max(zero).sqrt();
    let near = (middle - half).max(zero);
    let far = half_sq.lt(zero).select(arena.f(Ray::NOWHERE), middle + half);
    (near, far)
}

/// Rays and march results to the points where surfaces are looked at: a hit threshold in front of the hit, so that
/// normals are those of features about as large as a pixel. Of other pixels nothing is wanted.
///
/// `precision` decides the least step of finite differences, as it does in marches.
pub fn compose_surface_point(arena: &Arena, threshold: Threshold, precision: Precision) -> Function {
    let mut inputs = Inputs::new(arena);
    let seen = Seen::read(&mut inputs);
    let mut function = inputs.function("surface_point");
    let (ray, t, hit_eps) = (seen.ray, seen.march.t, threshold.at(seen.march.t));
    let query = Query {
        p: ray.origin + ray.direction * seen.front(hit_eps),
        d: ray.direction,
        h: (hit_eps * 0.1).max((t * 0.1 + 1.0) * precision.min_difference()),
        hit_eps: seen.is_hit().select(hit_eps, arena.f(Query::NOT_WANTED)),
    };
    query.write(&mut function);
    function
}

/// What is known of surfaces, as further inputs: the outputs of a [`crate::compose::Purpose::Surface`]; and what they are made of, where
/// the look is painted.
pub(crate) fn read_surface<'g>(inputs: &mut Inputs<'g>, look: &Look) -> (Surface<Expr<'g>>, Option<Matter<Expr<'g>>>) {
    let surface = Surface::read(inputs);
    (surface, read_matter(look, surface.gradient.arena, inputs))
}

/// What is known of surfaces to their albedo: what of white light they scatter or mirror, linear.
pub fn compose_albedo(arena: &Arena, look: &Look) -> Function {
    let mut inputs = Inputs::new(arena);
    let (surface, painted) = read_surface(&mut inputs, look);
    let mut function = inputs.function("albedo");
    Colour { colour: albedo(look, &surface, painted) }.write(&mut function);
    function
}

/// The albedo of a surface.
pub(crate) fn albedo<'g>(look: &Look, surface: &Surface<Expr<'g>>, painted: Option<Matter<Expr<'g>>>) -> Expr<'g> {
    match painted {
        None => paint(look, &look.paint.palette, usable_trap(surface.trap), None),
        Some(Matter { base, .. }) => base,
    }
}

/// A ray and what its march gave, as inputs of a function.
pub(crate) struct Seen<'g> {
    /// The ray.
    pub ray: Ray<Expr<'g>>,
    /// What its march gave.
    pub march: Marched<Expr<'g>>,
}

impl<'g> Seen<'g> {
    /// Takes both as the next inputs of a function.
    pub fn read(inputs: &mut Inputs<'g>) -> Seen<'g> {
        Seen { ray: Ray::read(inputs), march: Marched::read(inputs) }
    }

    /// Whether the ray hit.
    pub fn is_hit(&self) -> Expr<'g> {
        is_hit(self.march)
    }

    /// Where the surface is looked at: in front of the hit, where the estimate fell below the threshold, so that normals
    /// are those of features about as large as a pixel.
    fn front(&self, hit_eps: Expr<'g>) -> Expr<'g> {
        let Marched { t, t_front, .. } = self.march;
        t_front.max(t - hit_eps * 4.0).min(t - hit_eps)
    }
}

/// Whether a march hit.
fn is_hit(march: Marched<Expr<'_>>) -> Expr<'_> {
    march.status.equals(march.status.lift(Status::Hit.code()))
}

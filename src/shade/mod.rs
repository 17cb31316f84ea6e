//! Shading: camera rays, surface points, shadow rays, light and colour, all as expressions.
//!
//! Nothing here loops or branches: each function is straight-line, specialised to the scene, and reaches every back end
//! the way formula steps do. Colours are radiance: linear, and developed by [`film`](crate::film).

mod air;
mod colour;
mod finish;
mod light;
mod lighting;
mod path;
mod plane;
mod secondary;
mod sky;

use air::Air;
pub use colour::compose_colour;
pub use light::{Incoming, placed};
pub use lighting::Lighting;
pub use path::{Paths, first_path};
pub use plane::{compose_plane_camera, compose_plane_colour, compose_plane_point, facing, pixel_size};
pub use secondary::{compose_corner_ray, compose_shadow_ray};
pub use sky::Irradiance;

use serde::{Deserialize, Serialize};

use crate::compose::matter::read_matter;
use crate::compose::{Bounds, Sides};
use crate::expr::{Arena, Expr, Function, Inputs};
use crate::graph::{Camera, Look};
use crate::kernel::Status;
use crate::kernel::records::{Beam, Begin, Colour, Marched, Matter, Pixel, Query, Ray, Surface};
use crate::math::Precision;

/// Picture geometry.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct Size {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

/// A hit threshold.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Threshold {
    /// What it grows by with the distance.
    pub pixel_radius: f64,
    /// What does not grow, in world units.
    pub fixed: f64,
}

impl Threshold {
    fn at<'g>(self, t: Expr<'g>) -> Expr<'g> {
        if self.fixed > 0.0 { t * self.pixel_radius + self.fixed } else { t * self.pixel_radius }
    }
}

/// The camera's frame: unit vectors to the right, up and forward, in world coordinates.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct CameraFrame {
    /// To the right of the picture.
    pub right: [f64; 3],
    /// To its top.
    pub up: [f64; 3],
    /// Into it.
    pub forward: [f64; 3],
}

impl CameraFrame {
    /// The frame of a camera whose position, target and up direction do not lie on one line.
    pub fn new(camera: &Camera) -> CameraFrame {
        use glam::DVec3;
        let forward = (DVec3::from(camera.target) - DVec3::from(camera.position)).normalize();
        let right = forward.cross(DVec3::from(camera.up)).normalize();
        CameraFrame { right: right.into(), up: right.cross(forward).into(), forward: forward.into() }
    }

    /// A direction given as right, up and back, in world coordinates and of length 1; (0, 0, 0) stays.
    pub fn to_world(&self, [right, up, back]: [f64; 3]) -> [f64; 3] {
        let v = [0, 1, 2].map(|i| self.right[i] * right + self.up[i] * up - self.forward[i] * back);
        let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
        if length > 0.0 { v.map(|x| x / length) } else { v }
    }
}

/// The camera for a field that nobody framed: from the front right and above, so that the bounding sphere fills the
/// picture.
pub fn frame_automatically(bounding_radius: f64) -> Camera {
    let fov = 35f64.to_radians();
    // Fractals rarely fill their bounding sphere: frame nine tenths of it.
    let distance = 0.9 * bounding_radius / (fov / 2.0).sin();
    let direction = glam::DVec3::new(0.42, -0.80, 0.43).normalize();
    Camera { position: (direction * distance).into(), target: [0.0; 3], up: [0.0, 0.0, 1.0], fov }
}

/// The camera turned around its target about its up direction, by an angle in radians (counter-clockwise seen from there).
pub fn turned(camera: &Camera, angle: f64) -> Camera {
    use glam::{DQuat, DVec3};
    let (target, axis) = (DVec3::from(camera.target), DVec3::from(camera.up).normalize());
    let arm = DQuat::from_axis_angle(axis, angle) * (DVec3::from(camera.position) - target);
    Camera { position: (target + arm).into(), ..*camera }
}

/// Radius of a pixel at distance 1.
pub fn pixel_radius(camera: &Camera, size: Size) -> f64 {
    (camera.fov / 2.0).tan() / f64::from(size.height)
}

/// Pixel coordinates (`x` to the right, `y` down, centres at halves) to rays through the bounds.
pub fn compose_camera(arena: &Arena, camera: &Camera, size: Size, bounds: &Bounds) -> Function {
    let mut inputs = Inputs::new(arena);
    let Pixel { x, y } = Pixel::read(&mut inputs);
    let mut function = inputs.function("camera");
    ray_through(arena, camera, size, bounds, [x, y]).write(&mut function);
    function
}

/// Tiles to beams: a cone around the ray through `x, y` (as [`compose_camera`] takes them) that holds all rays whose unit
/// directions differ from its own by at most `spread`. It begins at distance `start`. What comes out is a ray whose
/// parameter is the beam's radius (see [`crate::march::compose_beam_march`]): t times `spread`.
pub fn compose_beam(arena: &Arena, camera: &Camera, size: Size, bounds: &Bounds) -> Function {
    let mut inputs = Inputs::new(arena);
    let Beam { x, y, spread, start } = Beam::read(&mut inputs);
    let mut function = inputs.function("beam");
    let direction = direction_of(arena, camera, size, x, y);
    // The farthest point of the bounds is this far away, so this far beside them may be the centre of a beam that touches
    // them.
    let farthest = glam::DVec3::from(camera.position).length() + bounds.radius;
    let (near, far) = range_within(bounds, arena.v3(camera.position), direction, spread * farthest);
    let (origin, direction) = (arena.v3(camera.position), direction * (1.0 / spread));
    Ray { origin, direction, t_near: near.max(start) * spread, t_far: far * spread }.write(&mut function);
    function
}

/// The rays of [`compose_camera`], beginning no nearer than at `start`; a ray that ends before has an empty range.
pub fn compose_begin(arena: &Arena, camera: &Camera, size: Size, bounds: &Bounds) -> Function {
    let mut inputs = Inputs::new(arena);
    let Begin { x, y, start } = Begin::read(&mut inputs);
    let mut function = inputs.function("begin");
    let ray = ray_through(arena, camera, size, bounds, [x, y]);
    let is_over = ray.t_far.le(start);
    let t_near = is_over.select(ray.t_near, ray.t_near.max(start));
    let t_far = is_over.select(arena.f(Ray::NOWHERE), ray.t_far);
    Ray { t_near, t_far, ..ray }.write(&mut function);
    function
}

/// The ray through a place of the picture, where it is inside the bounds.
fn ray_through<'g>(
    arena: &'g Arena,
    camera: &Camera,
    size: Size,
    bounds: &Bounds,
    [x, y]: [Expr<'g>; 2],
) -> Ray<Expr<'g>> {
    let direction = direction_of(arena, camera, size, x, y);
    let origin = arena.v3(camera.position);
    let (t_near, t_far) = range_within(bounds, origin, direction, arena.f(0.0));
    Ray { origin, direction, t_near, t_far }
}

/// The unit direction through a place of the picture.
fn direction_of<'g>(arena: &'g Arena, camera: &Camera, size: Size, x: Expr<'g>, y: Expr<'g>) -> Expr<'g> {
    let frame = CameraFrame::new(camera);
    let pixel = 2.0 * pixel_radius(camera, size);
    let right = (x - f64::from(size.width) / 2.0) * pixel;
    let up = (y - f64::from(size.height) / 2.0) * -pixel;
    (arena.v3(frame.right) * right + arena.v3(frame.up) * up + arena.v3(frame.forward)).normalize()
}

/// Pixel coordinates, as [`compose_camera`] takes them, to the radiance that a ray without a hit has.
pub fn compose_background(arena: &Arena, lighting: &Lighting, camera: &Camera, size: Size) -> Function {
    let mut inputs = Inputs::new(arena);
    let Pixel { x, y } = Pixel::read(&mut inputs);
    let mut function = inputs.function("background");
    let direction = direction_of(arena, camera, size, x, y);
    Colour { colour: lighting.background(arena, direction) }.write(&mut function);
    function
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
fn read_surface<'g>(inputs: &mut Inputs<'g>, look: &Look) -> (Surface<Expr<'g>>, Option<Matter<Expr<'g>>>) {
    let surface = Surface::read(inputs);
    (surface, read_matter(look, surface.gradient.arena, inputs))
}

/// A ray and what its march gave, as inputs of a function.
struct Seen<'g> {
    ray: Ray<Expr<'g>>,
    march: Marched<Expr<'g>>,
}

impl<'g> Seen<'g> {
    fn read(inputs: &mut Inputs<'g>) -> Seen<'g> {
        Seen { ray: Ray::read(inputs), march: Marched::read(inputs) }
    }

    /// Whether the ray hit.
    fn is_hit(&self) -> Expr<'g> {
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

//! Camera rays: places of the picture to rays, beams and backgrounds, for every lens.
//!
//! A lens is a few expressions: from a place of one eye's picture to where its ray starts and where it goes. Ordinary perspective
//! cameras have none of the others' operations. Frame of a picture: `x` to the right and `y` down, in pixels; frame of the camera:
//! right, up, forward.

use std::f64::consts::PI;

use super::{Lighting, Size, range_within};
use crate::compose::Bounds;
use crate::expr::{Arena, Expr, Function, Inputs};
use crate::graph::{Camera, CubeLayout, Lens, StereoLayout};
use crate::kernel::cpu::Cpu;
use crate::kernel::records::{Beam, Begin, Colour, Pixel, Ray};
use crate::kernel::{Backend, Kernel};
use crate::march::Threshold;
use crate::math::Precision;

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
    Camera::new((direction * distance).into(), [0.0; 3], [0.0, 0.0, 1.0], fov)
}

/// The camera turned around its target about its up direction, by an angle in radians (counter-clockwise seen from there).
pub fn turned(camera: &Camera, angle: f64) -> Camera {
    use glam::{DQuat, DVec3};
    let (target, axis) = (DVec3::from(camera.target), DVec3::from(camera.up).normalize());
    let arm = DQuat::from_axis_angle(axis, angle) * (DVec3::from(camera.position) - target);
    Camera { position: (target + arm).into(), ..*camera }
}

/// Half a pixel's edge: at distance 1 where rays diverge, else the same everywhere. Of lenses that squeeze pixels it is that of the
/// largest ones: at the equator, and in the middle of a cube's faces.
pub fn threshold(camera: &Camera, size: Size) -> Threshold {
    let [_, height] = eye_size(camera, size);
    let pixel_radius = match camera.lens {
        Lens::Perspective { .. } => (camera.fov / 2.0).tan() / height,
        Lens::Orthographic { height: of_world } => {
            return Threshold { pixel_radius: 0.0, fixed: of_world / 2.0 / height };
        }
        Lens::Fisheye | Lens::Equirectangular { .. } => camera.fov / 2.0 / height,
        Lens::CubeMap(layout) => 1.0 / (height / cells(layout)[1]),
    };
    Threshold { pixel_radius, fixed: 0.0 }
}

/// What directions of neighbouring rays differ by at most, in length and per half a pixel; `None` where rays do not start in one point
/// or neighbours may point anywhere, so that no cone holds them.
pub fn beam_radius(camera: &Camera, size: Size) -> Option<f64> {
    let [width, _] = eye_size(camera, size);
    let is_one_eye = camera.stereo.is_none_or(|s| matches!(s.layout, StereoLayout::Left | StereoLayout::Right));
    let radius = threshold(camera, size).pixel_radius;
    match camera.lens {
        Lens::Perspective { .. } | Lens::Fisheye if is_one_eye => Some(radius),
        Lens::Equirectangular { width: longitudes } if camera.stereo.is_none() => {
            Some(radius.max(longitudes / 2.0 / width))
        }
        _ => None,
    }
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
    let Sight { origin, direction, .. } = Sight::through(arena, camera, size, [x, y]);
    // The farthest point of the bounds is this far away, so this far beside them may be the centre of a beam that touches
    // them.
    let eye = camera.stereo.map_or(0.0, |stereo| stereo.eyes / 2.0);
    let farthest = glam::DVec3::from(camera.position).length() + bounds.radius + eye;
    let (near, far) = range_within(bounds, origin, direction, spread * farthest);
    let direction = direction * (1.0 / spread);
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

/// Pixel coordinates, as [`compose_camera`] takes them, to the radiance that a ray without a hit has.
pub fn compose_background(arena: &Arena, lighting: &Lighting, camera: &Camera, size: Size) -> Function {
    let mut inputs = Inputs::new(arena);
    let Pixel { x, y } = Pixel::read(&mut inputs);
    let mut function = inputs.function("background");
    let Sight { direction, .. } = Sight::through(arena, camera, size, [x, y]);
    Colour { colour: lighting.background(arena, direction) }.write(&mut function);
    function
}

/// Origins and unit directions of the rays through places of the picture, as [`compose_camera`] takes them; computed in f64.
pub fn rays(camera: &Camera, size: Size, places: &[[f64; 2]]) -> Vec<([f64; 3], [f64; 3])> {
    let arena = Arena::default();
    let function = compose_camera(&arena, camera, size, &Bounds::ball(1.0));
    // The same machine code everywhere.
    let cpu = Cpu::new(Precision::F64).narrow();
    let columns = [0, 1].map(|i| places.iter().map(|place| place[i]).collect::<Vec<f64>>());
    let run = || {
        let kernel = cpu.prepare(&arena, &Kernel::Map(function))?;
        cpu.download(&cpu.run(&kernel, &[&cpu.upload(&columns)?])?)
    };
    let columns = run().expect("the CPU runs every kernel");
    let vector = |first: usize, i: usize| [0, 1, 2].map(|k| columns[first + k][i]);
    (0..places.len()).map(|i| (vector(Ray::COLUMNS.origin, i), vector(Ray::COLUMNS.direction, i))).collect()
}

/// The ray through a place of the picture, where it is inside the bounds.
fn ray_through<'g>(
    arena: &'g Arena,
    camera: &Camera,
    size: Size,
    bounds: &Bounds,
    place: [Expr<'g>; 2],
) -> Ray<Expr<'g>> {
    let Sight { origin, direction, is_blank } = Sight::through(arena, camera, size, place);
    let (t_near, t_far) = range_within(bounds, origin, direction, arena.f(0.0));
    let t_far = not_beyond(camera, direction, t_far);
    let t_far = is_blank.map_or(t_far, |is_blank| is_blank.select(arena.f(Ray::NOWHERE), t_far));
    Ray { origin, direction, t_near, t_far }
}

/// The end of a ray's range that is not too far for the camera.
fn not_beyond<'g>(camera: &Camera, direction: Expr<'g>, far: Expr<'g>) -> Expr<'g> {
    let Some(most) = camera.far else { return far };
    match camera.lens {
        Lens::Perspective { .. } | Lens::Orthographic { .. } => {
            let along = direction.dot(direction.arena.v3(CameraFrame::new(camera).forward));
            far.min(most / along)
        }
        _ => far.min(far.lift(most)),
    }
}

/// Columns and rows of one eye's picture.
fn eye_size(camera: &Camera, size: Size) -> [f64; 2] {
    let [width, height] = [size.width, size.height].map(f64::from);
    match camera.stereo.map(|stereo| stereo.layout) {
        Some(StereoLayout::SideBySide) => [width / 2.0, height],
        Some(StereoLayout::OverUnder) => [width, height / 2.0],
        _ => [width, height],
    }
}

/// Columns and rows of faces in a cube map.
fn cells(layout: CubeLayout) -> [f64; 2] {
    match layout {
        CubeLayout::Strip => [3.0, 2.0],
        CubeLayout::Cross => [4.0, 3.0],
    }
}

/// Where a place of the picture looks from and to.
struct Sight<'g> {
    origin: Expr<'g>,
    /// A unit vector.
    direction: Expr<'g>,
    /// Whether nothing is there to see; `None` where that is never so.
    is_blank: Option<Expr<'g>>,
}

/// A camera's frame as expressions, and one eye's picture.
struct Eye<'g> {
    camera: Camera,
    position: Expr<'g>,
    right: Expr<'g>,
    up: Expr<'g>,
    forward: Expr<'g>,
    /// Columns and rows.
    size: [f64; 2],
    /// How far the eye is to the right of the camera's position; `None` for one eye.
    aside: Option<Expr<'g>>,
}

impl<'g> Sight<'g> {
    /// The sight through a place of the whole picture.
    fn through(arena: &'g Arena, camera: &Camera, size: Size, [x, y]: [Expr<'g>; 2]) -> Sight<'g> {
        let [right, up, forward] = {
            let frame = CameraFrame::new(camera);
            [frame.right, frame.up, frame.forward].map(|axis| arena.v3(axis))
        };
        let eye = eye_size(camera, size);
        let (aside, place) = match camera.stereo {
            None => (None, [x, y]),
            Some(stereo) => {
                let [left, other] = [-0.5, 0.5].map(|share| arena.f(share * stereo.eyes));
                let split = |at: Expr<'g>, half: f64| {
                    let is_left = at.lt(arena.f(half));
                    (is_left.select(left, other), is_left.select(at, at - half))
                };
                let (aside, place) = match stereo.layout {
                    StereoLayout::SideBySide => {
                        let (aside, x) = split(x, eye[0]);
                        (aside, [x, y])
                    }
                    StereoLayout::OverUnder => {
                        let (aside, y) = split(y, eye[1]);
                        (aside, [x, y])
                    }
                    StereoLayout::Right => (other, [x, y]),
                    StereoLayout::Left | StereoLayout::Anaglyph => (left, [x, y]),
                };
                (Some(aside), place)
            }
        };
        let position = arena.v3(camera.position);
        Eye { camera: *camera, position, right, up, forward, size: eye, aside }.sight(place)
    }
}

impl<'g> Eye<'g> {
    fn sight(&self, [x, y]: [Expr<'g>; 2]) -> Sight<'g> {
        let [width, height] = self.size;
        let fov = self.camera.fov;
        match self.camera.lens {
            Lens::Perspective { shift } => self.perspective([x, y], shift),
            Lens::Orthographic { height: of_world } => self.orthographic([x, y], of_world / height),
            Lens::Fisheye => {
                let pixel = fov / height;
                self.fisheye((x - width / 2.0) * pixel, (y - height / 2.0) * -pixel)
            }
            Lens::Equirectangular { width: longitudes } => {
                let longitude = (x - width / 2.0) * (longitudes / width);
                let latitude = (y - height / 2.0) * -(fov / height);
                let (sin, cos) = (longitude.sin(), longitude.cos());
                let direction = (self.right * sin + self.forward * cos) * latitude.cos() + self.up * latitude.sin();
                let origin = self.turning(self.right * cos - self.forward * sin);
                Sight { origin, direction, is_blank: None }
            }
            Lens::CubeMap(layout) => self.cube_map([x, y], layout),
        }
    }

    /// The eye's place where both look straight ahead.
    fn origin(&self) -> Expr<'g> {
        self.aside.map_or(self.position, |aside| self.position + self.right * aside)
    }

    /// The eye's place where both turn with the direction, on a circle whose tangent is `beside` (omnidirectional stereo: S. Peleg,
    /// M. Ben-Ezra and Y. Pritch, Omnistereo: Panoramic Stereo Imaging, 2001).
    fn turning(&self, beside: Expr<'g>) -> Expr<'g> {
        self.aside.map_or(self.position, |aside| self.position + beside * aside)
    }

    /// Eyes converge without being turned: both pictures show the plane through the target at the same place.
    fn perspective(&self, [x, y]: [Expr<'g>; 2], shift: [f64; 2]) -> Sight<'g> {
        let [width, height] = self.size;
        let pixel = 2.0 * (self.camera.fov / 2.0).tan() / height;
        let mut right = (x - (width / 2.0 - shift[0] * height)) * pixel;
        let up = (y - (height / 2.0 + shift[1] * height)) * -pixel;
        if let Some(aside) = self.aside {
            right = right - aside * (1.0 / self.camera.distance());
        }
        let direction = (self.right * right + self.up * up + self.forward).normalize();
        Sight { origin: self.origin(), direction, is_blank: None }
    }

    fn orthographic(&self, [x, y]: [Expr<'g>; 2], pixel: f64) -> Sight<'g> {
        let [width, height] = self.size;
        let beside = self.right * ((x - width / 2.0) * pixel) + self.up * ((y - height / 2.0) * -pixel);
        let direction = match self.aside {
            None => self.forward,
            Some(aside) => (self.forward * self.camera.distance() - self.right * aside).normalize(),
        };
        Sight { origin: self.origin() + beside, direction, is_blank: None }
    }

    /// The direction at angles to the right and up from the middle of the picture.
    fn fisheye(&self, right: Expr<'g>, up: Expr<'g>) -> Sight<'g> {
        let angle = (right * right + up * up).sqrt();
        // In the middle the sine is as long as the angle.
        let least = angle.lift(1e-9);
        let scale = angle.max(least).sin() / angle.max(least);
        let direction = (self.right * right + self.up * up) * scale + self.forward * angle.cos();
        Sight { origin: self.origin(), direction, is_blank: Some(angle.lift(PI).lt(angle)) }
    }

    /// Faces are seen from inside; where they meet in the frame of the camera they go on into each other as in ffmpeg's filter
    /// v360 (layouts `c3x2` with the order `rludfb`, and a horizontal cross).
    fn cube_map(&self, [x, y]: [Expr<'g>; 2], layout: CubeLayout) -> Sight<'g> {
        let [columns, rows] = cells(layout);
        let [width, height] = [self.size[0] / columns, self.size[1] / rows];
        let last =
            |at: Expr<'g>, edge: f64, count: f64| (at * (1.0 / edge)).floor().clamp(at.lift(0.0), at.lift(count - 1.0));
        let (column, row) = (last(x, width, columns), last(y, height, rows));
        let u = (x * (1.0 / width) - column) * 2.0 - 1.0;
        let v = (y * (1.0 / height) - row) * 2.0 - 1.0;
        let one = u.lift(1.0);
        // Parts to the right, up and forward.
        let [right, left] = [[one, -v, -u], [-one, -v, u]];
        let [up, down] = [[u, one, v], [u, -one, -v]];
        let [front, back] = [[u, -v, one], [-u, -v, -one]];
        let in_column = |number: f64| column.equals(column.lift(number));
        let in_row = |number: f64| row.equals(row.lift(number));
        let pick = |is: Expr<'g>, a: [Expr<'g>; 3], b: [Expr<'g>; 3]| [0, 1, 2].map(|k| is.select(a[k], b[k]));
        let three = |a, b, c| pick(in_column(0.0), a, pick(in_column(1.0), b, c));
        let (parts, is_blank) = match layout {
            CubeLayout::Strip => (pick(in_row(0.0), three(right, left, up), three(down, front, back)), None),
            CubeLayout::Cross => {
                let middle = pick(in_column(3.0), back, three(left, front, right));
                let parts = pick(in_row(0.0), up, pick(in_row(2.0), down, middle));
                (parts, Some(!in_row(1.0).or(in_column(1.0))))
            }
        };
        let [r, u, f] = parts;
        let direction = (self.right * r + self.up * u + self.forward * f).normalize();
        let level = (r * r + f * f).sqrt().max(r.lift(1e-9));
        let origin = self.turning((self.right * f - self.forward * r) * (1.0 / level));
        Sight { origin, direction, is_blank }
    }
}

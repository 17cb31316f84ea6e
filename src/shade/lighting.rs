//! The light of a picture: what a scene says of it, in world axes and as radiance.

use super::CameraFrame;
use super::light::{in_points, placed};
use super::panorama::Sampler;
use super::sky::{self, Irradiance};
use crate::expr::{Arena, Expr};
use crate::graph::{Atmosphere, Camera, Environment, Light, Scene};
use crate::kernel::BackendError;
use crate::march::Disc;

/// The light of a picture.
#[derive(Clone, PartialEq, Debug)]
pub struct Lighting {
    /// The lights that shine, in world axes.
    pub lights: Vec<Light>,
    /// What is between the camera and what it sees.
    pub atmosphere: Atmosphere,
    /// How much corners are darkened, from 0 to 1.
    pub occlusion: f64,
    /// Radius of the ball that holds everything, in world units.
    pub bounding_radius: f64,
    environment: Environment,
    up: [f64; 3],
    irradiance: Irradiance,
    /// How directions towards the surroundings are picked, where they are.
    pub(super) sampler: Option<Sampler>,
    backdrop: Option<Backdrop>,
}

/// What a camera sees where nothing is, instead of the environment: two radiances, mixed by height in the picture.
#[derive(Clone, Copy, PartialEq, Debug)]
struct Backdrop {
    bottom: [f64; 3],
    top: [f64; 3],
    up: [f64; 3],
}

/// Lights without extent that stand for one with soft edges.
const POINTS: usize = 8;
/// Most of them in a picture.
const MOST_POINTS: usize = 96;

impl Lighting {
    /// The light of a scene seen through a camera; `radiance_of` gives the radiance that is shown as a colour.
    ///
    /// Errors: those of the CPU back end.
    pub fn new(
        scene: &Scene,
        camera: &Camera,
        bounding_radius: f64,
        radiance_of: impl Fn([f64; 3]) -> [f64; 3],
    ) -> Result<Lighting, BackendError> {
        let home = scene.home.unwrap_or(*camera);
        let lights = scene.lights.iter().filter(|light| light.shines());
        let up = match scene.environment {
            Environment::Dome { .. } => CameraFrame::new(&home).up,
            _ => [0.0, 0.0, 1.0],
        };
        let backdrop = scene.backdrop.map(|[bottom, top]| Backdrop {
            bottom: radiance_of(bottom),
            top: radiance_of(top),
            up: CameraFrame::new(camera).up,
        });
        Ok(Lighting {
            lights: lights.map(|light| placed(light, camera, &home)).collect(),
            atmosphere: scene.atmosphere,
            occlusion: scene.look.occlusion,
            bounding_radius,
            environment: scene.environment.clone(),
            up,
            irradiance: Irradiance::new(&scene.environment, up)?,
            sampler: None,
            backdrop,
        })
    }

    /// The same light where the march of shadow rays tells no more than hit or miss: lights with soft edges are several without.
    #[must_use]
    pub fn in_points(mut self) -> Lighting {
        let count = (MOST_POINTS / self.lights.len().max(1)).clamp(1, POINTS);
        let is_soft = |light: &Light| light.shadows && Disc::of(light).is_soft();
        let points = |light: &Light| if is_soft(light) { in_points(light, count) } else { vec![light.clone()] };
        self.lights = self.lights.iter().flat_map(points).collect();
        self
    }

    /// The same light for paths: directions towards a picture that surrounds everything are picked where it is bright.
    #[must_use]
    pub fn for_paths(mut self) -> Lighting {
        if let Environment::Picture { panorama, turn, .. } = &self.environment {
            self.sampler = Some(Sampler::new(panorama, *turn));
        }
        self
    }

    /// How many lights paths pick from: the lights, and the surroundings where these are picked from.
    pub fn picked(&self) -> usize {
        self.lights.len() + usize::from(self.sampler.is_some())
    }

    /// The lights that cast shadows, by number.
    pub fn shadowing(&self) -> impl Iterator<Item = (u8, &Light)> {
        (0..).zip(&self.lights).filter(|(_, light)| light.shadows)
    }

    /// Radiance from a direction in which nothing is.
    pub fn radiance<'g>(&self, arena: &'g Arena, direction: Expr<'g>) -> Expr<'g> {
        sky::radiance(arena, &self.environment, self.up, direction)
    }

    /// The mean radiance over the side of a normal, weighted by the cosine.
    pub fn around<'g>(&self, normal: Expr<'g>) -> Expr<'g> {
        self.irradiance.on(normal)
    }

    /// What a surface of some roughness mirrors from a direction: between the radiance from there and its mean around.
    pub fn mirrored<'g>(&self, arena: &'g Arena, direction: Expr<'g>, roughness: Expr<'g>) -> Expr<'g> {
        self.radiance(arena, direction).mix(self.around(direction), roughness)
    }

    /// What the camera sees in a direction in which nothing is: radiance.
    pub fn background<'g>(&self, arena: &'g Arena, direction: Expr<'g>) -> Expr<'g> {
        let Some(Backdrop { bottom, top, up }) = self.backdrop else { return self.radiance(arena, direction) };
        let height = (direction.dot(arena.v3(up)) * 1.6 + 0.5).clamp(arena.f(0.0), arena.f(1.0));
        arena.v3(bottom).mix(arena.v3(top), height)
    }
}

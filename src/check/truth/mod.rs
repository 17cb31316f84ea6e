//! Depths found without any estimate, and what estimates are worth beside them.
//!
//! In come rays and a formula; out come [`Truths`]: for each ray the first point whose orbit does not escape within
//! `max_iterations`, or whose detail is below a pixel before that ([`Members::at_footprint`]), found by fixed small steps
//! and bisection in f64, halving the step until the answer stands still. Rays where it does not are [`Truth::Ambiguous`] and judge no estimate. The same truths then judge any number of
//! marches ([`march_rays`], [`Truths::judge`]): method, form, step multiplier, precision and back end are the caller's.
//!
//! Nothing here calls a distance estimate but the march that is judged. Where a limit set is known in closed form,
//! [`super::exact`] gives distances to check the truth itself with.
//!
//! ```
//! use bulbfold::check::{Formula, truth};
//! use bulbfold::render::RenderSettings;
//! use bulbfold::shade::Size;
//!
//! let formula = Formula::builtin("menger").unwrap();
//! let settings = RenderSettings { size: Size { width: 64, height: 48 }, ..RenderSettings::default() };
//! let judged = truth::judge(&formula.subject(), 100, &settings).unwrap();
//! assert!(judged.hits > 20 && judged.missed < 0.05);
//! ```

mod judge;
mod membership;
mod stops;
mod walk;

pub use judge::{Budget, End, Judgement, candidate, chance_of_at_least, ends, judge, march_rays};
pub use membership::{Members, compose_membership};

use self::walk::Walker;
use super::subject::sphere_range;
use crate::compose::{Choice, ComposeResult, Composer};
use crate::graph::Camera;
use crate::kernel::records;
use crate::march::Threshold;
use crate::math::random::Random;
use crate::shade::{Size, rays, threshold};

/// A ray: origin and unit direction, in world units.
pub type Ray = ([f64; 3], [f64; 3]);

/// A ray's first point of the set.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Truth {
    /// At this depth (world units from the ray's origin).
    Hit(f64),
    /// Nowhere in the bounding sphere.
    Miss,
    /// Finer steps kept changing the answer: the ray grazes the set or meets dust. Or it is on no member, but so near to a hair of
    /// them that a pixel could not tell: who passes that is not wrong, nor who stops.
    Ambiguous,
}

impl Truth {
    /// The depth of a hit.
    pub fn depth(self) -> Option<f64> {
        match self {
            Truth::Hit(t) => Some(t),
            Truth::Miss | Truth::Ambiguous => None,
        }
    }
}

/// What rays are measured with.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Scale {
    /// Radius of a pixel; steps are a quarter of a pixel's diameter and finer.
    pub pixel: Threshold,
    /// Radius of the ball around the world's origin that rays are clipped to.
    pub bounding_radius: f64,
    /// Depth below which steps no longer shrink with the distance; matters only for origins inside the bounding sphere.
    pub nearest: f64,
    /// Halvings of the step in a row that must not change an answer by more than half a footprint, from 1 to 5. Each
    /// more doubles the cost.
    pub agreements: u32,
}

/// [`Scale::agreements`] of a reference: steps of a 16th of a footprint at last.
pub const AGREEMENTS: u32 = 2;

impl Scale {
    /// The scale of a view.
    pub fn of_view(camera: &Camera, size: Size, bounding_radius: f64) -> Scale {
        Scale {
            pixel: threshold(camera, size),
            bounding_radius,
            nearest: 1e-3 * camera.distance(),
            agreements: AGREEMENTS,
        }
    }

    /// Pixel radii that a ray goes from one depth to another.
    fn thresholds_between(&self, near: f64, end: f64) -> f64 {
        let Scale { pixel: Threshold { pixel_radius, fixed }, nearest, .. } = *self;
        match fixed > 0.0 {
            true => ((end - near) / fixed).max(0.0),
            false => (end.max(nearest) / near.max(nearest)).ln().max(0.0) / pixel_radius,
        }
    }

    /// Diameter of a pixel at a depth.
    pub fn footprint(&self, depth: f64) -> f64 {
        self.pixel.footprint(depth)
    }
}

/// Random rays through a picture, the same for the same seed on every machine.
pub fn view_rays(camera: &Camera, size: Size, count: usize, seed: u64) -> Vec<Ray> {
    let mut random = Random::new(seed);
    let [width, height] = [size.width, size.height].map(f64::from);
    let mut place = || {
        let (x, y) = (random.unit(), random.unit());
        [x * width, (1.0 - y) * height]
    };
    let places: Vec<[f64; 2]> = (0..count).map(|_| place()).collect();
    rays(camera, size, &places)
}

/// Rays and their first points of the set. The lists have equal lengths.
pub struct Truths {
    /// The rays.
    pub rays: Vec<Ray>,
    /// What was found on each.
    pub depths: Vec<Truth>,
    /// For each ray, whether it stays inside for a hit threshold (half a footprint) behind its hit. What is thinner than
    /// that along the ray is less than a pixel can show; it counts all the same.
    pub thick: Vec<bool>,
    /// What they were measured with.
    pub scale: Scale,
    members: Members,
}

impl Truths {
    /// Finds the first points of rays by brute force on the f64 back end, in parallel.
    ///
    /// `choices` has one entry for each orbit of the field (a [`Plan`](crate::compose::Plan) holds them); of it only what
    /// decides membership is used. `progress` hears the share that is done, from 0 to 1, and returns whether to go on;
    /// after `false` only the rays that were finished are returned, in order. Cost: about the number of footprints
    /// across the set, times 16, memberships a ray.
    pub fn find(
        composer: &Composer,
        choices: &[Choice],
        rays: &[Ray],
        scale: Scale,
        progress: &mut dyn FnMut(f64) -> bool,
    ) -> ComposeResult<Truths> {
        let members = Members::at_footprint(composer, choices)?;
        let mut truths = Truths { rays: Vec::new(), depths: Vec::new(), thick: Vec::new(), scale, members };
        truths.extend(rays, progress);
        Ok(truths)
    }

    /// Finds the first points of more rays.
    pub fn extend(&mut self, rays: &[Ray], progress: &mut dyn FnMut(f64) -> bool) {
        let walker = Walker { members: &self.members, scale: self.scale };
        let mut depths = walker.settle(rays, progress);
        let rays = &rays[..depths.len()];
        walker.leave_hairs(rays, &mut depths);
        let thick = walker.thick(rays, &depths);
        self.thick.extend(thick);
        self.depths.extend(depths);
        self.rays.extend(rays);
    }

    /// How many rays hit, miss and are ambiguous.
    pub fn counts(&self) -> [usize; 3] {
        let count = |wanted: fn(&Truth) -> bool| self.depths.iter().filter(|truth| wanted(truth)).count();
        [count(|t| matches!(t, Truth::Hit(_))), count(|t| *t == Truth::Miss), count(|t| *t == Truth::Ambiguous)]
    }

    /// Hits that are thinner along their ray than a hit threshold.
    pub fn thin(&self) -> usize {
        self.depths.iter().zip(&self.thick).filter(|(truth, thick)| truth.depth().is_some() && !**thick).count()
    }

    /// Hit thresholds that a ray goes inside the bounding sphere, to its hit or to the far side, on the average of those that meet
    /// the sphere.
    pub fn reach(&self) -> f64 {
        let Scale { bounding_radius, .. } = self.scale;
        let way = |(ray, truth): (&Ray, &Truth)| {
            let (near, far) = sphere_range(ray.0, ray.1, bounding_radius);
            let end = truth.depth().unwrap_or(far);
            (near < far).then(|| self.scale.thresholds_between(near, end))
        };
        let ways: Vec<f64> = self.rays.iter().zip(&self.depths).filter_map(way).collect();
        ways.iter().sum::<f64>() / ways.len().max(1) as f64
    }

    /// The membership that decided.
    pub fn members(&self) -> &Members {
        &self.members
    }
}

/// The point of a ray at a depth.
pub fn point((origin, direction): Ray, t: f64) -> [f64; 3] {
    [0, 1, 2].map(|i| origin[i] + direction[i] * t)
}

/// Rays as the eight input columns of a march, clipped to the bounding sphere.
pub fn ray_columns(rays: &[Ray], bounding_radius: f64) -> Vec<Vec<f64>> {
    records::Ray::columns(rays.iter().map(|&(origin, direction)| {
        let (near, far) = sphere_range(origin, direction, bounding_radius);
        (origin, direction, [near, far])
    }))
}

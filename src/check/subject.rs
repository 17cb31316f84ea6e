//! One formula under test: its kernels, and the numbers they give on any back end.

use std::sync::Arc;

use super::backends::{Backends, Target};
use crate::compose::{Choice, ComposeResult, Composer, Plan, Purpose, choose, compose_estimator};
use crate::expr::Arena;
use crate::formula::library::Library;
use crate::graph::{EstimateSettings, Method, ValidGraph};
use crate::kernel::records::{Marched, Ray};
use crate::kernel::{BackendError, Estimator, Kernel, inwards};
use crate::march::{MarchSettings, compose_march};

/// First step of finite differences, before an estimate says which one is right.
const FIRST_DIFFERENCE: f64 = 1e-4;
/// Least step of finite differences in single precision.
const LEAST_DIFFERENCE: f64 = 1e-5;

/// A graph, the choices made for it, and where its expressions go.
pub struct Subject<'a> {
    /// Steps and script engine.
    pub library: &'a Library,
    /// The fractal.
    pub graph: &'a ValidGraph,
    /// Its expressions.
    pub arena: &'a Arc<Arena>,
    /// Methods, forms and extent.
    pub plan: Plan,
}

/// Points as input columns of an estimator, each seen along the ray towards the origin.
pub(super) fn estimator_columns(points: &[[f64; 3]], h: &[f64], hit_eps: f64) -> Vec<Vec<f64>> {
    Estimator::columns(points, &points.iter().map(inwards).collect::<Vec<_>>(), h, hit_eps)
}

impl<'a> Subject<'a> {
    /// Makes the choices for a graph.
    pub fn new(library: &'a Library, graph: &'a ValidGraph, arena: &'a Arc<Arena>) -> ComposeResult<Subject<'a>> {
        let plan = choose(&Composer { arena, library, graph }, &EstimateSettings::default())?;
        Ok(Subject { library, graph, arena, plan })
    }

    /// The composer of the graph.
    pub fn composer(&self) -> Composer<'a> {
        Composer { arena: self.arena, library: self.library, graph: self.graph }
    }

    /// The chosen method of the first orbit; primitives have none.
    pub fn method(&self) -> Option<Method> {
        self.plan.choices.first().map(|c| c.method)
    }

    /// Choices with another method wherever it applies; `None` keeps the plan's. Returns nothing if it applies nowhere.
    pub fn choices(&self, method: Option<Method>) -> Option<Vec<Choice>> {
        let Some(method) = method else { return Some(self.plan.choices.clone()) };
        if !self.plan.choices.is_empty() && !self.plan.choices.iter().any(|c| c.applicable.contains(&method)) {
            return None;
        }
        let with = |choice: &Choice| match choice.applicable.contains(&method) {
            true => Choice { method, ..choice.clone() },
            false => choice.clone(),
        };
        Some(self.plan.choices.iter().map(with).collect())
    }

    /// The estimator with outputs `de, inside`.
    pub fn estimator(&self, choices: &[Choice]) -> ComposeResult<Kernel> {
        Ok(Kernel::Estimate(compose_estimator(&self.composer(), choices, Purpose::Estimate)?))
    }

    /// The estimator with a higher iteration limit, for membership in something nearer to the limit set.
    pub fn deeper_estimator(&self, more: u32) -> ComposeResult<Kernel> {
        let graph = self.graph.with_orbit_settings(|settings| settings.max_iterations += more);
        let composer = Composer { graph: &graph, ..self.composer() };
        Ok(Kernel::Estimate(compose_estimator(&composer, &self.plan.choices, Purpose::Estimate)?))
    }

    /// The state after a number of iterations, whatever its size: outputs of the probe, `z` the last four.
    pub fn orbit_kernel(&self, iterations: u32) -> ComposeResult<Kernel> {
        let graph = self.graph.with_orbit_settings(|settings| {
            settings.never_escape();
            settings.max_iterations = iterations;
        });
        let composer = Composer { graph: &graph, ..self.composer() };
        Ok(Kernel::Estimate(compose_estimator(&composer, &self.plan.choices, Purpose::Probe)?))
    }

    /// States after a number of iterations, with as many components as the first orbit has.
    pub fn orbits(
        &self,
        backends: &Backends,
        target: Target,
        kernel: &Kernel,
        points: &[[f64; 3]],
    ) -> Result<Vec<Vec<f64>>, BackendError> {
        let h = vec![FIRST_DIFFERENCE; points.len()];
        let columns = backends.run(target, self.arena, kernel, &estimator_columns(points, &h, 1e-9))?;
        let orbits = crate::compose::field_orbits(&self.composer());
        let width = orbits.first().map_or(3, |o| self.graph.state_width(o.root, &o.settings) as usize);
        let first = columns.len() - 4;
        Ok((0..points.len()).map(|i| (0..width).map(|k| columns[first + k][i]).collect()).collect())
    }

    /// Estimate and membership of points. Finite differences take their step from a first estimate.
    pub fn estimates(
        &self,
        backends: &Backends,
        target: Target,
        kernel: &Kernel,
        points: &[[f64; 3]],
    ) -> Result<Vec<(f64, bool)>, BackendError> {
        let mut h = vec![FIRST_DIFFERENCE; points.len()];
        let first = backends.run(Target::CPU_F64, self.arena, kernel, &estimator_columns(points, &h, 1e-9))?;
        for (h, de) in h.iter_mut().zip(&first[0]) {
            let least = if de.is_finite() { LEAST_DIFFERENCE } else { FIRST_DIFFERENCE };
            *h = self.plan.difference_step.length(*de, least);
        }
        let columns = backends.run(target, self.arena, kernel, &estimator_columns(points, &h, 1e-9))?;
        Ok(columns[0].iter().zip(&columns[1]).map(|(&de, &inside)| (de, inside > 0.5)).collect())
    }

    /// Depths of rays, each clipped to the bounding sphere; `hit_eps` is in world units.
    pub fn depths(
        &self,
        backends: &Backends,
        target: Target,
        rays: &[([f64; 3], [f64; 3])],
        hit_eps: f64,
    ) -> Result<ComposeResult<Vec<Option<f64>>>, BackendError> {
        let composer = self.composer();
        let estimator = match compose_estimator(&composer, &self.plan.choices, Purpose::Estimate) {
            Ok(estimator) => estimator,
            Err(error) => return Ok(Err(error)),
        };
        let settings = MarchSettings {
            hit_eps,
            max_march_steps: 100_000,
            ..MarchSettings::of_plan(&self.plan, 0.0, target.precision())
        };
        let kernel = Kernel::March(compose_march(self.arena, estimator, &settings));
        let columns = super::truth::ray_columns(rays, self.plan.bounding_radius);
        let out = backends.run(target, self.arena, &kernel, &columns)?;
        Ok(Ok(Marched::of(&out).rays().map(|end| end.depth()).collect()))
    }
}

/// Where a ray is inside the ball of `radius` around the origin; an empty range where it misses it.
pub(super) fn sphere_range(origin: [f64; 3], direction: [f64; 3], radius: f64) -> (f64, f64) {
    let (o, d) = (glam::DVec3::from(origin), glam::DVec3::from(direction));
    let middle = -o.dot(d);
    let half_sq = radius * radius - (o + d * middle).length_squared();
    if half_sq < 0.0 {
        return (0.0, Ray::NOWHERE);
    }
    ((middle - half_sq.sqrt()).max(0.0), middle + half_sq.sqrt())
}

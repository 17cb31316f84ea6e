//! A picture of which everything is settled.

use std::ops::Range;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::{Error, Request, Settled};
use crate::calibrate::Calibration;
use crate::check::Formula;
use crate::compose::{Composer, Plan};
use crate::expr::Arena;
use crate::graph::{Camera, ValidGraph};
use crate::math::Precision;
use crate::render::{Iterations, Pipeline, RenderSettings, compose_planned};
use crate::shade::Size;

/// A picture of which everything is settled. Serialised it carries the formula's texts and every choice, so that another machine
/// renders the same picture, or some rows of it.
#[derive(Clone, Serialize, Deserialize)]
pub struct Job {
    /// Version of the program that settled it.
    pub version: String,
    /// The formula.
    pub formula: Arc<Formula>,
    /// What was wanted.
    pub request: Request,
    /// The view; none of a plane.
    pub camera: Option<Camera>,
    /// The view that the file itself shows, where the camera has left it.
    pub home: Option<Camera>,
    /// Limits of iterations, where they follow the view.
    pub iterations: Option<Iterations>,
    /// What the view shows of the numbers that gradients are placed by (see [`crate::render::tones`]).
    pub tones: Vec<Vec<f64>>,
    /// The precision.
    pub precision: Precision,
    /// The choice of the estimate, as a plan.
    pub plan: Plan,
    /// The evidence for it, on the machine that measured.
    #[serde(skip)]
    pub calibration: Option<Arc<Calibration>>,
    /// The kernels, once they are composed.
    #[serde(skip)]
    composed: OnceLock<Arc<Composed>>,
}

/// What was chosen for a graph.
pub(super) struct Parts {
    pub iterations: Option<Iterations>,
    pub precision: Precision,
    pub plan: Plan,
}

/// The kernels of a job.
pub struct Composed {
    /// Where their expressions are.
    pub arena: Arc<Arena>,
    /// The graph as the picture shows it.
    pub graph: ValidGraph,
    /// The kernels.
    pub pipeline: Pipeline,
    /// What the renderer is to do.
    pub settings: RenderSettings,
    /// Time that composing took.
    pub took: Duration,
}

impl Job {
    /// The job of what was settled.
    pub(super) fn new(formula: Arc<Formula>, request: Request, settled: Settled) -> Job {
        let Settled { graph, iterations, precision, calibration } = settled;
        let plan = calibration.plan.clone();
        let job = Job::of_parts(formula, request, &graph, Parts { iterations, precision, plan });
        Job { calibration: Some(Arc::new(calibration)), ..job }
    }

    /// The job of a graph as the picture shows it, and of what was chosen for it.
    pub(super) fn of_parts(formula: Arc<Formula>, request: Request, graph: &ValidGraph, parts: Parts) -> Job {
        Job {
            version: env!("CARGO_PKG_VERSION").to_string(),
            formula,
            request,
            camera: graph.scene.camera,
            home: graph.scene.home,
            iterations: parts.iterations,
            tones: graph.scene.look.tones(),
            precision: parts.precision,
            plan: parts.plan,
            calibration: None,
            composed: OnceLock::new(),
        }
    }

    /// The same from another place, with all that was chosen: for frames of a film and for cameras that are moved by hand, whose
    /// views are alike.
    #[must_use]
    pub fn with_camera(&self, camera: Camera) -> Job {
        Job { camera: Some(camera), home: self.home.or(self.camera), composed: OnceLock::new(), ..self.clone() }
    }

    /// The same of a formula that shows the same from the same place, and of a request that asks for the same of the view.
    #[must_use]
    pub fn with_request(&self, formula: Arc<Formula>, request: Request) -> Job {
        Job { formula, request, composed: OnceLock::new(), ..self.clone() }
    }

    /// Columns and rows.
    pub fn size(&self) -> Size {
        self.request.size
    }

    /// All rows.
    pub fn rows(&self) -> Range<u32> {
        0..self.request.size.height
    }

    /// The graph as the picture shows it.
    pub fn graph(&self) -> ValidGraph {
        let mut graph = self.formula.graph().clone();
        if let Some(camera) = self.camera.filter(|camera| graph.scene.camera != Some(*camera)) {
            let is_moved = graph.scene.camera.is_some();
            graph = graph.with_camera(camera);
            if is_moved {
                graph = graph.without_calibration();
            }
        }
        graph = graph.at_home(self.home);
        let graph = self.iterations.map_or_else(|| graph.clone(), |found| found.apply(&graph));
        graph.with_tones(&self.tones)
    }

    /// The kernels; they are composed when they are first asked for.
    ///
    /// Errors: [`Error::Formula`] where a step's script fails.
    pub fn composed(&self) -> Result<&Arc<Composed>, Error> {
        if let Some(known) = self.composed.get() {
            return Ok(known);
        }
        let start = Instant::now();
        let (library, arena, graph) = (self.formula.library(), Arc::new(Arena::default()), self.graph());
        let settings = RenderSettings { boxed: true, ..self.request.settings(self.precision) };
        let composer = Composer { arena: &arena, library, graph: &graph };
        let pipeline = compose_planned(&composer, &settings, self.plan.clone());
        let pipeline = pipeline.map_err(|message| Error::of_formula(message, &library.sources))?;
        let took = start.elapsed();
        Ok(self.composed.get_or_init(|| Arc::new(Composed { arena, graph, pipeline, settings, took })))
    }
}

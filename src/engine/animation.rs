//! The frames of a film, settled together: one framing, one limit of iterations, one precision and one estimate, so that nothing
//! jumps from frame to frame.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::job::Parts;
use super::{CameraChange, Error, Job, Observer, Request, Settling, Stage};
use crate::calibrate::Calibration;
use crate::check::Formula;
use crate::compose::Plan;
use crate::diag::Diagnostic;
use crate::expr::Arena;
use crate::graph::{Camera, EstimateSettings, ValidGraph};
use crate::math::Precision;
use crate::render::Iterations;

/// What a film shows at a moment.
pub struct Moment {
    /// The formula with the moment's values.
    pub formula: Arc<Formula>,
    /// What the moment changes of the camera.
    pub camera: CameraChange,
}

/// A film before it is settled: its moments, in order. A frame is one of them, or the average of several.
pub trait Moments {
    /// How many there are, at least one.
    fn count(&self) -> usize;

    /// What one of them shows; it may be asked for again.
    fn moment(&self, number: usize) -> Result<Moment, Error>;

    /// Whether all show the same set, so that what is measured of it for one holds for all.
    fn show_one_set(&self) -> bool;
}

/// A film of which everything is settled.
pub struct Animation<'a> {
    moments: &'a dyn Moments,
    request: &'a Request,
    /// The view of the first moment, before its camera moves: the one that moments without a camera share.
    base: Option<Camera>,
    iterations: Option<Iterations>,
    tones: Vec<Vec<f64>>,
    precision: Precision,
    estimate: EstimateSettings,
    /// The plan of all moments, once it is known.
    plan: Option<Plan>,
}

/// A moment as it is seen.
struct Seen {
    formula: Arc<Formula>,
    graph: ValidGraph,
}

impl<'a> Animation<'a> {
    /// Settles a film by its key moments. What is told of several of them is told once.
    ///
    /// Errors: [`Error::Formula`], [`Error::Request`], and those of the moments.
    pub fn settle(
        moments: &'a dyn Moments,
        request: &'a Request,
        observer: &mut dyn Observer,
    ) -> Result<Animation<'a>, Error> {
        let observer = &mut Once { observer, told: BTreeSet::new() };
        let asked = request.first_precision()?;
        let (iterations, tones, estimate) = (None, Vec::new(), request.estimate);
        let mut animation =
            Animation { moments, request, base: None, iterations, tones, precision: asked, estimate, plan: None };
        let keys = animation.key_moments();
        let mut seen = keys.iter().map(|&at| animation.seen(at)).collect::<Result<Vec<Seen>, Error>>()?;
        animation.limit(&mut seen)?;
        animation.tone(&mut seen)?;
        for Seen { formula, graph } in &seen {
            let arena = Arc::new(Arena::default());
            let settling = Settling { library: formula.library(), arena: &arena, request };
            let resolution = settling.resolution(graph, settling.plan(graph)?, asked)?;
            animation.precision = settling.precision(animation.precision, &resolution, observer);
        }
        animation.choose(&seen, observer)?;
        Ok(animation)
    }

    /// The moments that speak for the others: the first, the last, and some between.
    pub fn key_moments(&self) -> Vec<usize> {
        let last = self.moments.count() - 1;
        let parts = if last < LONG { 2 } else { 4 };
        (0..=parts).map(|i| last * i / parts).collect::<BTreeSet<usize>>().into_iter().collect()
    }

    /// The estimate of all moments, by its name.
    pub fn estimate_name(&self) -> &'static str {
        self.estimate.method.map_or("by the rules", crate::graph::Method::name)
    }

    /// The precision of all moments.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// A moment with its camera. One framing serves all: each framed by itself would jump.
    fn seen(&mut self, number: usize) -> Result<Seen, Error> {
        let Moment { formula, camera } = self.moments.moment(number)?;
        let arena = Arc::new(Arena::default());
        let request = Request { camera, ..self.request.clone() };
        let settling = Settling { library: formula.library(), arena: &arena, request: &request };
        let graph = formula.graph().clone();
        let graph = match self.base {
            Some(camera) if graph.scene.camera.is_none() && graph.scene.plane.is_none() => graph.with_camera(camera),
            _ => settling.framed(graph)?.graph,
        };
        self.base = self.base.or(graph.scene.camera);
        let graph = settling.viewed(graph)?.graph;
        // The light of the first moment's view lights all.
        let mut graph = graph.at_home(self.base);
        if let Some(found) = self.iterations {
            graph = found.apply(&graph);
        }
        Ok(Seen { graph: graph.with_tones(&self.tones), formula })
    }

    /// Gives all moments the largest limit of iterations that a key moment needs.
    fn limit(&mut self, seen: &mut [Seen]) -> Result<(), Error> {
        let is_own = self.request.camera.is_empty() && seen.iter().all(|s| s.graph.scene.camera == s.graph.scene.home);
        for Seen { formula, graph } in seen.iter() {
            let arena = Arc::new(Arena::default());
            let settling = Settling { library: formula.library(), arena: &arena, request: self.request };
            let found = settling.iterations(graph, is_own)?;
            self.iterations = match (self.iterations, found) {
                (Some(most), Some(found)) => Some(most.max(found)),
                (most, found) => most.or(found),
            };
        }
        if let Some(most) = self.iterations {
            seen.iter_mut().for_each(|seen| seen.graph = most.apply(&seen.graph));
        }
        Ok(())
    }

    /// Places the gradients of all moments by what the first one shows, so that colours stay where they are.
    fn tone(&mut self, seen: &mut [Seen]) -> Result<(), Error> {
        let Some(Seen { formula, graph }) = seen.first() else { return Ok(()) };
        let arena = Arc::new(Arena::default());
        let settling = Settling { library: formula.library(), arena: &arena, request: self.request };
        let toned = settling.toned(graph.clone(), &settling.plan(graph)?)?;
        self.tones = toned.scene.look.tones();
        seen.iter_mut().for_each(|seen| seen.graph = seen.graph.clone().with_tones(&self.tones));
        Ok(())
    }

    /// Chooses the estimate of all moments by the key moments. Where they choose different methods, the one is taken that keeps the error
    /// budget in all of them, else the one that breaks it the least.
    fn choose(&mut self, seen: &[Seen], observer: &mut dyn Observer) -> Result<(), Error> {
        let mut chosen: Vec<EstimateSettings> = Vec::new();
        for seen in seen {
            chosen.push(self.calibrated(seen, self.request.estimate, observer)?.chosen);
        }
        let mut kinds: Vec<EstimateSettings> = Vec::new();
        for one in &chosen {
            if !kinds.iter().any(|known| (known.method, known.form) == (one.method, one.form)) {
                kinds.push(self.joined(&chosen, one));
            }
        }
        self.estimate = match kinds[..] {
            [only] => only,
            _ => self.safest(seen, &kinds)?,
        };
        Ok(())
    }

    /// The choices of one method and form as one: the smallest fudge and the shortest steps are safe for all of them.
    fn joined(&self, chosen: &[EstimateSettings], like: &EstimateSettings) -> EstimateSettings {
        let alike = || chosen.iter().filter(|other| (other.method, other.form) == (like.method, like.form));
        let least = |of: fn(&EstimateSettings) -> Option<f64>| alike().filter_map(of).reduce(f64::min);
        let [fudge, least_step, most_step] = [least(|s| s.fudge), least(|s| s.least_step), least(|s| s.most_step)];
        let late_ends = alike().any(|s| s.late_ends == Some(true)).then_some(true);
        EstimateSettings { fudge, least_step, most_step, late_ends, ..*like }.or(self.request.estimate)
    }

    /// Of several methods, the settings of the one that breaks the error budget the least where it breaks it the most; the first of equal ones.
    fn safest(&self, seen: &[Seen], kinds: &[EstimateSettings]) -> Result<EstimateSettings, Error> {
        let mut best: Option<(f64, EstimateSettings)> = None;
        for kind in kinds {
            let wanted = EstimateSettings { method: kind.method, form: kind.form, ..self.request.estimate };
            let (mut most, mut chosen) = (0.0f64, Vec::new());
            for seen in seen {
                let found = self.calibrated(seen, wanted, &mut ())?;
                most = most.max(found.excess());
                chosen.push(found.chosen);
            }
            if best.as_ref().is_none_or(|(least, _)| most < *least) {
                best = Some((most, self.joined(&chosen, kind)));
            }
        }
        Ok(best.map_or(kinds[0], |(_, settings)| settings))
    }

    fn calibrated(
        &self,
        Seen { formula, graph }: &Seen,
        estimate: EstimateSettings,
        observer: &mut dyn Observer,
    ) -> Result<Calibration, Error> {
        let arena = Arc::new(Arena::default());
        let request = Request { estimate, ..self.request.clone() };
        let settling = Settling { library: formula.library(), arena: &arena, request: &request };
        settling.estimate(graph, settling.plan(graph)?, self.precision, observer)
    }

    /// The job of a moment.
    ///
    /// Errors: those of the moment, and [`Error::Formula`].
    pub fn job(&mut self, number: usize) -> Result<Job, Error> {
        let Seen { formula, graph } = self.seen(number)?;
        let plan = match &self.plan {
            Some(plan) => plan.clone(),
            None => {
                let arena = Arc::new(Arena::default());
                let request = Request { estimate: self.estimate, ..self.request.clone() };
                Settling { library: formula.library(), arena: &arena, request: &request }.plan(&graph)?
            }
        };
        if self.moments.show_one_set() {
            self.plan = Some(plan.clone());
        }
        let (iterations, precision) = (self.iterations, self.precision);
        Ok(Job::of_parts(formula, self.request.clone(), &graph, Parts { iterations, precision, plan }))
    }
}

/// Tells everything once.
struct Once<'a> {
    observer: &'a mut dyn Observer,
    told: BTreeSet<String>,
}

impl Observer for Once<'_> {
    fn progress(&mut self, stage: Stage, share: f64) {
        self.observer.progress(stage, share);
    }

    fn warn(&mut self, warning: Diagnostic) {
        if self.told.insert(warning.message.clone()) {
            self.observer.warn(warning);
        }
    }

    fn note(&mut self, text: &str) {
        if self.told.insert(text.to_string()) {
            self.observer.note(text);
        }
    }

    fn is_cancelled(&self) -> bool {
        self.observer.is_cancelled()
    }
}

/// Moments from which on more than three are looked at.
const LONG: usize = 24;

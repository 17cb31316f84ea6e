//! Settles what a picture needs and the request leaves open: the camera, the limit of iterations, the precision, the estimate.
//!
//! Each is a function of formula, request and view alone. The order matters: the camera first, since all else is measured on the
//! view; then the iterations that show; then the precision, by rays of a march by rules; then the estimate.

use std::sync::Arc;

use super::camera::{Zoom, approached, rounded};
use super::{BackendChoice, Error, Observer, Request, Stage};
use crate::calibrate::{Calibration, Options, cache, calibrate};
use crate::check::Subject;
use crate::compose::{Composer, Plan, choose};
use crate::diag::Diagnostic;
use crate::expr::Arena;
use crate::formula::library::Library;
use crate::graph::{Camera, ValidGraph};
use crate::math::Precision;
use crate::precision::{LEAST_ULPS, Resolution, resolution};
use crate::render::{
    Clearance, FoundView, Iterations, Search, Standpoint, camera_of, compose_planned, find_views, standpoint,
    surface_at, tones,
};

/// A fractal while what its picture needs is settled.
#[derive(Clone, Copy)]
pub struct Settling<'a> {
    /// Steps and texts.
    pub library: &'a Library,
    /// Where its expressions go.
    pub arena: &'a Arc<Arena>,
    /// What is wanted.
    pub request: &'a Request,
}

/// A graph as a picture shows it, and the plan by rules where one was made that holds for it.
pub struct Viewed {
    /// The graph, with its camera.
    pub graph: ValidGraph,
    /// The plan.
    pub plan: Option<Plan>,
}

/// Everything that was settled.
pub struct Settled {
    /// The graph, with its camera and its limits of iterations.
    pub graph: ValidGraph,
    /// The limits, where they follow the view.
    pub iterations: Option<Iterations>,
    /// The precision.
    pub precision: Precision,
    /// The choice of the estimate, with its evidence.
    pub calibration: Calibration,
}

impl<'a> Settling<'a> {
    fn composer<'b>(&self, graph: &'b ValidGraph) -> Composer<'b>
    where
        'a: 'b,
    {
        Composer { arena: self.arena, library: self.library, graph }
    }

    fn failed(&self, message: Diagnostic) -> Error {
        Error::of_formula(message, &self.library.sources)
    }

    /// The plan that the rules make of a graph.
    pub fn plan(&self, graph: &ValidGraph) -> Result<Plan, Error> {
        choose(&self.composer(graph), &self.request.estimate).map_err(|message| self.failed(message))
    }

    /// The graph with a camera: the file's, or one that frames what is there. Graphs of a plane stay as they are.
    pub fn framed(&self, graph: ValidGraph) -> Result<Viewed, Error> {
        if graph.scene.plane.is_some() || graph.scene.camera.is_some() {
            return Ok(Viewed { graph, plan: None });
        }
        let plan = self.plan(&graph)?;
        let camera = camera_of(&self.composer(&graph), &plan);
        Ok(Viewed { graph: graph.with_camera(camera), plan: Some(plan) })
    }

    /// The graph with the camera that is wanted.
    pub fn viewed(&self, graph: ValidGraph) -> Result<Viewed, Error> {
        let change = &self.request.camera;
        if graph.scene.plane.is_some() && !change.is_empty() {
            let text = format!("a picture of `{}` shows a plane, which has no camera", graph.name);
            return Err(Error::request(text, "place the plane: --set 'plane=(center: (-0.5, 0.0), height: 2.5)'"));
        }
        let viewed = self.framed(graph)?;
        match viewed.graph.scene.camera.filter(|_| !change.is_empty()) {
            None => Ok(viewed),
            // What the file's estimate was calibrated on is not seen any more.
            Some(base) => {
                let graph = viewed.graph.without_calibration();
                let mut camera = change.apply(base)?;
                if let Some(zoom) = change.zoom {
                    camera = self.zoomed(&graph, camera, zoom)?;
                }
                Ok(Viewed { graph: graph.with_camera(camera), plan: None })
            }
        }
    }

    /// The camera nearer to the surface at a place of its picture. It goes there in steps, because the surface is known about as
    /// well as pixels are large, and because what is near has detail that more iterations make.
    fn zoomed(&self, graph: &ValidGraph, camera: Camera, zoom: Zoom) -> Result<Camera, Error> {
        let (mut camera, mut at) = (camera, zoom.at);
        for factor in zoom.steps() {
            let graph = graph.clone().with_camera(camera);
            let found = self.iterations(&graph, false)?;
            let graph = found.map_or_else(|| graph.clone(), |found| found.apply(&graph));
            let plan = self.plan(&graph)?;
            let place = [at[0] * f64::from(self.request.size.width), at[1] * f64::from(self.request.size.height)];
            let seen = surface_at(&self.composer(&graph), &plan, &camera, self.request.size, place);
            let Some(surface) = seen.map_err(|message| self.failed(message))? else {
                let text = format!("the picture shows no surface at {},{} to zoom to", at[0], at[1]);
                return Err(Error::request(
                    text,
                    "0,0 is the upper left corner and 1,1 the lower right one: choose another `--at`",
                ));
            };
            camera = approached(camera, surface, factor);
            at = [0.5; 2];
        }
        rounded(camera)
    }

    /// The iterations that the view of a graph needs, where its limit follows the view. `is_own` says whether the file chose the view.
    pub fn iterations(&self, graph: &ValidGraph, is_own: bool) -> Result<Option<Iterations>, Error> {
        let composer = self.composer(graph);
        if !Iterations::follow(&composer, is_own) {
            return Ok(None);
        }
        let plan = self.plan(graph)?;
        Iterations::of_view(&composer, &plan, self.request.size, is_own).map_err(|message| self.failed(message))
    }

    /// The graph whose gradients are used up by what its view shows.
    pub fn toned(&self, graph: ValidGraph, plan: &Plan) -> Result<ValidGraph, Error> {
        let tones = tones(&self.composer(&graph), plan, self.request.size).map_err(|message| self.failed(message))?;
        Ok(graph.with_tones(&tones))
    }

    /// The graph as its own view shows it: framed, with the iterations that pictures of this size need.
    pub fn seen(&self, graph: ValidGraph) -> Result<ValidGraph, Error> {
        let graph = self.framed(graph)?.graph;
        let found = self.iterations(&graph, true)?;
        Ok(found.map_or_else(|| graph.clone(), |found| found.apply(&graph)))
    }

    /// What estimates how far points are from the surface of a graph, with the iterations of its own view.
    pub fn clearance(&self, graph: ValidGraph) -> Result<Clearance, Error> {
        let graph = self.seen(graph)?;
        Clearance::new(&self.composer(&graph), &self.plan(&graph)?).map_err(|message| self.failed(message))
    }

    /// Views of a graph that are worth it, the best first.
    pub fn found(&self, graph: ValidGraph, search: &Search) -> Result<Vec<FoundView>, Error> {
        let graph = self.seen(graph)?;
        let views = find_views(&self.composer(&graph), &self.plan(&graph)?, search);
        let views = views.map_err(|message| self.failed(message))?;
        views.into_iter().map(|view| Ok(FoundView { camera: rounded(view.camera)?, ..view })).collect()
    }

    /// How fine the view of a graph is, by the estimate of the rules.
    pub fn resolution(&self, graph: &ValidGraph, plan: Plan, precision: Precision) -> Result<Resolution, Error> {
        let composed = compose_planned(&self.composer(graph), &self.request.settings(precision), plan);
        let pipeline = composed.map_err(|message| self.failed(message))?;
        Ok(resolution(self.arena, &pipeline, self.request.size))
    }

    /// The precision of a view, with a word where the view is too close for one.
    pub fn precision(&self, asked: Precision, resolution: &Resolution, observer: &mut dyn Observer) -> Precision {
        let grain = |precision: Precision| {
            let ulps = resolution.ulps(precision);
            let shown = if ulps < 0.01 { format!("{ulps:.1e}") } else { format!("{ulps:.2}") };
            let name = precision.name();
            format!("a pixel spans {shown} units of the last place of {name} and should span {LEAST_ULPS}")
        };
        let mut warn = |text: String| observer.warn(Diagnostic::warning(text));
        if asked == Precision::F32 && !resolution.fits(asked) {
            let text = format!("this view is too close for f32: {}", grain(asked));
            match (self.request.precision, self.request.backend) {
                (None, BackendChoice::Auto | BackendChoice::Cpu) => {
                    observer.note(&format!("{text}; the CPU takes it in f64"));
                    return self.precision(Precision::F64, resolution, observer);
                }
                (_, BackendChoice::Gpu) => warn(format!("{text}; `--backend auto` takes the CPU, which has f64")),
                (Some(_), _) => warn(format!("{text}; `--precision auto` takes f64")),
            }
        } else if asked == Precision::F64 && !resolution.fits(asked) {
            let times = (1.0 / resolution.room(asked)).max(1.0);
            let grain = grain(asked);
            warn(format!(
                "this view is too close for f64: {grain}; the picture will show steps of rounding. Go {times:.1} times farther away"
            ));
        }
        asked
    }

    /// Chooses the estimate of a graph: measured, or by the rules if that is switched off.
    pub fn estimate(
        &self,
        graph: &ValidGraph,
        plan: Plan,
        precision: Precision,
        observer: &mut dyn Observer,
    ) -> Result<Calibration, Error> {
        self.measured(graph, plan, (precision, false), observer)
    }

    /// Chooses the estimate. If double precision may be taken, nothing is told of a choice that wants it.
    fn measured(
        &self,
        graph: &ValidGraph,
        plan: Plan,
        (precision, may_double): (Precision, bool),
        observer: &mut dyn Observer,
    ) -> Result<Calibration, Error> {
        let subject = Subject { library: self.library, graph, arena: self.arena, plan };
        let warnings = subject.plan.warnings.clone();
        let told = |observer: &mut dyn Observer| {
            warnings.iter().for_each(|warning| observer.warn(warning_of(warning)));
        };
        let camera = graph.scene.camera.unwrap_or_else(|| crate::calibrate::camera_of(&subject));
        let is_inside = graph.scene.plane.is_none() && self.warns_of_inside(&subject, &camera, observer)?;
        // Points of a plane need no step multiplier, and no ray misses them; from inside of the set none goes anywhere.
        if graph.scene.plane.is_some() || is_inside || !self.request.calibrate {
            if self.request.estimate.quality.is_some() && graph.scene.plane.is_none() && !is_inside {
                let help = "drop one of them, or name a proof: `--de certified-ball`";
                let text = "`--quality` is for the measured choice, which `--calibrate off` switches off";
                return Err(Error::request(text, help));
            }
            told(observer);
            return Ok(Calibration::by_rule(&subject));
        }
        let options = self.options(&subject, precision);
        let calibration = calibrate(&subject, &options, &mut |share| {
            observer.progress(Stage::Calibrating, share);
            !observer.is_cancelled()
        });
        if observer.is_cancelled() {
            return Err(Error::Cancelled);
        }
        let calibration = calibration.map_err(|message| self.failed(message))?;
        observer.progress(Stage::Calibrating, 1.0);
        if calibration.wants_double && may_double {
            return Ok(calibration);
        }
        told(observer);
        calibration.warnings.iter().for_each(|warning| observer.warn(warning_of(warning)));
        if let Some(line) = calibration.warns_of_price() {
            observer.note(&format!("note: {line}"));
        }
        Ok(calibration)
    }

    /// Settings of a calibration that reads and writes the user's cache.
    pub fn options(&self, subject: &Subject, precision: Precision) -> Options {
        Options {
            budget: self.request.budget,
            wanted: self.request.estimate,
            camera: subject.graph.scene.camera.unwrap_or_else(|| crate::calibrate::camera_of(subject)),
            size: self.request.size,
            precision,
            effort: self.request.effort,
            cache: cache::folder(),
            ..Options::of_view(subject)
        }
    }

    /// Settles everything.
    pub fn all(&self, graph: ValidGraph, observer: &mut dyn Observer) -> Result<Settled, Error> {
        self.library.engine.begin_formula();
        let asked = self.request.first_precision()?;
        let Viewed { mut graph, mut plan } = self.viewed(graph)?;
        let iterations = self.iterations(&graph, self.request.camera.is_empty())?;
        if let Some(found) = iterations {
            (graph, plan) = (found.apply(&graph), None);
        }
        let plan = plan.map_or_else(|| self.plan(&graph), Ok)?;
        graph = self.toned(graph, &plan)?;
        if graph.scene.camera.is_some_and(|camera| camera.aperture.is_some()) && self.request.path.is_none() {
            observer.note("everything is sharp: the aperture needs paths of light, `--integrator path`");
        }
        let resolution = self.resolution(&graph, plan.clone(), asked)?;
        let mut precision = self.precision(asked, &resolution, observer);
        let may_double = precision == Precision::F32
            && self.request.precision.is_none()
            && self.request.backend != BackendChoice::Gpu;
        let mut calibration = self.measured(&graph, plan.clone(), (precision, may_double), observer)?;
        if calibration.wants_double && may_double {
            observer.note("single precision is too coarse for this formula's orbits; the CPU takes it in f64");
            precision = Precision::F64;
            calibration = self.estimate(&graph, plan, precision, observer)?;
        }
        Ok(Settled { graph, iterations, precision, calibration })
    }

    /// Tells where a camera is in the set, in which no ray has a way to go; true where it is.
    fn warns_of_inside(&self, subject: &Subject, camera: &Camera, observer: &mut dyn Observer) -> Result<bool, Error> {
        let found = standpoint(&subject.composer(), &subject.plan, camera).map_err(|message| self.failed(message))?;
        let Standpoint::Inside(way) = found else { return Ok(false) };
        let shown = |p: [f64; 3]| p.map(|x| ((x * 1e6).round() / 1e6).to_string()).join(",");
        let help = match way {
            Some(p) => {
                format!("the nearest free point found is {}: `--camera={}`", shown(p).replace(',', ", "), shown(p))
            }
            None => "no free point was found around it".to_string(),
        };
        let at = shown(camera.position).replace(',', ", ");
        let text = format!("the camera is inside the set: every ray from ({at}) ends at once; {help}");
        observer.warn(Diagnostic::warning(text));
        Ok(true)
    }
}

/// A warning from a text whose second line says what helps.
fn warning_of(text: &str) -> Diagnostic {
    match text.split_once('\n') {
        Some((what, help)) => Diagnostic::warning(what).help(help),
        None => Diagnostic::warning(text),
    }
}

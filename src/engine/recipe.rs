//! What a picture says of how it was made, and what is made of it again.
//!
//! A recipe may come from anywhere: every number of it is checked before anything is computed with it, and a choice of estimates that
//! the formula could not have is not taken, but made anew.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::request::{MOST_EDGE, MOST_SAMPLES};
use super::{Error, Job, Settling};
use crate::check::Formula;
use crate::expr::Arena;
use crate::graph::{Camera, DifferenceStep};
use crate::render::PathTracing;
use crate::shade::CameraFrame;

/// Most paths through a pixel.
const MOST_PATHS: u32 = 65_536;

/// Most gradients, and most places of each.
const MOST_TONES: usize = 256;

/// A picture's job, and what rendered it.
#[derive(Clone, Serialize, Deserialize)]
pub struct Recipe {
    /// The back end that made it, in words.
    pub backend: String,
    /// Everything else.
    pub job: Job,
}

/// The parts of a recipe that say whether scripts run when it is read.
#[derive(Deserialize)]
struct Texts {
    job: JobTexts,
}

#[derive(Deserialize)]
struct JobTexts {
    formula: crate::load::Bundle,
}

impl Recipe {
    /// As JSON, in one line: the same text for the same picture.
    pub fn text(&self) -> String {
        serde_json::to_string(self).unwrap_or_default()
    }

    /// Whether reading a recipe runs scripts that are not built in: steps of its own, or a graph that a script makes.
    ///
    /// Errors: the text is no recipe.
    pub fn has_scripts(text: &str) -> Result<bool, Error> {
        let texts: Texts = serde_json::from_str(text).map_err(|error| broken(&error))?;
        let formula = &texts.job.formula;
        let is_script = |(name, _): &(String, String)| name.to_ascii_lowercase().ends_with(".rhai");
        let own = formula.is_script() && !formula.is_unchanged_builtin();
        Ok(!formula.steps.is_empty() || formula.files.iter().any(is_script) || own)
    }

    /// Reads a recipe. Its scripts run, within the limits of all scripts.
    ///
    /// Errors: [`Error::Request`] for what is no recipe, or asks for what no picture can be.
    pub fn read(text: &str) -> Result<Recipe, Error> {
        let recipe: Recipe = serde_json::from_str(text).map_err(|error| broken(&error))?;
        recipe.check()?;
        Ok(recipe)
    }

    /// Whether its job can be rendered as it is: the choice of estimates is one that its formula has.
    pub fn is_settled(&self) -> bool {
        let job = &self.job;
        let arena = Arc::new(Arena::default());
        let settling = Settling { library: job.formula.library(), arena: &arena, request: &job.request };
        settling.plan(&job.graph()).is_ok_and(|rules| job.plan.is_choice_of(&rules))
    }

    fn check(&self) -> Result<(), Error> {
        let (job, request) = (&self.job, &self.job.request);
        let edges = 1..=MOST_EDGE;
        if !edges.contains(&request.size.width) || !edges.contains(&request.size.height) {
            return Err(odd(&format!("its edges are not from 1 to {MOST_EDGE}")));
        }
        if !(1..=MOST_SAMPLES).contains(&request.samples) {
            return Err(odd(&format!("its samples are not from 1 to {MOST_SAMPLES}")));
        }
        let budget = [request.budget.missed, request.budget.early, request.budget.error, request.effort];
        if !budget.iter().all(|x| *x > 0.0 && *x <= 1e6) {
            return Err(odd("its error budget is out of range"));
        }
        let estimate = &request.estimate;
        let is_share = |x: Option<f64>| x.is_none_or(|x| x > 0.0 && x <= 1.0);
        let is_step = match estimate.step {
            Some(DifferenceStep::Share(x) | DifferenceStep::Fixed(x)) => x > 0.0 && x.is_finite(),
            None => true,
        };
        let is_known = |x: Option<f64>| x.is_none_or(|x| x > 0.0 && x.is_finite());
        if !is_share(estimate.fudge) || !is_share(estimate.least_step) || !is_known(estimate.most_step) || !is_step {
            return Err(odd("its estimate is out of range"));
        }
        let is_bounded = |path: &PathTracing| {
            (1..=MOST_PATHS).contains(&path.samples) && path.bounces <= MOST_PATHS && (0.0..=1.0).contains(&path.noise)
        };
        if !request.path.as_ref().is_none_or(is_bounded) || request.mirrors > MOST_PATHS {
            return Err(odd("its paths are out of range"));
        }
        let is_rising =
            |cuts: &Vec<f64>| cuts.len() <= MOST_TONES && cuts.is_sorted() && cuts.iter().all(|x| x.is_finite());
        if job.tones.len() > MOST_TONES || !job.tones.iter().all(is_rising) {
            return Err(odd("its gradients are out of range"));
        }
        let change = &request.camera;
        let numbers = [change.position, change.target, change.up].into_iter().flatten().flatten();
        if !numbers.chain(change.fov).chain(change.turn).all(f64::is_finite)
            || ![&job.camera, &job.home].into_iter().flatten().all(is_usable)
        {
            return Err(odd("its camera sees nothing"));
        }
        Ok(())
    }
}

/// Whether a camera has a frame.
fn is_usable(camera: &Camera) -> bool {
    let frame = CameraFrame::new(camera);
    let is_in_range = |x: &f64| x.abs() <= 1e9;
    camera.fov > 0.0
        && camera.fov <= 2.0 * std::f64::consts::PI
        && camera.position.iter().chain(&camera.target).all(is_in_range)
        && [frame.right, frame.up, frame.forward].iter().flatten().all(|x| x.is_finite())
}

fn broken(error: &serde_json::Error) -> Error {
    let text = format!("the recipe cannot be read: {error}");
    Error::request(text, "it is damaged, or of another version of Bulbfold: render the formula itself")
}

fn odd(why: &str) -> Error {
    Error::request(format!("the recipe is no picture's: {why}"), "render the formula itself")
}

/// A formula with more of its values changed.
///
/// Errors: [`Error::Formula`] where a change cannot be.
pub fn changed(formula: &Formula, changes: &[(String, String)]) -> Result<Arc<Formula>, Error> {
    let mut bundle = formula.bundle();
    bundle.set.extend(changes.iter().cloned());
    let (mut library, mut messages) =
        (crate::formula::library::Library::builtin(), crate::diag::Diagnostics::default());
    match bundle.load(&mut library, &mut messages).filter(|_| !messages.has_errors()) {
        Some(loaded) => Ok(Arc::new(Formula::of(library, loaded))),
        None => {
            let sources = library.sources;
            Err(Error::Formula(Box::new(super::FormulaMessages { messages, sources })))
        }
    }
}

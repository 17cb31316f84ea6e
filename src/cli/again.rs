//! Pictures as inputs: what they say of how they were made.

use std::collections::BTreeSet;
use std::path::Path;

use bulbfold::engine::{BackendChoice, CameraChange, Job, Observer, Recipe, Request, changed};
use bulbfold::files::is_foreign;
use bulbfold::film::{Layers, Made, read_made};
use bulbfold::graph::{Camera, Lens};

use super::{Failure, Session, usage};

/// What a picture's file says, which must be something.
pub fn made(path: &Path) -> Result<(Made, String), Failure> {
    let shown = path.display();
    let mut made = read_made(path).map_err(|why| {
        usage(format!("cannot read {shown}: {why}"), "give a picture that `bulbfold render` has written")
    })?;
    let recipe = made.recipe.take().ok_or_else(|| {
        let help = "pictures of `bulbfold render` do, unless a program has changed them; render the formula itself";
        usage(format!("{shown} does not say how it was made"), help)
    })?;
    Ok((made, recipe))
}

/// The recipe of a picture. Scripts of a picture that belongs to another user run with `--trust` alone.
pub fn recipe(session: &Session, path: &Path) -> Result<Recipe, Failure> {
    let (_, text) = made(path)?;
    let within = |error| match session.failed(error) {
        Failure::Usage(text) => {
            Failure::Usage(format!("{}: {text}", bulbfold::diag::printable(&path.display().to_string())))
        }
        other => other,
    };
    let is_foreign = is_foreign(path) || path.parent().is_some_and(is_foreign);
    if is_foreign && !session.library.trusts_others && Recipe::has_scripts(&text).map_err(within)? {
        let text = format!("{} belongs to another user and holds scripts", path.display());
        return Err(usage(text, "`bulbfold show` prints them; `--trust` runs them"));
    }
    Recipe::read(&text).map_err(within)
}

/// What the command line says besides the picture.
pub struct Asked<'a> {
    /// The request that it would make of a formula.
    pub request: Request,
    /// The names of the arguments that were given.
    pub given: &'a BTreeSet<String>,
    /// What is changed in the formula.
    pub changes: &'a [(String, String)],
    /// The layers of the files.
    pub layers: Layers,
}

/// The job of a picture with what is asked for besides; it is settled anew where that changes what was chosen.
pub fn job(session: &Session, recipe: Recipe, asked: Asked, observer: &mut dyn Observer) -> Result<Job, Failure> {
    let failed = |error| session.failed(error);
    let old = &recipe.job;
    let formula = match asked.changes.is_empty() {
        true => old.formula.clone(),
        false => changed(&old.formula, asked.changes).map_err(failed)?,
    };
    let keeps_view = asked.changes.iter().all(|(path, _)| path.starts_with("film."));
    let moved = asked.request.camera;
    let request = merged(&recipe, asked);
    let is_light = {
        let Request { samples, sampling, backend, layers, path, denoise, mirrors, .. } = request.clone();
        let like = Request { samples, sampling, backend, layers, path, denoise, mirrors, ..old.request.clone() };
        request == like
    };
    if keeps_view && is_light && recipe.is_settled() {
        return Ok(old.with_request(formula, request));
    }
    // The view is the picture's, wherever that came from.
    let own = formula.graph().scene.camera;
    let request = match old.camera.filter(|camera| own != Some(*camera)) {
        Some(camera) => Request { camera: over(change_to(camera, own), moved), ..request },
        None => Request { camera: moved, ..request },
    };
    session.engine.settle(&formula, &request, observer).map_err(failed)
}

/// The picture's request with what was given in its place.
fn merged(recipe: &Recipe, asked: Asked) -> Request {
    let (base, new) = (recipe.job.request.clone(), asked.request);
    let has = |name: &str| asked.given.contains(name);
    let recorded = match base.backend {
        // What the picture was made on, where that is certain to be here.
        BackendChoice::Auto if recipe.backend.starts_with("cpu") => BackendChoice::Cpu,
        other => other,
    };
    Request {
        size: if has("size") || has("scale") { new.size } else { base.size },
        samples: if has("samples") { new.samples } else { base.samples },
        sampling: if has("sampling") { new.sampling } else { base.sampling },
        camera: if new.camera.is_empty() { base.camera } else { new.camera },
        backend: if has("backend") { new.backend } else { recorded },
        precision: if has("precision") { new.precision } else { base.precision },
        estimate: new.estimate.or(base.estimate),
        calibrate: if has("calibrate") { new.calibrate } else { base.calibrate },
        budget: if has("error_budget") { new.budget } else { base.budget },
        path: if has("integrator") { new.path } else { new.path.or(base.path) },
        denoise: base.denoise || new.denoise,
        mirrors: if has("mirrors") { new.mirrors } else { base.mirrors },
        exact_rays: base.exact_rays || new.exact_rays,
        layers: asked.layers,
        ..base
    }
}

/// A change of a camera with another one over it. Moves are those of the new one alone.
fn over(base: CameraChange, new: CameraChange) -> CameraChange {
    CameraChange {
        position: new.position.or(base.position),
        target: new.target.or(base.target),
        up: new.up.or(base.up),
        lens: new.lens.or(base.lens),
        // A lens that is new has an angle of its own.
        fov: new.fov.or(base.fov.filter(|_| new.lens.is_none())),
        stereo: new.stereo.or(base.stereo),
        eyes: new.eyes.or(base.eyes),
        near: new.near.or(base.near),
        far: new.far.or(base.far),
        ..new
    }
}

/// The change that makes this camera of a formula's own.
fn change_to(camera: Camera, own: Option<Camera>) -> CameraChange {
    let differs = |of: fn(&Camera) -> Lens| own.is_none_or(|own| of(&own) != of(&camera));
    let has_angle = own.is_none_or(|own| own.fov != camera.fov) && camera.lens == Lens::default();
    CameraChange {
        position: Some(camera.position),
        target: Some(camera.target),
        up: Some(camera.up),
        lens: Some(camera.lens).filter(|_| differs(|camera| camera.lens)),
        fov: Some(camera.fov).filter(|_| has_angle),
        stereo: camera.stereo.map(|stereo| stereo.layout),
        eyes: camera.stereo.map(|stereo| stereo.eyes),
        near: Some(camera.near).filter(|near| *near > 0.0),
        far: camera.far,
        ..CameraChange::default()
    }
}

//! `bulbfold render --view`: pictures of what the march did, with a legend.

use bulbfold::check::truth::Truths;
use bulbfold::compose::Composer;
use bulbfold::expr::Arena;
use bulbfold::film::Image;
use bulbfold::kernel::{Backend, BackendError};
use bulbfold::math::Precision;
use bulbfold::render::{Pipeline, RenderSettings};
use bulbfold::shade::Size;
use bulbfold::view::{Marched, Shown, View, ViewKernels, find_truths, show};
use clap::ValueEnum;
use clap::builder::PossibleValue;

use super::arguments::BackendArg;
use super::backend::{Job, run_job};
use super::progress::Progress;
use super::session::talk;
use super::stats::estimate_rows;
use super::{Failure, Session};

/// A view as a flag's value.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ViewArg(pub View);

impl ValueEnum for ViewArg {
    fn value_variants<'a>() -> &'a [Self] {
        static ALL: [ViewArg; View::ALL.len()] = {
            let mut all = [ViewArg(View::Error); View::ALL.len()];
            let mut i = 0;
            while i < View::ALL.len() {
                all[i] = ViewArg(View::ALL[i]);
                i += 1;
            }
            all
        };
        &ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.0.name()).help(self.0.summary()))
    }
}

impl ViewArg {
    /// Size of the picture where none is given: brute force takes its time.
    pub fn default_size(self) -> Size {
        match self.0 {
            View::Error => Size { width: 640, height: 360 },
            _ => super::render::DEFAULT_SIZE,
        }
    }
}

/// What is rendered, and how.
pub struct Request<'a> {
    /// Which view.
    pub view: View,
    /// The fractal.
    pub composer: Composer<'a>,
    /// Its kernels.
    pub pipeline: &'a Pipeline,
    /// Size and estimate.
    pub settings: &'a RenderSettings,
    /// Where the march runs.
    pub backend: BackendArg,
    /// Its precision.
    pub precision: Precision,
    /// Whether progress is kept back.
    pub quiet: bool,
    /// Whether the numbers are printed.
    pub stats: bool,
}

/// Renders a view with its legend.
pub fn render(session: &Session, request: &Request) -> Result<Image, Failure> {
    let Request { view, composer, pipeline, settings, .. } = *request;
    let kernels = ViewKernels::new(&composer, pipeline, view).map_err(|error| session.failure(error))?;
    let truths = match view {
        View::Error => Some(walk(session, request)?),
        _ => None,
    };
    let mut job = ViewJob { kernels: &kernels, arena: composer.arena, size: settings.size, quiet: request.quiet };
    let (backend, marched) = run_job(session, request.backend, request.precision, &mut job)?;
    let shown = show(view, &composer, pipeline, &marched, truths.as_ref());
    if request.stats {
        print(&backend, pipeline, &shown);
    }
    Ok(shown.image())
}

/// Finds the truth of all pixels' rays.
fn walk(session: &Session, request: &Request) -> Result<Truths, Failure> {
    let mut progress = Progress::new(request.quiet);
    let size = request.settings.size;
    let truths = find_truths(&request.composer, request.pipeline, size, &mut |share| progress.update(share));
    progress.finish();
    truths.map_err(|error| session.failure(error))
}

fn print(backend: &str, pipeline: &Pipeline, shown: &Shown) {
    let mut rows = vec![("back end".to_string(), backend.to_string())];
    rows.extend(estimate_rows(&pipeline.plan));
    rows.extend(shown.summary());
    let width = rows.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    for (name, value) in rows {
        talk(&format!("{name:<width$} {value}"));
    }
}

struct ViewJob<'a> {
    kernels: &'a ViewKernels<'a>,
    arena: &'a Arena,
    size: Size,
    quiet: bool,
}

impl Job for ViewJob<'_> {
    type Output = Marched;

    fn run<B: Backend>(&mut self, backend: &B) -> Result<Marched, BackendError> {
        let mut progress = Progress::new(self.quiet);
        let marched = self.kernels.run(backend, self.arena, self.size, &mut |share| progress.update(share));
        progress.finish();
        marched
    }
}

//! `bulbfold render --view`: pictures of what the march did, with a legend.

use bulbfold::check::truth::Truths;
use bulbfold::compose::Composer;
use bulbfold::engine::{Composed, Job, Observer, Stage, Work};
use bulbfold::expr::Arena;
use bulbfold::film::Image;
use bulbfold::kernel::template::Kept;
use bulbfold::kernel::{Backend, BackendError};
use bulbfold::render::Pipeline;
use bulbfold::shade::Size;
use bulbfold::view::{PixelMarches, Shown, View, ViewKernels, find_truths, show};
use clap::ValueEnum;
use clap::builder::PossibleValue;

use super::observer::Terminal;
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
            _ => super::picture_args::DEFAULT_SIZE,
        }
    }
}

/// Renders a view of a picture, with its legend.
pub fn render(session: &Session, view: View, job: &Job, stats: bool) -> Result<Image, Failure> {
    let failed = |error| session.failed(error);
    let Composed { arena, graph, pipeline, .. } = &**job.composed().map_err(failed)?;
    let composer = Composer { arena, library: job.formula.library(), graph };
    let kernels = ViewKernels::new(&composer, pipeline, view).map_err(|error| session.failure(error))?;
    let mut watch = session.watch();
    let truths = match view {
        View::Error => Some(walk(session, &composer, (pipeline, job.size()), &mut watch)?),
        _ => None,
    };
    let mut work = ViewWork { kernels: &kernels, arena, size: job.size() };
    let done = session.engine.backends().run(job.request.backend, job.precision, &mut work, &mut watch);
    let (backend, marched) = done.map_err(failed)?;
    let shown = show(view, &composer, pipeline, &marched, truths.as_ref());
    if stats {
        print(&backend, pipeline, &shown);
    }
    Ok(shown.image())
}

/// Finds the truth of all pixels' rays.
fn walk(
    session: &Session,
    composer: &Composer,
    (pipeline, size): (&Pipeline, Size),
    watch: &mut Terminal,
) -> Result<Truths, Failure> {
    let truths = find_truths(composer, pipeline, size, &mut |share| watch.progress(Stage::Calibrating, share));
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

struct ViewWork<'a> {
    kernels: &'a ViewKernels<'a>,
    arena: &'a Arena,
    size: Size,
}

impl Work for ViewWork<'_> {
    type Output = PixelMarches;

    fn run<B: Backend>(
        &mut self,
        backend: &B,
        _: &mut Kept<B>,
        observer: &mut dyn Observer,
    ) -> Result<PixelMarches, BackendError> {
        let mut tell = |share| observer.progress(Stage::Rendering, share);
        let marched = self.kernels.run(backend, self.arena, self.size, &mut tell);
        tell(1.0);
        marched
    }
}

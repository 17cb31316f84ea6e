//! `auto`, measured: which way of estimating distances is the cheapest that keeps an error budget, on the view itself.
//!
//! In comes a [`Subject`] and [`Options`] (view, budget, what is fixed already); out comes a [`Calibration`]: the chosen
//! settings, the plan that they make, and the evidence, a [`Row`] for every candidate that was tried. A few hundred rays
//! of the view are walked by brute force, which is the truth; then candidates (method, form, step multiplier, shortest
//! step) march the same rays, the cheapest first, until one stays inside the budget. Cost is counted in operations and
//! not timed, so that the same formula and view give the same choice on every machine. Outcomes are kept in a [`cache`].
//!
//! ```
//! use bulbfold::calibrate::{Options, calibrate};
//! use bulbfold::check::Formula;
//!
//! let formula = Formula::builtin("menger").unwrap().without_calibration();
//! let options = Options { cache: None, ..Options::of_view(&formula.subject()) };
//! let calibration = calibrate(&formula.subject(), &options, &mut |_| {}).unwrap();
//! assert!(calibration.is_within && calibration.evidence.iter().any(|row| row.is_chosen()));
//! ```

mod blame;
pub mod cache;
mod candidate;
mod race;
pub mod written;

use std::path::PathBuf;
use std::time::{Duration, Instant};

pub use candidate::{Candidate, FUDGES, LEAST_STEPS, Space};

pub use crate::check::truth::Budget;
use crate::check::truth::{Scale, Truths, view_rays};
use crate::check::{Subject, Target};
use crate::compose::{Plan, choose, field_orbits};
use crate::diag::Diagnostic;
use crate::graph::{CALIBRATED_ROWS, Camera, EstimateSettings};
use crate::shade::{Size, frame_automatically};
use race::{Race, time_of_render};

/// Time that a calibration may always take.
pub const LEAST_TIME: Duration = Duration::from_millis(300);
/// Share of a render's time that it may take where that is more.
const SHARE_OF_RENDER: f64 = 0.1;
/// What a pixel takes besides its primary ray (its shadow and its colour), as a share of that.
const BESIDES_PRIMARY: f64 = 1.0;
/// Rays of the truth that are taken even where they take longer than they may, most rays, and hits that are enough.
const FIRST_RAYS: usize = 48;
const MOST_RAYS: usize = 4000;
const ENOUGH_HITS: usize = 500;
/// Share of the time that the truth may take; the candidates take the rest.
const SHARE_OF_TRUTH: f64 = 0.6;

/// What a calibration goes by.
#[derive(Clone, PartialEq, Debug)]
pub struct Options {
    /// Errors that are allowed.
    pub budget: Budget,
    /// What the command line fixes; only the rest is chosen. The subject's plan must have been made with it.
    pub wanted: EstimateSettings,
    /// The view.
    pub camera: Camera,
    /// The picture's size, which says how large a footprint is.
    pub size: Size,
    /// Primary rays of the whole render; 0 where nothing is rendered.
    pub primary_rays: u64,
    /// What the candidates march on. Pictures of a GPU are calibrated on the CPU in single precision.
    pub target: Target,
    /// Time that it may take, where a tenth of the render is less.
    pub time: Duration,
    /// Which random rays.
    pub seed: u64,
    /// Folder of the cache; `None` neither reads nor writes one.
    pub cache: Option<PathBuf>,
}

impl Options {
    /// The default budget on a formula's own view at 1280 x 720, in single precision, with the user's cache.
    pub fn of_view(subject: &Subject) -> Options {
        Options {
            budget: Budget::default(),
            wanted: EstimateSettings::default(),
            camera: camera_of(subject),
            size: Size { width: 1280, height: 720 },
            primary_rays: 0,
            target: Target::CpuF32,
            time: LEAST_TIME,
            seed: 1,
            cache: cache::folder(),
        }
    }
}

/// The camera of a subject's file, or one that sees all of it.
pub fn camera_of(subject: &Subject) -> Camera {
    subject.graph.camera.unwrap_or_else(|| frame_automatically(subject.plan.bounding_radius))
}

/// What became of a candidate.
#[derive(Clone, PartialEq, Debug)]
pub enum Verdict {
    /// It keeps the budget at the least cost; or, where none does, it is the least bad.
    Chosen,
    /// It breaks the budget; the text says where.
    Fails(String),
}

/// A candidate and what was measured of it.
#[derive(Clone, PartialEq, Debug)]
pub struct Row {
    /// The candidate.
    pub candidate: Candidate,
    /// Share of the hits that it missed.
    pub missed: f64,
    /// Share of its stops that are early.
    pub early: f64,
    /// Median depth error, in footprints.
    pub error: f64,
    /// Estimates a ray.
    pub estimates: f64,
    /// Operations a ray (products of two numbers), all rays of the view counted.
    pub cost: f64,
    /// What became of it.
    pub verdict: Verdict,
}

impl Row {
    /// Whether what was measured keeps a budget.
    pub fn is_within(&self, budget: &Budget) -> bool {
        self.missed <= budget.missed && self.early <= budget.early && self.error <= budget.error
    }

    /// Whether it was chosen.
    pub fn is_chosen(&self) -> bool {
        self.verdict == Verdict::Chosen
    }
}

/// Where a choice comes from.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Origin {
    /// Not measured at all: the rules' choice.
    Rules,
    /// Measured now.
    Measured,
    /// Measured by an earlier run, and kept.
    Cached,
    /// The file says that it was measured.
    File,
    /// Everything was fixed, so there was nothing to choose.
    Fixed,
}

/// A choice with its evidence.
#[derive(Clone, PartialEq, Debug)]
pub struct Calibration {
    /// The choice as settings: what to ask for to get it again.
    pub chosen: EstimateSettings,
    /// The choice as a plan.
    pub plan: Plan,
    /// Where it comes from.
    pub origin: Origin,
    /// Whether it keeps the budget.
    pub is_within: bool,
    /// Rows of the picture that it is for.
    pub rows: u32,
    /// Candidates in the order in which they were tried; empty where nothing was measured.
    pub evidence: Vec<Row>,
    /// Rays with a settled truth, and those of them that hit.
    pub rays: [usize; 2],
    /// What the user should know: that nothing keeps the budget and why, that the cache could not be used.
    pub warnings: Vec<String>,
    /// Time that it took.
    pub time: Duration,
}

impl Calibration {
    /// The rules' choice, where measuring is switched off.
    pub fn by_rule(subject: &Subject) -> Calibration {
        without_measuring(subject, Origin::Rules, CALIBRATED_ROWS, Instant::now())
    }
}

/// Chooses for a formula and a view. `progress` is told the share that is done. Fails only where a step's script does.
pub fn calibrate(
    subject: &Subject,
    options: &Options,
    progress: &mut dyn FnMut(f64),
) -> Result<Calibration, Diagnostic> {
    let start = Instant::now();
    let estimates: Vec<EstimateSettings> =
        field_orbits(&subject.composer()).into_iter().map(|orbit| orbit.settings.estimate).collect();
    if estimates.iter().any(|estimate| estimate.is_too_coarse_for(options.size.height)) {
        // The file's choice is for coarser pixels: it is measured as if the file carried none.
        let graph = subject.graph.without_calibration();
        let (library, arena) = (subject.library, subject.arena);
        let mut finer = Subject { library, graph: &graph, arena, plan: subject.plan.clone() };
        finer.plan = choose(&finer.composer(), &options.wanted)?;
        return calibrate(&finer, options, progress);
    }
    let space = Space::new(subject, &options.wanted);
    // Rays that stop in front of the set cannot be measured by how far they are from it.
    let is_soft = subject.plan.stop_at.is_some();
    let is_calibrated = estimates.iter().any(|estimate| estimate.calibrated.is_some());
    if is_calibrated || is_soft || space.is_decided() {
        let origin = if is_calibrated {
            Origin::File
        } else if is_soft {
            Origin::Rules
        } else {
            Origin::Fixed
        };
        return Ok(without_measuring(subject, origin, options.size.height, start));
    }
    let key = options.cache.as_ref().map(|_| cache::key(subject, options)).transpose()?;
    let entry = options.cache.as_ref().zip(key).map(|(folder, key)| folder.join(key));
    if let Some(found) = entry.as_ref().and_then(|path| cache::read(path)) {
        return Ok(found.into_calibration(&space, options.size.height, start));
    }
    let mut calibration = measure(subject, options, &space, start, progress)?;
    if let Some(path) = entry
        && let Err(why) = cache::write(&path, &calibration)
    {
        calibration.warnings.push(format!("the calibration could not be kept in {}: {why}", path.display()));
    }
    calibration.time = start.elapsed();
    Ok(calibration)
}

fn without_measuring(subject: &Subject, origin: Origin, rows: u32, start: Instant) -> Calibration {
    Calibration {
        chosen: EstimateSettings::default(),
        plan: subject.plan.clone(),
        origin,
        is_within: true,
        rows,
        evidence: Vec::new(),
        rays: [0, 0],
        warnings: Vec::new(),
        time: start.elapsed(),
    }
}

fn measure(
    subject: &Subject,
    options: &Options,
    space: &Space,
    start: Instant,
    progress: &mut dyn FnMut(f64),
) -> Result<Calibration, Diagnostic> {
    let time = options.time.max(time_of_render(subject, options, space)?.mul_f64(SHARE_OF_RENDER));
    let deadline = start + time;
    let until = start + time.mul_f64(SHARE_OF_TRUTH);
    let truths = find_truths(subject, options, until, &mut |share| progress(share * SHARE_OF_TRUTH))?;
    let [hits, misses, _] = truths.counts();
    let mut race = Race::new(subject, options, space, &truths);
    let mut told = || progress(SHARE_OF_TRUTH + (1.0 - SHARE_OF_TRUTH) * share_of(start, deadline));
    race.run(deadline, &mut told)?;
    let (chosen, evidence) = race.finish();
    let mut plan = space.plan(&chosen);
    let row = evidence.iter().find(|row| row.is_chosen());
    let is_within = row.is_some_and(|row| row.is_within(&options.budget));
    if let Some(row) = row {
        let reason = reason(row, hits, misses + hits);
        plan.choices.iter_mut().for_each(|choice| choice.reason = reason.clone());
    }
    let mut warnings = Vec::new();
    if let (false, Some(row)) = (is_within, row) {
        warnings.push(blame::warning(subject, options, row)?);
    }
    Ok(Calibration {
        chosen: chosen.settings(),
        plan,
        origin: Origin::Measured,
        is_within,
        rows: options.size.height,
        evidence,
        rays: [hits + misses, hits],
        warnings,
        time: start.elapsed(),
    })
}

fn share_of(start: Instant, deadline: Instant) -> f64 {
    let (passed, all) = (start.elapsed().as_secs_f64(), (deadline - start).as_secs_f64());
    (passed / all.max(1e-9)).min(1.0)
}

fn reason(row: &Row, hits: usize, rays: usize) -> String {
    format!(
        "measured: of {hits} hits on {rays} rays {:.2} % missed, {:.2} % of the stops early",
        100.0 * row.missed,
        100.0 * row.early
    )
}

/// The truth of a few rays, then of as many more as the time allows and the hits call for.
fn find_truths(
    subject: &Subject,
    options: &Options,
    until: Instant,
    progress: &mut dyn FnMut(f64),
) -> Result<Truths, Diagnostic> {
    let composer = subject.composer();
    let scale = Scale::of_view(&options.camera, options.size, subject.plan.bounding_radius);
    let rays = view_rays(&options.camera, options.size, MOST_RAYS, options.seed);
    let begin = Instant::now();
    let mut truths = Truths::find(&composer, &subject.plan.choices, &rays[..FIRST_RAYS], scale, &mut |_| true)?;
    let each = begin.elapsed().as_secs_f64() / FIRST_RAYS as f64;
    let left = until.saturating_duration_since(Instant::now()).as_secs_f64();
    let affordable = FIRST_RAYS + (left / each.max(1e-9)) as usize;
    let share = truths.counts()[0].max(1) as f64 / FIRST_RAYS as f64;
    let wanted = (ENOUGH_HITS as f64 / share) as usize;
    let count = wanted.min(affordable).clamp(FIRST_RAYS, MOST_RAYS);
    let more = Truths::find(&composer, &subject.plan.choices, &rays[FIRST_RAYS..count], scale, &mut |share| {
        progress(share);
        true
    })?;
    truths.rays.extend(more.rays);
    truths.depths.extend(more.depths);
    truths.thick.extend(more.thick);
    Ok(truths)
}

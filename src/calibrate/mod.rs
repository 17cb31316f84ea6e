//! `auto`, measured: which way of estimating distances is the cheapest that keeps an error budget, on the view itself.
//!
//! In comes a [`Subject`] and [`Options`] (view, budget, what is fixed already); out comes a [`Calibration`]: the chosen
//! settings, the plan that they make, and the evidence, a [`Row`] for every candidate that was tried. A few hundred rays
//! of the view are walked by brute force, which is the truth; then candidates (method, form, step multiplier, shortest
//! step) march them and others, the cheapest first, until one is shown to stay inside the budget. Cost is counted in
//! operations, and so is what a calibration itself may take: no clock is involved, and the same formula, view and settings give
//! the same choice on every machine, under any load. Outcomes are kept in a [`cache`].
//!
//! ```
//! use bulbfold::calibrate::{Options, calibrate};
//! use bulbfold::check::Formula;
//!
//! let formula = Formula::builtin("menger").unwrap().without_calibration();
//! let options = Options { cache: None, ..Options::of_view(&formula.subject()) };
//! let calibration = calibrate(&formula.subject(), &options, &mut |_| true).unwrap();
//! assert!(calibration.is_within && calibration.evidence.iter().any(|row| row.is_chosen()));
//! ```

mod blame;
pub mod cache;
mod candidate;
mod choice;
mod evidence;
mod marching;
mod meter;
mod race;
mod sight;
pub mod written;

use std::path::PathBuf;
use std::time::{Duration, Instant};

pub use candidate::{Candidate, FUDGES, LEAST_STEPS, MOST_STEPS, Space};
pub use evidence::Count;
pub use race::MOST_PRICE;

use crate::check::Subject;
use crate::check::health::{Health, Kind, check_steps};
pub use crate::check::truth::Budget;
use crate::check::truth::{Ray, Scale, Truths, view_rays};
use crate::compose::{Plan, choose, field_orbits};
use crate::diag::Diagnostic;
use crate::graph::{CALIBRATED_ROWS, Camera, EstimateSettings};
use crate::math::Precision;
use crate::shade::Size;
use choice::{Terms, rows};
use evidence::Tally;
use marching::Marching;
use meter::Meter;
use race::Race;

/// Rays of the truth that are taken even where they cost more than they may, most rays, and hits that are enough.
const FIRST_RAYS: usize = 24;
const MOST_TRUTHS: usize = 4000;
const ENOUGH_HITS: usize = 800;
/// The share that is told while a choice is confirmed.
const ALMOST_DONE: f64 = 0.99;
/// Share of all work that the truth may take; the candidates take the rest.
const SHARE_OF_TRUTH: f64 = 0.4;
/// The same of the truth of other rays, by which the choice is confirmed; hits that are enough for it; and choices that are tried.
const SHARE_OF_FRESH: f64 = 0.3;
const FRESH_HITS: usize = 1200;
const CONFIRMED: usize = 8;
/// Share of what single precision breaks the budget by that is left in double precision, where that is worth its price.
const DOUBLE_HELPS: f64 = 0.4;
/// Rays that are walked between two looks at what they cost.
const PORTION: usize = 256;
/// Most rays that candidates march, those with a truth included.
const MOST_RAYS: usize = 24_000;
/// Estimates a ray from which on a choice is expensive.
const EXPENSIVE: f64 = 200.0;

/// Settings of a calibration.
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
    /// What the candidates march in, on the CPU. Pictures of a GPU are calibrated in single precision.
    pub precision: Precision,
    /// How much it may compute, as a multiple of what it may by default: a tenth of a picture of one sample a pixel, or
    /// some 10^9 products of two numbers where that is more.
    pub effort: f64,
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
            precision: Precision::F32,
            effort: 1.0,
            seed: 1,
            cache: cache::folder(),
        }
    }
}

/// The camera of a subject's file, or one that sees all of it.
pub fn camera_of(subject: &Subject) -> Camera {
    crate::render::camera_of(&subject.composer(), &subject.plan)
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
    /// Missed hits, of all hits that are known.
    pub missed: Count,
    /// Early stops, of all its stops.
    pub early: Count,
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
        self.missed.share() <= budget.missed && self.early.share() <= budget.early && self.error <= budget.error
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
    /// Errors that were allowed.
    pub budget: Budget,
    /// Whether it keeps the budget.
    pub is_within: bool,
    /// Whether it breaks the budget in single precision, and double precision helps by far.
    pub wants_double: bool,
    /// Rows of the picture that it is for.
    pub rows: u32,
    /// Candidates in the order in which they were tried; empty if nothing was measured.
    pub evidence: Vec<Row>,
    /// Rays with a settled truth, and those of them that hit.
    pub rays: [usize; 2],
    /// What the user should know: that nothing keeps the budget and why, that the cache could not be used. A second line says
    /// what helps.
    pub warnings: Vec<String>,
    /// What the evidence does not show: candidates that were left out, and why.
    pub notes: Vec<String>,
    /// Time that it took; nothing was decided by it.
    pub time: Duration,
}

impl Calibration {
    /// The rules' choice, where measuring is switched off.
    pub fn by_rule(subject: &Subject) -> Calibration {
        without_measuring(subject, Origin::Rules, (Budget::default(), CALIBRATED_ROWS), Instant::now())
    }

    /// How many times as large as the budget the worst error of the choice is: 1 and less keeps it. 0 where nothing was measured.
    pub fn excess(&self) -> f64 {
        let worst = |row: &Row| {
            let shares = (row.missed.share() / self.budget.missed).max(row.early.share() / self.budget.early);
            shares.max(row.error / self.budget.error)
        };
        self.evidence.iter().find(|row| row.is_chosen()).map_or(0.0, worst)
    }

    /// What a picture will cost, in a line, where the choice takes many estimates a ray.
    pub fn warns_of_price(&self) -> Option<String> {
        let chosen = self.evidence.iter().find(|row| row.is_chosen())?;
        let cheapest = self.evidence.iter().min_by(|a, b| a.cost.total_cmp(&b.cost))?;
        let line = format!(
            "the estimate is expensive: {} takes {:.0} estimates a ray",
            chosen.candidate.name(),
            chosen.estimates
        );
        let beside = || {
            format!(
                ", {:.1} times the price of {} at fudge {}, which misses {:.2} % of {} hits",
                chosen.cost / cheapest.cost.max(1e-9),
                cheapest.candidate.name(),
                cheapest.candidate.fudge,
                100.0 * cheapest.missed.share(),
                cheapest.missed.of
            )
        };
        let is_expensive = chosen.estimates >= EXPENSIVE;
        is_expensive.then(|| if cheapest.is_chosen() { line } else { line + beside().as_str() })
    }
}

/// Chooses for a formula and a view. `progress` receives the share that is done, and says whether to go on: a calibration that is ended
/// chooses by rules, and is not kept. Fails only where a step's script does.
pub fn calibrate(
    subject: &Subject,
    options: &Options,
    progress: &mut dyn FnMut(f64) -> bool,
) -> Result<Calibration, Diagnostic> {
    let start = Instant::now();
    let estimates: Vec<EstimateSettings> =
        field_orbits(&subject.composer()).into_iter().map(|orbit| orbit.settings.estimate).collect();
    let is_too_coarse = estimates.iter().any(|estimate| estimate.is_too_coarse_for(options.size.height));
    let asks_for_proof = options.wanted.quality.is_some() && estimates.iter().any(|e| e.calibrated.is_some());
    if is_too_coarse || asks_for_proof {
        // The file's choice is for coarser pixels, or another wish: it is measured as if the file carried none.
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
        return Ok(without_measuring(subject, origin, (options.budget, options.size.height), start));
    }
    let key = options.cache.as_ref().map(|_| cache::key(subject, options)).transpose()?;
    let entry = options.cache.as_ref().zip(key).map(|(folder, key)| folder.join(key));
    if let Some(found) = entry.as_ref().and_then(|path| cache::read(path)) {
        return Ok(found.into_calibration(&space, options, start));
    }
    let mut is_ended = false;
    let mut go_on = |share: f64| {
        is_ended |= !progress(share);
        !is_ended
    };
    let mut calibration = measure(subject, options, &space, start, &mut go_on)?;
    if let Some(path) = entry.filter(|_| !is_ended)
        && let Err(why) = cache::write(&path, &calibration)
    {
        calibration.warnings.push(format!("the calibration could not be kept in {}: {why}", path.display()));
    }
    calibration.time = start.elapsed();
    Ok(calibration)
}

fn without_measuring(subject: &Subject, origin: Origin, (budget, rows): (Budget, u32), start: Instant) -> Calibration {
    Calibration {
        chosen: EstimateSettings::default(),
        plan: subject.plan.clone(),
        origin,
        budget,
        is_within: true,
        wants_double: false,
        rows,
        evidence: Vec::new(),
        rays: [0, 0],
        warnings: Vec::new(),
        notes: Vec::new(),
        time: start.elapsed(),
    }
}

fn measure(
    subject: &Subject,
    options: &Options,
    space: &Space,
    start: Instant,
    progress: &mut dyn FnMut(f64) -> bool,
) -> Result<Calibration, Diagnostic> {
    let scale = Scale::of_view(&options.camera, options.size, subject.plan.bounding_radius);
    let marching = Marching::new(subject, options, scale);
    let rays = view_rays(&options.camera, options.size, MOST_TRUTHS, options.seed);
    let (pilot, work) = marching.pilot(&space.plan(&space.by_rule()), &rays)?;
    let mut meter = Meter::new(options, pilot.price);
    meter.compiled(&work);
    let truths = find_truths(subject, (&rays, scale), (&mut meter, SHARE_OF_TRUTH, ENOUGH_HITS), progress)?;
    let [hits, misses, _] = truths.counts();
    let mut outcome = Race::new(options, space, &truths, marching, (&mut meter, pilot)).run(progress)?;
    if !progress(ALMOST_DONE) {
        return Ok(without_measuring(subject, Origin::Rules, (options.budget, options.size.height), start));
    }
    let terms = Terms { budget: &options.budget, proof: space.wants_proof };
    let mut health: Option<Health> = None;
    let mut jumps = || {
        let found = match health.take() {
            Some(found) => found,
            None => check_steps(subject)?,
        };
        Ok::<bool, Diagnostic>(health.insert(found).findings.iter().any(|finding| finding.kind == Kind::Jump))
    };
    let fresh = view_rays(&options.camera, options.size, MOST_TRUTHS, options.seed + 2);
    let mut extra = Meter::new(options, pilot.price);
    let fresh = find_truths(subject, (&fresh, scale), (&mut extra, SHARE_OF_FRESH, FRESH_HITS), &mut |_| {
        progress(ALMOST_DONE)
    })?;
    let mut evidence = rows(&outcome.tried, terms, &mut jumps)?;
    for _ in 0..CONFIRMED {
        let chosen = evidence.iter().position(Row::is_chosen);
        let Some(chosen) = chosen.filter(|at| outcome.tried[*at].1.fresh.is_none()) else { break };
        outcome.confirm(chosen, &fresh);
        evidence = rows(&outcome.tried, terms, &mut jumps)?;
    }
    let tally = evidence.iter().position(Row::is_chosen).map(|at| &outcome.tried[at].1);
    let is_within = tally.is_some_and(|tally| tally.is_within(&options.budget));
    let row = evidence.iter().find(|row| row.is_chosen());
    let chosen = row.map_or_else(|| space.by_rule(), |row| row.candidate);
    let mut plan = space.plan(&chosen);
    if let Some(row) = row {
        let reason = reason(row);
        plan.choices.iter_mut().for_each(|choice| choice.reason = reason.clone());
    }
    let mut warnings = Vec::new();
    warnings.extend(space.unproven.clone());
    let health = health.filter(|_| !is_within);
    warnings.extend(row.zip(health).map(|(row, health)| blame::warning(&health, &options.budget, row)));
    let by_double = || tally.map_or(Ok(false), |tally| double_helps(subject, options, (&plan, tally), &fresh));
    let wants_double = options.precision == Precision::F32 && !is_within && by_double()?;
    let doubt = tally.filter(|_| is_within).and_then(|tally| blame::doubt(tally, &options.budget));
    warnings.extend(doubt);
    Ok(Calibration {
        chosen: chosen.settings(),
        plan,
        origin: Origin::Measured,
        budget: options.budget,
        is_within,
        wants_double,
        rows: options.size.height,
        evidence,
        rays: [hits + misses, hits],
        warnings,
        notes: outcome.notes,
        time: start.elapsed(),
    })
}

/// Whether the march of a choice that breaks the budget in single precision does far better in double precision, on the same rays.
fn double_helps(
    subject: &Subject,
    options: &Options,
    (plan, tally): (&Plan, &Tally),
    fresh: &Truths,
) -> Result<bool, Diagnostic> {
    let options = Options { precision: Precision::F64, ..options.clone() };
    let marching = Marching::new(subject, &options, fresh.scale);
    let march = marching.compile(&marching.compose(plan)?);
    let mut double = Tally::default();
    double.add_fresh(&fresh.judge(&marching.run(&march, &fresh.rays)));
    Ok(double.excess(&options.budget).0 <= (DOUBLE_HELPS * tally.excess(&options.budget).0).max(1.0))
}

fn reason(row: &Row) -> String {
    format!(
        "measured: of {} hits {:.2} % missed, of {} stops {:.2} % early",
        row.missed.of,
        100.0 * row.missed.share(),
        row.early.of,
        100.0 * row.early.share()
    )
}

/// The truth of a few rays, then of as many more as may be walked and the hits call for.
fn find_truths(
    subject: &Subject,
    (rays, scale): (&[Ray], Scale),
    (meter, most, hits): (&mut Meter, f64, usize),
    progress: &mut dyn FnMut(f64) -> bool,
) -> Result<Truths, Diagnostic> {
    let composer = subject.composer();
    let mut truths = Truths::find(&composer, &subject.plan.choices, &rays[..FIRST_RAYS], scale, &mut |_| true)?;
    let each = truths.members().operations() / FIRST_RAYS as f64;
    let affordable = (most * meter.limit() / each.max(1.0)) as usize;
    let share = truths.counts()[0].max(1) as f64 / FIRST_RAYS as f64;
    let wanted = (hits as f64 / share) as usize;
    let count = wanted.min(affordable).clamp(FIRST_RAYS, MOST_TRUTHS);
    // Dust costs more than the first rays show.
    for portion in rays[FIRST_RAYS..count].chunks(PORTION) {
        if truths.members().operations() > most * meter.limit() {
            break;
        }
        truths.extend(portion, &mut |_| true);
        if !progress(most * truths.rays.len() as f64 / count as f64) {
            break;
        }
    }
    meter.spend(truths.members().operations());
    Ok(truths)
}

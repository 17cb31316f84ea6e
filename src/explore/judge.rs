//! Which drafts are worth a picture.

use std::sync::Arc;

use super::{Parent, Survivor};
use crate::calibrate::written::with_outcome;
use crate::calibrate::{Options, calibrate};
use crate::check::Subject;
use crate::check::truth::{Budget, End, Scale, candidate, march_rays};
use crate::compose::{Composer, Plan};
use crate::diag::Diagnostic;
use crate::engine::{Engine, Error, Formula, Job, MOST_EDGE, Request, Settling};
use crate::expr::Arena;
use crate::graph::{CALIBRATED_ROWS, ValidGraph};
use crate::kernel::Status;
use crate::kernel::cpu::Cpu;
use crate::march::MarchSettings;
use crate::math::Precision;
use crate::shade::{Size, rays};

/// Columns of the grid of rays that looks at a draft.
const COLUMNS: u32 = 96;
/// Share of the picture that is hit: at least, and at most. Pictures count every pixel, and may see a bit more or less.
const HITS: [f64; 2] = [0.04, 0.96];
/// Share of the hits that have less than two hits among their four neighbours: at most.
const DUST: f64 = 0.12;
/// Share of the picture's edge that is hit: at most, or so many times as much as of the parent.
const EDGE: f64 = 0.04;
const EDGE_OF_PARENT: f64 = 1.5;
/// Estimates a ray: at most so many times as many as of the parent. Five times is too slow, and other rays take some more.
const SLOWER: f64 = 4.0;
/// Share of the hits that lie in a hollow: at least, or half as many as of the parent. Balls and boxes have none.
const HOLLOW: f64 = 0.02;
/// Depth of a hollow between neighbours, in footprints: at least.
const DEEP: f64 = 0.5;
/// Pixels of two pictures that differ, of all that are hit in one of them: less than this is alike. Depths differ by a share of themselves.
const DIFFERENT: f64 = 0.04;
const OF_DEPTH: f64 = 0.02;
/// Share of rays that run out of steps, or whose estimate is no number: at most.
const LOST: f64 = 0.02;

/// Why a draft is rejected.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum Reason {
    /// It cannot be read or composed.
    Broken,
    /// There is next to nothing to be seen.
    Empty,
    /// It fills the picture.
    Full,
    /// It falls apart into single pixels.
    Dust,
    /// It is as good as a ball or a box.
    Plain,
    /// The frame cuts it.
    Cut,
    /// It takes over five times the estimates of its parent.
    Slow,
    /// No estimate of it keeps the error budget.
    Inexact,
    /// It looks like another one that was accepted before.
    Alike,
}

impl Reason {
    /// All of them.
    pub const ALL: [Reason; 9] = [
        Reason::Broken,
        Reason::Empty,
        Reason::Full,
        Reason::Dust,
        Reason::Plain,
        Reason::Cut,
        Reason::Slow,
        Reason::Inexact,
        Reason::Alike,
    ];

    /// What a draft is that is rejected for it: `3 cut by the frame`.
    pub fn name(self) -> &'static str {
        match self {
            Reason::Broken => "broken",
            Reason::Empty => "empty",
            Reason::Full => "full",
            Reason::Dust => "dust",
            Reason::Plain => "plain",
            Reason::Cut => "cut by the frame",
            Reason::Slow => "too slow",
            Reason::Inexact => "badly estimated",
            Reason::Alike => "like another one",
        }
    }
}

/// A draft that is worth a picture.
pub struct Accepted {
    /// The picture, with everything settled.
    pub job: Job,
    /// Share of it that is hit.
    pub hits: f64,
    /// Estimates a ray, of all rays of the picture.
    pub estimates: f64,
    /// Depths of a grid of rays, not a number where nothing is hit.
    depths: Vec<f64>,
}

/// Whether two pictures look the same, by their depths.
fn is_like(one: &[f64], other: &[f64]) -> bool {
    let (mut any, mut different) = (0, 0);
    for (a, b) in one.iter().zip(other) {
        let is_hit = [!a.is_nan(), !b.is_nan()];
        any += usize::from(is_hit[0] || is_hit[1]);
        different += usize::from(is_hit[0] != is_hit[1] || (a - b).abs() > OF_DEPTH * a);
    }
    (different as f64) < DIFFERENT * any as f64
}

/// What a grid of rays sees. Shares are from 0 to 1.
#[derive(Clone, Default, Debug)]
struct Sight {
    hits: f64,
    dust: f64,
    hollow: f64,
    edge: f64,
    lost: f64,
    estimates: f64,
    depths: Vec<f64>,
}

/// What is accepted, or why not, with the messages of what is broken.
pub type Verdict = Result<Accepted, (Reason, Option<Error>)>;

/// Looks at drafts as pictures of one request, beside what their parents show.
pub struct Judge {
    request: Request,
    /// Of the parents the largest values, of hollows the least.
    usual: Sight,
}

impl Judge {
    /// The judge of drafts of these parents.
    ///
    /// Errors: [`Error::Formula`], [`Error::Request`] of the parents' own pictures.
    pub fn of(engine: &Engine, parents: &[Arc<Formula>], request: &Request) -> Result<Judge, Error> {
        let mut usual = Sight { hollow: f64::INFINITY, ..Sight::default() };
        for parent in parents {
            let job = engine.settle(parent, request, &mut ())?;
            let sight = of_job(&job)?;
            usual.hits = usual.hits.max(sight.hits);
            usual.dust = usual.dust.max(sight.dust);
            usual.hollow = usual.hollow.min(sight.hollow);
            usual.edge = usual.edge.max(sight.edge);
            usual.lost = usual.lost.max(sight.lost);
            usual.estimates = usual.estimates.max(sight.estimates);
        }
        Ok(Judge { request: request.clone(), usual })
    }

    /// Judges the text of a draft beside those that were accepted before.
    pub fn judge(&self, engine: &Engine, parent: &Parent, text: &str, known: &[Survivor]) -> Verdict {
        let broken = |error| (Reason::Broken, Some(error));
        let formula = parent.read(text).map_err(broken)?;
        // By the plan of the rules first: most of what is rejected costs no calibration.
        let sight = by_rules(&formula, &self.request).map_err(broken)?;
        self.shows_something(&sight).map_err(|reason| (reason, None))?;
        if known.iter().any(|other| is_like(&sight.depths, &other.accepted.depths)) {
            return Err((Reason::Alike, None));
        }
        let job = engine.settle(&formula, &self.request, &mut ()).map_err(broken)?;
        let sight = of_job(&job).map_err(broken)?;
        self.shows_something(&sight).map_err(|reason| (reason, None))?;
        let is_exact = job.calibration.as_ref().is_none_or(|calibration| calibration.is_within);
        if !is_exact || sight.lost > LOST.max(self.usual.lost) {
            return Err((Reason::Inexact, None));
        }
        if sight.estimates > SLOWER * self.usual.estimates {
            return Err((Reason::Slow, None));
        }
        Ok(Accepted { job, hits: sight.hits, estimates: sight.estimates, depths: sight.depths })
    }

    /// Whether a sight is worth a picture.
    fn shows_something(&self, sight: &Sight) -> Result<(), Reason> {
        let [least, most] = HITS;
        match sight {
            _ if sight.hits < least => Err(Reason::Empty),
            // Inside of a parent there is no sky either.
            _ if sight.hits > most.max(self.usual.hits) => Err(Reason::Full),
            _ if sight.dust > DUST.max(EDGE_OF_PARENT * self.usual.dust) => Err(Reason::Dust),
            _ if sight.hollow < HOLLOW.min(0.5 * self.usual.hollow) => Err(Reason::Plain),
            _ if sight.edge > EDGE.max(EDGE_OF_PARENT * self.usual.edge) => Err(Reason::Cut),
            _ => Ok(()),
        }
    }
}

/// Shares of the error budget that an estimate is written for: one that keeps all of it on some rays may break it on others.
const STRICTER: [f64; 2] = [0.25, 0.5];

/// The text of a draft that was accepted, with an estimate measured for pictures of the size for which files are calibrated, so that it renders alone as it was
/// judged. Where nothing is to be measured, or none keeps a share of the budget, the text leaves the choice to whoever renders it.
///
/// Errors: [`Error::Formula`].
pub(super) fn with_estimate(formula: &Formula, text: &str, request: &Request) -> Result<String, Error> {
    if !request.calibrate {
        return Ok(text.to_string());
    }
    let arena = Arc::new(Arena::default());
    let height = CALIBRATED_ROWS;
    let wide = u64::from(request.size.width) * u64::from(height) / u64::from(request.size.height.max(1));
    let size = Size { width: u32::try_from(wide).unwrap_or(height).clamp(1, MOST_EDGE), height };
    let request = Request { size, ..request.clone() };
    let settling = Settling { library: formula.library(), arena: &arena, request: &request };
    let graph = settling.framed(formula.graph().clone())?.graph;
    let plan = settling.plan(&graph)?;
    let subject = Subject { library: formula.library(), graph: &graph, arena: &arena, plan };
    for share in STRICTER {
        let budget =
            Budget { missed: request.budget.missed * share, early: request.budget.early * share, ..request.budget };
        let options = Options { budget, cache: None, ..settling.options(&subject, Precision::F32) };
        let calibration = calibrate(&subject, &options, &mut |_| true);
        let calibration = calibration.map_err(|message| Error::of_formula(message, &formula.library().sources))?;
        if calibration.is_within
            && !calibration.wants_double
            && let Some(text) = with_outcome(&subject, formula.text(), &calibration)
        {
            return Ok(text);
        }
    }
    Ok(text.to_string())
}

/// What is seen of a job.
fn of_job(job: &Job) -> Result<Sight, Error> {
    let arena = Arc::new(Arena::default());
    let graph = job.graph();
    let library = job.formula.library();
    let composer = Composer { arena: &arena, library, graph: &graph };
    sight(&composer, &job.plan, job.size(), job.precision)
        .map_err(|message| Error::of_formula(message, &library.sources))
}

/// What is seen of a formula by the plan of the rules.
fn by_rules(formula: &Formula, request: &Request) -> Result<Sight, Error> {
    let arena = Arc::new(Arena::default());
    let library = formula.library();
    let settling = Settling { library, arena: &arena, request };
    let graph: ValidGraph = settling.seen(formula.graph().clone())?;
    let plan = settling.plan(&graph)?;
    let composer = Composer { arena: &arena, library, graph: &graph };
    sight(&composer, &plan, request.size, Precision::F32)
        .map_err(|message| Error::of_formula(message, &library.sources))
}

/// Marches a grid of rays through the picture.
fn sight(composer: &Composer, plan: &Plan, size: Size, precision: Precision) -> Result<Sight, Diagnostic> {
    let rows = (COLUMNS * size.height / size.width.max(1)).clamp(8, 4 * COLUMNS);
    let camera = crate::render::camera_of(composer, plan);
    let plan = plan.clone().in_precision(precision);
    let scale = Scale::of_view(&camera, size, plan.bounding_radius);
    let settings = MarchSettings::of_plan(&plan, scale.pixel, precision);
    let march = candidate(composer, &plan.choices, &settings)?;
    let place = |i: u32| {
        let [column, row] = [i % COLUMNS, i / COLUMNS].map(|at| f64::from(at) + 0.5);
        [column / f64::from(COLUMNS) * f64::from(size.width), row / f64::from(rows) * f64::from(size.height)]
    };
    let places: Vec<[f64; 2]> = (0..COLUMNS * rows).map(place).collect();
    let rays = rays(&camera, size, &places);
    let ends = march_rays(&Cpu::new(precision), composer.arena, &march, &rays, scale.bounding_radius);
    let ends = ends.expect("the CPU runs every kernel");
    // A pixel of the grid is wider than one of the picture.
    let wider = f64::from(size.width) / f64::from(COLUMNS);
    let hollow = hollow(&ends, COLUMNS as usize, |depth| scale.footprint(depth) * wider);
    Ok(Sight { hollow, ..seen(&ends, COLUMNS as usize) })
}

/// What the ends of rays show, row by row.
fn seen(ends: &[End], columns: usize) -> Sight {
    let rows = ends.len() / columns;
    let is_hit = |column: usize, row: usize| ends[row * columns + column].depth().is_some();
    let (mut hits, mut alone, mut edge) = (0, 0, 0);
    for row in 0..rows {
        for column in (0..columns).filter(|column| is_hit(*column, row)) {
            let beside = [
                column > 0 && is_hit(column - 1, row),
                column + 1 < columns && is_hit(column + 1, row),
                row > 0 && is_hit(column, row - 1),
                row + 1 < rows && is_hit(column, row + 1),
            ];
            hits += 1;
            alone += usize::from(beside.iter().filter(|hit| **hit).count() < 2);
            edge += usize::from(column == 0 || row == 0 || column + 1 == columns || row + 1 == rows);
        }
    }
    let share = |count: usize, of: usize| count as f64 / of.max(1) as f64;
    let is_lost = |end: &&End| end.nan || end.status == Status::Unfinished;
    Sight {
        hits: share(hits, ends.len()),
        dust: share(alone, hits),
        edge: share(edge, 2 * (columns + rows) - 4),
        lost: share(ends.iter().filter(is_lost).count(), ends.len()),
        estimates: ends.iter().map(|end| end.estimates as f64).sum::<f64>() / ends.len().max(1) as f64,
        depths: ends.iter().map(|end| end.depth().unwrap_or(f64::NAN)).collect(),
        ..Sight::default()
    }
}

/// Share of the hits that are farther than the middle between two opposite neighbours: the front of what is convex has none.
fn hollow(ends: &[End], columns: usize, footprint: impl Fn(f64) -> f64) -> f64 {
    let (mut hits, mut hollow) = (0_usize, 0_usize);
    for (i, end) in ends.iter().enumerate() {
        let Some(depth) = end.depth() else { continue };
        let beside = |by: usize| {
            let [before, behind] = [ends.get(i.wrapping_sub(by)), ends.get(i + by)];
            Some(0.5 * (before?.depth()? + behind?.depth()?))
        };
        let column = i % columns;
        let across = (column > 0 && column + 1 < columns).then(|| beside(1)).flatten();
        let is_behind = |middle: Option<f64>| middle.is_some_and(|middle| depth > middle + DEEP * footprint(depth));
        hits += 1;
        hollow += usize::from(is_behind(across) || is_behind(beside(columns)));
    }
    hollow as f64 / hits.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::{End, Status, hollow, is_like, seen};

    /// Ends of rays from a picture of `#` and `.`.
    fn ends(rows: &[&str]) -> Vec<End> {
        let end = |c: char| End {
            status: if c == '#' { Status::Hit } else { Status::Miss },
            t: 1.0,
            estimates: if c == '#' { 10 } else { 2 },
            iterations: 0,
            nan: false,
            undecided: false,
        };
        rows.iter().flat_map(|row| row.chars().map(end)).collect()
    }

    #[test]
    fn a_block_in_the_middle_is_no_dust() {
        let sight = seen(&ends(&["......", "..##..", "..##..", "......"]), 6);
        assert_eq!((sight.hits, sight.dust, sight.edge, sight.lost), (4.0 / 24.0, 0.0, 0.0, 0.0));
        assert_eq!(sight.estimates, (4.0 * 10.0 + 20.0 * 2.0) / 24.0);
    }

    /// Depths of a row: the front of a ball, and the same with a hole.
    #[test]
    fn balls_have_no_hollow() {
        let row = |depths: &[f64]| {
            let mut ends = ends(&["#######"]);
            ends.iter_mut().zip(depths).for_each(|(end, depth)| end.t = *depth);
            hollow(&ends, 7, |_| 0.1)
        };
        assert_eq!(row(&[2.0, 1.4, 1.1, 1.0, 1.1, 1.4, 2.0]), 0.0);
        assert_eq!(row(&[2.0, 1.4, 1.1, 1.6, 1.1, 1.4, 2.0]), 1.0 / 7.0);
        assert_eq!(row(&[1.0, 1.04, 1.0, 1.04, 1.0, 1.04, 1.0]), 0.0);
    }

    #[test]
    fn pictures_are_alike_where_few_pixels_differ() {
        let of = |changed: usize| -> Vec<f64> {
            (0..100)
                .map(|i| {
                    if i < changed {
                        1.1
                    } else if i < 90 {
                        1.0
                    } else {
                        f64::NAN
                    }
                })
                .collect()
        };
        // Of 90 pixels that are hit, 4 % are 3.6.
        assert!(is_like(&of(3), &of(0)) && !is_like(&of(4), &of(0)));
        let empty: Vec<f64> = (0..100).map(|i| if i < 86 { 1.0 } else { f64::NAN }).collect();
        assert!(!is_like(&empty, &of(0)));
    }

    #[test]
    fn single_pixels_are_dust_and_what_leaves_the_frame_is_at_its_edge() {
        let sight = seen(&ends(&["#.....", "..#.#.", "......", "###..."]), 6);
        assert_eq!((sight.hits, sight.dust), (6.0 / 24.0, 5.0 / 6.0));
        // Four of the 16 pixels of the edge.
        assert_eq!(sight.edge, 4.0 / 16.0);
    }
}

//! The race: candidates march the rays of the truth, the cheapest first, until one keeps the budget.
//!
//! Marching a few hundred rays takes a fraction of a millisecond, composing and compiling a march takes several. So all
//! rays are marched at once, and time is saved by trying few candidates: they are ordered by the cost that is expected of
//! them, which is corrected by what has been measured, and a candidate's more careful neighbours (a smaller step
//! multiplier, a shorter least step) are only looked at where it failed for something that they may mend.

use std::time::{Duration, Instant};

use super::{BESIDES_PRIMARY, Candidate, Options, Row, Space, Verdict};
use crate::check::truth::{
    End, Judgement, Ray, Scale, Truths, candidate as candidate_march, ends, ray_columns, view_rays,
};
use crate::check::{Backends, Subject};
use crate::compose::{ComposeResult, Plan};
use crate::graph::Method;
use crate::kernel::work::Work;
use crate::kernel::{Kernel, Status, march_output_ports};
use crate::march::{MarchSettings, is_undecided};
use crate::render::in_precision;

/// By what power of 1 / fudge the cost is expected to grow, and by what factor for a shortest step a quarter as long.
const COST_OF_FUDGE: f64 = 0.8;
const COST_OF_LEAST_STEP: f64 = 1.15;
/// Estimates that a proof or a form that the rules did not take is expected to need, compared with the others.
const COST_OF_PROOF: f64 = 1.3;
const COST_OF_OTHER_FORM: f64 = 1.3;
/// Candidates that are tried even where that takes longer than it may.
const FEWEST: usize = 3;
/// Rays that the render's time is taken from.
const TIMED_RAYS: usize = 512;
/// Share of the missed hits of the budget that a choice may come to: rays that nobody looked at shall keep the budget, too.
const MARGIN: f64 = 0.25;
/// The same where proofs get stuck at most hits, as on maps that jump: nobody knows then what careful marches miss.
const MARGIN_WITHOUT_PROOF: f64 = 0.05;
/// Share of the early stops of the budget that a choice may come to, for the same reason.
const MARGIN_OF_EARLY: f64 = 0.5;
/// Share of the hits that are not decided by proofs.
const MOSTLY: f64 = 0.5;
/// Hits without truth that candidates are compared with each other on, and the fewest and most rays for them.
const COMPARED_HITS: f64 = 3000.0;
const COMPARED_RAYS: [usize; 2] = [3000, 12_000];
/// A stop this many footprints behind a known member has passed it, as in [`Judgement`].
const BEHIND_FOOTPRINTS: f64 = 2.0;
/// Beyond this many times the budget, and where it is not thin things that are missed, a candidate's next smaller step
/// multiplier is passed over, and shorter least steps are not tried.
const HOPELESS: f64 = 6.0;
/// What is not at least so much better is no help.
const HELP: f64 = 0.8;

/// How a candidate is more careful than the one before it.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Axis {
    Fudge,
    LeastStep,
}

/// A candidate that has not been tried.
struct Entry {
    candidate: Candidate,
    /// Operations a ray that are expected.
    expected: f64,
    /// What makes it more careful than the candidate that failed before it, and that one's excess.
    after: Option<(Axis, f64)>,
}

/// More rays, without a truth: wherever a march stops on a member of the set, whoever passes it there has missed it.
struct Compared {
    rays: Vec<Ray>,
    columns: Vec<Vec<f64>>,
    /// Depth of the first known member of each ray, or infinity.
    known: Vec<f64>,
}

impl Compared {
    /// Hits that are known, and how many of them these ends passed; the ends' own stops are known from now on.
    fn passed(&mut self, ends: &[End], truths: &Truths) -> [usize; 2] {
        let footprint = |t: f64| truths.scale.footprint(t);
        // Orbits that ended at the footprint say nothing about members.
        let nearer = |i: &usize| ends[*i].depth().is_some_and(|t| t < self.known[*i]);
        let stops: Vec<usize> = (0..ends.len()).filter(nearer).collect();
        let places: Vec<(Ray, f64)> = stops.iter().map(|&i| (self.rays[i], ends[i].t)).collect();
        for (&i, is_member) in stops.iter().zip(truths.are_members(&places)) {
            if is_member {
                self.known[i] = ends[i].t;
            }
        }
        let pairs = || self.known.iter().zip(ends).filter(|(known, _)| known.is_finite());
        let is_passed =
            |known: f64, end: &End| end.depth().is_none_or(|t| t > known + BEHIND_FOOTPRINTS * footprint(known));
        [pairs().count(), pairs().filter(|(known, end)| is_passed(**known, end)).count()]
    }
}

/// A candidate that has been tried.
struct Tried {
    row: Row,
    /// How far it is outside the budget: 1 is just inside, 2 is twice as much as is allowed.
    excess: f64,
}

pub(super) struct Race<'a> {
    subject: &'a Subject<'a>,
    options: &'a Options,
    space: &'a Space,
    truths: &'a Truths,
    backends: Backends,
    columns: Vec<Vec<f64>>,
    compared: Compared,
    margin: f64,
    open: Vec<Entry>,
    tried: Vec<Tried>,
}

/// How long a render will take, going by a march of the rules' plan on a few rays of the view.
pub(super) fn time_of_render(subject: &Subject, options: &Options, space: &Space) -> ComposeResult<Duration> {
    if options.primary_rays == 0 {
        return Ok(Duration::ZERO);
    }
    let rays = view_rays(&options.camera, options.size, TIMED_RAYS, options.seed);
    let scale = Scale::of_view(&options.camera, options.size, subject.plan.bounding_radius);
    let kernel = march(subject, options, scale, &space.plan(&space.by_rule()))?;
    let columns = ray_columns(&rays, scale.bounding_radius);
    let timed = Backends::cpu_only().run_timed(options.target, subject.arena, &kernel, &columns);
    let (_, time) = timed.expect("the CPU runs every kernel");
    let times = options.primary_rays as f64 / TIMED_RAYS as f64;
    Ok(time.mul_f64(times * (1.0 + BESIDES_PRIMARY) / rayon::current_num_threads().max(1) as f64))
}

/// The march of a plan, in the precision of the options.
fn march(subject: &Subject, options: &Options, scale: Scale, plan: &Plan) -> ComposeResult<Kernel> {
    let least = options.target.min_difference();
    let plan = in_precision(plan.clone(), least);
    let settings = MarchSettings::of_plan(&plan, scale.pixel_radius, least);
    candidate_march(&subject.composer(), &plan.choices, &settings)
}

/// Share of the hits of a march of proofs that it walked up to, or crossed something before, without proof.
fn share_undecided(out: &[Vec<f64>]) -> f64 {
    let at =
        |name: &str| march_output_ports().iter().position(|p| p.name == name).expect("a march gives these columns");
    let [last, steps, status] = ["last_de", "steps", "status"].map(at);
    let hit = |i: &usize| Status::from_code(out[status][*i]) == Status::Hit;
    let hits: Vec<usize> = (0..out[status].len()).filter(hit).collect();
    let open = hits.iter().filter(|&&i| is_undecided(out[last][i], out[steps][i], Status::Hit)).count();
    open as f64 / hits.len().max(1) as f64
}

impl<'a> Race<'a> {
    pub(super) fn new(subject: &'a Subject, options: &'a Options, space: &'a Space, truths: &'a Truths) -> Race<'a> {
        let columns = ray_columns(&truths.rays, truths.scale.bounding_radius);
        let share = truths.counts()[0].max(1) as f64 / truths.rays.len().max(1) as f64;
        let [fewest, most] = COMPARED_RAYS;
        let count = ((COMPARED_HITS / share) as usize).clamp(fewest, most);
        let rays = view_rays(&options.camera, options.size, count, options.seed + 1);
        let compared = Compared {
            columns: ray_columns(&rays, truths.scale.bounding_radius),
            known: vec![f64::INFINITY; rays.len()],
            rays,
        };
        let backends = Backends::cpu_only();
        let (open, tried) = (Vec::new(), Vec::new());
        Race { subject, options, space, truths, backends, columns, compared, margin: MARGIN, open, tried }
    }

    fn kernel(&self, plan: &Plan) -> ComposeResult<Kernel> {
        march(self.subject, self.options, self.truths.scale, plan)
    }

    fn plan(&self, candidate: &Candidate) -> Plan {
        self.space.plan(candidate)
    }

    /// Runs until nothing is expected to be cheaper than the cheapest that keeps the budget, or until the time or the
    /// candidates come to an end.
    pub(super) fn run(&mut self, deadline: Instant, told: &mut dyn FnMut()) -> ComposeResult<()> {
        self.line_up()?;
        for careful in self.space.careful() {
            let plan = self.plan(&careful);
            let kernel = self.kernel(&plan)?;
            let out = self.compared_ends(&kernel);
            if plan.is_certified() && share_undecided(&out) > MOSTLY {
                self.margin = MARGIN_WITHOUT_PROOF;
            }
            self.passed(&out);
        }
        while let Some(entry) = self.next() {
            let is_late = Instant::now() > deadline && self.tried.len() >= FEWEST;
            if is_late || self.cheapest().is_some_and(|cheapest| cheapest <= entry.expected) {
                break;
            }
            self.try_one(entry)?;
            told();
        }
        if self.cheapest().is_some() {
            return Ok(());
        }
        // Out of time, or of candidates: what is careful is worth a last look.
        for candidate in self.space.careful() {
            if self.cheapest().is_none() && !self.tried.iter().any(|tried| tried.row.candidate == candidate) {
                self.try_one(Entry { candidate, expected: 0.0, after: None })?;
            }
        }
        Ok(())
    }

    /// The least cost of those that keep the budget.
    fn cheapest(&self) -> Option<f64> {
        let within = self.tried.iter().filter(|tried| tried.excess <= 1.0);
        within.map(|tried| tried.row.cost).min_by(f64::total_cmp)
    }

    /// All kinds at their cheapest.
    fn line_up(&mut self) -> ComposeResult<()> {
        let fudge = self.space.fudges[0];
        for (method, form) in self.space.kinds.clone() {
            let candidate = Candidate { method, form, fudge, least_step: self.space.longest_step(method) };
            let plan = self.plan(&candidate);
            let work = Work::of(self.subject.arena, &self.kernel(&plan)?);
            let mut expected = work.total(1.0, f64::from(self.mean_iterations()));
            if plan.is_certified() {
                expected *= COST_OF_PROOF;
            }
            if form.is_some() {
                expected *= COST_OF_OTHER_FORM;
            }
            self.open.push(Entry { candidate, expected, after: None });
        }
        Ok(())
    }

    /// A rough number of iterations of an estimate; the same for all methods, so that only their order depends on it.
    fn mean_iterations(&self) -> u32 {
        let orbits = crate::compose::field_orbits(&self.subject.composer());
        orbits.iter().map(|orbit| orbit.settings.max_iterations.div_ceil(2)).max().unwrap_or(0)
    }

    fn next(&mut self) -> Option<Entry> {
        let order = |a: &usize, b: &usize| self.open[*a].expected.total_cmp(&self.open[*b].expected);
        let cheapest = (0..self.open.len()).min_by(order)?;
        Some(self.open.remove(cheapest))
    }

    /// Marches with a candidate.
    fn try_one(&mut self, entry: Entry) -> ComposeResult<()> {
        let candidate = entry.candidate;
        let kernel = self.kernel(&self.plan(&candidate))?;
        let work = Work::of(self.subject.arena, &kernel);
        let out = self.backends.run(self.options.target, self.subject.arena, &kernel, &self.columns);
        let judged = self.truths.judge(&ends(&out.expect("the CPU runs every kernel"), self.truths.rays.len()));
        let cost = work.total(judged.estimates, judged.iterations);
        let [known, passed] = {
            let out = self.compared_ends(&kernel);
            self.passed(&out)
        };
        let hits = judged.hits + known;
        let missed = ((judged.missed * judged.hits as f64).round() + passed as f64) / hits.max(1) as f64;
        let (why, excess) = self.judge(&judged, missed, hits);
        let row = Row {
            candidate,
            missed,
            early: judged.early,
            error: judged.median_error,
            estimates: judged.estimates,
            cost,
            verdict: Verdict::Fails(if excess <= 1.0 { "costs more".to_string() } else { why }),
        };
        if self.tried.is_empty() {
            // Now it is known how many estimates a ray takes.
            let scale = cost / entry.expected.max(1e-9);
            self.open.iter_mut().for_each(|open| open.expected *= scale);
        }
        if excess > 1.0 {
            let lost_thin = judged.missed_thin * judged.thin as f64;
            let is_thin = 2.0 * lost_thin >= judged.missed * judged.hits as f64;
            self.add_neighbours(&row, excess, is_thin, entry.after);
        }
        self.tried.push(Tried { row, excess });
        Ok(())
    }

    /// Where the budget is broken, in words, and by how much.
    ///
    /// Hundreds of hits say little about half a percent: so one more than was missed is counted, which is what a rate is on
    /// the average that shows so many misses. Where there are too few hits for even that, none may be missed.
    fn judge(&self, judged: &Judgement, missed: f64, hits: usize) -> (String, f64) {
        let budget = &self.options.budget;
        let expected = |share: f64, of: usize| match (share * of as f64).round() {
            0.0 => 0.0,
            count => (count + 1.0) / (of as f64 + 1.0),
        };
        let stops = judged.hits;
        let checks = [
            (expected(missed, hits) / (self.margin * budget.missed).max(1e-9), "misses too much"),
            // What no march finds is known to the truth alone.
            (judged.missed / budget.missed.max(1e-9), "misses too much"),
            (expected(judged.early, stops) / (MARGIN_OF_EARLY * budget.early).max(1e-9), "stops too early"),
            (judged.median_error / budget.error.max(1e-9), "depths are off"),
        ];
        let (excess, why) = checks.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, ""));
        (why.to_string(), excess)
    }

    /// Marches the rays that candidates are compared on.
    fn compared_ends(&self, kernel: &Kernel) -> Vec<Vec<f64>> {
        let out = self.backends.run(self.options.target, self.subject.arena, kernel, &self.compared.columns);
        out.expect("the CPU runs every kernel")
    }

    /// Hits that are known of these rays, and how many of them a march passed.
    fn passed(&mut self, out: &[Vec<f64>]) -> [usize; 2] {
        let ends = ends(out, self.compared.known.len());
        self.compared.passed(&ends, self.truths)
    }

    /// The more careful neighbours of a candidate that failed; `is_thin` says that what it missed is mostly thin. What did
    /// not help once is not tried further.
    fn add_neighbours(&mut self, row: &Row, excess: f64, is_thin: bool, after: Option<(Axis, f64)>) {
        let candidate = row.candidate;
        let is_hopeless = excess > HOPELESS && !is_thin;
        let helps = |axis: Axis| after.is_none_or(|(last, before)| last != axis || excess < HELP * before);
        let below = |list: &[f64], value: f64, skip: usize| {
            let smaller: Vec<f64> = list.iter().copied().filter(|x| *x < value).collect();
            smaller.get(skip.min(smaller.len().saturating_sub(1))).copied()
        };
        // A proof does not overshoot.
        let is_proof = candidate.method.is_some_and(Method::is_certified);
        if helps(Axis::Fudge)
            && !is_proof
            && let Some(fudge) = below(&self.space.fudges, candidate.fudge, usize::from(is_hopeless))
        {
            let expected = row.cost * (candidate.fudge / fudge).powf(COST_OF_FUDGE);
            self.add(Candidate { fudge, ..candidate }, expected, (Axis::Fudge, excess));
        }
        if helps(Axis::LeastStep)
            && !is_hopeless
            && let Some(least_step) = below(&self.space.least_steps, candidate.least_step, 0)
        {
            let expected = row.cost * COST_OF_LEAST_STEP;
            self.add(Candidate { least_step, ..candidate }, expected, (Axis::LeastStep, excess));
        }
    }

    fn add(&mut self, candidate: Candidate, expected: f64, after: (Axis, f64)) {
        let is_known = self.open.iter().any(|open| open.candidate == candidate)
            || self.tried.iter().any(|tried| tried.row.candidate == candidate);
        if !is_known {
            self.open.push(Entry { candidate, expected, after: Some(after) });
        }
    }

    /// The choice and all evidence: the cheapest that keeps the budget; where none does, the least bad.
    pub(super) fn finish(mut self) -> (Candidate, Vec<Row>) {
        let badness = |tried: &Tried| (tried.excess.max(1.0), tried.row.cost);
        let order = |a: &&mut Tried, b: &&mut Tried| {
            let (a, b) = (badness(a), badness(b));
            a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
        };
        if let Some(best) = self.tried.iter_mut().min_by(order) {
            best.row.verdict = Verdict::Chosen;
        }
        let rows: Vec<Row> = self.tried.into_iter().map(|tried| tried.row).collect();
        let chosen = rows.iter().find(|row| row.is_chosen()).map(|row| row.candidate);
        (chosen.unwrap_or_else(|| self.space.by_rule()), rows)
    }
}

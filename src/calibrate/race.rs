//! The race: candidates march the rays of the truth, the cheapest first, until one keeps the budget.
//!
//! Marching a few hundred rays takes a fraction of a millisecond, composing and compiling a march takes several. So all
//! rays are marched at once, and time is saved by trying few candidates: they are ordered by the cost that is expected of
//! them, which is corrected by what has been measured, and a candidate's more careful neighbours (a smaller step
//! multiplier, a shorter least step) are only looked at where it failed for something that they may mend.

use std::time::{Duration, Instant};

use super::{BESIDES_PRIMARY, Candidate, Options, Row, Space, Verdict};
use crate::check::truth::{Judgement, Truths, candidate as candidate_march, ends, ray_columns};
use crate::check::{Backends, Subject};
use crate::compose::{ComposeResult, Plan};
use crate::graph::Method;
use crate::kernel::Kernel;
use crate::kernel::work::Work;
use crate::march::MarchSettings;

/// By what power of 1 / fudge the cost is expected to grow, and by what factor for a shortest step a quarter as long.
const COST_OF_FUDGE: f64 = 0.8;
const COST_OF_LEAST_STEP: f64 = 1.15;
/// Estimates that a proof or a form that the rules did not take is expected to need, compared with the others.
const COST_OF_PROOF: f64 = 1.3;
const COST_OF_OTHER_FORM: f64 = 1.3;
/// Candidates that are tried even where that takes longer than it may.
const FEWEST: usize = 3;
/// Estimates after which a ray is unfinished, as in a render.
const MAX_MARCH_STEPS: u32 = 1000;

/// A candidate that has not been tried.
struct Entry {
    candidate: Candidate,
    /// Operations a ray that are expected.
    expected: f64,
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
    open: Vec<Entry>,
    tried: Vec<Tried>,
}

impl<'a> Race<'a> {
    pub(super) fn new(subject: &'a Subject, options: &'a Options, space: &'a Space, truths: &'a Truths) -> Race<'a> {
        let columns = ray_columns(&truths.rays, truths.scale.bounding_radius);
        let backends = Backends::cpu_only();
        Race { subject, options, space, truths, backends, columns, open: Vec::new(), tried: Vec::new() }
    }

    fn kernel(&self, plan: &Plan) -> ComposeResult<Kernel> {
        let least = self.options.target.min_difference();
        let settings = MarchSettings {
            max_march_steps: MAX_MARCH_STEPS,
            ..MarchSettings::of_plan(plan, self.truths.scale.pixel_radius, least)
        };
        candidate_march(&self.subject.composer(), &plan.choices, &settings)
    }

    fn plan(&self, candidate: &Candidate) -> Plan {
        crate::render::in_precision(self.space.plan(candidate), self.options.target.min_difference())
    }

    /// How long the render will take, going by the rules' plan on these rays.
    pub(super) fn time_of_render(&self) -> ComposeResult<Duration> {
        if self.options.primary_rays == 0 {
            return Ok(Duration::ZERO);
        }
        let kernel = self.kernel(&self.plan(&self.space.by_rule()))?;
        let timed = self.backends.run_timed(self.options.target, self.subject.arena, &kernel, &self.columns);
        let (_, time) = timed.expect("the CPU runs every kernel");
        let rays = self.options.primary_rays as f64 / self.truths.rays.len().max(1) as f64;
        Ok(time.mul_f64(rays * (1.0 + BESIDES_PRIMARY) / rayon::current_num_threads().max(1) as f64))
    }

    /// Runs until a candidate keeps the budget (true), or the time or the candidates come to an end.
    pub(super) fn run(&mut self, deadline: Instant, told: &mut dyn FnMut()) -> ComposeResult<bool> {
        self.line_up()?;
        while let Some(entry) = self.next() {
            if Instant::now() > deadline && self.tried.len() >= FEWEST {
                break;
            }
            if self.try_one(entry)? {
                return Ok(true);
            }
            told();
        }
        // Out of time, or of candidates: a proof is worth a last look.
        let proof = Candidate {
            method: Some(Method::Certified),
            form: None,
            fudge: self.space.fudges[0],
            least_step: self.space.least_steps[self.space.least_steps.len().min(3) - 1],
        };
        let knows_proofs = self.space.kinds.contains(&(Some(Method::Certified), None));
        if knows_proofs && !self.tried.iter().any(|tried| tried.row.candidate == proof) {
            return self.try_one(Entry { candidate: proof, expected: 0.0 });
        }
        Ok(false)
    }

    /// All kinds at their cheapest.
    fn line_up(&mut self) -> ComposeResult<()> {
        let (fudge, least_step) = (self.space.fudges[0], self.space.least_steps[0]);
        for (method, form) in self.space.kinds.clone() {
            let candidate = Candidate { method, form, fudge, least_step };
            let plan = self.plan(&candidate);
            let work = Work::of(self.subject.arena, &self.kernel(&plan)?);
            let mut expected = work.total(1.0, f64::from(self.mean_iterations()));
            if plan.is_certified() {
                expected *= COST_OF_PROOF;
            }
            if form.is_some() {
                expected *= COST_OF_OTHER_FORM;
            }
            self.open.push(Entry { candidate, expected });
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

    /// Marches with a candidate; true where it keeps the budget.
    fn try_one(&mut self, entry: Entry) -> ComposeResult<bool> {
        let candidate = entry.candidate;
        let kernel = self.kernel(&self.plan(&candidate))?;
        let work = Work::of(self.subject.arena, &kernel);
        let out = self.backends.run(self.options.target, self.subject.arena, &kernel, &self.columns);
        let judged = self.truths.judge(&ends(&out.expect("the CPU runs every kernel"), self.truths.rays.len()));
        let cost = work.total(judged.estimates, judged.iterations);
        let (why, excess) = self.judge(&judged);
        let row = Row {
            candidate,
            missed: judged.missed,
            early: judged.early,
            error: judged.median_error,
            estimates: judged.estimates,
            cost,
            verdict: if excess <= 1.0 { Verdict::Chosen } else { Verdict::Fails(why) },
        };
        if self.tried.is_empty() {
            // Now it is known how many estimates a ray takes.
            let scale = cost / entry.expected.max(1e-9);
            self.open.iter_mut().for_each(|open| open.expected *= scale);
        }
        if excess > 1.0 {
            self.add_neighbours(&row, &judged);
        }
        self.tried.push(Tried { row, excess });
        Ok(excess <= 1.0)
    }

    /// Where the budget is broken, in words, and by how much.
    ///
    /// A few hundred hits say little about half a percent: so one more than was missed is counted, which is what a rate
    /// is on the average that shows so many misses. Where there are too few hits for even that, none may be missed.
    fn judge(&self, judged: &Judgement) -> (String, f64) {
        let budget = &self.options.budget;
        let expected = |share: f64, of: usize| match (share * of as f64).round() {
            0.0 => 0.0,
            count => (count + 1.0) / (of as f64 + 1.0),
        };
        let stops = judged.hits;
        let checks = [
            (expected(judged.missed, judged.hits) / budget.missed.max(1e-9), "misses too much"),
            (expected(judged.early, stops) / budget.early.max(1e-9), "stops too early"),
            (judged.median_error / budget.error.max(1e-9), "depths are off"),
        ];
        let (excess, why) = checks.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, ""));
        (why.to_string(), excess)
    }

    /// The more careful neighbours of a candidate that failed.
    fn add_neighbours(&mut self, row: &Row, judged: &Judgement) {
        let candidate = row.candidate;
        let below = |list: &[f64], value: f64| list.iter().copied().find(|x| *x < value);
        let is_proof = candidate.method == Some(Method::Certified);
        // A proof does not overshoot, and shorter least steps find nothing but what is thin.
        let fudge = below(&self.space.fudges, candidate.fudge).filter(|_| !is_proof);
        let least_step = below(&self.space.least_steps, candidate.least_step).filter(|_| judged.missed_thin > 0.0);
        if let Some(fudge) = fudge {
            let expected = row.cost * (candidate.fudge / fudge).powf(COST_OF_FUDGE);
            self.add(Candidate { fudge, ..candidate }, expected);
        }
        if let Some(least_step) = least_step {
            self.add(Candidate { least_step, ..candidate }, row.cost * COST_OF_LEAST_STEP);
        }
    }

    fn add(&mut self, candidate: Candidate, expected: f64) {
        let is_known = self.open.iter().any(|open| open.candidate == candidate)
            || self.tried.iter().any(|tried| tried.row.candidate == candidate);
        if !is_known {
            self.open.push(Entry { candidate, expected });
        }
    }

    /// The choice and all evidence. Where nothing kept the budget, the least bad is chosen.
    pub(super) fn finish(mut self) -> (Candidate, Vec<Row>) {
        if !self.tried.iter().any(|tried| tried.row.is_chosen()) {
            let by_excess = |a: &&mut Tried, b: &&mut Tried| {
                a.excess.total_cmp(&b.excess).then(a.row.cost.total_cmp(&b.row.cost))
            };
            if let Some(least_bad) = self.tried.iter_mut().min_by(by_excess) {
                least_bad.row.verdict = Verdict::Chosen;
            }
        }
        let rows: Vec<Row> = self.tried.into_iter().map(|tried| tried.row).collect();
        let chosen = rows.iter().find(|row| row.is_chosen()).map(|row| row.candidate);
        (chosen.unwrap_or_else(|| self.space.by_rule()), rows)
    }
}

//! Candidates beside one that was tried: more careful ones where it failed for something that they may mend, and less careful ones
//! where it is safe.

use super::{Axis, COST_OF_FUDGE, COST_OF_LEAST_STEP, Entry, Race};
use crate::calibrate::Candidate;
use crate::calibrate::evidence::Tally;
use crate::graph::Method;

/// Beyond the first of these many times the budget, and where it is not thin things that are missed, a candidate's next smaller
/// step multiplier is passed over, and shorter least steps are not tried; beyond the second two are passed over, and so on.
const HOPELESS: [f64; 3] = [4.0, 10.0, 30.0];
/// Times the price that orbits which run on are expected to cost.
const COST_OF_LATE_ENDS: f64 = 1.2;
/// What is not at least so much better is no help.
const HELP: f64 = 0.8;

impl Race<'_> {
    /// The less careful neighbours of a candidate that keeps the budget, where a careful one was tried before them.
    pub(super) fn add_cheaper(&mut self, at: usize) {
        let (candidate, cost) = (self.tried[at].candidate, self.tried[at].cost());
        let above = |list: &[f64], value: f64| list.iter().copied().rfind(|x| *x > value);
        let is_proof = candidate.method.is_some_and(Method::is_certified);
        if is_proof {
            return;
        }
        if let Some(fudge) = above(&self.space.fudges, candidate.fudge) {
            let expected = cost * (candidate.fudge / fudge).powf(COST_OF_FUDGE);
            self.add(Candidate { fudge, ..candidate }, expected, None);
        }
        if let Some(least_step) = above(&self.space.least_steps, candidate.least_step) {
            self.add(Candidate { least_step, ..candidate }, cost / COST_OF_LEAST_STEP, None);
        }
        if let (Some(most_step), false) = (candidate.most_step, self.space.most_steps.is_empty()) {
            let above = above(&self.space.most_steps, most_step);
            self.add(Candidate { most_step: above, ..candidate }, self.with_most_step(at, above), None);
        }
    }

    /// The more careful neighbours of a candidate that failed. What did not help once is not tried further.
    pub(super) fn add_neighbours(&mut self, at: usize, tally: &Tally, after: Option<(Axis, f64)>) {
        let (candidate, cost) = (self.tried[at].candidate, self.tried[at].cost());
        let budget = self.options.budget;
        let excess = tally.excess(&budget).0;
        let can_be_late = !candidate.late_ends && self.space.base.choices.iter().any(|choice| choice.ends);
        if can_be_late && tally.early.is_over(budget.early) {
            self.end_late(candidate, cost);
            return;
        }
        let is_thin = tally.missed_thin > 0 && 2 * tally.missed_thin >= tally.missed_truth.seen;
        let skip = HOPELESS.iter().filter(|limit| excess > **limit).count();
        let helps = |axis: Axis| after.is_none_or(|(last, before)| last != axis || excess < HELP * before);
        let kind @ (method, form) = (candidate.method, candidate.form);
        if !helps(Axis::LeastStep) {
            self.helpless.push(kind);
        }
        let below = |list: &[f64], value: f64, skip: usize| {
            let smaller: Vec<f64> = list.iter().copied().filter(|x| *x < value).collect();
            smaller.get(skip.min(smaller.len().saturating_sub(1))).copied()
        };
        // A proof does not overshoot.
        let is_proof = candidate.method.is_some_and(Method::is_certified);
        // What is thin is found by shorter steps; smaller multipliers are for later then.
        let shorter = below(&self.space.least_steps, candidate.least_step, if is_thin { skip.min(1) } else { 0 });
        let shorter = shorter.filter(|_| !self.helpless.contains(&kind) && (is_thin || skip == 0));
        if helps(Axis::Fudge)
            && !is_proof
            && !(is_thin && shorter.is_some())
            && let Some(fudge) = below(&self.space.fudges, candidate.fudge, skip)
        {
            let expected = cost * (candidate.fudge / fudge).powf(COST_OF_FUDGE);
            self.add(Candidate { fudge, ..candidate }, expected, Some((Axis::Fudge, excess)));
        }
        // A step that is not long passes little, whatever the estimate says.
        let is_limited = form.is_none() && self.limited.contains(&method);
        if is_limited && helps(Axis::MostStep) && tally.missed.share() > budget.missed {
            let most_step = below(&self.space.most_steps, candidate.most_step.unwrap_or(f64::INFINITY), skip);
            if most_step.is_some() {
                let expected = self.with_most_step(at, most_step);
                self.add(Candidate { most_step, ..candidate }, expected, Some((Axis::MostStep, excess)));
            }
        }
        if let Some(least_step) = shorter {
            let expected = cost * COST_OF_LEAST_STEP;
            self.add(Candidate { least_step, ..candidate }, expected, Some((Axis::LeastStep, excess)));
        }
    }

    /// Orbits that end at the footprint stop too early here: from now on they run on, in all candidates.
    fn end_late(&mut self, candidate: Candidate, cost: f64) {
        let certified = |candidate: &Candidate| candidate.method.is_some_and(Method::is_certified);
        self.add(Candidate { late_ends: true, ..candidate }, cost * COST_OF_LATE_ENDS, None);
        for entry in self.open.iter_mut().filter(|entry| !entry.candidate.late_ends) {
            entry.candidate.late_ends = true;
            entry.expected *= COST_OF_LATE_ENDS;
            entry.is_piloted &= !certified(&entry.candidate);
        }
    }

    /// Operations a ray that a candidate is expected to take with another longest step.
    fn with_most_step(&self, at: usize, most_step: Option<f64>) -> f64 {
        let tried = &self.tried[at];
        let estimates = tried.estimates().max(1.0);
        let steps = |most_step: Option<f64>| most_step.map_or(0.0, |most_step| self.reach / most_step);
        let own = (estimates - steps(tried.candidate.most_step)).max(0.25 * estimates);
        tried.cost() * (own + steps(most_step)) / estimates
    }

    fn add(&mut self, candidate: Candidate, expected: f64, after: Option<(Axis, f64)>) {
        let is_known = self.open.iter().any(|open| open.candidate == candidate)
            || self.tried.iter().any(|tried| tried.candidate == candidate);
        if !is_known {
            let is_piloted = candidate.method.is_some_and(Method::is_certified);
            self.open.push(Entry { candidate, expected, is_piloted, after });
        }
    }
}

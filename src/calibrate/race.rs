//! The race: candidates march the rays of the view, the cheapest first, until one keeps the budget.
//!
//! Composing and compiling a march takes as long as marching hundreds of rays, so time is saved by trying few candidates: they
//! are ordered by the cost that is expected of them, and a candidate's more careful neighbours (a smaller step multiplier, a
//! shorter least step) are only looked at where it failed for something that they may mend. Where the counts leave open
//! whether a candidate keeps the budget, it marches more rays until they decide.

mod neighbours;

use super::evidence::{Standing, Tally};
use super::marching::{Compiled, Marching, PILOT_RAYS, Pilot, totals};
use super::meter::Meter;
use super::sight::{Seen, Sight};
use super::{Candidate, Options, Space};
use crate::check::truth::Truths;
use crate::compose::ComposeResult;
use crate::graph::{DeForm, Method};

/// By what power of 1 / fudge the cost is expected to grow, and by what factor for a shortest step a quarter as long.
const COST_OF_FUDGE: f64 = 0.8;
const COST_OF_LEAST_STEP: f64 = 1.15;
/// Estimates that a proof or a form that the rules did not take is expected to need, compared with the others.
const COST_OF_PROOF: f64 = 1.3;
const COST_OF_OTHER_FORM: f64 = 1.3;
/// Candidates that are tried even where that takes more than it may, and those that are tried at all.
const FEWEST: usize = 3;
const MOST: usize = 60;
/// Times its work that a calibration may do as long as nothing is shown to keep the budget: a wrong picture is worse than a late
/// one.
const PATIENCE: f64 = 4.0;
/// Candidates after which, where none of them keeps the budget, a proof is tried before others that are cheaper.
const IMPATIENCE: usize = 10;
/// Methods whose steps may be limited.
const LIMITED: usize = 2;
/// Known hits that the choice is to be judged on, where that is affordable: who is the first of many to keep a budget may be lucky.
const CONFIRMED_HITS: usize = 3000;
/// Hits without a truth that candidates are first judged by, and the fewest and most rays for them.
const FIRST_HITS: f64 = 800.0;
const FIRST_RAYS: [usize; 2] = [500, 3000];
/// Rays that an expensive candidate marches at least.
const LEAST_RAYS: usize = 96;
/// Rays after which a candidate is given up that is out of the budget beyond doubt.
const DOUBTFUL_RAYS: usize = 4 * LEAST_RAYS;
/// Share of all work that each of the careful marches may take which find what others miss.
const SHARE_OF_CAREFUL: f64 = 0.2;
/// How much more expensive than the cheapest candidate that is seen to keep the budget one may be that is shown to.
pub(super) const SURER: f64 = 2.3;
/// Times the price of the cheapest candidate that keeps the budget as printed which no choice may cost, unless asked for.
pub const MOST_PRICE: f64 = 8.0;

/// How a candidate is more careful than the one before it.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Axis {
    Fudge,
    LeastStep,
    MostStep,
}

/// A candidate that has not been tried.
struct Entry {
    candidate: Candidate,
    /// Operations a ray that are expected.
    expected: f64,
    /// Whether they were measured by a pilot.
    is_piloted: bool,
    /// What makes it more careful than the candidate that failed before it, and that one's excess.
    after: Option<(Axis, f64)>,
}

/// A candidate that has been tried.
pub(super) struct Tried {
    pub candidate: Candidate,
    march: Compiled,
    /// One for each ray that it marched.
    seen: Vec<Seen>,
    /// Estimates and iterations of all of them.
    totals: [f64; 2],
}

impl Tried {
    /// Operations a ray.
    pub fn cost(&self) -> f64 {
        self.march.work.total(self.totals[0], self.totals[1]) / self.seen.len().max(1) as f64
    }

    /// Estimates a ray.
    pub fn estimates(&self) -> f64 {
        self.totals[0] / self.seen.len().max(1) as f64
    }
}

/// What a race leaves.
pub(super) struct Outcome<'a> {
    /// Candidates in the order in which they were tried, with what was counted of them.
    pub tried: Vec<(Tried, Tally)>,
    /// What the evidence does not show: why proofs were left out.
    pub notes: Vec<String>,
    /// What marches.
    marching: Marching<'a>,
}

impl Outcome<'_> {
    /// Lets a candidate march rays of a truth that no choice was made by, and counts them with the others.
    pub fn confirm(&mut self, at: usize, fresh: &Truths) {
        let (tried, tally) = &mut self.tried[at];
        let ends = self.marching.run(&tried.march, &fresh.rays);
        tally.add_fresh(&fresh.judge(&ends));
    }
}

pub(super) struct Race<'a> {
    options: &'a Options,
    space: &'a Space,
    marching: Marching<'a>,
    meter: &'a mut Meter,
    sight: Sight<'a>,
    /// Rays that every candidate marches if it is not too expensive.
    first: usize,
    pilot: Pilot,
    open: Vec<Entry>,
    tried: Vec<Tried>,
    /// How many of the first in `tried` look for hits that others miss.
    careful: usize,
    /// Methods and forms that shorter steps did not help.
    helpless: Vec<(Option<Method>, Option<DeForm>)>,
    /// Methods whose steps may be limited: the cheapest, since an estimate matters little then.
    limited: Vec<Option<Method>>,
    /// Hit thresholds from the bounding sphere to a ray's end, on the average.
    reach: f64,
    notes: Vec<String>,
}

impl<'a> Race<'a> {
    /// A race on a view. `pilot` is that of the rules' plan.
    pub fn new(
        options: &'a Options,
        space: &'a Space,
        truths: &'a Truths,
        marching: Marching<'a>,
        (meter, pilot): (&'a mut Meter, Pilot),
    ) -> Race<'a> {
        let share = truths.counts()[0].max(1) as f64 / truths.rays.len().max(1) as f64;
        let [fewest, most] = FIRST_RAYS;
        let first = truths.rays.len() + ((FIRST_HITS / share) as usize).clamp(fewest, most);
        let sight = Sight::new(options, truths);
        let (open, tried, notes) = (Vec::new(), Vec::new(), Vec::new());
        let (helpless, limited, reach) = (Vec::new(), Vec::new(), truths.reach());
        let careful = 0;
        #[rustfmt::skip]
        let race = Race { options, space, marching, meter, sight, first, pilot, open, tried, careful, helpless, limited, reach, notes };
        race
    }

    /// Runs until nothing is expected to be a better choice, or until the work or the candidates come to an end.
    pub fn run(mut self, told: &mut dyn FnMut(f64) -> bool) -> ComposeResult<Outcome<'a>> {
        self.line_up()?;
        self.look_carefully()?;
        loop {
            let entry = match self.next() {
                Some(entry) if !self.is_over(&entry) => entry,
                left => {
                    self.open.extend(left);
                    if self.confirm() {
                        continue;
                    }
                    break;
                }
            };
            let is_proof = entry.candidate.method.is_some_and(Method::is_certified);
            if is_proof && !entry.is_piloted {
                self.ask_first(entry)?;
            } else if !self.is_too_expensive(&entry) {
                self.try_one(&entry.candidate, self.first)?;
                self.settle(self.tried.len() - 1, entry.after);
            }
            if !told(self.meter.share()) {
                break;
            }
        }
        let Race { sight, tried, notes, marching, .. } = self;
        let with_tally = |tried: Tried| {
            let tally = sight.tally(&tried.seen);
            (tried, tally)
        };
        Ok(Outcome { tried: tried.into_iter().map(with_tally).collect(), notes, marching })
    }

    /// All kinds at their cheapest.
    fn line_up(&mut self) -> ComposeResult<()> {
        let fudge = self.space.fudges[0];
        let most_step = self.space.first_most_step();
        for (method, form) in self.space.kinds.clone() {
            let least_step = self.space.longest_step(method);
            let candidate = Candidate { method, form, fudge, least_step, most_step, late_ends: false };
            let plan = self.space.plan(&candidate);
            let work = self.marching.work(&self.marching.compose(&plan)?);
            let Pilot { estimates, iterations, .. } = self.pilot;
            let mut expected = work.total(estimates, estimates * iterations);
            if plan.is_certified() {
                expected *= COST_OF_PROOF;
            }
            if form.is_some() {
                expected *= COST_OF_OTHER_FORM;
            }
            self.open.push(Entry { candidate, expected, is_piloted: false, after: None });
        }
        let is_plain = |entry: &&Entry| {
            entry.candidate.form.is_none() && !entry.candidate.method.is_some_and(Method::is_certified)
        };
        let mut plain: Vec<&Entry> = self.open.iter().filter(is_plain).collect();
        plain.sort_by(|a, b| a.expected.total_cmp(&b.expected));
        self.limited = plain.into_iter().take(LIMITED).map(|entry| entry.candidate.method).collect();
        Ok(())
    }

    /// Marches with the most careful candidates that are not too expensive: they find the hits that the others may miss.
    fn look_carefully(&mut self) -> ComposeResult<()> {
        for candidate in self.space.careful() {
            let may_take = SHARE_OF_CAREFUL * self.meter.limit() / self.first as f64;
            let is_proof = candidate.method.is_some_and(Method::is_certified);
            if is_proof {
                let pilot = self.fly(&candidate)?;
                let entry = self.open.iter_mut().find(|entry| entry.candidate == candidate);
                entry.into_iter().for_each(|entry| (entry.expected, entry.is_piloted) = (pilot.price, true));
                if self.proves_nothing(&candidate, &pilot) || pilot.price > may_take {
                    continue;
                }
            }
            // Estimates that are too expensive for all rays still march some.
            let affordable = (may_take / self.pilot.price.max(1e-9) * self.first as f64) as usize;
            let count = if is_proof { self.first } else { self.first.min(affordable.max(LEAST_RAYS)) };
            self.open.retain(|entry| entry.candidate != candidate);
            self.try_one(&candidate, count)?;
            self.extend(self.careful, count);
            self.careful += 1;
        }
        for at in 0..self.careful {
            self.settle(at, None);
        }
        Ok(())
    }

    fn fly(&mut self, candidate: &Candidate) -> ComposeResult<Pilot> {
        let (pilot, work) = self.marching.pilot(&self.space.plan(candidate), &self.sight.rays)?;
        self.meter.compiled(&work);
        let rays = PILOT_RAYS.min(self.sight.rays.len()) as f64;
        self.meter.spend(rays * work.total(pilot.estimates, pilot.estimates * pilot.iterations));
        Ok(pilot)
    }

    /// Asks by a few rays whether a candidate proves anything, and what it costs. It is left out where it proves nothing.
    fn ask_first(&mut self, entry: Entry) -> ComposeResult<()> {
        let pilot = self.fly(&entry.candidate)?;
        if !self.proves_nothing(&entry.candidate, &pilot) {
            self.open.push(Entry { expected: pilot.price, is_piloted: true, ..entry });
        }
        Ok(())
    }

    /// Whether a pilot of proofs ended on no ray by proof, for many times the price of estimates. It is left out then.
    fn proves_nothing(&mut self, candidate: &Candidate, pilot: &Pilot) -> bool {
        let is_dear = pilot.price > MOST_PRICE * self.pilot.price;
        let nothing = pilot.decided == 0 && is_dear && !self.space.wants_proof && self.space.kinds.len() > 1;
        if nothing {
            self.notes.push(format!("{}: proves nothing on {PILOT_RAYS} rays, not tried", candidate.name()));
            self.open.retain(|entry| entry.candidate != *candidate);
        }
        nothing
    }

    /// Lets the best candidate march more rays where few of its hits are known; false if there is nothing to confirm.
    fn confirm(&mut self) -> bool {
        let Some(best) = self.best() else { return false };
        let count = self.tried[best].seen.len();
        let more = (2 * count).min(self.sight.rays.len());
        let is_enough = self.sight.tally(&self.tried[best].seen).missed.of >= CONFIRMED_HITS;
        if is_enough || more == count || self.price_of_more(best) * (more - count) as f64 > self.left() {
            return false;
        }
        self.extend_with_careful(best, more);
        self.settle(best, None);
        true
    }

    /// The candidate that would be chosen of those that are shown to keep the budget.
    fn best(&self) -> Option<usize> {
        let tallies: Vec<Tally> = self.tried.iter().map(|tried| self.sight.tally(&tried.seen)).collect();
        let budget = &self.options.budget;
        let price = |at: usize| self.tried[at].cost() * tallies[at].risk(budget);
        let shown = (0..tallies.len()).filter(|at| tallies[*at].standing(budget) <= Standing::Shown);
        shown.min_by(|a, b| price(*a).total_cmp(&price(*b)))
    }

    fn next(&mut self) -> Option<Entry> {
        let order = |a: &usize, b: &usize| self.open[*a].expected.total_cmp(&self.open[*b].expected);
        let is_proof = |candidate: &Candidate| candidate.method.is_some_and(Method::is_certified);
        if self.tried.len() >= IMPATIENCE
            && self.price_limit().is_none()
            && !self.tried.iter().any(|tried| is_proof(&tried.candidate))
            && let Some(proof) = (0..self.open.len()).filter(|at| is_proof(&self.open[*at].candidate)).min_by(order)
        {
            return Some(self.open.remove(proof));
        }
        let cheapest = (0..self.open.len()).min_by(order)?;
        Some(self.open.remove(cheapest))
    }

    /// Whether nothing that is left can be a better choice than what was tried, or all work is done.
    fn is_over(&self, next: &Entry) -> bool {
        if self.tried.len() >= MOST {
            return true;
        }
        match self.price_limit() {
            Some(limit) => next.expected >= limit || !self.can_measure(next),
            None => self.tried.len() >= FEWEST && !self.can_measure(next),
        }
    }

    /// Whether the work that is left is enough for half of the rays that candidates are to march, or at least the fewest.
    fn can_measure(&self, entry: &Entry) -> bool {
        let half = 0.5 * self.first as f64 * entry.expected;
        let fewest = LEAST_RAYS as f64 * entry.expected;
        self.left() > half.min(fewest.max(0.1 * self.meter.limit()))
    }

    /// The work that is left.
    fn left(&self) -> f64 {
        // What is found first may be a proof, for a price that calls for a longer search.
        let is_fair = |at: usize| self.tried[at].cost() <= MOST_PRICE * self.pilot.price;
        self.meter.left(if self.best().is_some_and(is_fair) { 1.0 } else { PATIENCE })
    }

    /// What a better choice than those that were tried costs at most; `None` if none keeps the budget.
    fn price_limit(&self) -> Option<f64> {
        let (mut seen, mut shown) = (f64::INFINITY, f64::INFINITY);
        for tried in &self.tried {
            let (tally, cost) = (self.sight.tally(&tried.seen), tried.cost());
            let standing = tally.standing(&self.options.budget);
            if standing <= Standing::Open {
                seen = seen.min(cost);
            }
            if standing <= Standing::Shown {
                // One that misses nothing could cost so much more.
                shown = shown.min(cost * tally.risk(&self.options.budget));
            }
        }
        let limit = shown.min(SURER * seen);
        limit.is_finite().then_some(limit)
    }

    /// Whether measuring a candidate takes more than all the work that is left, on the fewest rays. Others are tried first.
    fn is_too_expensive(&mut self, entry: &Entry) -> bool {
        let is_too_expensive = entry.expected * LEAST_RAYS as f64 > self.left().max(0.25 * self.meter.limit())
            && self.tried.len() + self.open.len() >= FEWEST;
        if is_too_expensive {
            let name = entry.candidate.name();
            self.notes.push(format!(
                "{name}: about {:.1} times the rules' price, too expensive to try",
                entry.expected / self.pilot.price
            ));
        }
        is_too_expensive
    }

    /// Marches with a candidate, on fewer rays where it is expensive.
    fn try_one(&mut self, candidate: &Candidate, count: usize) -> ComposeResult<()> {
        let march = self.marching.compose(&self.space.plan(candidate))?;
        let march = self.marching.compile(&march);
        self.meter.compiled(&march.work);
        self.tried.push(Tried { candidate: *candidate, march, seen: Vec::new(), totals: [0.0; 2] });
        let at = self.tried.len() - 1;
        // A few rays say what the others will cost.
        self.extend(at, LEAST_RAYS.min(count));
        let affordable = LEAST_RAYS + (self.left().max(0.0) / self.tried[at].cost().max(1e-9)) as usize;
        self.extend(at, count.min(affordable).min(DOUBTFUL_RAYS));
        if !self.sight.tally(&self.tried[at].seen).is_hopeless(&self.options.budget) {
            self.extend(at, count.min(affordable));
        }
        Ok(())
    }

    /// Lets a candidate march all rays up to `count`.
    fn extend(&mut self, at: usize, count: usize) {
        let tried = &mut self.tried[at];
        let range = tried.seen.len()..count.min(self.sight.rays.len());
        if range.is_empty() {
            return;
        }
        let ends = self.marching.run(&tried.march, &self.sight.rays[range.clone()]);
        let [estimates, iterations] = totals(&ends);
        self.meter.spend(tried.march.work.total(estimates, iterations));
        tried.totals = [tried.totals[0] + estimates, tried.totals[1] + iterations];
        tried.seen.extend(self.sight.look(range, &ends));
    }

    /// Operations of one more ray of a candidate, careful marches included.
    fn price_of_more(&self, at: usize) -> f64 {
        self.tried[..self.careful].iter().chain([&self.tried[at]]).map(Tried::cost).sum()
    }

    /// Lets a candidate march all rays up to `count`, after the careful marches, which look for the hits of the new ones.
    fn extend_with_careful(&mut self, at: usize, count: usize) {
        for careful in 0..self.careful {
            self.extend(careful, count);
        }
        self.extend(at, count);
    }

    /// Decides whether a candidate keeps the budget, by more rays where those that it marched leave that open; its more careful
    /// neighbours are next where it does not.
    fn settle(&mut self, at: usize, after: Option<(Axis, f64)>) {
        let budget = self.options.budget;
        loop {
            let count = self.tried[at].seen.len();
            let tally = self.sight.tally(&self.tried[at].seen);
            let more = (2 * count).min(self.sight.rays.len());
            let is_affordable = self.price_of_more(at) * (more - count) as f64 <= self.left();
            if !tally.is_undecided(&budget) || more == count || !is_affordable {
                break;
            }
            self.extend_with_careful(at, more);
        }
        let tally = self.sight.tally(&self.tried[at].seen);
        match tally.standing(&budget) {
            Standing::Safe => self.add_cheaper(at),
            standing => {
                if standing != Standing::Out {
                    self.add_cheaper(at);
                }
                self.add_neighbours(at, &tally, after);
            }
        }
    }
}

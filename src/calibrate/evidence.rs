//! What was seen of a candidate, and what that proves: counts, and the bounds that they put on a share.

use crate::check::truth::{Budget, Judgement, chance_of_at_least};

/// A bound holds with this chance of being wrong.
pub const DOUBT: f64 = 0.05;
/// What is less likely than this is never seen.
const NO_DOUBT: f64 = 1e-4;
/// Halvings that a bound is found in.
const HALVINGS: usize = 40;

/// How many of so many.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Count {
    /// Those that were seen to be wrong.
    pub seen: usize,
    /// All.
    pub of: usize,
}

impl Count {
    /// The share that was seen; 0 of nothing.
    pub fn share(&self) -> f64 {
        self.seen as f64 / self.of.max(1) as f64
    }

    /// The share that is to be expected of other rays: one more is counted than was seen.
    pub fn expected(&self) -> f64 {
        (self.seen + 1) as f64 / (self.of + 1) as f64
    }

    /// The share that all rays of the view stay under, with 95 % confidence (Clopper and Pearson's bound, from one side).
    pub fn bound(&self) -> f64 {
        if self.seen >= self.of {
            return 1.0;
        }
        let (mut low, mut high) = (self.share(), 1.0);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            let at_most = 1.0 - chance_of_at_least(self.seen + 1, self.of, middle);
            *(if at_most > DOUBT { &mut low } else { &mut high }) = middle;
        }
        high
    }

    /// Whether these are evidence that the share is above `allowed`: so many are seen by chance in one of twenty such samples.
    pub fn is_over(&self, allowed: f64) -> bool {
        self.exceeds(allowed, DOUBT)
    }

    /// Whether it is above `allowed` beyond doubt: so many are seen by chance in one of 10,000 such samples.
    pub fn is_far_over(&self, allowed: f64) -> bool {
        self.exceeds(allowed, NO_DOUBT)
    }

    fn exceeds(&self, allowed: f64, chance: f64) -> bool {
        self.share() > allowed && chance_of_at_least(self.seen, self.of, allowed) < chance
    }
}

/// What was counted of a candidate's march.
#[derive(Clone, PartialEq, Debug, Default)]
pub(super) struct Tally {
    /// Missed hits of all hits that are known.
    pub missed: Count,
    /// Those of rays with a truth alone: only brute force finds what no march does.
    pub missed_truth: Count,
    /// Missed hits on something thinner than a hit threshold, of rays with a truth.
    pub missed_thin: usize,
    /// Early stops of all stops.
    pub early: Count,
    /// Median depth error in footprints.
    pub error: f64,
    /// Missed hits of rays with a truth that the choice was not made by, where it was confirmed.
    pub fresh: Option<Count>,
}

/// What a tally says about a budget.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(super) enum Standing {
    /// The bounds are inside the budget, and what was seen is far inside.
    Safe,
    /// The bounds are inside the budget.
    Shown,
    /// What was seen is inside the budget, its bound is not.
    Open,
    /// The same of so few hits that one more that is missed would break the budget: no evidence.
    Scant,
    /// What was seen is outside the budget.
    Out,
}

/// Logarithms of the factors of the price that missing the whole budget counts for, and stopping early by all of it.
const RISK_OF_MISSED: f64 = 3.0;
const RISK_OF_EARLY: f64 = 0.6;
/// Share of the missed hits (and of the early stops) of a budget that a safe choice comes to.
const SAFE_MISSED: f64 = 0.25;
const SAFE_EARLY: f64 = 0.7;
/// The same of rays with a truth, of which there are fewer.
const SAFE_TRUTH: f64 = 0.5;
/// Hits with a truth from which on their share says something of its own.
const TELLING: usize = 200;
/// A share of them that is seen by chance in less than so many samples breaks the budget.
const DOUBT_OF_TRUTH: f64 = 0.2;

impl Tally {
    /// Whether the bounds of what was counted are inside a budget, too.
    pub fn is_shown(&self, budget: &Budget) -> bool {
        self.missed.bound() <= budget.missed
            && self.early.bound() <= budget.early
            && self.missed_truth.share() <= budget.missed
    }

    /// Where it stands.
    pub fn standing(&self, budget: &Budget) -> Standing {
        if self.excess(budget).0 > 1.0 {
            return Standing::Out;
        }
        let is_shown = self.is_shown(budget);
        // A rate is on the average a bit more than what few counts show.
        let expected = self.missed.expected();
        let is_safe = expected <= SAFE_MISSED * budget.missed
            && self.early.share() <= SAFE_EARLY * budget.early
            && self.missed_truth.share() <= SAFE_TRUTH * budget.missed;
        match (is_shown, is_safe) {
            (true, true) => Standing::Safe,
            (true, false) => Standing::Shown,
            (false, _) if expected > budget.missed => Standing::Scant,
            (false, _) => Standing::Open,
        }
    }

    /// Whether more rays could change the standing: neither is it shown that the budget is kept nor that it is broken.
    pub fn is_undecided(&self, budget: &Budget) -> bool {
        let is_out = self.missed.is_over(budget.missed)
            || self.missed_truth.is_over(budget.missed)
            || self.early.is_over(budget.early)
            || self.error > budget.error;
        let is_shown = self.missed.bound() <= budget.missed && self.early.bound() <= budget.early;
        !is_out && !is_shown
    }

    /// What a price is multiplied by for expected misses and early stops: rays that were not measured shall keep the budget,
    /// too, and who keeps it narrowly breaks it on many of them.
    pub fn risk(&self, budget: &Budget) -> f64 {
        let missed = self.expected() / budget.missed.max(1e-9);
        let early = self.early.share() / budget.early.max(1e-9);
        (RISK_OF_MISSED * missed + RISK_OF_EARLY * early).exp()
    }

    /// The share of missed hits that is to be expected, by what marches know and by what brute force knows.
    pub fn expected(&self) -> f64 {
        let truth = if self.missed_truth.of >= TELLING { self.missed_truth.expected() } else { 0.0 };
        self.missed.expected().max(truth)
    }

    /// Counts rays that the choice was not made by.
    pub fn add_fresh(&mut self, judged: &Judgement) {
        let count = |share: f64, of: usize| Count { seen: (share * of as f64).round() as usize, of };
        let (missed, early) = (count(judged.missed, judged.hits), count(judged.early, judged.stops));
        for (to, by) in [(&mut self.missed, missed), (&mut self.missed_truth, missed), (&mut self.early, early)] {
            (to.seen, to.of) = (to.seen + by.seen, to.of + by.of);
        }
        self.fresh = Some(missed);
    }

    /// Whether a budget is kept, by all that was counted.
    pub fn is_within(&self, budget: &Budget) -> bool {
        self.excess(budget).0 <= 1.0
    }

    /// Whether no further ray could save it.
    pub fn is_hopeless(&self, budget: &Budget) -> bool {
        self.missed.is_far_over(budget.missed) || self.early.is_far_over(budget.early)
    }

    /// By how much the budget is broken (1 is just inside, 2 is twice as much as is allowed), and what breaks it.
    pub fn excess(&self, budget: &Budget) -> (f64, &'static str) {
        let missed = self.missed.share() / budget.missed.max(1e-9);
        // Few hits with a truth say little, unless so many are missed that chance does not explain it.
        let truth = match missed <= 1.0 && self.missed_truth.exceeds(budget.missed, DOUBT_OF_TRUTH) {
            true => self.missed_truth.share() / budget.missed.max(1e-9),
            false => 0.0,
        };
        // One miss of few hits is chance.
        let fresh =
            self.fresh.filter(|fresh| fresh.seen > 1).map_or(0.0, |fresh| fresh.share() / budget.missed.max(1e-9));
        let checks = [
            (missed, "misses too much"),
            (truth, "misses what brute force finds"),
            (fresh, "misses more of other rays"),
            (self.early.share() / budget.early.max(1e-9), "stops too early"),
            (self.error / budget.error.max(1e-9), "depths are off"),
        ];
        checks.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, ""))
    }
}

#[cfg(test)]
mod tests {
    use super::{Budget, Count, Standing, Tally};

    /// The rule of three, and values of R's `binom.test(x, n, alternative = "less")`.
    #[test]
    fn bounds_are_those_of_clopper_and_pearson() {
        let bound = |seen: usize, of: usize| Count { seen, of }.bound();
        assert!((bound(0, 1000) - 0.002991).abs() < 1e-5);
        assert!((bound(0, 2) - 0.7764).abs() < 1e-4, "two hits are no evidence");
        assert!((bound(1, 10) - 0.3942).abs() < 1e-4);
        assert_eq!(bound(3, 3), 1.0);
        assert_eq!(bound(0, 0), 1.0);
    }

    #[test]
    fn a_share_inside_the_budget_is_thrown_away_by_no_margin() {
        let budget = Budget::default();
        let tally = |seen: usize, of: usize| Tally {
            missed: Count { seen, of },
            early: Count { seen: 0, of },
            ..Tally::default()
        };
        // 0.31 %: open on few hits, shown on many.
        assert_eq!(tally(3, 968).standing(&budget), Standing::Open);
        assert!(tally(3, 968).is_undecided(&budget));
        assert_eq!(tally(31, 10_000).standing(&budget), Standing::Shown);
        assert_eq!(tally(0, 2).standing(&budget), Standing::Scant, "two hits show nothing");
        assert_eq!(tally(0, 1000).standing(&budget), Standing::Safe);
        assert_eq!(tally(10, 1000).standing(&budget), Standing::Out);
        assert!(!tally(40, 1000).is_undecided(&budget));
    }
}

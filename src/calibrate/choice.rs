//! Which of the candidates that were tried is taken.
//!
//! The cheapest whose misses and early stops are shown to be inside the budget, where what it misses counts as a price; one
//! that is only seen to be inside it where none near its price is shown to be. No choice costs more than eight times the cheapest candidate that
//! keeps the budget as printed, unless proofs are asked for. Where none keeps it, the least bad weighs what is missed, what
//! is early and the price.

use std::cmp::Ordering;

use super::evidence::{Standing, Tally};
use super::race::{MOST_PRICE, SURER, Tried};
use super::{Row, Verdict};
use crate::check::truth::Budget;

/// What a factor of missed hits over the budget, of early stops over it, and of the price weighs in the least bad choice.
const WEIGHTS: [f64; 3] = [2.5, 2.0, 1.0];
/// What the share of the hits that are left weighs: what shows nothing is no picture at any price.
const WEIGHT_OF_LEFT: f64 = 2.0;
/// What missed hits weigh where maps jump: early stops there are what a jump looks like, and missed hits are holes.
const WEIGHT_OF_HOLES: f64 = 10.0;

/// How much more expensive than the cheapest that is only seen to keep the budget one of them may be that misses less.
const LUCK: f64 = 1.6;

/// What the choice depends on besides the evidence.
#[derive(Clone, Copy)]
pub(super) struct Terms<'a> {
    pub budget: &'a Budget,
    /// Whether proofs are asked for at any price.
    pub proof: bool,
}

struct Judged<'t> {
    tried: &'t Tried,
    tally: &'t Tally,
    standing: Standing,
    cost: f64,
}

/// The rows of all candidates, with the chosen one marked. `jumps` is asked whether the maps jump where none keeps the budget.
pub(super) fn rows<E>(
    tried: &[(Tried, Tally)],
    terms: Terms,
    jumps: &mut dyn FnMut() -> Result<bool, E>,
) -> Result<Vec<Row>, E> {
    let judged: Vec<Judged> = tried
        .iter()
        .map(|(tried, tally)| Judged { tried, tally, standing: tally.standing(terms.budget), cost: tried.cost() })
        .collect();
    let least = |worst: Standing| judged.iter().filter(|j| j.standing <= worst).map(|j| j.cost).min_by(f64::total_cmp);
    let base = least(Standing::Open).or(least(Standing::Scant));
    let cap = if terms.proof { f64::INFINITY } else { base.map_or(f64::INFINITY, |base| MOST_PRICE * base) };
    let chosen = match base {
        Some(base) => within(&judged, terms.budget, base, cap),
        None => least_bad(&judged, terms.budget, jumps()?),
    };
    let why = |j: &Judged| chosen.map_or(String::new(), |at| why_not(j, &judged[at], terms.budget, cap));
    let row = |(i, j): (usize, &Judged)| Row {
        candidate: j.tried.candidate,
        missed: j.tally.missed,
        early: j.tally.early,
        error: j.tally.error,
        estimates: j.tried.estimates(),
        cost: j.cost,
        verdict: if chosen == Some(i) { Verdict::Chosen } else { Verdict::Fails(why(j)) },
    };
    Ok(judged.iter().enumerate().map(row).collect())
}

/// The choice where some candidate keeps the budget.
fn within(judged: &[Judged], budget: &Budget, base: f64, cap: f64) -> Option<usize> {
    let price = |i: usize| judged[i].cost * judged[i].tally.risk(budget);
    let may_cost = if cap.is_infinite() { cap } else { SURER * base };
    let fits = |i: &usize| judged[*i].standing <= Standing::Shown && judged[*i].cost <= may_cost;
    if let Some(best) = (0..judged.len()).filter(fits).min_by(|a, b| price(*a).total_cmp(&price(*b))) {
        return Some(best);
    }
    // Of those that are only seen to keep it the cheapest may be the luckiest.
    let open = (0..judged.len()).filter(|i| judged[*i].standing <= Standing::Scant && judged[*i].cost <= LUCK * base);
    let order = |j: &Judged| (j.standing == Standing::Scant, j.tally.expected(), j.cost);
    open.min_by(|a, b| order(&judged[*a]).partial_cmp(&order(&judged[*b])).unwrap_or(Ordering::Equal))
}

/// The choice where none does: missed hits, early stops and the price, each by its factor.
fn least_bad(judged: &[Judged], budget: &Budget, jumps: bool) -> Option<usize> {
    let least = judged.iter().map(|j| j.cost).min_by(f64::total_cmp)?;
    let [missed, early, price] = WEIGHTS;
    let missed = if jumps { WEIGHT_OF_HOLES } else { missed };
    let over = |share: f64, allowed: f64| (share / allowed.max(1e-9)).max(1.0).ln();
    let badness = |j: &Judged| {
        let share = j.tally.missed.expected().max(j.tally.missed_truth.share());
        missed * over(share, budget.missed) - WEIGHT_OF_LEFT * (1.0 - share).max(1e-3).ln()
            + early * (over(j.tally.early.share(), budget.early) + over(j.tally.error.min(1e6), budget.error))
            + price * (j.cost / least.max(1e-9)).ln()
    };
    (0..judged.len()).min_by(|a, b| badness(&judged[*a]).total_cmp(&badness(&judged[*b])))
}

/// Why a candidate was not chosen, in words.
fn why_not(j: &Judged, chosen: &Judged, budget: &Budget, cap: f64) -> String {
    match j.standing {
        Standing::Out => j.tally.excess(budget).1.into(),
        _ if j.cost > cap => format!("over {MOST_PRICE} times the price of the cheapest"),
        Standing::Scant => "too few hits".into(),
        _ if j.cost >= chosen.cost => "costs more".into(),
        Standing::Open => "open: the bound is outside".into(),
        Standing::Safe | Standing::Shown => "misses more, for little less".into(),
    }
}

//! Why nothing keeps the budget: the step of the formula that no estimate gets right, and what would help.

use super::Row;
use super::evidence::Tally;
use crate::check::health::{Finding, Health, Kind, Severity};
use crate::check::truth::Budget;
use crate::graph::Method;

/// The warning for a choice that is only the least bad: what is wrong with it, and in a second line the likely cause and what helps.
pub(super) fn warning(health: &Health, budget: &Budget, row: &Row) -> String {
    let mut wrong = Vec::new();
    let mut say = |share: f64, allowed: f64, what: &str| {
        if share > allowed {
            wrong.push(format!("{what} {:.2} % (allowed {:.2} %)", 100.0 * share, 100.0 * allowed));
        }
    };
    say(row.missed.share(), budget.missed, "misses");
    say(row.early.share(), budget.early, "stops early at");
    if row.error > budget.error {
        wrong.push(format!("errs by {:.2} footprints (allowed {})", row.error.min(999.0), budget.error));
    }
    if wrong.is_empty() {
        wrong.push("misses more of the hits that brute force finds than chance explains".into());
    }
    let (name, fudge) = (row.candidate.name(), row.candidate.fudge);
    let what =
        format!("no estimate keeps the error budget; the least bad, {name} at fudge {fudge}, {}", wrong.join(" and "));
    let uses_rules = matches!(row.candidate.method, Some(Method::Scalar | Method::Combined));
    let causes = health.findings.iter().filter(|finding| rank(finding, uses_rules) > 0);
    match causes.max_by_key(|finding| (rank(finding, uses_rules), finding.severity)) {
        Some(finding) => format!("{what}\nlikely cause: {}; {}", finding.message, finding.help),
        None => format!(
            "{what}\nno step is to blame: each is continuous and keeps its rule; fewer iterations or more pixels help, since what \
             is missed is finer than they are"
        ),
    }
}

/// The warning for a choice that is seen to keep the budget, but might not: a bound is outside, or rays that it was not chosen
/// by speak against it.
pub(super) fn doubt(tally: &Tally, budget: &Budget) -> Option<String> {
    let is_in_doubt = !tally.is_shown(budget) && tally.missed.seen > 0;
    let fresh = tally.fresh.filter(|fresh| fresh.seen > 1 && fresh.share() > budget.missed);
    let count = fresh.unwrap_or(if tally.missed_truth.share() > tally.missed.share() {
        tally.missed_truth
    } else {
        tally.missed
    });
    (is_in_doubt || fresh.is_some()).then(|| {
        format!(
            "the estimate may miss more than is allowed: it missed {} of {} hits, so up to {:.2} % (allowed {:.2} %)",
            count.seen,
            count.of,
            100.0 * count.bound(),
            100.0 * budget.missed
        )
    })
}

/// What explains errors best: values that are no numbers, a rule that is broken almost everywhere, a jump before an unbounded
/// stretch, a rule that is exceeded here and there. 0 is no cause.
fn rank(finding: &Finding, uses_rules: bool) -> u8 {
    match (finding.kind, finding.severity) {
        (Kind::NotANumber, _) => 5,
        // Without the rule there is no cheap estimate that never oversteps, whatever method is the least bad.
        (Kind::Rule, Severity::Wrong) => 4,
        (Kind::Jump, _) => 3,
        (Kind::Stretch, _) => 2,
        (Kind::Rule, Severity::Note) if uses_rules => 1,
        _ => 0,
    }
}

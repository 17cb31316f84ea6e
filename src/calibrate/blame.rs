//! Why nothing keeps the budget: the step of the formula that no estimate gets right, and what would help.

use super::{Options, Row};
use crate::check::Subject;
use crate::check::health::{Finding, Kind, Severity, check_steps};
use crate::diag::Diagnostic;
use crate::graph::Method;

/// The warning for a choice that is only the least bad.
pub(super) fn warning(subject: &Subject, options: &Options, row: &Row) -> Result<String, Diagnostic> {
    let budget = &options.budget;
    let what = format!(
        "no estimate keeps the error budget; the least bad, {} with fudge {}, misses {:.2} % of the hits (allowed are \
         {:.2} %), and {:.2} % of its stops are early (allowed are {:.2} %)",
        row.candidate.name(),
        row.candidate.fudge,
        100.0 * row.missed,
        100.0 * budget.missed,
        100.0 * row.early,
        100.0 * budget.early
    );
    let health = check_steps(subject)?;
    let uses_rules = matches!(row.candidate.method, Some(Method::Scalar | Method::Combined));
    let culprit = health
        .findings
        .iter()
        .filter(|f| is_cause(f) && (uses_rules || f.kind != Kind::Rule))
        .max_by_key(|f| (rank(f.kind), f.severity));
    Ok(match culprit {
        Some(finding) => format!("{what}. The cause is likely this: {}. What helps: {}", finding.message, finding.help),
        None => format!(
            "{what}. No single step is to blame: each is continuous and keeps its rule. What helps: fewer iterations, or \
             more pixels, since what is missed is finer than they are; `--de certified` where it was not tried"
        ),
    })
}

fn is_cause(finding: &Finding) -> bool {
    rank(finding.kind) > 0 && (finding.kind != Kind::Rule || finding.severity != Severity::Warning)
}

/// What explains missed hits best: a jump before an unbounded stretch before a rule that is exceeded.
fn rank(kind: Kind) -> u8 {
    match kind {
        Kind::NotANumber => 4,
        Kind::Jump => 3,
        Kind::Stretch => 2,
        Kind::Rule => 1,
        _ => 0,
    }
}

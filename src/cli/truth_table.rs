//! `bulbfold truth` of several formulas: a line for each, and whether all keep the budget.

use std::io::Write;
use std::path::{Path, PathBuf};

use bulbfold::calibrate::Budget;
use bulbfold::check::truth::Judgement;

use super::page::{Block, markdown, plain};
use super::truth::{Arguments, Measured, measure};
use super::{Failure, Outcome, Session, message};

/// Head of the table.
const HEAD: [&str; 10] =
    ["Fractal", "Estimate", "Fudge", "Rays", "Hits", "Missed %", "Early %", "Depth error", "Ambiguous", "Budget"];

/// Measures all files. What is wrong with one does not stop the others.
pub fn run(arguments: &Arguments, files: &[PathBuf], session: &mut Session, out: &mut dyn Write) -> Outcome {
    let budget = arguments.estimate.error_budget;
    let (mut rows, mut wrong) = (Vec::new(), Vec::new());
    for file in files {
        let shown = file.display();
        match measure(arguments, session, file) {
            Ok(measured) => {
                let why = measured.complaint(&budget);
                wrong.extend(why.iter().map(|why| format!("{shown}: {why}")));
                match arguments.json {
                    true => measured.summary(out)?,
                    false => rows.push(row(file, &measured, why.is_none())),
                }
            }
            Err(Failure::Usage(text) | Failure::Work(text)) => wrong.push(format!("{shown}: {}", text.trim_end())),
            Err(Failure::ClosedPipe) => return Err(Failure::ClosedPipe),
        }
        out.flush()?;
    }
    if !arguments.json {
        let table = [Block::Table(HEAD.to_vec(), rows)];
        let text = if arguments.markdown { markdown(&table, 0) } else { plain(&table) };
        write!(out, "{}", text.trim_end_matches('\n'))?;
        writeln!(out)?;
    }
    match wrong.is_empty() {
        true => Ok(()),
        false => Err(broken(&wrong.join("\n"))),
    }
}

/// The failure of formulas that break the budget; `wrong` says which, and how.
pub(super) fn broken(wrong: &str) -> Failure {
    Failure::Work(message(wrong, "`bulbfold calibrate FILE --write` measures an estimate anew"))
}

fn row(file: &Path, measured: &Measured, is_kept: bool) -> Vec<String> {
    let judged = measured.judged();
    let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let percent = |share: f64| format!("{:.2}", 100.0 * share);
    vec![
        name,
        measured.method(),
        measured.plan.fudge.to_string(),
        measured.rays().to_string(),
        judged.hits.to_string(),
        percent(judged.missed),
        percent(judged.early),
        format!("{:.3}", judged.median_error),
        judged.ambiguous.to_string(),
        if is_kept { "kept" } else { "broken" }.to_string(),
    ]
}

/// What is out of the budget. A view without hits says nothing of misses, so it keeps none.
pub(super) fn complaint(judged: &Judgement, budget: &Budget) -> Option<String> {
    if judged.hits == 0 {
        return Some("no ray of the view hits anything".into());
    }
    let parts =
        [("of the hits missed", judged.missed, budget.missed), ("of the stops early", judged.early, budget.early)];
    let mut wrong: Vec<String> = parts
        .into_iter()
        .filter(|(_, found, allowed)| found > allowed)
        .map(|(what, found, allowed)| format!("{:.2} % {what} (allowed are {:.2} %)", 100.0 * found, 100.0 * allowed))
        .collect();
    if judged.median_error > budget.error {
        wrong.push(format!(
            "a median depth error of {:.3} footprints (allowed are {})",
            judged.median_error, budget.error
        ));
    }
    (!wrong.is_empty()).then(|| wrong.join(", "))
}

#[cfg(test)]
mod tests {
    use bulbfold::calibrate::Budget;
    use bulbfold::check::truth::Judgement;

    use super::complaint;

    #[test]
    fn each_part_of_the_budget_counts() {
        let good = Judgement { hits: 200, missed: 0.005, early: 0.05, median_error: 0.5, ..Judgement::default() };
        let budget = Budget::default();
        assert_eq!(complaint(&good, &budget), None);
        for (bad, word) in [
            (Judgement { missed: 0.0051, ..good }, "missed"),
            (Judgement { early: 0.06, ..good }, "early"),
            (Judgement { median_error: 0.51, ..good }, "depth"),
            (Judgement { hits: 0, ..good }, "no ray"),
        ] {
            assert!(complaint(&bad, &budget).is_some_and(|why| why.contains(word)), "{word}");
        }
    }
}

//! `bulbfold doctor`: what this machine has, and whether its back ends agree.

use std::io::Write;
use std::sync::Arc;

use bulbfold::compose::{Composer, Purpose, choose, compose_estimator};
use bulbfold::engine::Error;
use bulbfold::expr::Arena;
use bulbfold::graph::EstimateSettings;
use bulbfold::kernel::cpu::Cpu;
use bulbfold::kernel::{Estimator, Kernel, inwards};
use bulbfold::math::Precision;
use clap::Args;

use super::backend::{run_everywhere, tried_adapters};
use super::probe::KernelJob;
use super::{Failure, Outcome, Session, message};

/// Arguments of `doctor`.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bulbfold doctor
  bulbfold doctor > report.txt      to attach to a bug report")]
pub struct Arguments {}

/// Points of the probe set, for each fractal.
const POINTS: usize = 200;
/// Largest difference of estimates that passes, relative to the estimate or to 1: single precision loses digits with each
/// iteration, and a point beside a fold may take the other side.
const TOLERANCE: f64 = 2e-3;
/// Share of points that may differ more, for the same reason.
const OUTLIERS: usize = POINTS / 50;
/// What is probed.
const FRACTALS: [&str; 2] = ["mandelbulb", "mandelbox"];

/// Runs the command.
pub fn run(_: &Arguments, session: &mut Session, out: &mut dyn Write) -> Outcome {
    writeln!(out, "bulbfold {}", env!("CARGO_PKG_VERSION"))?;
    writeln!(out, "cpu      {}", Cpu::new(Precision::F32).description())?;
    writeln!(out, "threads  {}", rayon::current_num_threads())?;
    out.flush()?;
    let (adapters, broken) = tried_adapters();
    for (line, is_software) in &adapters {
        let note = if *is_software { ", in software: `auto` prefers the CPU back end" } else { "" };
        writeln!(out, "adapter  {line}{note}")?;
    }
    if adapters.is_empty() {
        writeln!(out, "adapter  none")?;
    }
    let mut failed = 0;
    if let Some(error) = &broken {
        failed += 1;
        writeln!(out, "FAIL     gpu: {error}")?;
    }
    for name in FRACTALS {
        for (backend, verdict) in compare(session, name, broken.is_none())? {
            let (word, text) = match verdict {
                Ok(text) => ("PASS", text),
                Err(text) => ("FAIL", text),
            };
            failed += usize::from(word == "FAIL");
            writeln!(out, "{word}     {name} on {backend}: {text}")?;
        }
    }
    match failed {
        0 => Ok(()),
        1 => Err(Failure::Work(message("a back end failed", "`--backend cpu --precision f64` is the reference"))),
        count => Err(Failure::Work(message(
            &format!("{count} checks failed"),
            "`--backend cpu --precision f64` is the reference",
        ))),
    }
}

/// A back end's name, and how far it is from the reference, or why it failed.
type Verdict = (String, Result<String, String>);

/// Compares the back ends; the GPU where its driver `works`.
fn compare(session: &mut Session, name: &str, works: bool) -> Result<Vec<Verdict>, Failure> {
    let graph = session.load(name, &[])?.graph;
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library: &session.library, graph: &graph };
    let kernel = choose(&composer, &EstimateSettings::default()).and_then(|plan| {
        let estimator = compose_estimator(&composer, &plan.choices, Purpose::March)?;
        Ok((Kernel::Estimate(estimator), plan.bounding_radius))
    });
    let (kernel, radius) = kernel.map_err(|diagnostic| session.failure(diagnostic))?;
    let columns = probe_set(radius);
    let mut job = KernelJob { arena: &arena, kernel: &kernel, columns: &columns };
    let mut results = run_everywhere(&mut job, works).into_iter();
    let Some((first, Ok(reference))) = results.next() else {
        return Err(Failure::Work(message("the reference back end failed", "")));
    };
    let mut verdicts = vec![(first, Ok("the reference".to_string()))];
    verdicts.extend(results.map(|(backend, result)| (backend, judge(&reference, result))));
    Ok(verdicts)
}

/// Points through the ball, without order, the same on every machine (R3 sequence, Roberts 2018).
fn probe_set(radius: f64) -> Vec<Vec<f64>> {
    let steps = [0.819_172_513_396_164_4, 0.671_043_606_703_789_2, 0.549_700_477_901_970_2];
    let coordinate = |i: usize, step: f64| (2.0 * (0.5 + step * (i + 1) as f64).fract() - 1.0) * radius;
    let points: Vec<[f64; 3]> = (0..POINTS).map(|i| steps.map(|step| coordinate(i, step))).collect();
    let directions: Vec<[f64; 3]> = points.iter().map(inwards).collect();
    Estimator::columns(&points, &directions, &[1e-3 * radius], 0.0)
}

fn judge(reference: &[Vec<f64>], result: Result<Vec<Vec<f64>>, Error>) -> Result<String, String> {
    let result = result.map_err(|error| error.to_string())?;
    if result.len() != reference.len() || result.iter().zip(reference).any(|(a, b)| a.len() != b.len()) {
        return Err("the result has the wrong shape".into());
    }
    let mut differences: Vec<f64> = (0..POINTS)
        .map(|i| {
            let (expected, found) = (reference[0][i], result[0][i]);
            let difference = (expected - found).abs() / expected.abs().max(1.0);
            if difference.is_finite() && reference[1][i] == result[1][i] { difference } else { f64::INFINITY }
        })
        .collect();
    differences.sort_by(f64::total_cmp);
    let outliers = differences.iter().filter(|&&difference| difference > TOLERANCE).count();
    let usual = differences[POINTS - 1 - OUTLIERS];
    let text = format!(
        "largest difference {usual:.1e} ({outliers} of {POINTS} points beside a fold or a boundary differ more)"
    );
    if outliers <= OUTLIERS {
        Ok(text)
    } else {
        Err(format!("{outliers} of {POINTS} points differ by more than {TOLERANCE}"))
    }
}

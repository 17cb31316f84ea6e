//! Runs the tests of every built-in formula and step file on every back end, and judges the distance estimates.

use std::path::PathBuf;

use bulbfold::check::{Backends, Formula, Options, Target, agreement, run_paths, truth};
use bulbfold::formula::embedded::FRACTALS;
use bulbfold::formula::library::Library;
use bulbfold::render::RenderSettings;
use bulbfold::shade::Size;

fn folder(name: &str) -> Vec<PathBuf> {
    vec![PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("formulas").join(name)]
}

fn run(name: &str) {
    let mut library = Library::builtin();
    let report = run_paths(&mut library, &folder(name), &Options::default());
    println!("{report}");
    assert!(report.outcomes.len() > 10, "the folder {name} was not found");
    assert!(report.is_ok(), "\n{report}");
}

#[test]
fn built_in_steps_do_what_their_files_say() {
    run("steps");
}

#[test]
fn built_in_fractals_do_what_their_files_say() {
    let mut library = Library::builtin();
    let report = run_paths(&mut library, &folder("fractals"), &Options::default());
    println!("{report}");
    assert!(report.outcomes.len() >= FRACTALS.len());
    assert!(report.is_ok(), "\n{report}");
}

/// Hits thicker than half a pixel that a chosen method may pass, and its median depth error in pixel footprints.
const MISSED: f64 = 0.02;
const MEDIAN: f64 = 0.5;

#[test]
fn chosen_estimates_hit_what_brute_force_hits() {
    let mut wrong = Vec::new();
    let settings = RenderSettings { size: Size { width: 320, height: 240 }, ..RenderSettings::default() };
    for name in crate::sampled::sampled(12) {
        let formula = Formula::builtin(name).unwrap();
        let subject = formula.subject();
        let judged = truth::judge(&subject, 300, &settings).unwrap();
        let single = agreement(&subject, &Backends::cpu_only(), Target::CPU_F32).unwrap();
        let line = format!(
            "{name:24} {:9} R {:.3} hits {:3} thin {:2} ambiguous {:3} missed {:5.2} % (thin {:5.2} %) early {:5.2} % median {:.4} footprints; f32 agrees {:.2} %",
            subject.method().map_or("own", |m| m.name()),
            subject.plan.bounding_radius,
            judged.hits,
            judged.thin,
            judged.ambiguous,
            100.0 * judged.missed,
            100.0 * judged.missed_thin,
            100.0 * judged.early,
            judged.median_error,
            100.0 * single.share()
        );
        println!("{line}");
        if judged.hits - judged.thin < 20 || judged.missed_thick >= MISSED || judged.median_error >= MEDIAN {
            wrong.push(line);
        }
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

#[test]
#[ignore = "a measurement: what the step multiplier and the hit threshold do to missed hits"]
fn sweep() {
    for name in crate::sampled::sampled(12) {
        let formula = Formula::builtin(name).unwrap();
        for (fudge, detail) in [(1.0, 1.0), (0.7, 1.0), (0.5, 1.0), (0.3, 1.0), (1.0, 0.5), (1.0, 0.25), (0.5, 0.25)] {
            let mut settings =
                RenderSettings { size: Size { width: 320, height: 240 }, detail, ..RenderSettings::default() };
            settings.estimate.fudge = Some(fudge);
            let j = truth::judge(&formula.subject(), 1000, &settings).unwrap();
            println!("{name:24} fudge {fudge} detail {detail}: {j:?}");
        }
    }
}

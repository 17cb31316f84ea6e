//! Sweeps from the command line: frames are the pictures that single renders make, and share their kernels.

use std::path::Path;

use crate::support::{bulbfold, folder, pixels, program, stderr};

/// Arguments of small pictures; estimates go by rules, so that no measurement decides.
const SMALL: [&str; 8] = ["render", "mandelbulb", "--size", "48x36", "--samples", "1", "--calibrate", "off"];

fn render(folder: &Path, backend: &str, more: &[&str]) -> serde_json::Value {
    let arguments = [&SMALL, &["--backend", backend, "--json", "--quiet"][..], more].concat();
    let output = bulbfold(folder, &arguments);
    assert!(output.status.success(), "{}", stderr(&output));
    serde_json::from_slice(&output.stdout).expect("JSON on stdout")
}

/// Share of bytes that are more than two steps apart.
fn difference(a: &Path, b: &Path) -> f64 {
    let (a, b) = (pixels(a), pixels(b));
    a.iter().zip(&b).filter(|(a, b)| a.abs_diff(**b) > 2).count() as f64 / a.len() as f64
}

fn has_gpu(folder: &Path) -> bool {
    let tried = bulbfold(folder, [&SMALL, &["--backend", "gpu", "-o", "tried.png"][..]].concat());
    let required = std::env::var("BULBFOLD_REQUIRE_GPU").is_ok_and(|v| v == "1");
    assert!(tried.status.success() || !required, "{}", stderr(&tried));
    tried.status.success()
}

/// Parameter, camera and angle at once: every frame with the kernels of the first, and equal to a picture of its own.
fn frames_share_kernels_and_are_right(folder: &Path, backend: &str, most_different: f64) {
    let sweep = ["--sweep", "power=5.2..7.6", "--sweep", "fov=40..50", "--sweep", "camera=1.5,-2,1..1.2,-2.2,1.4"];
    let report = render(folder, backend, &[&sweep[..], &["--frames", "5", "-o", "f%02d.png"]].concat());
    assert_eq!(report["frames"], 5);
    // So small a picture has none of the four kernels of beams, but `camera`.
    assert_eq!(report["kernels_compiled"], 10, "{report}");
    assert_eq!(report["structures"], serde_json::json!({}), "{report}");
    // The third of five, half the way.
    let own = ["--set", "power=6.4", "--fov", "45", "--camera", "1.35,-2.1,1.2", "--force", "-o", "own.png"];
    render(folder, backend, &own);
    let different = difference(&folder.join("f03.png"), &folder.join("own.png"));
    assert!(different <= most_different, "{different} of the picture differs");
    assert!(difference(&folder.join("f01.png"), &folder.join("f05.png")) > 0.1, "the frames move");
}

#[test]
fn frames_on_the_cpu() {
    let folder = folder();
    frames_share_kernels_and_are_right(folder.path(), "cpu", 0.0);
}

#[test]
fn frames_on_the_gpu() {
    let folder = folder();
    if has_gpu(folder.path()) {
        // Drivers may fold constants and round their products together.
        frames_share_kernels_and_are_right(folder.path(), "gpu", 0.02);
    }
}

#[test]
fn a_parameter_that_changes_the_structure_brings_kernels_of_its_own() {
    let folder = folder();
    let report = render(folder.path(), "cpu", &["--sweep", "power=4..6", "--frames", "5", "-o", "f%d.png"]);
    // Whole powers are products of 4, 5 and 6 factors; 4.5 and 5.5 go through angles.
    assert_eq!(report["structures"]["march"], 4, "{report}");
    for (frame, power) in ["4", "4.5", "5", "5.5", "6"].iter().enumerate() {
        let own = folder.path().join("own.png");
        render(folder.path(), "cpu", &["--set", &format!("power={power}"), "--force", "-o", "own.png"]);
        assert_eq!(difference(&folder.path().join(format!("f{}.png", frame + 1)), &own), 0.0, "power {power}");
    }
}

/// First, middle and last speak for the others; each view that is measured leaves a file in the cache.
#[test]
fn three_frames_are_measured_however_many_there_are() {
    let folder = folder();
    // Nothing but the step multiplier is left to choose, so the three agree.
    let one =
        ["--de", "scalar", "--form", "logarithmic", "--size", "24x18", "--samples", "1", "--backend", "cpu", "--quiet"];
    let sweep = ["--sweep", "turn=5..60", "--frames", "9", "-o", "f%d.png"];
    let mut command = program(folder.path());
    command.env("BULBFOLD_CACHE", folder.path().join("cache"));
    let output = command.args(["render", "mandelbulb"]).args(one).args(sweep).output().expect("the program starts");
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(folder.path().join("f9.png").exists());
    assert_eq!(std::fs::read_dir(folder.path().join("cache")).expect("something was measured").count(), 3);
}

#[test]
fn resume_keeps_frames_and_renders_the_others() {
    let folder = folder();
    let sweep = ["--sweep", "turn=0..90", "--frames", "4", "-o", "f%d.png"];
    assert_eq!(render(folder.path(), "cpu", &sweep)["frames"], 4);
    let second = folder.path().join("f2.png");
    let third = folder.path().join("f3.png");
    let before = [pixels(&second), pixels(&third)];
    // What is no frame of this sweep is made again (tests/output has more of that).
    std::fs::write(&second, b"mine").expect("the folder takes files");
    std::fs::remove_file(&third).expect("the frame is there");
    let report = render(folder.path(), "cpu", &[&sweep[..], &["--resume"]].concat());
    assert_eq!((&report["frames"], &report["skipped"]), (&2.into(), &2.into()));
    assert_eq!([pixels(&second), pixels(&third)], before);
    // Without it all are made again.
    assert_eq!(render(folder.path(), "cpu", &sweep)["frames"], 4);
}

#[test]
fn wrong_sweeps_say_what_to_do() {
    let folder = folder();
    let cases: [(&[&str], &str); 6] = [
        (&["--sweep", "power=2..12"], "--frames"),
        (&["--sweep", "power=2", "--frames", "3"], "NAME=FROM..TO"),
        (&["--sweep", "power=2..12", "--frames", "3", "-o", "frame.png"], "frame_%04d.png"),
        (&["--sweep", "powr=2..12", "--frames", "3"], "power"),
        (&["--sweep", "power=2..99", "--frames", "3"], "16"),
        (&["--sweep", "camera=0,0,0..1,1,1", "--sweep", "target=0,0,0..1,1,1", "--frames", "3"], "target"),
    ];
    for (arguments, expected) in cases {
        let output = bulbfold(folder.path(), [&SMALL, arguments].concat());
        let told = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {told}");
        assert!(told.contains(expected), "{arguments:?}: {told}");
        assert!(!folder.path().join("mandelbulb_0001.png").exists(), "{arguments:?}: something was rendered");
    }
}

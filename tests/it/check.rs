//! What is wrong in a formula is found and named; what is shipped is clean.

use bulbfold::check::Formula;
use bulbfold::check::health::{Health, Kind, Severity, check_formula, check_step};
use bulbfold::formula::library::Library;
use bulbfold::shade::Size;

use crate::support::{bulbfold, folder_with, stderr, stdout};

const SIZE: Size = Size { width: 320, height: 180 };

fn health_of(formula: &Formula) -> Health {
    check_formula(&formula.subject(), SIZE, &mut |_| {}).unwrap_or_else(|error| panic!("{}", error.message))
}

fn texts(health: &Health) -> Vec<String> {
    health.findings.iter().map(|f| format!("{} {}: {}", f.severity.name(), f.kind.name(), f.message)).collect()
}

fn has(health: &Health, severity: Severity, kind: Kind) -> bool {
    health.findings.iter().any(|f| f.severity == severity && f.kind == kind)
}

#[test]
fn shipped_steps_are_clean() {
    let library = Library::builtin();
    let mut wrong = Vec::new();
    let mut count = 0;
    for step in library.steps() {
        count += 1;
        let health = check_step(&library, step).unwrap_or_else(|error| panic!("{}", error.message));
        assert!(health.measures.len() >= 3, "{}", step.name);
        wrong.extend(health.wrong().map(|f| format!("{}: {}", step.name, f.message)));
    }
    assert!(count >= 22, "{count}");
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

#[test]
fn shipped_fractals_are_clean() {
    let mut wrong = Vec::new();
    for name in crate::sampled::sampled(20) {
        let health = health_of(&Formula::builtin(name).unwrap());
        println!("{name}: {:#?}\n{:#?}", health.measures, texts(&health));
        wrong.extend(health.wrong().map(|f| format!("{name}: {}", f.message)));
    }
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

/// The notes of `bulb_power` say that it jumps there, so it is no mistake, but it is told.
#[test]
fn a_known_jump_is_a_warning_with_its_place() {
    let bulb = r#"(nodes: { "b": bulb_power(power: 2, convention: "asin") }, max_iterations: 4, bounding_radius: 2.0)"#;
    let health = health_of(&Formula::from_ron(bulb).unwrap());
    let jump = health.findings.iter().find(|f| f.kind == Kind::Jump);
    let jump = jump.unwrap_or_else(|| panic!("{:?}", texts(&health)));
    assert_eq!(jump.severity, Severity::Warning);
    // The polar axis is z.
    let at = jump.point.as_ref().expect("a jump has a place");
    assert!(at[0].abs() < 1e-6 && at[1].abs() < 1e-6, "{at:?}");
    // With three times the angle nothing jumps: cos 3 90 degrees is 0.
    let odd = bulb.replace("power: 2", "power: 3");
    let health = health_of(&Formula::from_ron(&odd).unwrap());
    assert!(!health.findings.iter().any(|f| f.kind == Kind::Jump), "{:?}", texts(&health));
}

const SOUND: &str = r#"
fn step(z, c, p) {
    clamp(z, -1.0, 1.0) * 2.0 - z
}
fn derivative(z, dr, p) {
    dr * 1.0
}
#{
    group: "fold",
    summary: "A box fold.",
    source: "A test",
    scalar_rule: "exact",
    examples: [ #{ z: [1.5, 0.0, 0.0], expect: [0.5, 0.0, 0.0] } ],
}
"#;

const GRAPH: &str = r#"(
    nodes: { "mine": my_step(), "grow": scale(scale: 2.0), "all": Sequence(["mine", "grow"]) },
    output: "all", escape_radius: 60, max_iterations: 8, bounding_radius: 11.0,
)"#;

/// A folder with the step and a formula that uses it.
fn beside(step: &str, graph: &str) -> tempfile::TempDir {
    folder_with(&[("my_step.rhai", step), ("mine.ron", graph)])
}

/// Checks the formula and the step alone; both must be told the same thing. Returns the text.
fn expect_wrong(step: &str, words: &[&str]) {
    let folder = beside(step, GRAPH);
    for file in ["mine.ron", "my_step.rhai"] {
        let output = bulbfold(folder.path(), ["check", file, "--size", "320x180"]);
        let text = stdout(&output);
        assert_eq!(output.status.code(), Some(1), "{file}\n{text}\n{}", stderr(&output));
        for word in words {
            assert!(text.contains(word), "{file} does not say `{word}`:\n{text}");
        }
        assert!(!text.contains('\u{1b}'), "colour without a terminal");
    }
}

#[test]
fn a_sound_step_is_clean() {
    let folder = beside(SOUND, GRAPH);
    for file in ["mine.ron", "my_step.rhai"] {
        let output = bulbfold(folder.path(), ["check", file, "--size", "320x180"]);
        let text = stdout(&output);
        assert_eq!(output.status.code(), Some(0), "{file}\n{text}\n{}", stderr(&output));
        assert!(text.contains("result: 0 wrong"), "{text}");
    }
}

#[test]
fn a_rule_below_the_stretch_is_named_with_its_line() {
    let step = SOUND.replace("dr * 1.0", "dr * 0.5");
    expect_wrong(&step, &["scalar rule of", "too small", "my_step.rhai:5", "the true stretch is 1", "says 0.5"]);
}

#[test]
fn a_rule_that_is_too_small_at_a_few_places_is_found() {
    // Right but between radii 1 and 1.2.
    let step = SOUND.replace("dr * 1.0", "select(and(dot(z, z) > 1.0, dot(z, z) < 1.44), dr * 0.9, dr)");
    expect_wrong(&step, &["too small", "the true stretch is 1", "says 0.9"]);
}

#[test]
fn a_heuristic_rule_that_is_mostly_too_small_is_wrong() {
    let step = SOUND.replace("dr * 1.0", "dr * 0.5").replace("\"exact\"", "\"heuristic\"");
    expect_wrong(&step, &["too small at 100 % of all states"]);
}

#[test]
fn a_rule_of_a_step_that_cannot_be_differentiated_is_checked_too() {
    let step = SOUND.replace("dr * 1.0", "dr * 0.5").replace("scalar_rule:", "differentiable: false, scalar_rule:");
    expect_wrong(&step, &["too small", "my_step.rhai:5"]);
}

#[test]
fn a_jump_is_found_at_its_plane() {
    // A conditional translation across x = 0.4.
    let step = SOUND.replace("clamp(z, -1.0, 1.0) * 2.0 - z", "select(z.x > 0.4, z + vec3(0.25, 0.0, 0.0), z)");
    expect_wrong(&step, &["jumps by 0.25 at z = (0.4, ", "my_step.rhai:2", "write it as a fold"]);
}

#[test]
fn a_step_that_gives_nan_is_found() {
    let step = SOUND.replace("clamp(z, -1.0, 1.0) * 2.0 - z", "z * (dot(z, z) / dot(z, z))");
    expect_wrong(&step, &["gives NaN at z = (0, 0, 0)"]);
}

#[test]
fn a_wrong_growth_is_found() {
    let step = SOUND.replace("scalar_rule:", "growth: \"power\", scalar_rule:");
    expect_wrong(&step, &["declares the growth power", "growth: \"linear\"", "my_step.rhai:12"]);
}

fn findings_of(graph: &str) -> Health {
    health_of(&Formula::from_ron(graph).unwrap())
}

#[test]
fn a_wrong_form_is_found() {
    let power = r#"(nodes: { "b": bulb_power() }, escape_radius: 10, max_iterations: 4, bounding_radius: 1.3, estimate: (form: linear))"#;
    let health = findings_of(power);
    assert!(has(&health, Severity::Wrong, Kind::Form), "{:?}", texts(&health));
    let health = findings_of(&power.replace("form: linear", "form: logarithmic"));
    assert!(!has(&health, Severity::Wrong, Kind::Form), "{:?}", texts(&health));
}

const MENGER: &str = r#"(
    nodes: { "fold": menger_fold(), "grow": scale(scale: 3.0, centre: (1, 1, 1)), "all": Sequence(["fold", "grow"]) },
    output: "all", constant: Off, escape_radius: 8, max_iterations: 6, bounding_radius: 1.75, estimate: (radius: 1.7320509),
)"#;

#[test]
fn a_wrong_radius_is_found() {
    assert_eq!(findings_of(MENGER).wrong().count(), 0);
    // The corners are at sqrt(3), 1.73.
    let health = findings_of(&MENGER.replace("radius: 1.7320509)", "radius: 1.2)"));
    assert!(has(&health, Severity::Wrong, Kind::Radius), "{:?}", texts(&health));
    let health = findings_of(&MENGER.replace("bounding_radius: 1.75", "bounding_radius: 1.3"));
    assert!(has(&health, Severity::Wrong, Kind::Bounds), "{:?}", texts(&health));
}

#[test]
fn iterations_that_no_pixel_shows_are_noted() {
    // Each iteration makes the sponge's grain three times finer: after 14 it is a millionth of the sponge.
    let health = findings_of(&MENGER.replace("max_iterations: 6", "max_iterations: 14"));
    let text = texts(&health).join("\n");
    assert!(has(&health, Severity::Note, Kind::Iterations), "{text}");
    let few = findings_of(&MENGER.replace("max_iterations: 6", "max_iterations: 3"));
    assert!(!has(&few, Severity::Note, Kind::Iterations), "{:?}", texts(&few));
}

#[test]
fn bad_input_is_refused_with_2() {
    let folder = beside(SOUND, "(nodes: {");
    for file in ["mine.ron", "no_such_thing", "."] {
        let output = bulbfold(folder.path(), ["check", file]);
        assert_eq!(output.status.code(), Some(2), "{file}");
        assert!(stderr(&output).starts_with("error"), "{file}");
    }
}

#[test]
fn json_lines_are_complete() {
    let folder = beside(&SOUND.replace("dr * 1.0", "dr * 0.5"), GRAPH);
    let output = bulbfold(folder.path(), ["check", "mine.ron", "--size", "320x180", "--json"]);
    assert_eq!(output.status.code(), Some(1));
    let text = stdout(&output);
    let lines: Vec<serde_json::Value> = text.lines().map(|line| serde_json::from_str(line).expect(line)).collect();
    let rule = lines.iter().find(|line| line["finding"]["kind"] == "rule").expect("the rule is found");
    assert_eq!(rule["finding"]["severity"], "wrong");
    assert!(rule["finding"]["place"].as_str().is_some_and(|place| place.ends_with("my_step.rhai:5")), "{rule}");
    assert_eq!(lines.last().expect("a summary")["summary"]["wrong"], 1);
}

#[test]
fn shapes_of_graphs_are_looked_at() {
    let health = health_of(&Formula::open("tests/it/reach/bumpy_ball.ron").unwrap());
    assert!(has(&health, Severity::Wrong, Kind::Rule), "{:?}", texts(&health));
    assert!(texts(&health).iter().any(|text| text.contains("rises by 4.")), "{:?}", texts(&health));
}

#[test]
fn growth_that_goes_up_and_down_gives_no_advice() {
    // Far out r is multiplied by something between 0.5 and 3.5.
    let text = r#"(nodes: { "a": waves() }, output: "a", escape_radius: 30, max_iterations: 6)"#;
    let folder = std::env::temp_dir().join(format!("bulbfold-waves-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let step = "fn step(z, c, p) { z * (2.0 + 1.5 * sin(4.0 * length(z))) }\n\
                #{ group: \"scale\", summary: \"Rings.\", source: \"mine\", params: [], examples: [] }\n";
    std::fs::write(folder.join("waves.rhai"), step).unwrap();
    std::fs::write(folder.join("rings.ron"), text).unwrap();
    let health = health_of(&Formula::open(folder.join("rings.ron")).unwrap());
    let all = format!("{:?} {:?}", health.measures, texts(&health));
    assert!(!has(&health, Severity::Wrong, Kind::Growth) && !has(&health, Severity::Wrong, Kind::Form), "{all}");
    assert!(!all.contains("e308") && !all.contains("by -"), "{all}");
    assert!(all.contains("up and down"), "{all}");
    std::fs::remove_dir_all(folder).unwrap();
}

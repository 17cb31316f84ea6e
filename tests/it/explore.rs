//! New formulas from old ones: drafts are the same on every run, stay within their ranges and are read back as they were; the
//! judge rejects what is no picture; what is written renders alone.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use bulbfold::engine::{Engine, Formula, Request};
use bulbfold::explore::{Judge, Parent, Reason, Variation, breed, vary};
use bulbfold::formula::embedded::{FRACTALS, SCRIPTS};
use bulbfold::graph::print::listing;
use bulbfold::graph::{NodeKind, ParamInput};
use bulbfold::shade::Size;

use crate::support::{bulbfold, folder, folder_with, stderr, success};

const SMALL: Variation = Variation { seed: 1, amount: 0.3, structure: false };

fn request() -> Request {
    Request { size: Size { width: 96, height: 72 }, samples: 1, calibrate: false, ..Request::default() }
}

fn parent(what: &str) -> (Arc<Formula>, Parent) {
    let formula = Engine::new().open(what).unwrap_or_else(|error| panic!("{what}: {error}"));
    let parent = Parent::of(&formula, what).unwrap_or_else(|error| panic!("{what}: {error}"));
    (formula, parent)
}

/// A formula of a text, and the reason for which it is rejected beside a sphere in the middle of the picture.
fn verdict(text: &str) -> Result<f64, Reason> {
    let engine = Engine::new();
    let ball = engine.read("ball.ron", BALL, &[]).expect("a sphere");
    let judge = Judge::of(&engine, std::slice::from_ref(&ball), &request()).expect("a sphere can be judged");
    let parent = Parent::of(&ball, "ball").expect("a sphere is a parent");
    judge.judge(&engine, &parent, text, &[]).map(|accepted| accepted.hits).map_err(|(reason, _)| reason)
}

const BALL: &str = "(nodes: {\"a\": Sphere(radius: 1)}, output: \"a\", bounding_radius: 4, cuts: true, \
                    camera: (position: (0, -4, 0), target: (0, 0, 0), fov: 60))";

#[test]
fn trees_are_read_back_as_they_were() {
    for (name, _) in FRACTALS.iter().chain(SCRIPTS) {
        let (formula, parent) = parent(name);
        let text = parent.text();
        let again = parent.read(&text).unwrap_or_else(|error| panic!("{name}: {error}\n{text}"));
        let shown = |formula: &Formula| listing(formula.graph()).lines().skip(1).collect::<Vec<_>>().join("\n");
        assert_eq!(shown(&again), shown(&formula), "{name}\n{text}");
        assert_eq!(
            format!("{:?}", again.graph().scene.camera),
            format!("{:?}", formula.graph().scene.camera),
            "{name}"
        );
        // Written again it is the same text.
        let twice = Parent::of(&again, name).expect("it is a parent").text();
        assert_eq!(twice, text, "{name}");
    }
}

#[test]
fn drafts_follow_from_seed_and_number() {
    let (_, parent) = parent("mandelbox");
    for structure in [false, true] {
        let variation = Variation { structure, ..SMALL };
        let text = |seed: u64, number: u64| {
            vary(&parent, &Variation { seed, ..variation }, number).expect("it has numbers").text()
        };
        assert_eq!(text(1, 5), text(1, 5));
        let texts: std::collections::BTreeSet<String> = (1..=20).map(|number| text(1, number)).collect();
        assert_eq!(texts.len(), 20, "drafts differ");
        assert_ne!(text(1, 5), text(2, 5));
    }
}

/// Every number of a draft is within the range that its parameter or its step states, and something has changed.
#[test]
fn numbers_stay_in_their_ranges() {
    for (name, _) in FRACTALS.iter().step_by(7) {
        let (formula, parent) = parent(name);
        if formula.graph().scene.plane.is_some() {
            continue;
        }
        for number in 1..=6 {
            let Ok(draft) = vary(&parent, &Variation { amount: 1.0, ..SMALL }, number) else { continue };
            assert!(!draft.changes.is_empty(), "{name} {number}");
            // A parameter may lead a node's number out of its range; that is an error with a place, and the judge's matter.
            let Ok(child) = parent.read(&draft.text()) else { continue };
            let graph = child.graph();
            assert!(graph.params.iter().all(|p| (p.min..=p.max).contains(&p.value)), "{name}: {}", draft.text());
            for node in &graph.nodes {
                let NodeKind::Step { step, params } = &node.kind else { continue };
                for (param, value) in step.params.iter().zip(params) {
                    if let ParamInput::Known(bulbfold::formula::step::ParamValue::Number(x)) = value {
                        assert!((param.min..=param.max).contains(x), "{name}: {} {x}", param.name);
                    }
                }
            }
        }
    }
}

#[test]
fn the_judge_names_what_is_no_picture() {
    let with = |nodes: &str, camera: &str| {
        format!("(nodes: {{{nodes}}}, output: \"a\", bounding_radius: 4, cuts: true, camera: ({camera}, fov: 60))")
    };
    let front = "position: (0, -4, 0), target: (0, 0, 0)";
    let ball = "\"a\": Sphere(radius: 1)";
    // A ball of radius 1 at distance 4 covers asin(1/4) = 14.5 degrees around the axis of a picture 60 degrees high and 4:3 wide.
    let hits = verdict(&with(ball, front)).expect("a ball is a picture");
    let radius = (0.25_f64.asin().tan()) / 30_f64.to_radians().tan();
    let area = std::f64::consts::PI * radius * radius / (4.0 * 4.0 / 3.0);
    assert!((hits / area - 1.0).abs() < 0.1, "{hits} and {area}");
    let cases = [
        (Reason::Empty, with(ball, "position: (0, -4, 0), target: (0, -9, 0)")),
        (Reason::Full, with("\"a\": Sphere(radius: 3.9)", front)),
        (Reason::Cut, with(ball, "position: (0, -4, 0), target: (2.3, 0, 0)")),
        (
            Reason::Dust,
            with(
                "\"b\": Sphere(radius: 0.1), \"a\": Tile(of: \"b\", period: (1, 1, 1))",
                "position: (0.5, -9.5, 0.5), target: (0.6, 0, 0.4)",
            ),
        ),
        (Reason::Slow, "(nodes: {\"a\": bulb_power(power: 8)}, escape_radius: 10, estimate: (fudge: 0.2))".to_string()),
        (Reason::Broken, "(nodes: {\"a\": no_such_step()})".to_string()),
    ];
    for (expected, text) in cases {
        assert_eq!(verdict(&text).err(), Some(expected), "{text}");
    }
}

/// A ball is plain beside a sponge, and a picture beside a ball.
#[test]
fn balls_are_plain_beside_sponges() {
    let engine = Engine::new();
    let (sponge, parent) = parent("menger");
    let judge = Judge::of(&engine, &[sponge], &request()).expect("a sponge can be judged");
    let verdict = |text: &str| judge.judge(&engine, &parent, text, &[]).err().map(|(reason, _)| reason);
    assert_eq!(verdict("(nodes: {\"a\": Sphere(radius: 1)}, output: \"a\")"), Some(Reason::Plain));
    assert_eq!(verdict("(nodes: {\"a\": Box()}, output: \"a\")"), Some(Reason::Plain));
    assert_eq!(verdict(&parent.text()), None);
}

/// Children of the same formula have numbers between those of both parents.
#[test]
fn children_of_one_formula_lie_between_their_parents() {
    let file = |scale: f64, limit: f64| {
        format!("(nodes: {{\"a\": Sequence([box_fold(limit: {limit}), scale(scale: {scale})])}}, output: \"a\")")
    };
    let engine = Engine::new();
    let parent =
        |text: String| Parent::of(&engine.read("p.ron", &text, &[]).expect("a formula"), "p").expect("a parent");
    let (a, b) = (parent(file(2.0, 1.0)), parent(file(3.0, 0.5)));
    let mut scales = Vec::new();
    for number in 1..=20 {
        let child = a.read(&breed(&a, &b, 3, number).expect("a child").text()).expect("it is read");
        let values: BTreeMap<String, f64> = child.graph().nodes.iter().flat_map(known).collect();
        assert!((2.0..=3.0).contains(&values["scale.scale"]), "{values:?}");
        assert!((0.5..=1.0).contains(&values["box_fold.limit"]), "{values:?}");
        scales.push(values["scale.scale"]);
    }
    let [least, most] = [scales.iter().copied().fold(9.0, f64::min), scales.iter().copied().fold(0.0, f64::max)];
    assert!(least < 2.3 && most > 2.7, "{scales:?}");
}

fn known(node: &bulbfold::graph::Node) -> Vec<(String, f64)> {
    let NodeKind::Step { step, params } = &node.kind else { return Vec::new() };
    let number = |(param, value): (&bulbfold::formula::step::StepParam, &ParamInput)| match value {
        ParamInput::Known(bulbfold::formula::step::ParamValue::Number(x)) => {
            Some((format!("{}.{}", step.name, param.name), *x))
        }
        _ => None,
    };
    step.params.iter().zip(params).filter_map(number).collect()
}

/// Names that both parents use are told apart, and a child has the steps of both.
#[test]
fn children_of_two_formulas_have_the_steps_of_both() {
    let engine = Engine::new();
    let parent = |name: &str| Parent::of(&engine.open(name).expect("built in"), name).expect("a parent");
    // Both have a node `fold` and a node `grow`.
    let (a, b) = (parent("mandelbox"), parent("menger"));
    for number in 1..=12 {
        let text = breed(&a, &b, 1, number).expect("a child").text();
        let child = a.read(&text).unwrap_or_else(|error| panic!("{error}\n{text}"));
        let steps: Vec<&str> = child.graph().nodes.iter().map(|node| node.kind.keyword()).collect();
        assert!(steps.contains(&"sphere_fold") && steps.contains(&"menger_fold"), "{steps:?}");
        assert!(text.contains("\"fold2\": menger_fold"), "{text}");
    }
}

#[test]
fn written_files_render_alone_and_show_what_was_seen() {
    let (folder, again) = (folder(), folder());
    let run = |folder: &Path, seed: &str| {
        let small = ["--size", "96x72", "--backend", "cpu", "--calibrate", "off", "-q", "-o", "s.png"];
        let arguments = [&["vary", "mandelbox", "--count", "3", "--seed", seed][..], &small].concat();
        success(&bulbfold(folder, arguments))
    };
    let said = run(folder.path(), "4");
    assert!(said.lines().last().is_some_and(|line| line.starts_with("3 of 3 found, ")), "{said}");
    assert_eq!(run(again.path(), "4"), said, "the same seed makes the same formulas");
    let mut shares = Vec::new();
    for number in 1..=3 {
        let file = format!("s/mandelbox_{number:02}.ron");
        let [text, twin] = [&folder, &again].map(|f| std::fs::read_to_string(f.path().join(&file)).expect("written"));
        assert_eq!(text, twin);
        assert!(text.starts_with("// A variation of mandelbox (seed 4, draft "), "{text}");
        // Alone in another folder.
        let alone = folder_with(&[("a.ron", &text)]);
        let arguments =
            ["render", "a.ron", "--size", "96x72", "--samples", "1", "--json", "--calibrate", "off", "-q", "-oa.png"];
        let output = bulbfold(alone.path(), arguments);
        let stats: serde_json::Value =
            serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{e} {}", stderr(&output)));
        let share = stats["hits"].as_f64().expect("hits") / stats["rays"].as_f64().expect("rays");
        assert!((0.03..=0.97).contains(&share), "{file}: {share}");
        shares.push(share);
    }
    let bytes = [&folder, &again].map(|folder| std::fs::read(folder.path().join("s.png")).expect("a sheet"));
    assert!(bytes[0] == bytes[1] && bytes[0].starts_with(b"\x89PNG"));
}

/// A file that is to render alone says which estimate is right for it, unless nothing is to be measured.
#[test]
fn written_files_carry_an_estimate_that_was_measured() {
    let folder = folder();
    let small = ["vary", "mandelbox", "--count", "1", "--seed", "4", "--size", "96x72", "--backend", "cpu", "-q"];
    success(&bulbfold(folder.path(), [&small[..], &["-o", "measured.png"]].concat()));
    success(&bulbfold(folder.path(), [&small[..], &["--calibrate", "off", "-o", "plain.png"]].concat()));
    let text = |of: &str| std::fs::read_to_string(folder.path().join(of).join("mandelbox_01.ron")).expect("written");
    assert!(text("measured").contains("calibrated: true"), "{}", text("measured"));
    assert!(!text("plain").contains("calibrated"), "{}", text("plain"));
}

#[test]
fn steps_of_a_folder_go_with_the_files() {
    let step = "fn step(z, c, p) { z * p.by }\n#{ params: [#{ name: \"by\", type: \"float\", \"default\": 1.0, min: 0.95, max: 1.05 }], growth: \"linear\" }\n";
    let graph = "(nodes: {\"a\": Sequence([menger_fold(), scale(scale: 3, centre: (1, 1, 1)), mine(by: 0.99)])}, \
                 constant: Off, escape_radius: 8, max_iterations: 5)";
    let folder = folder_with(&[("mine.rhai", step), ("own.ron", graph)]);
    let small = ["--count", "1", "--size", "64x48", "--backend", "cpu", "--calibrate", "off", "-q", "-o", "v.png"];
    success(&bulbfold(folder.path(), [&["vary", "own.ron"][..], &small].concat()));
    assert_eq!(std::fs::read_to_string(folder.path().join("v/mine.rhai")).expect("the step"), step);
}

#[test]
fn sheets_have_a_picture_for_each_value() {
    let folder = folder();
    let size = |arguments: &[&str]| {
        let small = ["--size", "48x36", "--backend", "cpu", "--calibrate", "off", "-q", "-o", "sheet.png"];
        success(&bulbfold(folder.path(), [&["sheet"][..], arguments, &small].concat()));
        let bytes = std::fs::read(folder.path().join("sheet.png")).expect("a sheet");
        let edge = |at: usize| u32::from_be_bytes(bytes[at..at + 4].try_into().expect("four bytes"));
        [edge(16), edge(20)]
    };
    // 8 pixels around pictures, 13-pixel captions and 11-pixel notes in lines 1.45 times as high.
    let page = |columns: u32, rows: u32, notes: f64| {
        let height = f64::from(rows) * (36.0 + 1.45 * (13.0 + 11.0 * notes) + 8.0) + 8.0;
        [columns * 56 + 8, height.ceil() as u32]
    };
    assert_eq!(size(&["menger"]), page(1, 1, 0.0));
    assert_eq!(size(&["mandelbulb", "--sweep", "power=2..4", "--values", "3"]), page(3, 1, 1.0));
    let two = ["mandelbox", "--sweep", "scale=1.8,2.2", "--sweep", "min_radius=0.3..0.6", "--values", "3"];
    assert_eq!(size(&two), page(2, 3, 2.0));
    // The formula, two presets.
    assert_eq!(size(&["mandelbulb", "--presets"]), page(2, 2, 0.0));
}

#[test]
fn mistakes_are_told() {
    let folder = folder_with(&[("plain.ron", "(nodes: {\"a\": Box()}, output: \"a\")")]);
    for (arguments, word) in [
        (&["sheet", "menger", "--sweep", "turn=0..90"][..], "cannot move `turn`"),
        (&["sheet", "mandelbox", "--sweep", "a=1..2", "--sweep", "b=1..2", "--sweep", "c=1..2"], "two axes"),
        (&["sheet", "mandelbox", "--sweep", "scal=1..2"], "scale"),
        (&["vary", "mandelbrot"], "plane"),
        (&["vary", "mandelbox", "--amount", "0"], "share"),
        (&["vary", "mandelbox", "-o", "-"], "stdout"),
        (&["vary", "plain.ron"], "no numbers"),
        (&["breed", "mandelbox", "mandelbrot"], "plane"),
        (&["breed", "mandelbox", "no_such"], "no_such"),
    ] {
        let output = bulbfold(folder.path(), arguments);
        let text = stderr(&output);
        assert!(output.status.code() == Some(2) && text.contains(word), "{arguments:?}: {:?} {text}", output.status);
    }
}

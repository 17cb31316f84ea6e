//! No input makes the program panic or hang: thousands of damaged formula and step files end in messages or in a picture.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use bulbfold::check::{Backends, Random, Target};
use bulbfold::compose::{Choice, Composer, Purpose, choose, compose_estimator, field_orbits, scalar_rules};
use bulbfold::diag::Diagnostics;
use bulbfold::expr::{Arena, Function, Port, Type};
use bulbfold::formula::embedded::{FRACTALS, STEPS};
use bulbfold::formula::library::Library;
use bulbfold::formula::step::{StateWidth, Step, StepInputs, script_value};
use bulbfold::graph::{DeForm, EstimateSettings, Method};
use bulbfold::kernel::{Kernel, wgsl};
use bulbfold::load::load_text;
use bulbfold::march::{MarchSettings, compose_march};

const CASES: usize = 10_000;
/// A case that takes longer counts as a hang. Generous: other programs share the machine.
const SLOW: Duration = Duration::from_secs(5);
/// Every how many cases that load the automatic choices are made, too: they cost fifty times the rest.
const CHOOSE_EVERY: usize = 10;

/// A graph with every kind of node, since fractals use few of them.
const EVERYTHING: &str = r#"(
    summary: "Everything", params: { "s": (default: 2.0, min: 1, max: 4) },
    nodes: {
        "fold": box_fold(limit: 1.0), "ball": sphere_fold(min_radius: 0.5), "grow": scale(scale: "s + 0.1 * n"),
        "box": Sequence(["fold", "ball", "grow"]), "bulb": bulb_power(power: 8),
        "rep": Repeat(of: "fold", times: 3), "mix": Blend(a: "box", b: "bulb", weight: 0.25),
        "pick": Choose(when: RadiusBelow(1.2), then: "mix", otherwise: "rep"),
        "span": Between(of: "pick", from: 1, to: 4, otherwise: Item(of: "box", constant: Julia((0.1, 0.2, 0.3)))),
        "turns": Alternate([("span", 2), "box", ("bulb", 1)]),
        "orbit": Orbit(of: "turns", max_iterations: 7, constant: Mix(julia: (1, 0, 0), amount: 0.5), pre: [translate()]),
        "other": Orbit(of: "bulb", constant: Off, escape_radius: 4, estimate: (method: delta, form: linear, radius: 1, fudge: 0.5)),
        "cube": Box(half_size: (1, 2, 0.5)), "ring": Torus(major: 1, minor: 0.2), "rod": Cylinder(radius: 0.2),
        "floor": Plane(normal: (0, 0, 1), offset: -1), "shell": Sphere(radius: 2, form: shell),
        "placed": Transform(of: "orbit", translate: (1, 0, 0), axis: (1, 1, 0), angle: 30, scale: 0.5),
        "cut": Difference(a: "placed", b: "cube"), "both": Intersection(["shell", "other"]),
        "all": Union(["cut", "both", "ring", SmoothUnion(of: ["rod", "floor"], radius: 0.2)]),
    },
    output: "all", camera: (position: (4, -4, 3), target: (0, 0, 0), fov: 40), bounding_radius: 4,
    tests: [Inside((0, 0, 0)), Ray(origin: (4, 0, 0), direction: (-1, 0, 0), t: 2), Symmetric(Turn(axis: (0, 0, 1), angle: 90))],
)"#;

/// Damages a text in one of the ways that hands and programs do.
fn mutate(text: &str, random: &mut Random) -> String {
    let mut bytes = text.as_bytes().to_vec();
    let at = random.below(bytes.len());
    match random.below(9) {
        0 => bytes.truncate(at),
        1 => bytes[at] ^= 1 << random.below(8),
        2 => drop(bytes.drain(at..(at + 1 + random.below(30)).min(text.len()))),
        3 => {
            let part = bytes[at..(at + 1 + random.below(60)).min(text.len())].to_vec();
            let to = random.below(bytes.len());
            bytes.splice(to..to, part);
        }
        4 => return swap_lines(text, random),
        5 | 6 => return replace_number(text, random),
        7 => return swap_words(text, random),
        _ => {
            let extra =
                ["(", ")", "[", "{", "\"", ",", ":", "#{", "//", "/*", "\\", "\0", "é", "Some(", "-", "1e999", ".."];
            bytes.splice(at..at, extra[random.below(extra.len())].bytes());
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

fn swap_lines(text: &str, random: &mut Random) -> String {
    let mut lines: Vec<&str> = text.lines().collect();
    let (a, b) = (random.below(lines.len()), random.below(lines.len()));
    lines.swap(a, b);
    if random.below(2) == 0 {
        lines.insert(a, lines[b]);
    }
    lines.join("\n")
}

/// Places of maximal runs of characters that `of` holds for.
fn runs(text: &str, of: impl Fn(char) -> bool) -> Vec<(usize, usize)> {
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for (at, c) in text.char_indices().filter(|(_, c)| of(*c)) {
        match runs.last_mut() {
            Some((_, end)) if *end == at => *end += c.len_utf8(),
            _ => runs.push((at, at + c.len_utf8())),
        }
    }
    runs
}

fn replace_number(text: &str, random: &mut Random) -> String {
    let numbers = runs(text, |c| c.is_ascii_digit() || c == '.');
    let Some(&(from, to)) = numbers.get(random.below(numbers.len())) else { return String::new() };
    let values = [
        "0",
        "-1",
        "1e308",
        "-1e308",
        "1e-308",
        "NaN",
        "inf",
        "-inf",
        "1e999",
        "100",
        "9999999999999999999999",
        "0.0",
        "-0.0",
        "3",
        "1000",
        "0x10",
        "true",
        "\"n\"",
        "\"s\"",
        "()",
    ];
    format!("{}{}{}", &text[..from], values[random.below(values.len())], &text[to..])
}

fn swap_words(text: &str, random: &mut Random) -> String {
    let words = runs(text, |c| c.is_ascii_alphabetic() || c == '_');
    if words.len() < 2 {
        return String::new();
    }
    let (a, b) = (words[random.below(words.len())], words[random.below(words.len())]);
    format!("{}{}{}", &text[..a.0], &text[b.0..b.1], &text[a.1..])
}

#[derive(Default, Debug)]
struct Counts {
    refused: usize,
    failed_to_compose: usize,
    drawn: usize,
    chosen: usize,
}

/// Loads a graph and marches a picture of 4x4 pixels.
fn try_graph(library: &mut Library, text: &str, counts: &mut Counts) {
    let mut d = Diagnostics::default();
    let Some(loaded) = load_text(library, "mutant.ron", text, &[], &mut d) else {
        assert!(d.has_errors(), "a file was refused without a message");
        let shown = d.render(&library.sources, false);
        assert!(!shown.is_empty());
        counts.refused += 1;
        return;
    };
    let graph = loaded.graph.with_orbit_settings(|s| s.max_iterations = s.max_iterations.min(12));
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library, graph: &graph };
    counts.drawn += 1;
    let plan = match counts.drawn % CHOOSE_EVERY {
        0 => choose(&composer, &EstimateSettings::default()).map(|plan| {
            counts.chosen += 1;
            plan.choices
        }),
        _ => Ok(fixed_choices(&composer)),
    };
    let estimator = plan.and_then(|choices| compose_estimator(&composer, &choices, Purpose::March));
    let Ok(estimator) = estimator else {
        counts.failed_to_compose += 1;
        return;
    };
    let settings = MarchSettings { pixel_radius: 0.1, max_march_steps: 60, ..MarchSettings::default() };
    let march = Kernel::March(compose_march(&arena, estimator, &settings));
    let mut columns = vec![Vec::new(); 8];
    for i in 0..16 {
        let (x, y) = (f64::from(i % 4) * 0.1 - 0.15, f64::from(i / 4) * 0.1 - 0.15);
        let values = [-4.0, 0.1, 0.05, 1.0, x, y, 0.0, 8.0];
        columns.iter_mut().zip(values).for_each(|(column, value)| column.push(value));
    }
    Backends::cpu_only().run(Target::CPU_F32, &arena, &march, &columns).unwrap();
    if counts.drawn.is_multiple_of(20) {
        wgsl::validate(&wgsl::write(&arena, &march)).unwrap();
    }
}

fn fixed_choices(composer: &Composer) -> Vec<Choice> {
    let choice = |differentiable: bool, scalar: bool| Choice {
        method: if !differentiable {
            Method::Delta
        } else if scalar {
            Method::Combined
        } else {
            Method::Gradient
        },
        form: DeForm::Logarithmic,
        differentiable,
        applicable: Method::ALL.to_vec(),
        ..Choice::default()
    };
    field_orbits(composer)
        .iter()
        .map(|orbit| {
            let roots = std::iter::once(orbit.root)
                .chain(orbit.settings.pre.iter().copied())
                .chain(orbit.settings.post.iter().copied());
            choice(true, roots.into_iter().all(|root| scalar_rules(composer, root).is_some()))
        })
        .collect()
}

/// Reads a step and traces it with its defaults.
fn try_step(library: &mut Library, name: &str, text: &str, counts: &mut Counts) {
    let id = library.sources.add("mutant.rhai", text);
    let mut d = Diagnostics::default();
    let Some(step) = Step::read(&library.engine, &library.sources, id, name, &mut d) else {
        assert!(!d.render(&library.sources, false).is_empty(), "a file was refused without a message");
        counts.refused += 1;
        return;
    };
    let arena = Arc::new(Arena::default());
    let ty = if step.state == StateWidth::Four { Type::V4 } else { Type::V3 };
    let mut params = rhai::Map::new();
    for param in &step.params {
        params.insert(param.name.as_str().into(), script_value(&arena, &param.kind, &param.default));
    }
    let inputs =
        StepInputs { z: arena.input(0, ty), c: arena.input(1, ty), dr: Some(arena.input(2, Type::F)), before: None };
    if step.is_shape() {
        return match step.trace_distance(&library.engine, &library.sources, &arena, inputs.z, &params) {
            Err(_) => counts.failed_to_compose += 1,
            Ok(_) => counts.drawn += 1,
        };
    }
    match step.trace(&library.engine, &library.sources, &arena, inputs, &params) {
        Err(error) => {
            d.push(error);
            assert!(!d.render(&library.sources, false).is_empty());
            counts.failed_to_compose += 1;
        }
        Ok(traced) => {
            let mut function =
                Function::new("step", vec![Port::new("z", ty), Port::new("c", ty), Port::new("dr", Type::F)]);
            function.output("z", traced.z);
            let columns = vec![vec![0.3]; 2 * usize::from(ty.width) + 1];
            Backends::cpu_only().run(Target::CPU_F32, &arena, &Kernel::Map(function), &columns).unwrap();
            counts.drawn += 1;
        }
    }
}

#[test]
fn damaged_files_never_panic_or_hang() {
    let mut graphs: Vec<&str> = FRACTALS.iter().map(|(_, text)| *text).collect();
    // As often as all fractals together: it holds what they do not.
    graphs.extend(vec![EVERYTHING; graphs.len()]);
    let mut random = Random::new(2026);
    let panics = Arc::new(Mutex::new(String::new()));
    let seen = panics.clone();
    let old = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| *seen.lock().unwrap() = info.to_string()));
    let mut library = Library::builtin();
    for text in &graphs {
        let mut d = Diagnostics::default();
        let loaded = load_text(&mut library, "whole.ron", text, &[], &mut d);
        assert!(loaded.is_some(), "an undamaged file does not load:\n{}", d.render(&library.sources, false));
    }
    let (mut of_graphs, mut of_steps) = (Counts::default(), Counts::default());
    let mut wrong = Vec::new();
    let start = Instant::now();
    for case in 0..CASES {
        let is_step = case % 3 == 0;
        let (name, original) = match is_step {
            true => STEPS[random.below(STEPS.len())],
            false => ("mutant", graphs[random.below(graphs.len())]),
        };
        let mut text = mutate(original, &mut random);
        if random.below(3) == 0 && !text.is_empty() {
            text = mutate(&text, &mut random);
        }
        let begin = Instant::now();
        let result = catch_unwind(AssertUnwindSafe(|| match is_step {
            true => try_step(&mut library, name, &text, &mut of_steps),
            false => try_graph(&mut library, &text, &mut of_graphs),
        }));
        if result.is_err() {
            wrong.push(format!("case {case} panicked: {}\n{text}\n", panics.lock().unwrap()));
            library = Library::builtin();
        } else if begin.elapsed() > SLOW {
            wrong.push(format!("case {case} took {:?}\n{text}\n", begin.elapsed()));
        }
        if wrong.len() >= 5 {
            break;
        }
    }
    std::panic::set_hook(old);
    println!("graphs {of_graphs:?}\nsteps {of_steps:?}\nin {:?}", start.elapsed());
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
    assert!(of_graphs.drawn > 500 && of_steps.drawn > 500, "too few damaged files still load to test anything");
}

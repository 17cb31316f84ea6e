//! Materials: their own tests, what of them becomes columns, parts, and what is said of wrong ones.

use std::path::PathBuf;
use std::sync::Arc;

use bulbfold::check::{Backends, Formula, Options, Target, run_paths};
use bulbfold::compose::{Composer, Purpose, choose, compose_estimator};
use bulbfold::expr::{Arena, Inputs, Type};
use bulbfold::formula::library::Library;
use bulbfold::formula::material::OUTPUTS;
use bulbfold::graph::EstimateSettings;
use bulbfold::kernel::Kernel;
use bulbfold::kernel::records::Matter;

use crate::support::{bulbfold, folder, folder_with, formula, pixels, stderr, stdout, success};

/// Every material has a summary, and passes the tests in its file on every back end.
#[test]
fn materials_pass_their_own_tests() {
    let library = Library::builtin();
    let files = std::fs::read_dir("formulas/materials").expect("the folder is there").count();
    assert!(library.materials().count() == files && files >= 20, "{files}");
    for material in library.materials() {
        assert!(material.summary.ends_with('.') && !material.examples.is_empty(), "{}", material.name);
        assert!(material.params.iter().all(|param| !param.help.is_empty()), "{}", material.name);
    }
    let report = run_paths(&mut Library::builtin(), &[PathBuf::from("formulas/materials")], &Options::default());
    assert!(report.is_ok() && report.passed() > 4 * files, "{report}");
}

/// A surface of which nothing is said but its colour is made of what materials leave out.
#[test]
fn defaults_are_those_of_plain_surfaces() {
    let arena = Arena::default();
    let plain = Matter::of_colour(arena.v3([OUTPUTS[0].2; 3]));
    for (value, (name, _, default, ..)) in plain.values().into_iter().zip(OUTPUTS) {
        assert_eq!(value.as_constant().map(|c| c[0]), Some(*default), "{name}");
    }
}

/// The outputs of the surfaces of a formula behind gradient and traps.
fn columns(text: &str) -> Vec<String> {
    let formula = formula(text);
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library: formula.library(), graph: formula.graph() };
    let plan = choose(&composer, &EstimateSettings::default()).unwrap_or_else(|error| panic!("{}", error.message));
    let surface =
        compose_estimator(&composer, &plan.choices, Purpose::Surface).unwrap_or_else(|e| panic!("{}", e.message));
    surface.combine.output_ports().into_iter().skip(2).map(|port| port.name).collect()
}

/// What is the same everywhere stays a constant; a look without materials writes nothing.
#[test]
fn only_what_differs_is_a_column() {
    let look = |look: &str| {
        let text = format!(
            r#"(nodes: {{ "ball": Sphere(radius: 1.0), "cube": Box(centre: (2, 0, 0)), "both": Union(["ball", "cube"]) }},
                output: "both", look: ({look}))"#
        );
        columns(&text)
    };
    let none: [&str; 0] = [];
    assert_eq!(look(""), none);
    assert_eq!(look("material: \"gold\""), none);
    assert_eq!(look("material: \"marble\""), ["base"]);
    assert_eq!(look("palette: \"ember\""), ["base"]);
    assert_eq!(look(r#"material: "gold", parts: { "cube": (material: copper(roughness: 0.22)) }"#), ["base"]);
    assert_eq!(
        look(r#"material: "gold", parts: { "cube": (material: "glass") }"#),
        ["base", "metallic", "roughness", "transmission"]
    );
}

/// What a material does not read is not carried by orbits.
#[test]
fn orbits_note_only_what_is_read() {
    let kernel = |look: &str| {
        formula(&format!(r#"(nodes: {{ "bulb": bulb_power(power: 8.0) }}, output: "bulb", look: ({look}))"#)).wgsl()
    };
    let gold = kernel("material: \"gold\", occlusion: 0.0");
    assert!(!gold.contains("trap =") && !gold.contains("r_before"), "gold reads traps");
    let enamel = kernel("material: \"enamel\", palette: \"lagoon\"");
    assert!(enamel.contains("r_before") && !enamel.contains("caught"));
    assert!(kernel("material: \"inlay\"").contains("caught"));
}

/// A gold ball and a blue one, by the file and by the command line.
#[test]
fn materials_show() {
    let text = r#"(nodes: { "ball": Sphere(radius: 1.0), "cube": Sphere(centre: (2.5, 0, 0), radius: 1.0), "both": Union(["ball", "cube"]) },
        output: "both", camera: (position: (1.25, -9.0, 0.0), target: (1.25, 0, 0), fov: 30),
        look: (material: "gold", parts: { "cube": (palette: [(0.0, 0.0, 0.8)], material: "lacquer") }))"#;
    let folder = folder_with(&[("balls.ron", text)]);
    let render = |options: &[&str]| {
        let base = [
            "render",
            "balls.ron",
            "--size",
            "64x36",
            "--samples",
            "1",
            "--backend",
            "cpu",
            "--force",
            "-o",
            "out.png",
        ];
        success(&bulbfold(folder.path(), base.iter().chain(options)));
        pixels(&folder.path().join("out.png"))
    };
    let count = |picture: &[u8], is: fn([u8; 3]) -> bool| picture.chunks(3).filter(|p| is([p[0], p[1], p[2]])).count();
    let golden = |[r, g, b]: [u8; 3]| r > b.saturating_add(30) && g > b.saturating_add(15);
    let blue = |[r, _, b]: [u8; 3]| b > 60 && b > r.saturating_mul(2);
    let picture = render(&[]);
    assert!(
        count(&picture, golden) > 50 && count(&picture, blue) > 50,
        "{} {}",
        count(&picture, golden),
        count(&picture, blue)
    );
    let black = render(&["--material", "rubber"]);
    assert!(count(&black, golden) == 0 && count(&black, blue) > 50);
}

/// Noise is 0 at the corners of its lattice, within its range, smooth, and the same on every back end.
#[test]
fn noise_is_the_same_everywhere() {
    let arena = Arc::new(Arena::default());
    let mut inputs = Inputs::new(&arena);
    let p = inputs.take("p", Type::V3);
    let mut function = inputs.function("noise");
    function.output("noise", p.noise());
    function.output("octaves", p.octaves(4));
    let mut random = bulbfold::check::random::Random::new(2);
    let mut points: Vec<[f64; 3]> = (0..2000).map(|_| [(); 3].map(|()| random.range(-300.0, 300.0))).collect();
    // Numbers that single precision has.
    points.iter_mut().flatten().for_each(|x| *x = f64::from(*x as f32));
    points.extend([[0.0, 0.0, 0.0], [5.0, -3.0, 288.0], [289.0, 290.0, -1.0]]);
    let columns: Vec<Vec<f64>> = (0..3).map(|k| points.iter().map(|p| p[k]).collect()).collect();
    let (backends, kernel) = (Backends::new(), Kernel::Map(function));
    let run = |target| backends.run(target, &arena, &kernel, &columns).unwrap_or_else(|error| panic!("{error}"));
    let exact = run(Target::CPU_F64);
    assert!(exact[0][2000..].iter().all(|x| *x == 0.0), "{:?}", &exact[0][2000..]);
    let range = exact[0].iter().fold([f64::MAX, f64::MIN], |[low, high], x| [low.min(*x), high.max(*x)]);
    assert!(range[0] < -0.5 && range[1] > 0.5 && range[0] > -1.3 && range[1] < 1.3, "{range:?}");
    let mean = exact[0].iter().sum::<f64>() / exact[0].len() as f64;
    assert!(mean.abs() < 0.03, "{mean}");
    for target in backends.targets() {
        let found = run(target);
        for (k, slack) in [(0, 1e-3), (1, 5e-3)] {
            let far = (0..points.len()).filter(|i| (found[k][*i] - exact[k][*i]).abs() > slack).count();
            assert_eq!(far, 0, "{} output {k}", target.name());
        }
    }
}

#[test]
fn wrong_materials_are_refused_with_their_place() {
    for (look, expected) in [
        ("material: \"golt\"", "did you mean `gold`?"),
        ("material: gold(roughnes: 0.1)", "unknown parameter `roughnes`"),
        ("material: gold(roughness: 2.0)", "`roughness`"),
        ("material: 3", "a material such as"),
        ("material: marble(scale: \"n + 1\")", "cannot depend on `n`"),
    ] {
        let text = format!("(nodes: {{ \"ball\": Sphere(radius: 1.0) }}, output: \"ball\", look: ({look}))");
        let error = Formula::from_ron(&text).err().unwrap_or_else(|| panic!("{look} is taken")).to_string();
        assert!(error.contains(expected), "{look}: {error}");
    }
    let head = "#{ summary: \"x\", examples: [#{ expect: #{ metallic: 0.0 } }] }";
    for (body, expected) in [
        ("#{ bas: vec3(1.0) }", "did you mean `base`?"),
        ("vec3(1.0)", "must return"),
        ("#{ base: s.normal.x > 0.0 }", "`base` must be a vec3"),
        ("#{ base: s.colours }", "colours"),
        ("#{ base: nois(s.position) }", "there is no function `nois`"),
        ("#{ base: s.colour * p.gain }", "no parameter `gain`"),
    ] {
        let material = format!("fn material(s, p) {{\n    {body}\n}}\n{head}\n");
        let text = "(nodes: { \"ball\": Sphere(radius: 1.0) }, output: \"ball\", look: (material: \"own\"))";
        let folder = folder_with(&[("own.rhai", &material), ("ball.ron", text)]);
        let output = bulbfold(folder.path(), ["compile", "ball.ron", "--emit", "graph"]);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{body}: {said}");
        assert!(said.contains(expected) && said.contains("own.rhai:2"), "{body}: {said}");
    }
}

/// A file beside a formula is a material like the built-in ones: tested, explained, used.
#[test]
fn a_material_is_one_file() {
    let material = r#"// Half of the look's colour.
fn material(s, p) {
    #{ base: s.colour * p.share, roughness: 1.0 }
}
#{
    summary: "Half of the look's own colour.",
    params: [ #{ name: "share", type: "float", "default": 0.5, min: 0.0, max: 1.0, unit: "", help: "Share of it." } ],
    examples: [ #{ at: #{ colour: [0.2, 0.4, 0.6] }, expect: #{ base: [0.1, 0.2, 0.3], roughness: 1.0 } } ],
}
"#;
    let text = "(nodes: { \"ball\": Sphere(radius: 1.0) }, output: \"ball\", look: (material: half(share: 0.25)))";
    let folder = folder_with(&[("half.rhai", material), ("ball.ron", text)]);
    let tested = success(&bulbfold(folder.path(), ["test", "half.rhai"]));
    assert!(tested.contains("half.rhai::example 1::cpu_f64") && tested.contains("0 failed"), "{tested}");
    let explained = success(&bulbfold(folder.path(), ["explain", "half.rhai"]));
    assert!(explained.contains("Share of it.") && explained.contains("0.1, 0.2, 0.3"), "{explained}");
    success(&bulbfold(folder.path(), ["render", "ball.ron", "--size", "16x9", "--backend", "cpu"]));
    success(&bulbfold(
        folder.path(),
        ["render", "menger", "--material", "half.rhai", "--size", "16x9", "--backend", "cpu"],
    ));
    let wrong = material.replace("0.1, 0.2, 0.3", "0.1, 0.2, 0.4");
    let folder = folder_with(&[("half.rhai", &wrong)]);
    let output = bulbfold(folder.path(), ["test", "half.rhai"]);
    assert!(
        output.status.code() == Some(1) && stdout(&output).contains("expected [0.1, 0.2, 0.4]"),
        "{}",
        stdout(&output)
    );
}

#[test]
fn materials_are_listed_explained_and_documented() {
    let folder = folder();
    let listed = success(&bulbfold(folder.path(), ["list", "materials"]));
    let explained = success(&bulbfold(folder.path(), ["explain", "marble"]));
    assert!(explained.contains("scale") && explained.contains("fn material(s, p)"));
    let ember = success(&bulbfold(folder.path(), ["explain", "ember"]));
    assert!(ember.contains("OKLab") && ember.contains('#'));
    success(&bulbfold(folder.path(), ["docs", "-o", "."]));
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).expect("the page was written");
    let (materials, palettes) = (read("materials.md"), read("palettes.md"));
    for material in Library::builtin().materials() {
        assert!(
            listed.contains(&format!("{} ", material.name)) && materials.contains(&format!("### {}", material.name))
        );
    }
    assert!(palettes.contains("| ember |") && materials.contains("s.smooth"));
}

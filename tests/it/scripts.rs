//! Scripts: functions of shading languages, messages in the user's words, and values of the command line by path.

use std::path::Path;
use std::process::Output;

use bulbfold::check::{Formula, Options, run_paths};
use bulbfold::diag::Diagnostics;
use bulbfold::expr::{Arena, Expr};
use bulbfold::formula::library::Library;
use bulbfold::load::{load, load_text};

use crate::support::{bulbfold, folder, stderr};

/// A step whose image is these three numbers at z = (0.3, -0.4, 0.5).
fn step(calls: &[(&str, f64)]) -> String {
    let part = |i: usize| calls.get(i).map_or("0.0", |(call, _)| *call);
    let value = |i: usize| calls.get(i).map_or(0.0, |(_, value)| *value);
    format!(
        "fn step(z, c, p) {{\n    vec3({}, {}, {})\n}}\n#{{ group: \"tweak\", summary: \"A test.\", examples: [\n    \
         #{{ z: [0.3, -0.4, 0.5], expect: [{:?}, {:?}, {:?}] }}] }}\n",
        part(0),
        part(1),
        part(2),
        value(0),
        value(1),
        value(2)
    )
}

/// Functions and swizzles by the names of GLSL and WGSL, on every back end, with derivatives that differences agree with.
#[test]
fn names_of_shading_languages() {
    let calls = [
        ("sinh(z.x)", 0.3f64.sinh()),
        ("sinh(4.0 * z.y)", (-1.6f64).sinh()),
        ("cosh(z.y)", 0.4f64.cosh()),
        ("tanh(z.y)", (-0.4f64).tanh()),
        ("tanh(6.0 * z.z)", 3.0f64.tanh()),
        ("log(1.0 + z.z)", 1.5f64.ln()),
        ("z.x * log(2.0)", 0.3 * 2f64.ln()),
        ("log2(1.0 + z.z)", 1.5f64.log2()),
        ("exp2(z.z)", 0.5f64.exp2()),
        ("atan(z.y, z.x)", (-0.4f64).atan2(0.3)),
        ("atan(z.y)", (-0.4f64).atan()),
        ("round(4.0 * z.x) + z.x * 0.0", 1.0),
        ("ceil(z.x)", 1.0),
        ("trunc(-5.0 * z.x)", -1.0),
        ("step(0.4, z.z)", 1.0),
        ("step(z.z, 0.4)", 0.0),
        ("smoothstep(0.0, 1.0, z.x)", 0.3 * 0.3 * (3.0 - 0.6)),
        ("mix(z.x, z.z, 0.25)", 0.35),
        ("inversesqrt(z.z)", 0.5f64.sqrt().recip()),
        ("saturate(z.y)", 0.0),
        ("radians(z.x)", 0.3f64.to_radians()),
        ("z.xzy.y", 0.5),
        ("length(z.xy)", 0.5),
        ("dot(z.xy, z.yx)", -0.24),
        ("(z.xy / z.zz + 1.0).y", 0.2),
        ("vec3(z.xy, 7.0).z + vec2(z.x).y", 7.3),
        ("vec4(z.yz, z.xy).z", 0.3),
        ("z.xxyy.w", -0.4),
        ("reflect(z, vec3(0.0, 0.0, 1.0)).z", -0.5),
    ];
    let folder = folder();
    for (i, three) in calls.chunks(3).enumerate() {
        std::fs::write(folder.path().join(format!("calls_{i}.rhai")), step(three)).expect("a file");
    }
    let report = run_paths(&mut Library::builtin(), &[folder.path().to_path_buf()], &Options::default());
    assert!(report.is_ok() && report.outcomes.len() > 30, "\n{report}");
    // And a wrong value is seen.
    std::fs::write(folder.path().join("calls_0.rhai"), step(&[("sinh(z.x)", 0.3)])).expect("a file");
    assert!(!run_paths(&mut Library::builtin(), &[folder.path().to_path_buf()], &Options::default()).is_ok());
}

#[test]
fn swizzles_can_be_set() {
    let folder = folder();
    let text = step(&[("0.0", 0.5), ("0.0", -0.4), ("0.0", 0.3)]);
    let text = text.replace("    vec3(0.0, 0.0, 0.0)\n", "    z.xz = z.zx;\n    z\n");
    std::fs::write(folder.path().join("swap.rhai"), text).expect("a file");
    let report = run_paths(&mut Library::builtin(), &[folder.path().to_path_buf()], &Options::default());
    assert!(report.is_ok(), "\n{report}");
}

/// Constants fold by the same rules as every back end computes.
fn known(f: impl Fn(Expr<'_>) -> Expr<'_>, x: f64) -> f64 {
    let arena = Arena::default();
    f(arena.f(x)).as_constant().expect("a number")[0]
}

#[test]
fn hyperbolic_functions_are_accurate() {
    for x in [1e-300, 1e-9, 1e-3, 0.3, 0.499_999, 0.5, 0.7, 3.0, 20.0, 700.0] {
        for x in [x, -x] {
            for (name, found, expected) in [
                ("sinh", known(|x| x.sinh(), x), x.sinh()),
                ("cosh", known(|x| x.cosh(), x), x.cosh()),
                ("tanh", known(|x| x.tanh(), x), x.tanh()),
            ] {
                assert!((found - expected).abs() <= 1e-15 * expected.abs(), "{name}({x}): {found} {expected}");
            }
        }
    }
    for x in [1e3, 1e30, f64::MAX, f64::INFINITY] {
        assert_eq!((known(|x| x.tanh(), x), known(|x| x.tanh(), -x)), (1.0, -1.0), "{x}");
    }
}

#[test]
fn rounding_is_to_the_nearest_even_number() {
    let odd = 4_503_599_627_370_497.0;
    for x in [0.5, 1.5, 2.5, 0.499_999_999_999_999_94, 0.3, 7.0, odd, 1e300] {
        for x in [x, -x] {
            assert_eq!(known(|x| x.round(), x), x.round_ties_even(), "{x}");
            assert_eq!(known(|x| x.trunc(), x), x.trunc(), "{x}");
        }
    }
}

/// What is said about a formula beside the step `mine`.
fn message(name: &str, text: &str, step: &str) -> String {
    let folder = folder();
    if !step.is_empty() {
        std::fs::write(folder.path().join("mine.rhai"), step).expect("a file");
    }
    let path = folder.path().join(name);
    std::fs::write(&path, text).expect("a file");
    let text = Formula::open(&path).err().map(|error| error.to_string()).unwrap_or_default();
    text.replace(&format!("{}/", folder.path().display()), "")
}

fn expect_all(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "`{part}` is missing in\n{text}");
    }
    for word in ["symbolic", "getter", "setter", "object map", "not registered", "Function not found", "rhai::"] {
        assert!(!text.contains(word), "`{word}` stands in\n{text}");
    }
}

const USES: &str = "(nodes: { \"a\": mine() })";

#[test]
fn all_mistakes_of_a_script_are_told() {
    let step = "fn helper(v) { v + q }\nfn step(z, c, p) {\n    let a = sinnh(z.x) + lerp(1.0, 2.0, z.y);\n    let list = [1, 2].map(|i| i * pover);\n    \
                let b = z.xq + p.sise;\n    helper(z) * b + y\n}\n#{ params: [#{ name: \"size\", \"default\": 1.0 }] }\n";
    let text = message("a.ron", USES, step);
    let places = ["rhai:1:20", "rhai:3:13", "rhai:3:26", "rhai:4:35", "rhai:5:15", "rhai:5:22", "rhai:6:21"];
    expect_all(&text, &places);
    assert_eq!(text.matches("error:").count(), places.len(), "{text}");
    expect_all(&text, &["did you mean `sinh`?", "write `mix(a, b, t)`", "did you mean `size`?", "no component `xq`"]);
    let text = message("a.rhai", "let a = box_flod();\nlet b = sclae();\nSequence([a, b, c])\n", "");
    expect_all(
        &text,
        &["a.rhai:1:9", "did you mean `box_fold`?", "a.rhai:2:9", "did you mean `scale`?", "a.rhai:3:17"],
    );
}

#[test]
fn messages_have_the_words_of_users() {
    let cases = [
        ("z.q", "a vector has no component `q`"),
        ("let v = z * 2.0; v.xyq", "a vec3 has no component `xyq`: it has x, y, z, and combinations of them"),
        ("let v = z.xy; v.z", "a vec2 has no component `z`"),
        ("z.xy + z", "cannot combine a vec2 with a vector of 3 components"),
        ("z.xy", "must return a vec3, but returns a vec2"),
        ("let a = 1.0; a.x", "a number has no part `x`"),
        ("z + [1]", "`+` cannot be applied to: number or vector of the orbit, list"),
        ("clamp(z)", "`clamp` cannot take: number or vector of the orbit"),
        ("clamp(z, [1], 2.0)", "expected a number or a vector, found list"),
        ("let m = #{ a: 1 }; m.b", "there is no field `b`"),
        ("let a = 3.0; for i in a { } z", "`for` runs over a range"),
        ("while z.x > 0.0 { } z", "known only while rendering"),
        ("arctan(z.x)", "write `atan(a)`"),
        ("foo_bar(z)", "docs/operators.md"),
        ("z.xx = z.xy; z", "names a component twice"),
        ("z.x = z; z", "`x` needs a number, found a vec3"),
    ];
    for (body, expected) in cases {
        let step = format!("fn step(z, c, p) {{\n    {body}\n}}\n#{{ }}\n");
        let text = message("a.ron", USES, &step);
        expect_all(&text, &[expected, "mine.rhai:2:"]);
    }
}

#[test]
fn values_of_scripts_keep_their_places() {
    let graph = "let power = \"abc\";\nlet extra = #{ escape_radius: [1] };\nextra.slice = true;\n#{\n    nodes: #{ b: bulb_power(#{\n        \
                 power: power,\n        angle: 1 }) },\n    max_iterations: extra.escape_radius,\n    look: #{\n        fog: -1 },\n    \
                 tests: [Inside([0, 0, 0]),\n        7],\n    camera: #{ position: [1, 2,\n        \"x\"] },\n}\n";
    let text = message("g.rhai", graph, "");
    expect_all(&text, &["g.rhai:1:13", "g.rhai:7:9", "g.rhai:8:21", "g.rhai:10:14", "g.rhai:12:9", "g.rhai:14:9"]);
    let step = "fn step(z, c, p) {\n    let a = 1.0;\n    z.x\n}\n#{\n    params: [\n        #{ name: \"a\", \"default\": 1.0 },\n        \
                #{ name: \"b\", \"default\": \"x\" },\n    ],\n    examples: [#{ z: [1, 2, 3],\n        expect: [1, 2] }],\n    stat: 3,\n}\n";
    let text = message("a.ron", USES, step);
    expect_all(&text, &["mine.rhai:8:34", "mine.rhai:12:5"]);
    let step =
        step.replace("\"x\"", "2.0").replace("expect: [1, 2]", "expect: [1, 2, 3]").replace("    stat: 3,\n", "");
    // What a function returns is told where it is returned.
    expect_all(&message("a.ron", USES, &step), &["must return a vec3, but returns a number", "mine.rhai:3:5"]);
}

#[test]
fn reserved_words_are_named() {
    let word = "`loop` is a reserved word of the script language";
    expect_all(&message("a.rhai", "let loop = box_fold();\nloop\n", ""), &[word, "a.rhai:1:5"]);
    let key = "#{ nodes: #{ loop: box_fold() }, output: \"loop\" }";
    expect_all(&message("a.rhai", key, ""), &[word, "a.rhai:1:14", "write it in quotes: \"loop\": ..."]);
    expect_all(
        &message("a.ron", USES, "fn step(z, c, p) {\n    let if = z;\n    if\n}\n#{}\n"),
        &["`if` is a reserved word"],
    );
    let n = message("a.ron", "(params: { \"n\": (default: 2.0) },\n nodes: { \"a\": scale(scale: \"n\") })", "");
    expect_all(&n, &["a parameter cannot be called `n`", "a.ron:1:12", "the number of the iteration"]);
    expect_all(
        &message("a.rhai", "scale(#{ scale: param(\"n\", 2.0) })", ""),
        &["cannot be called `n`", "a.rhai:1:17"],
    );
    let other = message("a.ron", "(params: { \"loop\": (default: 2.0) }, nodes: { \"a\": scale() })", "");
    expect_all(&other, &["a parameter cannot be called `loop`"]);
}

#[test]
fn a_step_of_ones_own_need_not_say_where_it_comes_from() {
    assert_eq!(
        message("a.ron", USES, "fn step(z, c, p) {\n    z * 2.0\n}\n#{ params: [#{ name: \"a\", \"default\": 1 }] }\n"),
        ""
    );
    for step in Library::builtin().steps() {
        let texts = [&step.group, &step.summary, &step.source];
        assert!(texts.iter().all(|text| !text.trim().is_empty()) && step.group != "own", "{} lacks a text", step.name);
        assert!(step.params.iter().all(|param| !param.help.is_empty()), "{}: a parameter lacks its help", step.name);
    }
}

/// Built-in steps are not looked through when they are read, but have no unknown names.
#[test]
fn built_in_steps_name_what_there_is() {
    let folder = folder();
    for entry in
        std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("formulas/steps")).expect("the steps").flatten()
    {
        let text = std::fs::read_to_string(entry.path()).expect("a text");
        // Another text of the same name is read as a step of one's own.
        std::fs::write(folder.path().join(entry.file_name()), format!("{text}\n")).expect("a file");
    }
    let (mut library, mut d) = (Library::builtin(), Diagnostics::default());
    library.add_folder(folder.path(), &mut d);
    assert!(!d.has_errors() && d.len() > 100, "{}", d.render(&library.sources, false));
}

const FILE: &str = "(\n    params: { \"power\": (default: 8.0, max: 9.0) },\n    nodes: {\n        \"turn\": rotate(axis: (0, 0, 1)),\n        \
                    \"all\": Sequence([\"turn\", bulb_power(power: \"power\")]),\n    },\n    output: \"all\",\n    \
                    camera: (position: (1, -3, 1)),\n)";

#[test]
fn paths_reach_every_part_of_a_file() {
    let read = |set: &[(&str, &str)]| {
        let (mut library, mut d) = (Library::builtin(), Diagnostics::default());
        let set: Vec<(String, String)> = set.iter().map(|(k, v)| (k.to_string(), v.to_string())).collect();
        let loaded = load_text(&mut library, "a.ron", FILE, &set, &mut d);
        loaded.map(|loaded| loaded.graph).ok_or_else(|| d.render(&library.sources, false))
    };
    let graph = read(&[
        ("look.fog", "0.3"),
        ("look.sun", "(1, 2, 3)"),
        ("camera.fov", "60"),
        ("camera.position.x", "2"),
        ("estimate.fudge", "0.5"),
        ("params.power.max", "20"),
        ("power", "12"),
        ("all.0.0", "\"turn\""),
        ("nodes.turn.axis.0", "1"),
    ])
    .unwrap_or_else(|text| panic!("{text}"));
    let camera = graph.scene.camera.expect("a camera");
    assert_eq!((graph.scene.look.fog, graph.orbit.estimate.fudge, graph.params[0].value), (0.3, Some(0.5), 12.0));
    assert_eq!((camera.fov, camera.position), (60f64.to_radians(), [2.0, -3.0, 1.0]));
    for (path, expected) in [
        ("look.fgo", "did you mean `fog`?"),
        ("lok.fog", "did you mean `look`?"),
        ("camera.position.5", "items are numbered from 0 to 2"),
        ("output.x", "\"all\" has no parts"),
        ("turn.axis.x.y", "has no parts"),
        ("all.0.7.power", "there is no item `7`"),
    ] {
        let text = read(&[(path, "1")]).err().unwrap_or_default();
        assert!(text.contains(expected) && text.contains(&format!("--set {path}")), "{path}: {text}");
    }
}

/// A calibrated file stays calibrated where light and estimate alone change.
#[test]
fn the_estimate_is_set_in_a_calibrated_file() {
    let (mut library, mut d) = (Library::builtin(), Diagnostics::default());
    let text =
        FILE.replace("    output", "    estimate: (method: \"scalar\", fudge: 0.8, calibrated: true),\n    output");
    let set = [("estimate.fudge".to_string(), "0.4".to_string()), ("look.fog".to_string(), "0.1".to_string())];
    let graph = load_text(&mut library, "a.ron", &text, &set, &mut d).expect("a formula").graph;
    assert_eq!((graph.orbit.estimate.fudge, graph.orbit.estimate.calibrated.is_some()), (Some(0.4), true));
}

#[test]
fn a_camera_is_set_where_the_file_has_none() {
    let folder = folder();
    std::fs::write(folder.path().join("a.ron"), "(nodes: { \"a\": bulb_power() }, max_iterations: 6)").expect("a file");
    let render = |name: &str, more: &[&str]| {
        let small = [
            "render",
            "a.ron",
            "--size",
            "16x12",
            "--samples",
            "1",
            "--calibrate",
            "off",
            "--backend",
            "cpu",
            "-q",
            "-o",
            name,
        ];
        let output = bulbfold(folder.path(), [&small[..], more].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        crate::support::pixels(&folder.path().join(name))
    };
    let set = render("set.png", &["--set", "camera.fov=60", "--set", "camera.target=(0, 0, 0.2)"]);
    assert_eq!(set, render("flags.png", &["--fov", "60", "--target", "0,0,0.2"]));
    assert_ne!(set, render("plain.png", &[]));
}

#[test]
fn sweeps_take_lists_paths_and_whole_numbers() {
    let folder = folder();
    let script =
        "let seed = param(\"seed\", 1);\n#{ nodes: #{ a: bulb_power(#{ power: 2 + seed % 3 }) }, max_iterations: 4 }\n";
    std::fs::write(folder.path().join("a.rhai"), script).expect("a file");
    let sweep = |more: &[&str]| {
        let small =
            ["render", "a.rhai", "--size", "4x3", "--samples", "1", "--calibrate", "off", "--backend", "cpu", "-q"];
        bulbfold(folder.path(), [&small[..], more].concat())
    };
    let files = |prefix: &str| {
        let names = std::fs::read_dir(folder.path()).expect("the folder").flatten().map(|e| e.file_name());
        names.filter(|name| name.to_string_lossy().starts_with(prefix)).count()
    };
    let fine = |output: Output| assert!(output.status.success(), "{}", stderr(&output));
    fine(sweep(&["--sweep", "seed=1..20", "--frames", "20", "-o", "w%02d.png"]));
    assert_eq!(files("w"), 20);
    fine(sweep(&["--sweep", "seed=3,7,18", "--sweep", "look.fog=0..0.4", "-o", "l%d.png"]));
    assert_eq!(files("l"), 3);
    for (arguments, expected) in [
        (&["--sweep", "seed=3,7,18", "--frames", "4"][..], "lists 3 values for 4 frames"),
        (&["--sweep", "seed=3..7"][..], "--frames"),
        (&["--sweep", "seed=1..2", "--frames", "3"][..], "`seed` must be a whole number, but is 1.5"),
    ] {
        let output = sweep(&[arguments, &["-o", "x%d.png"]].concat());
        let text = stderr(&output);
        assert!(output.status.code() == Some(2) && text.contains(expected), "{text}");
    }
    assert_eq!(files("x"), 0);
}

#[test]
fn built_in_scripts_still_run() {
    for name in ["power_sweep", "random_hybrid"] {
        let (mut library, mut d) = (Library::builtin(), Diagnostics::default());
        assert!(load(&mut library, name, &[], &mut d).is_some(), "{}", d.render(&library.sources, false));
    }
}

/// What shows only while a step is traced is told of every step of a formula, not of the first alone.
#[test]
fn mistakes_of_all_steps_are_told() {
    let folder = folder();
    let step = |body: &str| format!("fn step(z, c, p) {{\n    {body}\n}}\n#{{}}\n");
    std::fs::write(folder.path().join("first.rhai"), step("z + vec4(z, 1.0)")).expect("a file");
    std::fs::write(folder.path().join("second.rhai"), step("if z.x > 0.0 { z } else { -z }")).expect("a file");
    let path = folder.path().join("a.ron");
    std::fs::write(&path, "(nodes: { \"a\": Sequence([first(), second()]) })").expect("a file");
    let text = Formula::open(&path).err().map(|error| error.to_string()).unwrap_or_default();
    expect_all(&text, &["first.rhai:2:7", "second.rhai:2:12", "used by the node `a/1`"]);
}

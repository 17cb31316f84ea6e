//! Files made to break the program: each gets an answer within bounded time and memory, and nothing of it reaches a terminal raw.

use std::fmt::Write;
use std::path::Path;
use std::process::{Command, Output};

use crate::support::{folder_with, stderr, stdout};

/// Most seconds of processor time, and KiB of address space, of a run: what the program itself needs, and what is allowed.
const SECONDS: u32 = 10;
const SPACE: u32 = 3_000_000;

/// Runs the program in a folder under these limits, which end it by a signal.
fn bulbfold(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new("sh");
    command.current_dir(folder).env("NODEVICE_SELECT", "1").env("BULBFOLD_CACHE", "");
    let limits = format!("ulimit -t {SECONDS}; ulimit -v {SPACE}; exec \"$0\" \"$@\"");
    command.args(["-c", &limits, env!("CARGO_BIN_EXE_bulbfold")]).args(arguments).output().expect("the program starts")
}

/// What is said about a file that is refused.
fn refused(folder: &Path, arguments: &[&str]) -> String {
    let output = bulbfold(folder, arguments);
    let text = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {:?}\n{text}", output.status);
    text
}

/// A picture that costs nothing.
const SMALL: [&str; 11] =
    ["--force", "--size", "4x3", "--samples", "1", "--calibrate", "off", "--backend", "cpu", "-o", "x.png"];

/// A map where a field is expected becomes an orbit with the file's settings, whose end may be that very field.
#[test]
fn maps_under_an_end_are_a_cycle() {
    let file = |w: &str| format!("(nodes: {{\"f\": box_fold(), \"w\": Union([{w}])}}, output: \"f\", end: \"w\")");
    for w in [
        "Sequence([Sphere(radius: 1)])",
        "Repeat(of: Sphere(radius: 1), times: 2)",
        "box_fold(), scale(scale: 2)",
        "Transform(of: scale(scale: 2), translate: (1, 0, 0))",
        "Difference(a: Box(), b: Intersection([scale(scale: 2), Box()]))",
    ] {
        let folder = folder_with(&[("f.ron", &file(w))]);
        for command in [&["probe", "f.ron", "--point", "0,0,0.5"][..], &["explain", "f.ron"], &["check", "f.ron"]] {
            let text = refused(folder.path(), command);
            assert!(text.contains("cycle") && text.contains('w') && text.contains("f.ron:1:"), "{text}");
        }
        assert!(refused(folder.path(), &[&["render", "f.ron"][..], &SMALL].concat()).contains("cycle"));
    }
}

/// A chain of nodes, each made of the one before.
fn chain(first: &str, count: u32, next: impl Fn(u32) -> String) -> String {
    let mut text = format!("(nodes: {{ \"a0\": {first},\n");
    for i in 1..=count {
        writeln!(text, "  \"a{i}\": {},", next(i - 1)).expect("a string takes all");
    }
    write!(text, "}}, output: \"a{count}\", max_iterations: 4)").expect("a string takes all");
    text
}

#[test]
fn shared_wires_are_counted_before_they_are_composed() {
    let (fold, ball) = ("box_fold(limit: 1)", "Sphere(radius: 0.5)");
    let cases = [
        chain(fold, 25, |i| format!("Sequence([\"a{i}\", \"a{i}\"])")),
        chain(fold, 60, |i| format!("Sequence([\"a{i}\", \"a{i}\"])")),
        chain(fold, 40, |i| format!("Repeat(of: \"a{i}\", times: 2)")),
        chain(fold, 20, |i| format!("Blend(a: \"a{i}\", b: \"a{i}\", weight: 0.5)")),
        chain(fold, 20, |i| format!("Choose(when: Negative(\"x\"), then: \"a{i}\", otherwise: \"a{i}\")")),
        chain(fold, 20, |i| format!("Alternate([\"a{i}\", \"a{i}\"])")),
        chain(fold, 20, |i| format!("Between(of: \"a{i}\", from: 0, to: 4, otherwise: \"a{i}\")")),
        chain(ball, 22, |i| format!("Union([\"a{i}\", \"a{i}\"])")),
        chain(ball, 60, |i| format!("Union([\"a{i}\", \"a{i}\"])")),
        chain(ball, 30, |i| format!("Difference(a: \"a{i}\", b: \"a{i}\")")),
        chain(ball, 30, |i| format!("SmoothUnion(of: [\"a{i}\", \"a{i}\"], radius: 0.1)")),
        chain(ball, 5, |i| format!("Tile(of: \"a{i}\", period: (2, 2, 2))")),
        chain(ball, 20, |i| format!("Tile(of: \"a{i}\", period: (2, 2, 2))")),
        chain(ball, 20, |i| format!("Union([\"a{i}\", Warp(of: \"a{i}\", by: scale())])")),
        chain(ball, 20, |i| format!("Union([\"a{i}\", Transform(of: \"a{i}\", translate: (1, 0, 0))])")),
    ];
    for text in &cases {
        let folder = folder_with(&[("a.ron", text)]);
        let output = bulbfold(folder.path(), &["probe", "a.ron", "--point", "0.5,0.2,0.1", "--backend", "cpu"]);
        let said = stderr(&output);
        match output.status.code() {
            Some(0) => {}
            Some(2) => assert!(said.contains("is made of") && said.contains("a.ron:"), "{said}\n{text}"),
            _ => panic!("{:?}: {said}\n{text}", output.status),
        }
        // What one command refuses, all do.
        for command in [&["check", "a.ron"][..], &["export", "a.ron", "--to", "wgsl"]] {
            if output.status.code() == Some(2) {
                assert!(refused(folder.path(), command).contains("is made of"));
            }
        }
    }
    // Seven doublings are fine.
    let small = chain(fold, 7, |i| format!("Sequence([\"a{i}\", \"a{i}\"])"));
    let folder = folder_with(&[("a.ron", &small)]);
    let output = bulbfold(folder.path(), &["probe", "a.ron", "--point", "0.5,0.2,0.1", "--backend", "cpu"]);
    assert!(output.status.success(), "{}", stderr(&output));
}

#[test]
fn scripts_have_no_clock() {
    let step = "fn step(z, c, p) {\n    sleep(1000000.0);\n    z * 2.0\n}\n#{}\n";
    let folder = folder_with(&[
        ("sleep.rhai", "sleep(1000000); bulb_power()"),
        ("clock.rhai", "let t = timestamp(); bulb_power(#{ power: t.elapsed })"),
        ("sleep.ron", "(params: {\"p\": (default: 1)}, nodes: {\"a\": box_fold(limit: \"sleep(1000000)\")})"),
        ("clock.ron", "(nodes: {\"a\": box_fold(limit: \"1 + timestamp().elapsed\")})"),
        ("uses.ron", "(nodes: {\"a\": mine()})"),
        ("mine.rhai", step),
    ]);
    for (file, word) in [
        ("sleep.rhai", "sleep"),
        ("clock.rhai", "timestamp"),
        ("sleep.ron", "sleep"),
        ("clock.ron", "timestamp"),
        ("uses.ron", "mine.rhai:2:5"),
    ] {
        let text = refused(folder.path(), &["probe", file, "--point", "0,0,0.5"]);
        assert!(text.contains(word) && text.contains("no clock"), "{file}: {text}");
    }
}

#[test]
fn scripts_are_bounded() {
    let cases = [
        ("array", "let x = 1.0; for i in 0..9900 { x = [x]; } #{output: x}", "deep"),
        ("map", "let x = 1.0; for i in 0..900 { x = #{ a: x }; } #{output: x}", "deep"),
        ("equal", "let x = [1.0]; for i in 0..9800 { x = [x]; } let y = x; if x == y { bulb_power() } else { 1 }", ""),
        ("curry", "let f = || 1; for i in 0..1000000 { let g = f; f = |x| g; } bulb_power()", ""),
        ("closures", "let x = [1.0]; for i in 0..100000 { let y = x; x = [|| y]; } bulb_power()", ""),
        ("nodes", "let x = box_fold(); for i in 0..300 { x = Sequence([x]); } x", "deep"),
        (
            "sort",
            "let a = []; for i in 0..9999 { a.push((i * 7919) % 10007); } for i in 0..400000 { let b = a; b.sort(); } bulb_power()",
            "seconds",
        ),
        (
            "strings",
            "let s = \"a\"; s.pad(100000, \"a\"); for i in 0..600000 { let t = s.to_upper(); } bulb_power()",
            "",
        ),
        (
            "bytes",
            "let s = \"a\"; s.pad(90000, \"a\"); let a = []; for i in 0..9000 { a.push(box_fold(#{limit: s + i})); } a[0]",
            "MiB",
        ),
        ("loop", "loop { }", "operations"),
    ];
    for (name, text, expected) in cases {
        let file = format!("{name}.rhai");
        let folder = folder_with(&[(&file, text)]);
        let output = bulbfold(folder.path(), &[&["render", &file][..], &SMALL].concat());
        let said = stderr(&output);
        assert!(matches!(output.status.code(), Some(0 | 2)), "{name}: {:?} {said}", output.status);
        // A slow machine ends some of them sooner.
        assert!(said.contains(expected) || said.contains("seconds"), "{name}: {said}");
    }
    let variables: String = (0..30_000).map(|i| format!("let v{i}=s+{i};")).collect();
    let text = format!("let s=\"a\";s.pad(99900,\"a\");{variables}bulb_power()");
    let folder = folder_with(&[("vars.rhai", &text)]);
    let said = refused(folder.path(), &[&["render", "vars.rhai"][..], &SMALL].concat());
    assert!(said.contains("variables") || said.contains("MiB"), "{said}");
}

/// A step of so many sines, each in the next.
fn sines(count: u32) -> String {
    format!(
        "fn step(z, c, p) {{\n    let x = z;\n    for i in 0..{count} {{ x = sin(x) * 1.01 + z; }}\n    x\n}}\n#{{ state: \"any\" }}\n"
    )
}

#[test]
fn long_steps_are_taken_or_refused_by_all_commands() {
    let folder = folder_with(&[
        ("long.rhai", &sines(100)),
        ("longer.rhai", &sines(60_000)),
        ("a.ron", "(nodes: { \"a\": long() }, max_iterations: 4)"),
        ("b.ron", "(nodes: { \"a\": longer() }, max_iterations: 4)"),
    ]);
    let probe = bulbfold(folder.path(), &["export", "a.ron", "--to", "wgsl"]);
    assert!(probe.status.success(), "{}", stderr(&probe));
    for command in [
        &["probe", "b.ron", "--point", "0.1,0.2,0.3"][..],
        &["check", "b.ron"],
        &[&["render", "b.ron"][..], &SMALL].concat(),
    ] {
        let text = refused(folder.path(), command);
        assert!(text.contains("`a` is made of") || text.contains("more than"), "{text}");
    }
}

/// Control characters but for line ends and tabs.
fn controls(output: &Output) -> Vec<char> {
    let text = [stdout(output), stderr(output)].concat();
    text.chars().filter(|c| c.is_control() && !"\n\r\t".contains(*c)).collect()
}

#[test]
fn nothing_of_a_file_reaches_a_terminal_raw() {
    let graph = "(summary: \"\\u{1b}[31mRED\", inventor: \"\\u{1b}]0;t\\u{7}\", source: \"\\u{1b}[1m\", group: \"\\u{1b}[5m\", \
                 params: {\"p\": (default: 1, unit: \"\\u{1b}[8m\", help: \"\\u{1b}[7m\")}, nodes: {\"a\": bulb_power()}, \
                 presets: {\"q\": (help: \"\\u{1b}[3m\", set: {\"max_iterations\": 4})}, tests: [Inside((9,9,9))])";
    let step = "fn step(z, c, p) {\n    z * 2.0\n}\n#{ group: \"t\", summary: \"\\x1b[31mRED\\x07\", source: \"\\x1b]0;t\\x07\", inventor: \"\\x1b[1m\" }\n";
    let loud = "e\u{1b}[31m.ron";
    let folder = folder_with(&[("e.ron", graph), (loud, graph)]);
    std::fs::create_dir(folder.path().join("steps")).expect("a folder");
    std::fs::write(folder.path().join("steps/loud.rhai"), step).expect("a file");
    for command in [
        &["explain", "e.ron"][..],
        &["explain", "e.ron", "--markdown"],
        &["compile", "e.ron", "--emit", "graph"],
        &["compile", "e.ron", "--emit", "dot"],
        &["list", "--steps", "steps"],
        &["explain", "loud", "--steps", "steps"],
        &["test", "e.ron"],
        &["check", loud, "--set", "nothing=1"],
        &["render", loud, "--size", "4x3", "--samples", "1", "--calibrate", "off", "--backend", "cpu"],
    ] {
        let output = bulbfold(folder.path(), command);
        let found = controls(&output);
        assert!(found.is_empty() && output.status.code().is_some_and(|code| code <= 2), "{command:?}: {found:?}");
    }
}

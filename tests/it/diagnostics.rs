//! The main messages, each as users see it. `BULBFOLD_BLESS=1 cargo test --test it diagnostics::` renews the expected ones.

use std::path::Path;

use bulbfold::check::Formula;

use crate::support::folder;

/// A step file around the body of `fn step`.
fn step(body: &str) -> String {
    format!(
        "fn step(z, c, p) {{\n    {body}\n}}\n\n#{{\n    group: \"fold\", summary: \"A test.\", source: \"A test\",\n    \
         params: [#{{ name: \"size\", \"default\": 1.0, min: 0.0, max: 2.0, help: \"Size.\" }}],\n    \
         examples: [#{{ z: [0.0, 0.0, 0.0], expect: [0.0, 0.0, 0.0] }}],\n}}\n"
    )
}

/// The message for a graph beside the step `mine`.
fn message(graph: &str, step: &str) -> String {
    let folder = folder();
    if !step.is_empty() {
        std::fs::write(folder.path().join("mine.rhai"), step).unwrap();
    }
    std::fs::write(folder.path().join("test.ron"), graph).unwrap();
    let path = folder.path().join("test.ron");
    let text = match Formula::open(&path) {
        Ok(_) => "no error\n".to_string(),
        Err(error) => error.to_string(),
    };
    text.replace(&format!("{}/", folder.path().display()), "")
}

fn expect(name: &str, found: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/diagnostics").join(format!("{name}.txt"));
    if std::env::var("BULBFOLD_BLESS").is_ok_and(|v| v == "1") {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, found).unwrap();
        return;
    }
    let expected = std::fs::read_to_string(&path).unwrap_or_default();
    assert_eq!(expected, found, "\nthe message {name} changed; expected:\n{expected}\nfound:\n{found}");
}

fn graph(name: &str, text: &str) {
    expect(name, &message(text, ""));
}

fn script(name: &str, body: &str) {
    expect(name, &message("(nodes: { \"a\": mine() })\n", &step(body)));
}

#[test]
fn unknown_field() {
    graph("unknown_field", "(\n    nodes: { \"a\": box_fold() },\n    max_iteratoins: 10,\n)\n");
}

#[test]
fn unknown_step() {
    graph("unknown_step", "(\n    nodes: { \"a\": box_flod(limit: 1.0) },\n)\n");
}

#[test]
fn unknown_parameter() {
    graph("unknown_parameter", "(\n    nodes: { \"a\": box_fold(limti: 1.0) },\n)\n");
}

#[test]
fn duplicate_key() {
    graph("duplicate_key", "(\n    nodes: {\n        \"a\": box_fold(),\n        \"a\": scale(),\n    },\n)\n");
}

#[test]
fn cycle() {
    graph(
        "cycle",
        "(\n    nodes: {\n        \"a\": Sequence([\"b\"]),\n        \"b\": Sequence([\"a\"]),\n    },\n    output: \"a\",\n)\n",
    );
}

#[test]
fn missing_node() {
    graph(
        "missing_node",
        "(\n    nodes: {\n        \"fold\": box_fold(),\n        \"b\": Sequence([\"flod\"]),\n    },\n    output: \"b\",\n)\n",
    );
}

#[test]
fn missing_output() {
    graph("missing_output", "(\n    nodes: {\n        \"fold\": box_fold(),\n        \"grow\": scale(),\n    },\n)\n");
}

#[test]
fn wrong_type() {
    graph("wrong_type", "(\n    nodes: { \"a\": box_fold(limit: [1, 2]) },\n    summary: 12,\n)\n");
}

#[test]
fn out_of_range() {
    graph("out_of_range", "(\n    nodes: { \"a\": box_fold(limit: -3.0) },\n)\n");
}

#[test]
fn not_a_number() {
    graph("not_a_number", "(\n    nodes: { \"a\": box_fold(limit: NaN) },\n    escape_radius: inf,\n)\n");
}

#[test]
fn field_where_map_belongs() {
    graph(
        "field_where_map_belongs",
        "(\n    nodes: {\n        \"ball\": Sphere(radius: 1),\n        \"b\": Sequence([\"ball\"]),\n    },\n    output: \"b\",\n)\n",
    );
}

#[test]
fn unknown_name_in_expression() {
    graph(
        "unknown_name_in_expression",
        "(\n    params: { \"size\": (default: 1.0) },\n    nodes: { \"a\": box_fold(limit: \"2 * sizes\") },\n)\n",
    );
}

#[test]
fn several_at_once() {
    graph(
        "several_at_once",
        "(\n    nodes: {\n        \"a\": box_flod(),\n        \"b\": sphere_fold(min_radius: -1),\n        \"c\": Sequence([\"a\", \"x\"]),\n    },\n    colour: 3,\n    output: \"c\",\n)\n",
    );
}

#[test]
fn unclosed_bracket() {
    graph("unclosed_bracket", "(\n    nodes: { \"a\": box_fold(limit: 1.0 },\n)\n");
}

#[test]
fn wrong_test() {
    graph(
        "wrong_test",
        "(\n    nodes: { \"a\": box_fold() },\n    tests: [Insied((0, 0, 0)), Ray(origin: (1, 0, 0), direction: (0, 0, 0), t: 1)],\n)\n",
    );
}

#[test]
fn symbolic_if() {
    script("symbolic_if", "if z.x > 0.0 { z } else { -z }");
}

#[test]
fn symbolic_and() {
    script("symbolic_and", "if z.x > 0.0 && z.y > 0.0 { z } else { -z }");
}

#[test]
fn switch() {
    script("switch", "switch p.size { 1.0 => z, _ => -z }");
}

#[test]
fn endless_loop() {
    script("endless_loop", "let x = z; while true { x = x + 1.0; } x");
}

#[test]
fn endless_plain_loop() {
    script("endless_plain_loop", "let i = 0; loop { i += 1; } z");
}

#[test]
fn wrong_return_type() {
    script("wrong_return_type", "z.x");
}

#[test]
fn nothing_returned() {
    script("nothing_returned", "let x = z * 2.0;");
}

#[test]
fn unknown_function() {
    script("unknown_function", "clmap(z, -1.0, 1.0)");
}

#[test]
fn unknown_script_parameter() {
    script("unknown_script_parameter", "z * p.sise");
}

#[test]
fn vectors_of_two_widths() {
    script("vectors_of_two_widths", "z + vec4(z, 1.0)");
}

#[test]
fn string_comparison() {
    script("string_comparison", "if z == \"a\" { z } else { -z }");
}

#[test]
fn syntax_error() {
    script("syntax_error", "let x = z * ; x");
}

#[test]
fn endless_recursion() {
    script("endless_recursion", "step(z, c, p)");
}

#[test]
fn endless_recursion_of_a_helper() {
    expect(
        "endless_recursion_of_a_helper",
        &message(
            "(nodes: { \"a\": mine() })\n",
            &step("turned(z)").replace("fn step", "fn turned(v) {\n    turned(v * 2.0)\n}\n\nfn step"),
        ),
    );
}

#[test]
fn function_with_other_arguments() {
    script("function_with_other_arguments", "clamp(z, 1.0)");
}

#[test]
fn rule_with_other_arguments() {
    let step = format!("fn bend(z, e, p) {{\n    1.0\n}}\n\n{}", step("z"));
    expect("rule_with_other_arguments", &message("(nodes: { \"a\": mine() })\n", &step));
}

#[test]
fn empty_file() {
    graph("empty_file", " \n");
}

#[test]
fn shape_without_its_parts() {
    graph("shape_without_its_parts", "(\n    nodes: { \"a\": Repeat(), \"b\": Sequence() },\n    output: \"a\",\n)\n");
}

#[test]
fn map_as_end_shape() {
    graph("map_as_end_shape", "(\n    nodes: { \"a\": box_fold() },\n    end: \"a\",\n    output: \"a\",\n)\n");
}

#[test]
fn unmeasured_orbit_in_an_end_shape() {
    graph(
        "unmeasured_orbit_in_an_end_shape",
        "(\n    nodes: {\n        \"a\": scale(),\n        \"b\": Orbit(of: \"a\", max_iterations: 30),\n    },\n    \
         end: \"b\",\n    output: \"a\",\n)\n",
    );
}

#[test]
fn embedding_inside_an_orbit() {
    graph("embedding_inside_an_orbit", "(\n    nodes: { \"a\": stereographic() },\n    output: \"a\",\n)\n");
}

/// A shape file as a step, without its worth, and of too many components.
#[test]
fn shapes_out_of_place() {
    let shape = |state: &str, distance: &str| {
        format!(
            "fn distance(z, p) {{\n    length(z) - 1.0\n}}\n\n#{{\n    group: \"shape\", summary: \"A test.\", source: \"A test\",{state}{distance}\n    \
             examples: [#{{ z: [2.0, 0.0, 0.0], expect: 1.0 }}],\n}}\n"
        )
    };
    let used = "(\n    nodes: { \"a\": mine() },\n    output: \"a\",\n)\n";
    let exact = " distance: \"exact\",";
    expect("shape_without_its_worth", &message(used, &shape("", "")));
    expect("shape_of_four_components", &message(used, &shape(" state: 4,", exact)));
    let sequence = "(\n    nodes: { \"a\": Sequence([mine()]) },\n    output: \"a\",\n)\n";
    expect("shape_in_a_sequence", &message(sequence, &shape("", exact)));
}

#[test]
fn levels_without_any() {
    graph(
        "levels_without_any",
        "(\n    nodes: {\n        \"a\": scale(),\n        \"b\": Levels(of: \"a\", shape: Box(), from: 3, to: 3, join: Union),\n        \
         \"c\": Levels(of: \"a\", shape: Box(), to: 3, join: Sum),\n    },\n    output: \"b\",\n)\n",
    );
}

#[test]
fn warp_and_tile_without_their_parts() {
    graph(
        "warp_and_tile_without_their_parts",
        "(\n    nodes: {\n        \"a\": Tile(of: Box()),\n        \"b\": Warp(of: Box()),\n    },\n    output: \"a\",\n)\n",
    );
}

#[test]
fn warp_by_what_is_no_map_of_space() {
    graph(
        "warp_by_what_is_no_map_of_space",
        "(\n    nodes: {\n        \"a\": Warp(of: Box(), by: Sphere()),\n        \"b\": Warp(of: \"a\", by: stereographic()),\n    \
         },\n    output: \"b\",\n)\n",
    );
}

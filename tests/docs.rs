//! The documentation holds: generated pages are fresh, links lead somewhere, examples work.

use std::path::Path;
use std::process::{Command, Output};

use bulbfold::check::{Formula, Options, run_paths};
use bulbfold::diag::Diagnostics;
use bulbfold::formula::library::Library;
use bulbfold::graph::Method;
use bulbfold::load::load_text;

/// Pages that people write.
const PAGES: &[&str] = &[
    "README.md",
    "CHANGELOG.md",
    "docs/formulas.md",
    "docs/gallery.md",
    "docs/views.md",
    "docs/precision.md",
    "docs/performance.md",
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn text(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

fn bulbfold(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_bulbfold")).args(arguments).current_dir(folder).output().expect("it starts")
}

/// The blocks of a language in a page.
fn blocks(page: &str, language: &str) -> Vec<String> {
    let text = text(page);
    let parts = text.split("\n```").skip(1).step_by(2);
    parts.filter_map(|block| block.strip_prefix(&format!("{language}\n")).map(|code| format!("{code}\n"))).collect()
}

#[test]
fn generated_pages_are_fresh() {
    let folder = tempfile::tempdir().expect("a folder can be made");
    // Which pictures there are decides about what the pages show.
    std::fs::create_dir(folder.path().join("thumbnails")).expect("a folder can be made");
    for picture in std::fs::read_dir(root().join("docs/thumbnails")).into_iter().flatten().flatten() {
        std::fs::write(folder.path().join("thumbnails").join(picture.file_name()), "").expect("a file can be made");
    }
    let output = bulbfold(folder.path(), &["docs", "-o", "."]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    for name in ["steps.md", "fractals.md", "operators.md"] {
        let fresh = std::fs::read_to_string(folder.path().join(name)).expect("the page was written");
        let is_fresh = fresh == text(&format!("docs/{name}"));
        assert!(is_fresh, "docs/{name} is out of date; renew it with: cargo run --release -- docs -o docs");
    }
}

#[test]
fn links_lead_somewhere() {
    for page in PAGES {
        let text = text(page);
        let folder = root().join(page);
        let folder = folder.parent().expect("a page lies in a folder");
        let targets = text.split("](").skip(1).filter_map(|rest| rest.split(')').next());
        for target in targets.filter(|target| !target.starts_with("http") && !target.starts_with('#')) {
            let path = target.split('#').next().unwrap_or_default();
            assert!(folder.join(path).exists(), "{page} links to {target}, which does not exist");
        }
    }
}

#[test]
fn examples_of_graph_files_load_and_pass_their_tests() {
    let examples = blocks("docs/formulas.md", "ron");
    assert!(!examples.is_empty());
    for example in examples {
        let formula = Formula::from_ron(&example).unwrap_or_else(|error| panic!("{example}\n{error}"));
        formula.assert_tests();
    }
}

#[test]
fn examples_of_scripts_load_and_pass_their_tests() {
    let (steps, graphs): (Vec<String>, Vec<String>) = blocks("docs/formulas.md", "rhai")
        .into_iter()
        .partition(|example| bulbfold::formula::shape::is_step_text(example));
    assert!(!steps.is_empty() && !graphs.is_empty());
    let folder = tempfile::tempdir().expect("a folder can be made");
    for (i, example) in steps.iter().enumerate() {
        std::fs::write(folder.path().join(format!("example_{i}.rhai")), example).expect("the step is written");
    }
    let mut library = Library::builtin();
    let report = run_paths(&mut library, &[folder.path().to_path_buf()], &Options::default());
    assert!(report.is_ok(), "{report}");
    for example in &graphs {
        let mut d = Diagnostics::default();
        let loaded = load_text(&mut library, "example.rhai", example, &[], &mut d);
        assert!(loaded.is_some(), "{example}\n{}", d.render(&library.sources, false));
    }
}

/// The code of the README's test, on a built-in fractal.
#[test]
fn the_unit_test_of_the_readme_works() {
    let snippet = blocks("README.md", "rust").concat();
    for call in [".inside([", ".estimate([", "Method::Gradient", ".ray([", ".assert_tests()", "Formula::open("] {
        assert!(snippet.contains(call), "the README does not call {call} any more; change this test with it");
    }
    let formula = Formula::open(root().join("formulas/fractals/mandelbulb.ron")).unwrap();
    assert!(formula.inside([0.0, 0.0, 0.0]));
    assert!(formula.estimate([3.0, 0.0, 0.0], Method::Gradient) <= 2.0);
    assert!(formula.ray([0.0, -5.0, 0.0], [0.0, 1.0, 0.0]).is_some_and(|t| t < 4.5));
    formula.assert_tests();
}

/// Every node, condition, constant and test of the tables in docs/formulas.md.
#[test]
fn everything_in_the_tables_can_be_written() {
    let text = include_str!("docs/everything.ron");
    let formula = Formula::from_ron(text).unwrap_or_else(|error| panic!("{error}"));
    formula.assert_tests();
    let text = include_str!("docs/shapes_without_fields.ron");
    let formula = Formula::from_ron(text).unwrap_or_else(|error| panic!("{error}"));
    formula.assert_tests();
}

/// Commands of the README that only print.
#[test]
fn commands_of_the_readme_work() {
    let readme = text("README.md");
    let folder = tempfile::tempdir().expect("a folder can be made");
    let mut count = 0;
    for line in readme.lines().filter_map(|line| line.strip_prefix("bulbfold ")) {
        let command = line.split('#').next().unwrap_or_default();
        let arguments: Vec<&str> = command.split_whitespace().collect();
        if ["list", "explain", "compile", "probe"].contains(&arguments[0]) {
            let output = bulbfold(folder.path(), &arguments);
            assert!(output.status.success(), "{command}: {}", String::from_utf8_lossy(&output.stderr));
            count += 1;
        }
    }
    assert!(count >= 4, "{count}");
}

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

/// Pages of people whose files and commands are followed from top to bottom, each in an empty folder.
const TUTORIALS: &[&str] =
    &["docs/tutorials/first_formula.md", "docs/tutorials/first_hybrid.md", "docs/tutorials/why_holes.md"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn text(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

fn bulbfold(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bulbfold"));
    command.args(arguments).current_dir(folder).env("BULBFOLD_CACHE", "").output().expect("it starts")
}

/// A fenced block of a page.
struct Block {
    /// The last line before it that is not empty.
    before: String,
    /// What is written behind its fence.
    language: String,
    /// Its lines.
    code: String,
}

/// The fenced blocks of a page, in order.
fn fenced(page: &str) -> Vec<Block> {
    let text = text(page);
    let parts: Vec<&str> = text.split("\n```").collect();
    let block = |pair: &[&str]| {
        let (language, code) = pair[1].split_once('\n').unwrap_or((pair[1], ""));
        Block {
            before: pair[0].trim_end().lines().next_back().unwrap_or_default().to_owned(),
            language: language.to_owned(),
            code: format!("{code}\n"),
        }
    };
    parts.chunks_exact(2).map(block).collect()
}

/// The blocks of a language in a page.
fn blocks(page: &str, language: &str) -> Vec<String> {
    fenced(page).into_iter().filter(|block| block.language == language).map(|block| block.code).collect()
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
    for page in PAGES.iter().chain(TUTORIALS) {
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

/// A reader's way: the files are written, the commands typed, and those with `# fails` behind them fail.
#[test]
fn tutorials_can_be_followed() {
    for page in TUTORIALS {
        let folder = tempfile::tempdir().expect("a folder can be made");
        let mut count = 0;
        for block in fenced(page) {
            match block.language.as_str() {
                "ron" | "rhai" => {
                    let name = block.before.strip_prefix("In `").and_then(|rest| rest.strip_suffix("`:"));
                    let name = name.unwrap_or_else(|| panic!("{page} does not name the file of\n{}", block.code));
                    std::fs::write(folder.path().join(name), &block.code).expect("the file is written");
                }
                "sh" => {
                    for line in block.code.lines() {
                        follow(page, folder.path(), line);
                        count += 1;
                    }
                }
                _ => {}
            }
        }
        assert!(count >= 8, "{page} has {count} commands");
    }
}

/// Runs a command of a tutorial, with few pixels and rays.
fn follow(page: &str, folder: &Path, line: &str) {
    let (command, note) = line.split_once(" #").unwrap_or((line, ""));
    let words: Vec<&str> = command.split_whitespace().collect();
    assert_eq!(words.first(), Some(&"bulbfold"), "{page}: {line}");
    let output = bulbfold(folder, &quick(&words[1..]));
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code().is_some_and(|code| code <= 2), "{page}: {line}\n{said}");
    assert_eq!(!output.status.success(), note.trim() == "fails", "{page}: {line}\n{said}");
}

/// The arguments of a command, changed so that it takes little time.
fn quick<'a>(words: &[&'a str]) -> Vec<&'a str> {
    let mut quick = words.to_vec();
    match words[0] {
        "render" => {
            put(&mut quick, "--size", "32x24");
            put(&mut quick, "--calibrate", "off");
            if !words.contains(&"--view") {
                put(&mut quick, "--samples", "1");
            }
        }
        "check" | "calibrate" => put(&mut quick, "--size", "64x48"),
        "truth" => put(&mut quick, "--rays", "40"),
        _ => {}
    }
    quick
}

/// Gives an option another value, or adds it.
fn put<'a>(words: &mut Vec<&'a str>, option: &'a str, value: &'a str) {
    match words.iter().position(|word| *word == option) {
        Some(i) => words[i + 1] = value,
        None => words.extend([option, value]),
    }
}

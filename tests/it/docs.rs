//! The documentation holds: generated pages are fresh, links lead somewhere, examples work.

use std::path::Path;

use bulbfold::check::{Formula, Options, run_paths};
use bulbfold::diag::Diagnostics;
use bulbfold::formula::embedded::FRACTALS;
use bulbfold::formula::library::Library;
use bulbfold::graph::Method;
use bulbfold::load::load_text;

use crate::support::{bulbfold, folder, stderr, success};

/// Pages of people whose files and commands are followed from top to bottom, each in an empty folder.
const TUTORIALS: &[&str] = &[
    "docs/farm.md",
    "docs/tutorials/first_formula.md",
    "docs/tutorials/first_hybrid.md",
    "docs/tutorials/why_holes.md",
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn text(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
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

/// What GitHub makes of a heading's text: the name that links go to.
fn anchor(heading: &str) -> String {
    let kept = heading.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
    kept.collect::<String>().to_lowercase().replace(' ', "-")
}

/// The names of a page's headings that links can go to.
fn anchors(text: &str) -> Vec<String> {
    text.lines().filter(|line| line.starts_with('#')).map(|line| anchor(line.trim_start_matches('#').trim())).collect()
}

/// The targets of a page's links and pictures.
fn targets(text: &str) -> impl Iterator<Item = &str> {
    text.split("](").skip(1).filter_map(|rest| rest.split(')').next())
}

/// `bulbfold docs` writes every step and fractal with its parameters and presets, and no link that leads nowhere.
#[test]
fn generated_pages_are_complete() {
    let folder = folder();
    // Pages show the thumbnails that lie beside them.
    std::fs::create_dir(folder.path().join("thumbnails")).expect("a folder can be made");
    for (name, _) in FRACTALS {
        std::fs::write(folder.path().join(format!("thumbnails/{name}.jpg")), "").expect("a file can be made");
    }
    success(&bulbfold(folder.path(), ["docs", "-o", "."]));
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).expect("the page was written");
    let (steps, fractals) = (read("steps.md"), read("fractals.md"));
    let has = |page: &str, line: &str| page.lines().any(|other| other == line);
    for step in Library::builtin().steps() {
        assert!(has(&steps, &format!("### {}", step.name)), "{} has no entry", step.name);
        assert!(steps.contains(&step.summary.replace('|', "\\|")), "{} has no summary", step.name);
        for param in &step.params {
            assert!(steps.contains(&format!("| {} |", param.name)), "{}: {}", step.name, param.name);
        }
    }
    for (name, _) in FRACTALS {
        assert!(has(&fractals, &format!("### {name}")), "{name} has no entry");
        assert!(has(&fractals, &format!("![{name}](thumbnails/{name}.jpg)")), "{name} has no picture");
    }
    let places = [("steps.md", anchors(&steps)), ("fractals.md", anchors(&fractals))];
    for (page, text) in [("steps.md", &steps), ("fractals.md", &fractals)] {
        for target in targets(text).filter(|target| !target.starts_with("http")) {
            let (file, place) = target.split_once('#').unwrap_or((target, ""));
            let file = if file.is_empty() { page } else { file };
            assert!(folder.path().join(file).exists(), "{page} links to {target}, which does not exist");
            let known = places.iter().find(|(name, _)| *name == file);
            let is_there = place.is_empty() || known.is_some_and(|(_, places)| places.iter().any(|name| name == place));
            assert!(is_there, "{page} links to {target}, which has no such heading");
        }
    }
    let is_fresh = read("operators.md") == text("docs/operators.md");
    assert!(is_fresh, "docs/operators.md is out of date; renew it with: cargo run --release -- docs -o docs");
}

/// Every page that people write: those of the root, of docs and of its folders.
fn pages() -> Vec<String> {
    let mut pages = Vec::new();
    for folder in ["", "docs/", "docs/lab/", "docs/tutorials/"] {
        for entry in std::fs::read_dir(root().join(folder)).into_iter().flatten().flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            // These are made, and tested as such.
            let made = ["steps.md", "fractals.md", "materials.md", "palettes.md"];
            if name.ends_with(".md") && !made.contains(&name.as_str()) {
                pages.push(format!("{folder}{name}"));
            }
        }
    }
    pages.sort();
    pages
}

#[test]
fn links_lead_somewhere() {
    let pages = pages();
    assert!(pages.len() >= 20, "{pages:?}");
    for page in pages {
        let text = text(&page);
        let folder = root().join(&page);
        let folder = folder.parent().expect("a page lies in a folder");
        // What stands between back quotes is code.
        let prose: String = text.split('`').step_by(2).collect();
        for target in targets(&prose).filter(|target| !target.starts_with("http")) {
            let (path, place) = target.split_once('#').unwrap_or((target, ""));
            let path = if path.is_empty() { root().join(&page) } else { folder.join(path) };
            assert!(path.exists(), "{page} links to {target}, which does not exist");
            let other = (!place.is_empty()).then(|| std::fs::read_to_string(&path).expect("a page is text"));
            let is_there = other.is_none_or(|other| anchors(&other).iter().any(|name| name == place));
            assert!(is_there, "{page} links to {target}, which has no such heading");
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
    let folder = folder();
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

/// The commands of a page's code spans, without the program's name.
fn commands(page: &str) -> Vec<String> {
    let text = text(page);
    let spans = text.split('`').skip(1).step_by(2);
    spans
        .filter_map(|span| span.strip_prefix("bulbfold "))
        .filter(|rest| *rest != "COMMAND --help")
        .map(str::to_owned)
        .collect()
}

/// The words of a command line, in which single quotes hold words together.
fn words(command: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    for (i, part) in command.split('\'').enumerate() {
        if i % 2 == 1 {
            words.last_mut().expect("there is a word").push_str(part);
            continue;
        }
        for (k, word) in part.split(' ').enumerate() {
            if k > 0 {
                words.push(String::new());
            }
            words.last_mut().expect("there is a word").push_str(word);
        }
    }
    words.retain(|word| !word.is_empty());
    words
}

/// Every command of the README that makes no page of all fractals, with few pixels, beside a formula that `new` wrote.
#[test]
fn commands_of_the_readme_work() {
    let folder = folder();
    let output = bulbfold(folder.path(), ["new", "my_hybrid"]);
    assert!(output.status.success(), "{}", stderr(&output));
    // `gallery` and `watch` have tests of their own, measured times need a quiet machine, and there is no scene to import.
    let left_out = ["gallery", "watch", "bench", "import"];
    let all = commands("README.md");
    let run: Vec<&String> = all.iter().filter(|command| command.contains(' ') || *command == "list").collect();
    let run: Vec<&&String> =
        run.iter().filter(|command| !left_out.iter().any(|name| command.starts_with(name))).collect();
    assert!(run.len() >= 20, "{run:?}");
    for command in run {
        let words = words(command);
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        let output = bulbfold(folder.path(), quick(&words));
        assert!(output.status.success(), "{command}: {}", stderr(&output));
    }
}

/// Each picture of the README's strip exists and has its command in the row below.
#[test]
fn pictures_of_the_readme_have_commands() {
    let text = text("README.md");
    let rows: Vec<&str> = text.lines().filter(|line| line.starts_with('|')).collect();
    let mut count = 0;
    for pair in rows.windows(2) {
        let pictures = pair[0].matches("(docs/images/strip/").count();
        assert!(pictures == 0 || pictures == pair[1].matches("`bulbfold render ").count(), "{}", pair[0]);
        count += pictures;
    }
    assert_eq!(count, 9);
}

/// A reader's way: the files are written, the commands typed, and those with `# fails` behind them fail.
#[test]
fn tutorials_can_be_followed() {
    for page in TUTORIALS {
        let folder = folder();
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

/// Every command of the page on meshes, with few cells.
#[test]
fn commands_of_the_page_on_meshes_work() {
    let folder = folder();
    let page = "docs/meshes.md";
    let lines: Vec<String> = blocks(page, "sh").iter().flat_map(|code| code.lines()).map(str::to_owned).collect();
    assert!(lines.len() >= 5, "{lines:?}");
    lines.iter().for_each(|line| follow(page, folder.path(), line));
}

/// Runs a command of a tutorial, with few pixels and rays.
fn follow(page: &str, folder: &Path, line: &str) {
    let (command, note) = line.split_once(" #").unwrap_or((line, ""));
    let words: Vec<&str> = command.split_whitespace().collect();
    assert_eq!(words.first(), Some(&"bulbfold"), "{page}: {line}");
    let output = bulbfold(folder, quick(&words[1..]));
    let said = stderr(&output);
    assert!(output.status.code().is_some_and(|code| code <= 2), "{page}: {line}\n{said}");
    assert_eq!(!output.status.success(), note.trim() == "fails", "{page}: {line}\n{said}");
}

/// The arguments of a command, changed so that it takes little time.
fn quick<'a>(words: &[&'a str]) -> Vec<&'a str> {
    let mut quick = words.to_vec();
    match words[0] {
        // All of a part is settled in its job.
        "render" if words.contains(&"--part") => {}
        "job" => {
            put(&mut quick, "--size", "32x24");
            put(&mut quick, "--samples", "1");
            put(&mut quick, "--calibrate", "off");
        }
        "render" => {
            put(&mut quick, "--size", "32x24");
            if words.contains(&"--frames") {
                put(&mut quick, "--frames", "2");
            }
            put(&mut quick, "--calibrate", "off");
            if !words.contains(&"--view") {
                put(&mut quick, "--samples", "1");
            }
        }
        "animate" => {
            put(&mut quick, "--size", "32x24");
            put(&mut quick, "--samples", "1");
            put(&mut quick, "--calibrate", "off");
            put(&mut quick, "--frames", "1..3");
        }
        "check" | "calibrate" => put(&mut quick, "--size", "64x48"),
        "truth" => put(&mut quick, "--rays", "40"),
        "mesh" | "slices" => put(&mut quick, "--resolution", "24"),
        "vary" => {
            put(&mut quick, "--count", "2");
            put(&mut quick, "--size", "64x48");
        }
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

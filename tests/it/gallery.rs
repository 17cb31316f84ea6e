//! The gallery: pages, pictures that are kept, broken formulas, and the page in a real browser.

use std::path::Path;
use std::process::{Command, Output};

use bulbfold::check::Formula;
use bulbfold::formula::embedded::FRACTALS;

use crate::support::{bulbfold, folder, stderr, stdout};

/// Set to 1, a machine without Chromium fails its tests instead of leaving them out.
const REQUIRE_CHROMIUM: &str = "BULBFOLD_REQUIRE_CHROMIUM";
/// What `scripts/gallery_check.py` says where there is no browser.
const NO_CHROMIUM: i32 = 3;

fn gallery(folder: &Path, arguments: &[&str]) -> Output {
    let quick = ["--size", "48x36", "--samples", "1", "--calibrate", "off", "--backend", "cpu"];
    bulbfold(folder, [&["gallery"], arguments, &quick].concat())
}

fn error_of(output: &Output) -> String {
    stderr(output)
}

const BALL: &str = r#"(summary: "A <b>ball</b>.", group: "mine", params: {"size": (default: 1.0, help: "Its radius")},
    nodes: { "ball": Sphere(radius: "size") }, camera: (position: (0, -4, 0), target: (0, 0, 0)), bounding_radius: 1.5)"#;

/// Three fractals and a formula with a mistake.
fn page_of_four(folder: &Path) -> Output {
    std::fs::create_dir_all(folder.join("mine")).unwrap();
    std::fs::write(folder.join("mine/ball.ron"), BALL).unwrap();
    std::fs::write(folder.join("mine/broken.ron"), r#"(nodes: { "a": bulb_powr() })"#).unwrap();
    gallery(folder, &["menger", "mandelbulb", "mine", "-o", "page"])
}

#[test]
fn pages_hold_everything_and_pictures_are_kept() {
    let folder = folder();
    let output = page_of_four(folder.path());
    // One formula is broken: that is told, and the others are done.
    assert_eq!(output.status.code(), Some(1), "{}", error_of(&output));
    assert!(error_of(&output).contains("did you mean `bulb_power`?"), "{}", error_of(&output));
    assert!(error_of(&output).contains("3 pictures rendered, 0 kept, 1 broken"), "{}", error_of(&output));
    let page = std::fs::read_to_string(folder.path().join("page/index.html")).unwrap();
    for text in [
        "A &lt;b&gt;ball&lt;/b&gt;.",
        "Its radius",
        "bulbfold render mine/ball.ron --size 48x36 --samples 1 -o ball.png",
        "did you mean `bulb_power`?",
        "pictures/menger.jpg",
        "menger_fold()",
        "<option value=\"broken\">broken (1)</option>",
    ] {
        assert!(page.contains(text), "{text} is missing");
    }
    for outside in ["http://", "https://", "<link rel=\"stylesheet\"", "<script src"] {
        assert!(!page.contains(outside), "the page holds {outside}");
    }
    for name in ["menger", "mandelbulb", "ball"] {
        let path = folder.path().join(format!("page/pictures/{name}.jpg"));
        let picture = image::open(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display())).into_rgb8();
        assert_eq!(picture.dimensions(), (48, 36));
        let (least, most) = picture.pixels().map(|p| p.0[0]).fold((255, 0), |(a, b), x| (a.min(x), b.max(x)));
        assert!(most > least + 40, "{name} shows nothing");
    }

    // A second run keeps what shows the same, and renders what has changed, lost its end or is gone.
    let output = page_of_four(folder.path());
    assert!(error_of(&output).contains("0 pictures rendered, 3 kept, 1 broken"), "{}", error_of(&output));
    let menger = folder.path().join("page/pictures/menger.jpg");
    let whole = std::fs::read(&menger).unwrap();
    std::fs::write(&menger, &whole[..whole.len() / 2]).unwrap();
    std::fs::remove_file(folder.path().join("page/pictures/mandelbulb.jpg")).unwrap();
    let output = page_of_four(folder.path());
    assert!(error_of(&output).contains("2 pictures rendered, 1 kept, 1 broken"), "{}", error_of(&output));
    assert_eq!(std::fs::read(&menger).unwrap(), whole, "the same picture again");
    std::fs::write(folder.path().join("mine/ball.ron"), BALL.replace("default: 1.0", "default: 0.5")).unwrap();
    let output = gallery(folder.path(), &["menger", "mandelbulb", "mine/ball.ron", "-o", "page"]);
    assert!(output.status.success(), "{}", error_of(&output));
    assert!(error_of(&output).contains("1 pictures rendered, 2 kept, 0 broken"), "{}", error_of(&output));
    // A comment does not show.
    let text = format!("// round\n{}", BALL.replace("default: 1.0", "default: 0.5"));
    std::fs::write(folder.path().join("mine/ball.ron"), text).unwrap();
    let output = gallery(folder.path(), &["menger", "mandelbulb", "mine/ball.ron", "-o", "page"]);
    assert!(error_of(&output).contains("0 pictures rendered, 3 kept, 0 broken"), "{}", error_of(&output));
}

#[test]
fn formulas_of_one_name_have_pictures_of_their_own() {
    let folder = folder();
    for inner in ["a", "b"] {
        std::fs::create_dir_all(folder.path().join(inner)).unwrap();
        std::fs::write(folder.path().join(inner).join("ball.ron"), BALL).unwrap();
    }
    let output = gallery(folder.path(), &["a", "b", "--thumbnails", "small"]);
    assert!(output.status.success(), "{}", error_of(&output));
    assert!(folder.path().join("small/ball.jpg").exists() && folder.path().join("small/ball-2.jpg").exists());
    let output = gallery(folder.path(), &["a"]);
    assert_eq!(output.status.code(), Some(2), "a folder to write to is needed");
}

#[test]
fn the_page_works_in_a_real_browser() {
    let folder = folder();
    page_of_four(folder.path());
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/gallery_check.py");
    let required = std::env::var(REQUIRE_CHROMIUM).is_ok_and(|v| v == "1");
    let output = Command::new("python3").arg(script).arg("page/index.html").current_dir(folder.path()).output();
    let output = match output {
        Ok(output) => output,
        Err(error) if !required => return eprintln!("skipped: python3: {error}"),
        Err(error) => panic!("python3: {error}"),
    };
    let text = format!("{}{}", stdout(&output), error_of(&output));
    if output.status.code() == Some(NO_CHROMIUM) && !required {
        return eprintln!("skipped: {text}");
    }
    assert!(output.status.success(), "{text}");
    assert!(text.matches("ok  ").count() >= 15, "{text}");
}

/// Bytes of all thumbnails together.
const THUMBNAILS: u64 = 6 << 20;

#[test]
fn every_fractal_is_pictured_and_described() {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs");
    let (mut wrong, mut bytes) = (Vec::new(), 0);
    for (name, _) in FRACTALS {
        let formula = Formula::builtin(name).unwrap();
        let graph = formula.graph();
        for (what, text) in [("group", &graph.group), ("summary", &graph.summary), ("source", &graph.source)] {
            if text.is_empty() {
                wrong.push(format!("{name}: no {what}"));
            }
        }
        if graph.tests.len() < 2 {
            wrong.push(format!("{name}: {} tests", graph.tests.len()));
        }
        if graph.scene.camera.is_none() && graph.scene.plane.is_none() {
            wrong.push(format!("{name}: neither camera nor plane"));
        }
        let path = docs.join("thumbnails").join(format!("{name}.jpg"));
        match image::open(&path) {
            Ok(picture) if (picture.width(), picture.height()) == (256, 192) => {
                bytes += std::fs::metadata(&path).map_or(0, |data| data.len());
            }
            Ok(_) => wrong.push(format!("{name}: the thumbnail is not 256x192")),
            Err(error) => wrong.push(format!("{name}: no thumbnail: {error}")),
        }
    }
    let help = "bulbfold gallery --thumbnails docs/thumbnails";
    assert!(wrong.is_empty(), "\n{}\nthumbnails are made by: {help}", wrong.join("\n"));
    assert!(bytes < THUMBNAILS, "the thumbnails take {bytes} bytes");
}

//! `bulbfold watch`: pictures on every save, a page for this machine alone, and what was moved put into the file.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::support::{bulbfold, folder_with, program, stderr, stdout};

const BOX: &str = "// A small box.
(
    params: { \"scale\": (default: 2.0, min: 1.5, max: 4.0, help: \"Scale factor\") }, // its scale
    nodes: {
        \"fold\": box_fold(limit: 1.0),
        \"ball\": sphere_fold(min_radius: 0.5, fixed_radius: 1.0),
        \"grow\": scale(scale: \"scale\"),
        \"box\": Sequence([\"fold\", \"ball\", \"grow\"]),
    },
    output: \"box\",
    escape_radius: 60.0,
    max_iterations: 8,
    bounding_radius: 12.0,
    camera: (position: (13.5, -20.0, 12.0), target: (0.0, 0.0, -0.9), fov: 42), // from the right
    presets: { \"far\": (help: \"Farther away\", set: { \"scale\": 2.4 }, camera: (position: (20, -30, 16), fov: 42)) },
)
";

/// A program that watches; ended when it is dropped.
struct Watching {
    child: Child,
    address: String,
}

impl Drop for Watching {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Watching {
    fn start(folder: &Path) -> Watching {
        let arguments = ["watch", "box.ron", "--size", "240x160", "--no-preview", "--quiet", "--backend", "cpu"];
        let mut child = program(folder).args(arguments).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let mut address = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut address).unwrap();
        assert!(address.starts_with("http://127.0.0.1:"), "{address}");
        Watching { child, address: address.trim().to_string() }
    }

    fn host(&self) -> &str {
        self.address.trim_start_matches("http://").split('/').next().unwrap()
    }

    fn path(&self) -> String {
        self.address.trim_start_matches("http://").trim_start_matches(self.host()).to_string()
    }

    /// The code and the body of an answer.
    fn ask(&self, method: &str, path: &str, lines: &[(&str, &str)], body: &str) -> (u16, Vec<u8>) {
        let mut stream = TcpStream::connect(self.host()).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        let mut text = format!("{method} {path} HTTP/1.0\r\nContent-Length: {}\r\n", body.len());
        if !lines.iter().any(|(name, _)| *name == "Host") {
            text += &format!("Host: {}\r\n", self.host());
        }
        lines.iter().for_each(|(name, value)| text += &format!("{name}: {value}\r\n"));
        write!(stream, "{text}\r\n{body}").unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        let end = answer.windows(4).position(|four| four == b"\r\n\r\n").unwrap();
        let code = std::str::from_utf8(&answer[9..12]).unwrap().parse().unwrap();
        (code, answer[end + 4..].to_vec())
    }

    fn state(&self, after: u64) -> Value {
        let (code, body) = self.ask("GET", &format!("{}state?after={after}", self.path()), &[], "");
        assert_eq!(code, 200);
        serde_json::from_slice(&body).unwrap()
    }

    /// Waits for a state.
    fn until(&self, what: &str, holds: impl Fn(&Value) -> bool) -> Value {
        let (start, mut after) = (Instant::now(), 0);
        while start.elapsed() < Duration::from_secs(120) {
            let state = self.state(after);
            if holds(&state) {
                return state;
            }
            after = state["version"].as_u64().unwrap();
        }
        panic!("{what} did not happen: {}", self.state(0));
    }

    /// The whole picture of another state than one.
    fn next(&self, before: &Value) -> Value {
        let is_new = |state: &Value| state["picture"].as_u64() > before["picture"].as_u64();
        self.until("another picture", |state| is_new(state) && state["part"] == "whole")
    }

    fn order(&self, order: &Value) -> (u16, String) {
        let (code, body) = self.ask("POST", &format!("{}order", self.path()), &[], &order.to_string());
        (code, String::from_utf8(body).unwrap())
    }

    fn picture(&self) -> Vec<u8> {
        let (code, body) = self.ask("GET", &format!("{}picture", self.path()), &[], "");
        assert_eq!(code, 200);
        body
    }
}

#[test]
fn a_save_shows_another_picture_and_a_mistake_keeps_the_last() {
    let folder = folder_with(&[("box.ron", BOX)]);
    let watching = Watching::start(folder.path());
    let first = watching.until("the whole picture", |state| state["part"] == "whole");
    let picture = watching.picture();
    assert_eq!(picture.len(), 8 + 240 * 160 * 4);
    std::fs::write(folder.path().join("box.ron"), BOX.replace("fov: 42), //", "fov: 30), //")).unwrap();
    let second = watching.next(&first);
    let closer = watching.picture();
    assert_ne!(closer, picture);
    std::fs::write(folder.path().join("box.ron"), BOX.replace("fov: 42), //", "fov: wide), //")).unwrap();
    let broken = watching.until("a message", |state| state["message"] != "");
    assert!(broken["message"].as_str().unwrap().contains("box.ron:14:"), "{broken}");
    assert_eq!(watching.picture(), closer, "the last good picture stays");
    std::fs::write(folder.path().join("box.ron"), BOX).unwrap();
    let mended = watching.next(&second);
    assert_eq!(mended["message"], "");
    assert_eq!(watching.picture(), picture);
}

#[test]
fn the_whole_picture_is_that_of_render() {
    let folder = folder_with(&[("box.ron", BOX)]);
    let watching = Watching::start(folder.path());
    watching.until("the whole picture", |state| state["part"] == "whole");
    let seen = watching.picture();
    let rendered =
        bulbfold(folder.path(), ["render", "box.ron", "--size", "240x160", "--backend", "cpu", "-o", "box.png"]);
    assert!(rendered.status.success(), "{}", stderr(&rendered));
    let pixels = crate::support::pixels(&folder.path().join("box.png"));
    let rgb: Vec<u8> = seen[8..].chunks_exact(4).flat_map(|rgba| rgba[..3].to_vec()).collect();
    assert_eq!(rgb, pixels);
}

#[test]
fn what_is_moved_is_seen_and_goes_into_the_file() {
    let folder = folder_with(&[("box.ron", BOX)]);
    let watching = Watching::start(folder.path());
    let first = watching.until("the whole picture", |state| state["part"] == "whole");
    let paths: Vec<&str> = first["sliders"].as_array().unwrap().iter().map(|s| s["path"].as_str().unwrap()).collect();
    assert!(
        paths.starts_with(&["scale", "fold.limit", "ball.min_radius", "ball.fixed_radius", "grow.centre.x"]),
        "{paths:?}"
    );
    assert_eq!(first["sliders"][0]["help"], "Scale factor");
    let order = |order: Value, before: &Value| {
        let (code, why) = watching.order(&order);
        assert_eq!(code, 200, "{order}: {why}");
        watching.next(before)
    };
    let scaled = order(json!({ "set": { "path": "scale", "value": 2.5, "is_moving": false } }), &first);
    let turned = order(json!({ "move": { "movement": { "orbit": [0.5, 0.1] }, "is_moving": false } }), &scaled);
    assert_ne!(turned["flags"], first["flags"]);
    let flown = order(json!({ "move": { "movement": { "fly": [0.0, 0.0, 0.5] }, "is_moving": false } }), &turned);
    let camera = flown["camera"].as_str().unwrap();
    assert_eq!(watching.order(&json!("write")).0, 200);
    let written = std::fs::read_to_string(folder.path().join("box.ron")).unwrap();
    assert!(
        written.contains("(default: 2.5, min: 1.5, max: 4.0, help: \"Scale factor\") }, // its scale"),
        "{written}"
    );
    let position = &camera[camera.find("position").unwrap()..camera.find(", target").unwrap()];
    assert!(written.contains(position) && written.contains("fov: 42), // from the right"), "{written}");
    assert_eq!(written.lines().count(), BOX.lines().count());
    // Limits of iterations and a look's sun go by the file's own view, which is another one by now, so that colours may differ.
    watching.until("the file's own view", |state| {
        let shows = |camera: &str| camera.contains(position);
        state["is_moved"] == false && state["part"] == "whole" && state["camera"].as_str().is_some_and(shows)
    });
    let far = order(json!({ "preset": "far" }), &watching.state(0));
    assert_eq!(far["preset"], "far");
    for wrong in [
        json!({ "set": { "path": "nothing", "value": 1.0, "is_moving": false } }),
        json!({ "set": { "path": "scale", "value": 9.0, "is_moving": false } }),
        json!({ "preset": "near" }),
        json!({ "move": { "movement": { "jump": 1 }, "is_moving": false } }),
        json!({ "move": { "movement": { "dolly": 0.0 }, "is_moving": false } }),
        json!("remove"),
    ] {
        let (code, why) = watching.order(&wrong);
        assert!(code == 400 && !why.is_empty(), "{wrong}: {code}");
    }
}

#[test]
fn nobody_else_reaches_the_page() {
    let folder = folder_with(&[("box.ron", BOX)]);
    let watching = Watching::start(folder.path());
    let page = watching.path();
    assert_eq!(page.len(), 34, "32 digits that nobody guesses: {page}");
    assert_eq!(watching.ask("GET", &page, &[], "").0, 200);
    assert_eq!(watching.ask("GET", "/", &[], "").0, 404);
    assert_eq!(watching.ask("GET", &format!("/{}/", "0".repeat(32)), &[], "").0, 404);
    assert_eq!(watching.ask("GET", &page, &[("Host", "elsewhere.example")], "").0, 403, "a name that leads here");
    let order = format!("{page}order");
    assert_eq!(watching.ask("POST", &order, &[("Origin", "http://elsewhere.example")], "\"write\"").0, 403);
    assert_eq!(
        watching.ask("POST", &order, &[], &format!("{}\"write\"", " ".repeat(100_000))).0,
        400,
        "orders are short"
    );
}

#[test]
fn what_cannot_be_watched_is_refused() {
    let folder = folder_with(&[("box.ron", BOX)]);
    for (arguments, expected) in [
        (vec!["watch", "nothing.ron"], "there is no file nothing.ron"),
        (vec!["watch", "mandelbulb"], "there is no file mandelbulb"),
        (vec!["watch", "box.ron", "--open", "--no-page"], "cannot be used with"),
        (vec!["watch", "box.ron", "--port", "70000"], "70000"),
    ] {
        let output = bulbfold(folder.path(), &arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(stderr(&output).contains(expected), "{arguments:?}: {}", stderr(&output));
    }
}

#[test]
fn the_page_works_in_a_real_browser() {
    let folder = folder_with(&[("box.ron", BOX)]);
    let watching = Watching::start(folder.path());
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/watch_check.py");
    let required = std::env::var("BULBFOLD_REQUIRE_CHROMIUM").is_ok_and(|v| v == "1");
    let output =
        Command::new("python3").arg(script).arg(&watching.address).arg("box.ron").current_dir(folder.path()).output();
    let output = match output {
        Ok(output) => output,
        Err(error) if !required => return eprintln!("skipped: python3: {error}"),
        Err(error) => panic!("python3: {error}"),
    };
    let text = format!("{}{}", stdout(&output), stderr(&output));
    if output.status.code() == Some(3) && !required {
        return eprintln!("skipped: {text}");
    }
    assert!(output.status.success(), "{text}");
    assert!(text.matches("ok  ").count() >= 20, "{text}");
}

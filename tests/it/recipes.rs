//! Pictures that know how they were made: made again, shown, taken apart; and renders that go on where they were stopped.

use std::io::Write;
use std::path::Path;

use bulbfold::film::{read_made, read_made_bytes};
use serde_json::{Value, json};

use crate::support::{bulbfold, folder, folder_with, pixels, program, stderr, stdout, success};

const BULB: [&str; 10] =
    ["render", "mandelbulb", "-q", "--backend", "cpu", "--set", "power=6", "--camera=1.6,-1.8,0.9", "--fov", "50"];

fn render(folder: &Path, arguments: &[&str]) {
    success(&bulbfold(folder, arguments));
}

#[test]
fn a_picture_is_made_again_bit_for_bit() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    let size = ["--size", "64x36", "-o", "a.png", "-o", "a.exr", "-o", "a.jpg", "-o", "a.webp", "-o", "a.tif"];
    render(folder.path(), &[&BULB[..], &size].concat());
    render(folder.path(), &["render", "a.png", "-q", "-o", "b.png", "-o", "b.exr"]);
    let bytes = |name: &str| std::fs::read(path(name)).unwrap();
    assert!(bytes("a.png") == bytes("b.png"), "the picture has other bytes");
    for from in ["a.exr", "a.jpg", "a.webp", "a.tif"] {
        render(folder.path(), &["render", from, "-q", "--force", "-o", "c.png"]);
        assert!(pixels(&path("a.png")) == pixels(&path("c.png")), "{from}");
    }
    // Options that are given win, all else stays.
    let agree = |options: &[&str]| {
        render(folder.path(), &[&["render", "a.png", "-q", "--force", "-o", "d.png"], options].concat());
        let size = if options.contains(&"--size") { &[][..] } else { &["--size", "64x36"] };
        render(folder.path(), &[&BULB[..], &["--force", "-o", "e.png"], size, options].concat());
        assert!(pixels(&path("d.png")) == pixels(&path("e.png")), "{options:?}");
        assert!(pixels(&path("d.png")) != pixels(&path("a.png")), "{options:?}");
    };
    agree(&["--exposure", "1"]);
    agree(&["--samples", "1"]);
    agree(&["--size", "48x48"]);
    agree(&["--set", "power=7"]);
    let refused = bulbfold(folder.path(), ["render", "a.png", "-o", "a.png"]);
    assert!(refused.status.code() == Some(2) && stderr(&refused).contains("input"), "{}", stderr(&refused));
}

#[test]
fn pictures_carry_steps_of_their_own() {
    let step = "//! summary: turns\n//! group: fold\n\nfn step(z, c, p) {\n    vec3(z.y, -z.x, z.z)\n}\n";
    let graph = r#"(nodes: { "turn": turned(), "bulb": bulb_power(power: 8.0), "both": Sequence(["turn", "bulb"]) }, output: "both")"#;
    let folder = folder_with(&[("turned.rhai", step), ("graph.ron", graph)]);
    let first =
        bulbfold(folder.path(), ["render", "graph.ron", "-q", "--backend", "cpu", "--size", "32x18", "-o", "a.png"]);
    success(&first);
    let other = folder_with(&[]);
    std::fs::copy(folder.path().join("a.png"), other.path().join("a.png")).unwrap();
    render(other.path(), &["render", "a.png", "-q", "-o", "b.png"]);
    assert!(pixels(&other.path().join("a.png")) == pixels(&other.path().join("b.png")));
    render(other.path(), &["new", "found", "--from", "a.png"]);
    assert_eq!(std::fs::read_to_string(other.path().join("turned.rhai")).unwrap(), step);
    let shown = success(&bulbfold(other.path(), ["show", "a.png"]));
    assert!(shown.contains("step turned:") && shown.contains("vec3(z.y, -z.x, z.z)"), "{shown}");
    #[cfg(unix)]
    if std::os::unix::fs::chown(other.path().join("a.png"), Some(12_345), None).is_ok() {
        let refused = bulbfold(other.path(), ["render", "a.png", "-q", "-o", "c.png"]);
        assert!(refused.status.code() == Some(2) && stderr(&refused).contains("--trust"), "{}", stderr(&refused));
        success(&bulbfold(other.path(), ["show", "a.png"]));
        render(other.path(), &["render", "a.png", "--trust", "-q", "-o", "c.png"]);
    }
}

#[test]
fn show_says_what_a_picture_is_and_runs_nothing() {
    let ball = "(summary: \"\u{1b}[31mred\", nodes: { \"ball\": Sphere(radius: 0.5) }, output: \"ball\")";
    let folder = folder_with(&[("ball.ron", ball)]);
    let arguments =
        ["render", "ball.ron", "-q", "--backend", "cpu", "--size", "32x18", "--camera=0,-3,0.5", "-o", "a.png"];
    render(folder.path(), &[&arguments[..], &["--set", "ball.radius=0.75"]].concat());
    let shown = success(&bulbfold(folder.path(), ["show", "a.png"]));
    for expected in
        ["ball.ron", "--camera=0.0,-3.0,0.5", "--set 'ball.radius=0.75'", "32x18", "cpu, f32", "Sphere(radius: 0.5)"]
    {
        assert!(shown.contains(expected), "{expected}: {shown}");
    }
    assert!(!shown.contains('\u{1b}'));
    let object: Value = serde_json::from_str(&success(&bulbfold(folder.path(), ["show", "a.png", "--json"]))).unwrap();
    assert_eq!(object["version"], 1);
    assert_eq!(object["recipe"]["job"]["request"]["size"], json!({ "width": 32, "height": 18 }));
    assert_eq!(object["key"], json!(read_made(&folder.path().join("a.png")).unwrap().key));
}

#[test]
fn a_formula_comes_out_of_a_picture_with_its_camera() {
    let ball = "// A ball.\n(\n    nodes: { \"ball\": Sphere(radius: 0.5) },\n    output: \"ball\",\n)\n";
    let folder = folder_with(&[("ball.ron", ball)]);
    let view = ["-q", "--backend", "cpu", "--size", "40x30"];
    let seen = ["--camera=0.4,-3,0.5", "--fov", "25", "--exposure", "0.5", "-o", "a.png"];
    render(folder.path(), &[&["render", "ball.ron"], &view[..], &seen].concat());
    let told = bulbfold(folder.path(), ["new", "found", "--from", "a.png"]);
    assert!(stderr(&told).contains("bulbfold render found.ron"), "{}", stderr(&told));
    let text = std::fs::read_to_string(folder.path().join("found.ron")).unwrap();
    assert!(
        text.contains("// A ball.") && text.contains("position: (0.4, -3.0, 0.5)") && text.contains("exposure: 0.5"),
        "{text}"
    );
    let again = bulbfold(folder.path(), [&["render", "found.ron", "-o", "b.png", "--json"], &view[..]].concat());
    let said: Value = serde_json::from_str(&success(&again)).unwrap();
    let shown: Value = serde_json::from_str(&success(&bulbfold(folder.path(), ["show", "a.png", "--json"]))).unwrap();
    for part in ["position", "target", "up"] {
        assert_eq!(said["camera"][part], shown["recipe"]["job"]["camera"][part], "{part}");
    }
    assert!(said["camera"]["fov"].as_f64().is_some_and(|fov| (fov - 25.0).abs() < 1e-9));
}

/// A PNG of one pixel with some chunks.
fn png(chunks: &[(&[u8; 4], Vec<u8>)]) -> Vec<u8> {
    let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
    let mut chunk = |kind: &[u8; 4], data: &[u8]| {
        let mut crc = flate2::Crc::new();
        crc.update(kind);
        crc.update(data);
        bytes.extend((data.len() as u32).to_be_bytes());
        bytes.extend(kind);
        bytes.extend(data);
        bytes.extend(crc.sum().to_be_bytes());
    };
    chunk(b"IHDR", &[0, 0, 0, 1, 0, 0, 0, 1, 8, 0, 0, 0, 0]);
    chunks.iter().for_each(|(kind, data)| chunk(kind, data));
    chunk(b"IDAT", &packed(&[0, 0]));
    chunk(b"IEND", &[]);
    bytes
}

fn packed(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A PNG with a recipe.
fn with_recipe(recipe: &[u8]) -> Vec<u8> {
    png(&[(b"iTXt", [b"bulbfold-recipe\0\x01\0\0\0".to_vec(), packed(recipe)].concat())])
}

#[test]
fn recipes_made_to_break_the_program_are_refused() {
    let ball = "(nodes: { \"ball\": Sphere(radius: 0.5), \"bulb\": bulb_power(power: 8.0) }, output: \"bulb\")";
    let folder = folder_with(&[("ball.ron", ball)]);
    let arguments =
        ["render", "ball.ron", "-q", "--backend", "cpu", "--calibrate", "off", "--size", "16x9", "-o", "a.png"];
    render(folder.path(), &arguments);
    let made = read_made(&folder.path().join("a.png")).unwrap().recipe.unwrap();
    let good: Value = serde_json::from_str(&made).unwrap();
    let write = |bytes: &[u8]| std::fs::write(folder.path().join("x.png"), bytes).unwrap();
    let again = |bytes: &[u8]| {
        write(bytes);
        bulbfold(folder.path(), ["render", "x.png", "-q", "--force", "-o", "y.png"])
    };
    let changed = |pointer: &str, value: Value| {
        let mut recipe = good.clone();
        *recipe.pointer_mut(pointer).unwrap_or_else(|| panic!("{pointer}")) = value;
        with_recipe(recipe.to_string().as_bytes())
    };
    assert!(again(&with_recipe(made.as_bytes())).status.success());
    assert!(pixels(&folder.path().join("y.png")) == pixels(&folder.path().join("a.png")));
    for (bytes, expected) in [
        (png(&[]), "does not say how it was made"),
        (png(&[])[..40].to_vec(), "no whole PNG"),
        (with_recipe(b"{}"), "cannot be read"),
        (with_recipe(b"\xff\xfe"), "no text"),
        (with_recipe("[".repeat(100_000).as_bytes()), "cannot be read"),
        (with_recipe(&vec![b' '; 9 << 20]), "larger than"),
        (png(&[(b"iTXt", b"bulbfold-recipe\0\x01\0\0\0garbage".to_vec())]), "damaged"),
        (changed("/job/request/size/width", json!(0)), "edges"),
        (changed("/job/request/size/width", json!(4_000_000_000_u32)), "edges"),
        (changed("/job/request/samples", json!(1_000_000)), "samples"),
        (changed("/job/request/effort", json!(-1.0)), "range"),
        (changed("/job/request/estimate/fudge", json!(1e300)), "range"),
        (changed("/job/tones", json!([[1.0, 0.0]])), "gradients"),
        (changed("/job/camera/fov", json!(0.0)), "camera"),
        (changed("/job/camera/target", json!([1e300, 0.0, 0.0])), "camera"),
        (changed("/job/formula/text", json!("(nodes: {}")), "cannot be read"),
        (changed("/job/formula/text", json!("\u{1b}[2J")), "cannot be read"),
    ] {
        let output = again(&bytes);
        let said = stderr(&output);
        assert!(output.status.code() == Some(2) && said.contains(expected), "{expected}: {said}");
        assert!(!said.contains('\u{1b}') && !said.contains("panicked"));
        let shown = bulbfold(folder.path(), ["show", "x.png"]);
        assert!(shown.status.code().is_some_and(|code| code == 0 || code == 2));
        assert!(!stdout(&shown).contains('\u{1b}'));
    }
    // A choice of estimates that the formula cannot have is made anew.
    for (pointer, value) in [
        ("/job/plan/choices", json!([])),
        ("/job/plan/choices/0/method", json!("Directional")),
        ("/job/plan/choices/0/fudge", json!(1e9)),
        ("/job/plan/bounding_radius", json!(-1.0)),
        ("/job/plan/least_step", json!(0.0)),
    ] {
        let output = again(&changed(pointer, value));
        assert!(output.status.success(), "{pointer}: {}", stderr(&output));
        assert!(pixels(&folder.path().join("y.png")).len() == 16 * 9 * 3);
    }
    // Any part of a file is read without harm.
    let whole = std::fs::read(folder.path().join("a.png")).unwrap();
    for length in 0..whole.len() {
        let _ = read_made_bytes(&whole[..length]);
    }
    for at in 0..whole.len() {
        let mut damaged = whole.clone();
        damaged[at] ^= 0x55;
        let _ = read_made_bytes(&damaged);
    }
}

#[test]
fn comments_of_all_formats_are_read_without_harm() {
    let folder = folder();
    let names = ["a.exr", "a.jpg", "a.webp", "a.tif", "a.hdr"];
    let outputs: Vec<&str> = names.iter().flat_map(|name| ["-o", name]).collect();
    let quick = ["render", "mandelbrot", "-q", "--backend", "cpu", "--size", "8x6"];
    render(folder.path(), &[&quick[..], &outputs].concat());
    for name in names {
        let whole = std::fs::read(folder.path().join(name)).unwrap();
        assert!(read_made_bytes(&whole).is_ok_and(|made| made.recipe.is_some()), "{name}");
        for at in 0..whole.len().min(4000) {
            let _ = read_made_bytes(&whole[..at]);
            let mut damaged = whole.clone();
            damaged[at] ^= 0xff;
            let _ = read_made_bytes(&damaged);
        }
    }
}

#[cfg(unix)]
#[test]
fn a_stopped_render_goes_on_where_it_was() {
    let folder = folder();
    let path = |name: &str| folder.path().join(name);
    let common =
        ["render", "mandelbox", "-q", "--backend", "cpu", "--calibrate", "off", "--size", "320x640", "--samples", "3"];
    let slow = ["--precision", "f64", "--threads", "1", "--depth", "16", "-o"];
    let all = |output: &'static str| [&common[..], &slow, &[output]].concat();
    render(folder.path(), &all("whole.png"));
    let length = || std::fs::metadata(path("parts.png.part")).map_or(0, |data| data.len());
    let (mut kills, mut kept) = (0, Vec::new());
    for signal in [libc::SIGTERM, libc::SIGKILL, libc::SIGINT, libc::SIGKILL, libc::SIGTERM] {
        let mut child = program(folder.path()).args(all("parts.png")).arg("--resume").spawn().unwrap();
        let before = length();
        // Until a band more is there, or all is done.
        while length() <= before.max(100) && child.try_wait().unwrap().is_none() {
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
        if child.try_wait().unwrap().is_none() {
            // SAFETY: the process is a child that has not been waited for.
            unsafe { libc::kill(child.id() as libc::pid_t, signal) };
            kills += 1;
        }
        let _ = child.wait();
        kept.push(length());
    }
    assert!(kills >= 3 && kept.windows(2).filter(|pair| pair[0] < pair[1]).count() >= 2, "{kills} {kept:?}");
    assert!(!path("parts.png").exists());
    // What was cut off in the middle of a band counts as not there.
    let part = std::fs::read(path("parts.png.part")).unwrap();
    std::fs::write(path("parts.png.part"), &part[..part.len() - 5]).unwrap();
    render(folder.path(), &[&all("parts.png")[..], &["--resume"]].concat());
    assert!(std::fs::read(path("parts.png")).unwrap() == std::fs::read(path("whole.png")).unwrap());
    assert!(!path("parts.png.part").exists());
    // What is of another picture is not taken.
    std::fs::write(path("parts.png.part"), &part).unwrap();
    let small =
        ["render", "mandelbrot", "-q", "--backend", "cpu", "--size", "32x18", "--resume", "--force", "-o", "parts.png"];
    let output = bulbfold(folder.path(), small);
    assert!(output.status.success() && stderr(&output).contains("another picture"), "{}", stderr(&output));
    assert!(!path("parts.png.part").exists());
    let piped = bulbfold(folder.path(), ["render", "mandelbrot", "--size", "8x6", "--resume", "-o", "-"]);
    assert!(stderr(&piped).contains("pipe"), "{}", stderr(&piped));
}

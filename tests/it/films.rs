//! Films from the command line: frames are the pictures of their times, whatever makes them.

use std::path::Path;

use crate::support::{bulbfold, folder_with, pixels, program, stderr, success};

/// A scene whose scale, light, camera and colour move, each in its own way. Its palette is not spread over what a view shows, which a film does once.
const MOVING: &str = r##"(
    params: { "scale": (default: 3.0, min: 2.0, max: 4.0) },
    nodes: { "fold": box_fold(), "ball": sphere_fold(min_radius: 0.5), "grow": scale(scale: "scale"), "box": Sequence(["fold", "ball", "grow"]) },
    output: "box",
    max_iterations: 5,
    camera: (position: (0.0, -9.0, 3.0), target: (0.0, 0.0, 0.0), fov: 50.0),
    light: { "key": Sun(direction: (-0.5, -0.8, 0.6), strength: 2.0) },
    look: (palette: [(0.85, 0.6, 0.4), (0.3, 0.45, 0.7)]),
    animation: (
        seconds: 2.0,
        fps: 4,
        tracks: {
            "scale": [(0, 2.5), (1, 3.0, linear), (Frame(6), 2.5, step)],
            "light.key.strength": "2.5 + sin(t * PI)",
            "film.exposure": Wave(from: 0.25, to: 1.25, seconds: 2.0),
        },
    ),
)"##;

/// Arguments of small pictures whose estimate goes by rules.
const SMALL: [&str; 9] = ["--size", "32x24", "--samples", "1", "--calibrate", "off", "--backend", "cpu", "--quiet"];

fn animate(folder: &Path, file: &str, more: &[&str]) -> serde_json::Value {
    let output = bulbfold(folder, [&["animate", file, "--json"], &SMALL[..], more].concat());
    serde_json::from_str(&success(&output)).expect("JSON on stdout")
}

#[test]
fn frames_are_the_pictures_of_their_times() {
    let folder = folder_with(&[("moving.ron", MOVING)]);
    let report = animate(folder.path(), "moving.ron", &["-o", "f%d.png"]);
    assert_eq!((&report["frames"], &report["structures"]), (&8.into(), &serde_json::json!({})), "{report}");
    // Frame 3 is at half a second, frame 7 at one and a half.
    for (frame, set) in [
        (3, ["scale=2.75", "light.key.strength=3.5", "film.exposure=0.75"]),
        (7, ["scale=2.5", "light.key.strength=1.5", "film.exposure=0.75"]),
    ] {
        let set: Vec<&str> = set.iter().flat_map(|set| ["--set", set]).collect();
        success(&bulbfold(folder.path(), [&["render", "moving.ron", "-o", "own.png"], &SMALL[..], &set].concat()));
        let [own, film] =
            ["own.png".to_string(), format!("f{frame}.png")].map(|name| pixels(&folder.path().join(name)));
        let different = own.iter().zip(&film).filter(|(a, b)| a.abs_diff(**b) > 1).count();
        assert_eq!(different, 0, "frame {frame}");
    }
}

/// A film whose numbers alone move has the kernels of one picture.
#[test]
fn numbers_that_move_compile_nothing() {
    let folder = folder_with(&[("moving.ron", MOVING)]);
    let one = animate(folder.path(), "moving.ron", &["--frames", "2", "-o", "one%d.png"]);
    let all = animate(folder.path(), "moving.ron", &["-o", "all%d.png"]);
    assert_eq!(one["kernels_compiled"], all["kernels_compiled"], "{one} {all}");
}

#[test]
fn whole_frames_are_kept_and_broken_ones_made_again() {
    let folder = folder_with(&[("moving.ron", MOVING)]);
    animate(folder.path(), "moving.ron", &["-o", "f%d.png"]);
    let frame = |n: u32| folder.path().join(format!("f{n}.png"));
    let before: Vec<Vec<u8>> = (1..=8).map(|n| std::fs::read(frame(n)).expect("it is there")).collect();
    std::fs::write(frame(2), &before[1][..before[1].len() - 20]).expect("it can be cut");
    std::fs::remove_file(frame(5)).expect("it can be removed");
    std::fs::copy(frame(3), frame(7)).expect("it can be replaced");
    let report = animate(folder.path(), "moving.ron", &["-o", "f%d.png"]);
    assert_eq!((&report["frames"], &report["skipped"]), (&3.into(), &5.into()));
    let after: Vec<Vec<u8>> = (1..=8).map(|n| std::fs::read(frame(n)).expect("it is there")).collect();
    assert!(before == after, "frames made again are the same to the byte");
    let manifest = std::fs::read(folder.path().join("fmanifest.json")).expect("there is a manifest");
    let manifest: serde_json::Value = serde_json::from_slice(&manifest).expect("it is JSON");
    assert_eq!(manifest["frames"].as_array().map(Vec::len), Some(8));
    assert!(manifest["frames"][0]["seconds"].as_f64().is_some(), "times of kept frames stay: {manifest}");
}

/// The middle of a bar that moves by its own width is half as bright as the bar.
#[test]
fn motion_blur_is_the_average_of_its_moments() {
    let folder = folder_with(&[("moving.ron", MOVING)]);
    let still = ["--set", "animation=(seconds: 1, fps: 2, tracks: {\"film.exposure\": [(0, 0.0)]})"];
    animate(folder.path(), "moving.ron", &[&still[..], &["-o", "sharp%d.png", "--frames", "1"]].concat());
    let blur = ["--shutter", "180", "--shutter-samples", "3", "-o", "blur%d.png", "--frames", "1"];
    animate(folder.path(), "moving.ron", &[&still[..], &blur].concat());
    let [sharp, blurred] = ["sharp1.png", "blur1.png"].map(|name| pixels(&folder.path().join(name)));
    assert!(sharp.iter().zip(&blurred).all(|(a, b)| a.abs_diff(*b) <= 1), "what stands still is sharp");
    // Light doubles within the frame: the average of 1 and 2 is 1.5, not what is halfway in bytes.
    let flash =
        ["--set", "animation=(seconds: 1, fps: 2, tracks: {\"light.key.strength\": [(0, 1.0), (0.0001, 3.0, step)]})"];
    animate(
        folder.path(),
        "moving.ron",
        &[&flash[..], &["--shutter", "360", "--shutter-samples", "2", "-o", "flash%d.png", "--frames", "1"]].concat(),
    );
    let mean = ["--set", "light.key.strength=2", "-o", "mean.png"];
    success(&bulbfold(folder.path(), [&["render", "moving.ron"], &SMALL[..], &mean].concat()));
    let [flash, mean] = ["flash1.png", "mean.png"].map(|name| pixels(&folder.path().join(name)));
    let off = flash.iter().zip(&mean).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(off.is_some_and(|off| off <= 1), "{off:?}");
}

#[test]
fn films_in_one_file_have_all_frames() {
    let folder = folder_with(&[("moving.ron", MOVING)]);
    for name in ["film.gif", "film.apng", "film.webp"] {
        animate(folder.path(), "moving.ron", &["-o", name]);
        assert!(!folder.path().join(format!("{name}.frames")).exists(), "{name}: frames are removed");
    }
    let gif = std::fs::File::open(folder.path().join("film.gif")).expect("it is there");
    let mut frames = gif::DecodeOptions::new().read_info(gif).expect("it is a GIF");
    let mut time = 0;
    while let Some(frame) = frames.read_next_frame().expect("it is whole") {
        time += frame.delay;
    }
    assert_eq!(time, 200, "two seconds");
}

/// A stand-in for ffmpeg that keeps what it is given: arguments beside the film, and the pictures in the film.
#[cfg(unix)]
#[test]
fn ffmpeg_gets_every_frame_and_the_sound() {
    use std::os::unix::fs::PermissionsExt;
    let script = "#!/bin/sh\n[ \"$1\" = -version ] && exit 0\nfor last; do :; done\necho \"$@\" > arguments.txt\ncat > \"$last\"\n";
    let folder = folder_with(&[("moving.ron", MOVING), ("ffmpeg", script), ("song.wav", "")]);
    let tool = folder.path().join("ffmpeg");
    std::fs::set_permissions(&tool, std::fs::Permissions::from_mode(0o755)).expect("modes can be set");
    let path = format!("{}:{}", folder.path().display(), std::env::var("PATH").unwrap_or_default());
    let mut command = program(folder.path());
    command.env("PATH", path).args([
        "animate",
        "moving.ron",
        "-o",
        "film.mp4",
        "--audio",
        "song.wav",
        "--fps",
        "29.97",
    ]);
    let output = command.args(SMALL).output().expect("the program starts");
    assert!(output.status.success(), "{}", stderr(&output));
    let film = std::fs::read(folder.path().join("film.mp4")).expect("there is a film");
    let pictures = film.windows(8).filter(|bytes| *bytes == b"\x89PNG\r\n\x1a\n").count();
    assert_eq!(pictures, 60);
    let arguments = std::fs::read_to_string(folder.path().join("arguments.txt")).expect("it was called");
    assert!(arguments.contains("-framerate 30000/1001") && arguments.contains("-i song.wav"), "{arguments}");
    assert!(!folder.path().join("film.mp4.frames").exists());
    // Some frames have the sound of their time.
    let path = format!("{}:{}", folder.path().display(), std::env::var("PATH").unwrap_or_default());
    let mut command = program(folder.path());
    command.env("PATH", path).args([
        "animate",
        "moving.ron",
        "-o",
        "film.mp4",
        "--audio",
        "song.wav",
        "--frames",
        "5..8",
    ]);
    let output = command.args(SMALL).output().expect("the program starts");
    assert!(output.status.success(), "{}", stderr(&output));
    let arguments = std::fs::read_to_string(folder.path().join("arguments.txt")).expect("it was called");
    assert!(arguments.contains("-ss 1 -i song.wav") && arguments.contains("-t 1 "), "{arguments}");
}

/// A film that is killed again and again has in the end the frames of one that was left alone; what has a frame's name is whole at any time.
#[cfg(unix)]
#[test]
fn a_film_that_is_killed_goes_on() {
    let folder = folder_with(&[("moving.ron", MOVING)]);
    let arguments = [&["animate", "moving.ron", "--fps", "12"], &SMALL[..]].concat();
    success(&bulbfold(folder.path(), [&arguments[..], &["-o", "alone_%d.png"]].concat()));
    let (mut random, mut kills) = (0x2545_f491_4f6c_dd1du64, 0);
    for _ in 0..20 {
        let mut child = program(folder.path())
            .args(&arguments)
            .args(["-o", "killed_%d.png"])
            .stdout(std::process::Stdio::null())
            .stderr(std::process::Stdio::null())
            .spawn()
            .expect("the program starts");
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        std::thread::sleep(std::time::Duration::from_millis(5 + (random >> 33) % 120));
        kills += usize::from(child.try_wait().is_ok_and(|status| status.is_none()));
        child.kill().and_then(|()| child.wait()).expect("it can be killed");
        for frame in 1..=24 {
            let path = folder.path().join(format!("killed_{frame}.png"));
            assert!(!path.exists() || pixels(&path).len() == 32 * 24 * 3, "frame {frame} is whole");
        }
    }
    assert!(kills > 0, "no film was killed while it was made");
    success(&bulbfold(folder.path(), [&arguments[..], &["-o", "killed_%d.png"]].concat()));
    for frame in 1..=24 {
        let [alone, killed] = ["alone", "killed"]
            .map(|name| std::fs::read(folder.path().join(format!("{name}_{frame}.png"))).expect("it is there"));
        assert!(alone == killed, "frame {frame} is the same to the byte");
    }
    let litter = std::fs::read_dir(folder.path()).expect("it can be read").flatten();
    let litter: Vec<_> =
        litter.map(|entry| entry.file_name()).filter(|name| name.to_string_lossy().ends_with(".tmp")).collect();
    assert!(litter.is_empty(), "{litter:?}");
}

/// From the view of one preset to that of another: the ends are the presets' pictures.
#[test]
fn cameras_go_from_preset_to_preset() {
    let scene = MOVING.replace("animation: (", "animation: (camera: [(0, \"far\"), (1.75, \"near\")],").replace(
        "light: {",
        "presets: { \"far\": (camera: (position: (0.0, -12.0, 4.0), target: (0.0, 0.0, 0.0), fov: 40.0)), \
         \"near\": (camera: (position: (7.0, -6.0, 5.0), target: (0.0, 0.0, 0.0), fov: 50.0)) }, light: {",
    );
    let scene = scene.replace("\"scale\": [(0, 2.5), (1, 3.0, linear), (Frame(6), 2.5, step)],", "");
    let folder = folder_with(&[("moving.ron", &scene)]);
    animate(folder.path(), "moving.ron", &["-o", "f%d.png"]);
    let output =
        bulbfold(folder.path(), ["path", "moving.ron", "-o", "camera.json", "-o", "camera.gltf", "-o", "camera.usda"]);
    assert!(success(&output).contains("0 frames in the set"));
    let camera = std::fs::read_to_string(folder.path().join("camera.json")).expect("it is there");
    let camera: serde_json::Value = serde_json::from_str(&camera).expect("it is JSON");
    assert_eq!(camera["frames"].as_array().map(Vec::len), Some(8));
    assert_eq!(camera["frames"][0]["position"], serde_json::json!([0.0, -12.0, 4.0]));
    assert_eq!(camera["frames"][7]["position"], serde_json::json!([7.0, -6.0, 5.0]));
    assert!((camera["frames"][7]["fov"].as_f64().expect("an angle") - 50.0).abs() < 1e-9);
    let light = ["--set", "light.key.strength=2.5", "--set", "film.exposure=0.25"];
    let own = ["render", "moving.ron", "--preset", "far", "-o", "far.png"];
    success(&bulbfold(folder.path(), [&own[..], &SMALL, &light].concat()));
    let [film, own] = ["f1.png", "far.png"].map(|name| pixels(&folder.path().join(name)));
    assert!(film.iter().zip(&own).all(|(a, b)| a.abs_diff(*b) <= 1));
}

#[test]
fn scripts_and_tables_move_what_they_name() {
    let script =
        "fn values(t) { #{ \"film.exposure\": t } }\nfn camera(t, u) { #{ position: [9.0 * cos(u), -9.0, 3.0] } }\n";
    let table = "t;scale\n0;2.5\n2;3.5\n";
    let animation = "animation: (seconds: 2, fps: 2, script: \"move.rhai\", tracks: { \"scale\": Column(file: \"table.csv\", name: \"scale\") }),\n)";
    let scene = format!("{}{animation}", &MOVING[..MOVING.find("    animation:").expect("it moves")]);
    let folder = folder_with(&[("moving.ron", &scene), ("move.rhai", script), ("table.csv", table)]);
    animate(folder.path(), "moving.ron", &["-o", "f%d.png"]);
    let set = ["--set", "film.exposure=1", "--set", "scale=3", "--set", "camera.position=(7.898243057013355, -9, 3)"];
    success(&bulbfold(folder.path(), [&["render", "moving.ron", "-o", "own.png"], &SMALL[..], &set].concat()));
    let [film, own] = ["f3.png", "own.png"].map(|name| pixels(&folder.path().join(name)));
    let different = film.iter().zip(&own).filter(|(a, b)| a.abs_diff(**b) > 1).count();
    assert_eq!(different, 0);
}

#[test]
fn what_is_wrong_with_a_film_is_told_with_its_place() {
    let cases: [(&str, &str, &str); 9] = [
        ("\"scale\": [(0, 2.5), (1, 3.0, linear), (Frame(6), 2.5, step)]", "\"scael\": [(0, 2.5), (1, 3.0)]", "scael"),
        ("(1, 3.0, linear)", "(1, 9.0, linear)", "scale"),
        ("(1, 3.0, linear)", "(0, 3.0, linear)", "comes after"),
        ("linear", "linaer", "linear"),
        ("\"2.5 + sin(t * PI)\"", "\"2 + sin(time)\"", "time"),
        ("seconds: 2.0,\n        fps", "fps", "seconds: 10"),
        ("Wave(from: 0.25, to: 1.25, seconds: 2.0)", "Column(file: \"none.csv\", name: \"x\")", "none.csv"),
        ("fps: 4", "fps: 0", "0"),
        ("tracks: {", "camera: [(0, Own), (1, \"nowhere\")], tracks: {", "nowhere"),
    ];
    for (from, to, expected) in cases {
        assert!(MOVING.contains(from), "{from}");
        let folder = folder_with(&[("moving.ron", &MOVING.replace(from, to))]);
        let output = bulbfold(folder.path(), [&["animate", "moving.ron", "-o", "f%d.png"], &SMALL[..]].concat());
        let told = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{to}: {told}");
        assert!(told.contains(expected), "{to}: {told}");
        assert!(!folder.path().join("f1.png").exists(), "{to}: something was rendered");
    }
    let folder = folder_with(&[("moving.ron", MOVING)]);
    for (arguments, expected) in [
        (&["animate", "menger", "-o", "f%d.png"][..], "--way turntable"),
        (&["animate", "moving.ron", "-o", "film.xyz"], "%04d"),
        (&["animate", "moving.ron", "--frames", "5..99", "-o", "f%d.png"], "the film has 8"),
        (&["path", "moving.ron", "-o", "camera.fbx"], ".gltf"),
        (&["fly", "moving.ron", "--set", "scale=9"], "from 2 to 4"),
    ] {
        let output = bulbfold(folder.path(), arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", stderr(&output));
        assert!(stderr(&output).contains(expected), "{arguments:?}: {}", stderr(&output));
    }
}

#[test]
fn flights_stay_outside_of_the_set() {
    let folder = folder_with(&[]);
    for (name, seed) in [("menger", "1"), ("mandelbox", "2")] {
        let file = format!("{name}.ron");
        success(&bulbfold(folder.path(), ["fly", name, "--seed", seed, "--seconds", "6", "-o", &file]));
        let first = std::fs::read(folder.path().join(&file)).expect("it is there");
        success(&bulbfold(folder.path(), ["fly", name, "--seed", seed, "--seconds", "6", "-o", &file]));
        assert!(
            first == std::fs::read(folder.path().join(&file)).expect("it is there"),
            "{name}: one seed, one flight"
        );
        let told = success(&bulbfold(folder.path(), ["path", &file]));
        assert!(told.contains(" 0 frames in the set"), "{name}: {told}");
        let numbers: Vec<f64> = told
            .split(|c: char| !c.is_ascii_digit() && c != '.' && c != 'e' && c != '-')
            .filter_map(|n| n.parse().ok())
            .collect();
        // frames, least and most distance, frames inside, mean, slowest and fastest speed.
        let [mean, slow, fast] = [numbers[4], numbers[5], numbers[6]];
        assert!(slow > mean / 2.0 && fast < mean * 2.0, "{name}: {told}");
    }
}

#[test]
fn flicker_is_found() {
    let folder = folder_with(&[("moving.ron", MOVING)]);
    let check = |animation: &str| {
        let set = format!("animation=(seconds: 1, fps: 8, tracks: {{ {animation} }})");
        bulbfold(folder.path(), ["animate", "moving.ron", "--check", "--calibrate", "off", "--set", &set])
    };
    let smooth = check("\"light.key.strength\": [(0, 2.0), (1, 2.5)]");
    assert!(success(&smooth).contains("0 of 6 frames flicker"));
    let strobe = check("\"light.key.strength\": \"if (t * 8.0).to_int() % 2 == 0 { 1.0 } else { 3.0 }\"");
    assert_eq!(strobe.status.code(), Some(1), "{}", stderr(&strobe));
}

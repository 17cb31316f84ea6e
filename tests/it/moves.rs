//! The camera on the command line: moves, two eyes, contradictions, and views that are found.

#[cfg(feature = "chart")]
use bulbfold::check::Formula;
use bulbfold::engine::{CameraChange, Engine, Request, Zoom};
use bulbfold::shade::Size;
use glam::DVec3;

use crate::cameras::BALL;
#[cfg(feature = "chart")]
use crate::support::stdout;
use crate::support::{bulbfold, folder_with, pixels, stderr, success};

const SIZE: Size = Size { width: 80, height: 60 };

fn is_near(a: DVec3, b: [f64; 3]) {
    assert!((a - DVec3::from(b)).length() < 1e-6, "{a} is not {b:?}");
}

/// A zoom makes what is there as many times as large, and the arguments that it prints make the same picture.
#[test]
fn zooms_land_on_the_surface_and_their_arguments_come_back() {
    let engine = Engine::new();
    let formula = engine.read("ball.ron", BALL, &[]).expect("it is read");
    let request = |zoom: Zoom| Request {
        size: SIZE,
        camera: CameraChange { zoom: Some(zoom), ..CameraChange::default() },
        calibrate: false,
        ..Request::default()
    };
    for factor in [3.0, 1e4] {
        let job = engine.settle(&formula, &request(Zoom { factor, at: [0.5, 0.5] }), &mut ()).expect("it settles");
        let camera = job.camera.expect("it has a camera");
        // The ball's nearest point is 4 away.
        is_near(DVec3::from(camera.target), [0.0, -1.0, 0.0]);
        assert!((camera.distance() * factor / 4.0 - 1.0).abs() < 1e-4, "{camera:?}");
    }
    let job = engine.settle(&formula, &request(Zoom { factor: 2.0, at: [0.4, 0.6] }), &mut ()).expect("it settles");
    let camera = job.camera.expect("it has a camera");
    assert!((DVec3::from(camera.target).length() - 1.0).abs() < 0.02, "{camera:?}");
    let missed = engine.settle(&formula, &request(Zoom { factor: 2.0, at: [0.01, 0.01] }), &mut ());
    assert!(missed.is_err_and(|error| error.to_string().contains("no surface")));

    let folder = folder_with(&[("ball.ron", BALL)]);
    let small = ["--size", "64x48", "--backend", "cpu"];
    for moves in [
        &["--zoom", "5", "--at", "0.4,0.6"][..],
        &["--yaw", "3", "--pitch", "-2.5", "--roll", "20", "--dolly", "0.8"],
        &["--ortho", "3", "--orbit", "30,20"],
        &["--lens", "fisheye", "--stereo", "side-by-side", "--orbit=-15", "--eyes", "0.3"],
    ] {
        let moved = bulbfold(
            folder.path(),
            [&["render", "ball.ron", "--force", "-o", "moved.png"], &small[..], moves].concat(),
        );
        success(&moved);
        let told = stderr(&moved);
        let lines: Vec<&str> = told.lines().filter(|line| line.starts_with("--")).collect();
        assert_eq!(lines.len(), 2, "{told}");
        let arguments: Vec<&str> = lines.iter().flat_map(|line| line.split(' ')).collect();
        success(&bulbfold(
            folder.path(),
            [&["render", "ball.ron", "--force", "-o", "again.png"], &small[..], &arguments].concat(),
        ));
        let [a, b] = ["moved.png", "again.png"].map(|name| pixels(&folder.path().join(name)));
        assert!(a == b, "{moves:?} and {arguments:?} give other pictures");
    }
}

#[test]
fn an_anaglyph_is_red_of_the_left_and_the_rest_of_the_right() {
    let folder = folder_with(&[("ball.ron", BALL)]);
    let [anaglyph, left, right] = ["anaglyph", "left", "right"].map(|layout| {
        let line = [
            "render",
            "--force",
            "ball.ron",
            "--size",
            "64x48",
            "--backend",
            "cpu",
            "--eyes",
            "0.4",
            "--stereo",
            layout,
            "-o",
            "eye.png",
        ];
        success(&bulbfold(folder.path(), line));
        pixels(&folder.path().join("eye.png"))
    });
    assert!(left != right);
    for ((both, left), right) in anaglyph.chunks(3).zip(left.chunks(3)).zip(right.chunks(3)) {
        assert_eq!(both, [left[0], right[1], right[2]]);
    }
}

#[test]
fn contradictions_of_cameras_are_told() {
    let folder = folder_with(&[("ball.ron", BALL)]);
    for (arguments, what) in [
        (&["--fov", "200"][..], "175"),
        (&["--lens", "cube-strip", "--fov", "90"], "cube map"),
        (&["--lens", "orthographic", "--fov", "90"], "--ortho"),
        (&["--eyes", "0.1"], "--stereo"),
        (&["--at", "0.5,0.5"], "--zoom"),
        (&["--zoom", "2", "--at", "0.01,0.01"], "no surface"),
        (&["--zoom", "0"], "0.001"),
        (&["--ortho", "2", "--lens", "fisheye"], "cannot be used"),
    ] {
        let output = bulbfold(
            folder.path(),
            [&["render", "ball.ron", "--size", "32x24", "--force", "-o", "x.png"], arguments].concat(),
        );
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", stderr(&output));
        assert!(stderr(&output).contains(what), "{arguments:?}: {}", stderr(&output));
    }
}

/// Views that are found are free, show enough, are unlike each other, and the same on every run.
#[cfg(feature = "chart")]
#[test]
fn views_are_found_and_shown() {
    let folder = folder_with(&[]);
    for more in [&[][..], &["--interior"]] {
        let line =
            [&["look", "menger", "--count", "4", "--size", "64x48", "--backend", "cpu", "--calibrate", "off"], more]
                .concat();
        let output = bulbfold(folder.path(), &line);
        let listing = success(&output);
        let sheet = std::fs::read(folder.path().join("menger_look.png")).expect("there is a sheet");
        let again = bulbfold(folder.path(), &line);
        assert_eq!(stdout(&again), listing, "another run finds the same");
        assert_eq!(std::fs::read(folder.path().join("menger_look.png")).expect("there is a sheet"), sheet);
        let views: Vec<&str> = listing.lines().collect();
        assert_eq!(views.len(), 4, "{listing}");
        let subject = Formula::builtin("menger").expect("it is built in");
        for view in &views {
            let numbers = |name: &str| -> [f64; 3] {
                let text =
                    view.split(name).nth(1).and_then(|rest| rest.split(' ').next()).expect("it has this argument");
                let numbers: Vec<f64> = text.split(',').map(|x| x.parse().expect("a number")).collect();
                numbers.try_into().expect("three numbers")
            };
            let [position, target] = [numbers("--camera="), numbers("--target=")].map(DVec3::from);
            let depth = subject.ray(position.to_array(), (target - position).normalize().to_array());
            assert!(depth.is_none_or(|depth| depth > 1e-3), "{view} stands in the set");
            let is_within = position.abs().max_element() < 1.01;
            assert!(is_within || more.is_empty(), "{view} is inside");
        }
        assert!(views.windows(2).all(|pair| pair[0][pair[0].find("--camera").expect("it is there")..]
            != pair[1][pair[1].find("--camera").expect("it is there")..]));
    }
}

//! Jobs for many machines: parts in any order, by any engine, join to the bytes of one machine.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::support::{bulbfold, folder, folder_with, program, stderr, success};

/// Makes tests fail whose programs are not installed.
const REQUIRED: &str = "BULBFOLD_REQUIRE_FARM";

/// Arguments of small pictures whose estimate goes by rules.
const SMALL: [&str; 7] = ["--size", "40x30", "--calibrate", "off", "--backend", "cpu", "--quiet"];

/// A scene of which a number, the camera and the light move.
const MOVING: &str = r##"(
    params: { "scale": (default: 3.0, min: 2.0, max: 4.0) },
    nodes: { "fold": box_fold(), "ball": sphere_fold(min_radius: 0.5), "grow": scale(scale: "scale"), "box": Sequence(["fold", "ball", "grow"]) },
    output: "box",
    max_iterations: 5,
    camera: (position: (0.0, -9.0, 3.0), target: (0.0, 0.0, 0.0), fov: 50.0),
    light: { "key": Sun(direction: (-0.5, -0.8, 0.6), strength: 2.0) },
    animation: (
        seconds: 2.0,
        fps: 4,
        tracks: { "scale": [(0, 2.5), (1, 3.0, linear), (Frame(6), 2.5, step)], "light.key.strength": "2.5 + sin(t * PI)" },
        camera: Turntable(turns: 0.1),
    ),
)"##;

fn run(folder: &Path, arguments: &[&str]) -> String {
    let output = bulbfold(folder, arguments);
    success(&output);
    stderr(&output)
}

/// The output of a command that must fail with this exit code.
fn refused(folder: &Path, arguments: &[&str], code: i32) -> String {
    let output = bulbfold(folder, arguments);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}\n{}", stderr(&output));
    stderr(&output)
}

/// Writes the job of a small picture or film into `job`.
fn job(folder: &Path, scene: &str, more: &[&str]) {
    run(folder, &[&["job", scene, "-o", "job"], &SMALL[..], more].concat());
}

/// Renders parts of `job`, of so many, in this order.
fn parts(folder: &Path, numbers: impl IntoIterator<Item = u32>, count: u32) {
    for number in numbers {
        run(folder, &["render", "job", "-q", "--part", &format!("{number}/{count}")]);
    }
}

/// Whether two files are the same to the byte.
fn are_same(folder: &Path, names: [&str; 2]) -> bool {
    let [one, other] =
        names.map(|name| std::fs::read(folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}")));
    one == other
}

#[test]
fn parts_in_any_order_join_to_the_picture() {
    let folder = folder();
    let files = |option: &'static str| [option, "a.png", option, "a.exr", option, "a16.tif", "--depth", "16"];
    run(folder.path(), &[&["render", "mandelbox"], &SMALL[..], &files("-o")].concat());
    job(folder.path(), "mandelbox", &[&files("--picture")[..], &["--tiles", "3"]].concat());
    parts(folder.path(), [3, 1, 2], 3);
    run(folder.path(), &["join", "job", "-q"]);
    for name in ["a.png", "a.exr", "a16.tif"] {
        assert!(are_same(folder.path(), [name, &format!("job/{name}")]), "{name}");
    }
    // The same picture under another name, and in another format.
    run(folder.path(), &["join", "job", "-q", "-o", "b.png", "-o", "b.hdr"]);
    assert!(are_same(folder.path(), ["b.png", "a.png"]));
    // A job that is there is the same job; another one is not put over it.
    job(folder.path(), "mandelbox", &[&files("--picture")[..], &["--tiles", "3"]].concat());
    let other = [&["job", "mandelbox", "-o", "job"], &SMALL[..]].concat();
    assert!(refused(folder.path(), &other, 2).contains("another job"));
}

#[test]
fn samples_of_paths_join_to_the_picture() {
    let folder = folder();
    let paths = ["--paths", "7", "--bounces", "3"];
    run(folder.path(), &[&["render", "mandelbulb", "-o", "a.png", "-o", "a.exr"], &SMALL[..], &paths].concat());
    let cut = ["--picture", "a.png", "--picture", "a.exr", "--tiles", "2", "--samples-split", "3"];
    job(folder.path(), "mandelbulb", &[&paths[..], &cut].concat());
    parts(folder.path(), [6, 2, 4, 1, 5, 3], 6);
    run(folder.path(), &["join", "job", "-q"]);
    assert!(are_same(folder.path(), ["a.png", "job/a.png"]) && are_same(folder.path(), ["a.exr", "job/a.exr"]));
    for (more, why) in [
        (&["--samples-split", "2"][..], "not one of paths"),
        (&["--paths", "8", "--noise", "5%", "--samples-split", "2"], "noise"),
        (&["--paths", "8", "--noise", "5%", "--tiles", "2"], "noise"),
        (&["--paths", "8", "--samples-split", "9"], "fewer"),
        (&["--tiles", "31"], "30 rows"),
    ] {
        let said = refused(folder.path(), &[&["job", "mandelbulb", "-o", "none"], &SMALL[..], more].concat(), 2);
        assert!(said.contains(why) && !folder.path().join("none").exists(), "{said}");
    }
}

#[test]
fn frames_join_to_the_film() {
    let folder = folder_with(&[("moving.ron", MOVING)]);
    let film = ["--frames", "2..5", "--shutter", "180", "--shutter-samples", "2"];
    for (name, more, frames) in [
        ("f%d.exr", &["--frames", "2..6", "--every", "2"][..], &[2, 4, 6][..]),
        ("b%d.png", &film[..], &[2, 3, 4, 5]),
        ("film.gif", &["--frames", "1..3"], &[]),
    ] {
        run(folder.path(), &[&["animate", "moving.ron", "-o", name], &SMALL[..], more].concat());
        let _ = std::fs::remove_dir_all(folder.path().join("job"));
        job(folder.path(), "moving.ron", &[more, &["--picture", name, "--tiles", "2"]].concat());
        let count = 2 * frames.len().max(3) as u32;
        parts(folder.path(), (1..=count).rev(), count);
        run(folder.path(), &["join", "job", "-q"]);
        let names = frames.iter().map(|n| name.replace("%d", &n.to_string()));
        let names: Vec<String> = if frames.is_empty() { vec![name.to_string()] } else { names.collect() };
        for name in names {
            assert!(are_same(folder.path(), [&name, &format!("job/{name}")]), "{name}");
        }
    }
    let split =
        [&["job", "moving.ron", "-o", "none", "--paths", "8", "--samples-split", "2"], &SMALL[..], &film].concat();
    assert!(refused(folder.path(), &split, 2).contains("motion blur"));
}

#[test]
fn what_cannot_be_joined_is_named() {
    let folder = folder();
    let join = ["join", "job", "-q"];
    job(folder.path(), "mandelbox", &["--tiles", "4"]);
    let file = |name: &str| folder.path().join("job").join(name);
    let said = refused(folder.path(), &join, 1);
    assert!(said.contains("4 of 4 parts") && said.contains("1/4 (rows 1 to 8) is missing"), "{said}");
    parts(folder.path(), 1..=4, 4);
    let kept: Vec<Vec<u8>> = (1..=4).map(|n| std::fs::read(file(&format!("parts/{n}.part"))).unwrap()).collect();
    // A part that is there is kept.
    let said = run(folder.path(), &["render", "job", "--part", "2/4"]);
    assert!(said.contains("is there"), "{said}");
    // One that is cut off, one with another byte, one of another place, one of another job.
    std::fs::write(file("parts/1.part"), &kept[0][..kept[0].len() - 3]).unwrap();
    let mut changed = kept[1].clone();
    let middle = changed.len() / 2;
    changed[middle] ^= 1;
    std::fs::write(file("parts/2.part"), changed).unwrap();
    std::fs::write(file("parts/3.part"), &kept[3]).unwrap();
    run(folder.path(), &[&["job", "mandelbox", "-o", "other", "--tiles", "4", "--samples", "1"], &SMALL[..]].concat());
    run(folder.path(), &["render", "other", "-q", "--part", "4/4"]);
    std::fs::copy(folder.path().join("other/parts/4.part"), file("parts/4.part")).unwrap();
    let said = refused(folder.path(), &join, 1);
    for why in ["1/4", "cut off or damaged", "2/4", "is part 4/4, under another name", "4/4", "is of another job"] {
        assert!(said.contains(why), "{why}: {said}");
    }
    assert!(!file("mandelbox.png").exists());
    // Each is rendered again, and says why.
    for number in 1..=4 {
        let said = run(folder.path(), &["render", "job", "--part", &format!("{number}/4")]);
        assert!(said.contains("is rendered again"), "{said}");
        assert!(std::fs::read(file(&format!("parts/{number}.part"))).unwrap() == kept[number - 1]);
    }
    run(folder.path(), &join);
    // A part of another version of the program, and a job of one.
    let head = kept[0].iter().position(|byte| *byte == b'\n').unwrap();
    let line = String::from_utf8(kept[0][..head].to_vec()).unwrap();
    let old = line.replace(env!("CARGO_PKG_VERSION"), "0.0.9");
    std::fs::write(file("parts/1.part"), [old.as_bytes(), &kept[0][head..]].concat()).unwrap();
    assert!(refused(folder.path(), &join, 1).contains("was made by bulbfold 0.0.9"));
    let manifest = std::fs::read_to_string(file("manifest.json")).unwrap();
    let rewritten = |from: &str, to: &str| std::fs::write(file("manifest.json"), manifest.replace(from, to)).unwrap();
    rewritten("\"tiles\": 4", "\"tiles\": 2");
    assert!(refused(folder.path(), &join, 2).contains("was changed"));
    rewritten(env!("CARGO_PKG_VERSION"), "0.0.9");
    assert!(refused(folder.path(), &join, 2).contains("was made by bulbfold 0.0.9"));
    rewritten("", "");
    std::fs::write(file("frames/00001.json"), "{}").unwrap();
    assert!(refused(folder.path(), &["render", "job", "--part", "1/4"], 2).contains("is damaged"));
}

#[test]
fn parts_are_asked_for_as_the_job_has_them() {
    let folder = folder_with(&[("moving.ron", MOVING)]);
    job(folder.path(), "moving.ron", &["--frames", "3..4", "--tiles", "2"]);
    for (part, why) in [
        ("1/5", "has 4 parts"),
        ("5/4", "counted from 1"),
        ("5,1,1", "no part"),
        ("3,3,1", "no part"),
        ("3,1,2", "no part"),
    ] {
        let said = refused(folder.path(), &["render", "job", "--part", part], 2);
        assert!(said.contains(why), "{part}: {said}");
    }
    let said = refused(folder.path(), &["render", "job", "--part", "1/4", "--samples", "3"], 2);
    assert!(said.contains("`--samples` is settled"), "{said}");
    assert!(refused(folder.path(), &["render", "nothing", "--part", "1/4"], 2).contains("no folder"));
    assert!(refused(folder.path(), &["join", "."], 2).contains("is no job"));
    // Progress as engines read it.
    let said = run(folder.path(), &["render", "job", "--part", "4,2,1", "--openjd"]);
    for line in ["openjd_status: frame 4, rows 17 to 30", "openjd_progress: 100"] {
        assert!(said.lines().any(|other| other == line), "{said}");
    }
    assert!(folder.path().join("job/parts/4.part").exists());
    let said = refused(folder.path(), &["join", "job", "--openjd"], 1);
    assert!(said.lines().any(|line| line.starts_with("openjd_fail: 3 of 4 parts")), "{said}");
}

#[test]
fn back_ends_are_mixed_only_where_that_is_asked_for() {
    let folder = folder();
    run(
        folder.path(),
        &["job", "mandelbox", "-q", "--size", "40x30", "--calibrate", "off", "--tiles", "2", "-o", "job"],
    );
    run(folder.path(), &["render", "job", "-q", "--part", "1/2", "--backend", "cpu"]);
    let on_gpu = bulbfold(folder.path(), ["render", "job", "-q", "--part", "2/2", "--backend", "gpu"]);
    if !on_gpu.status.success() {
        assert!(std::env::var_os("BULBFOLD_REQUIRE_GPU").is_none(), "{}", stderr(&on_gpu));
        eprintln!("skipped: {}", stderr(&on_gpu));
        return;
    }
    let said = refused(folder.path(), &["join", "job"], 2);
    assert!(said.contains("cpu, f32") && said.contains("gpu, f32") && said.contains("--mix-backends"), "{said}");
    run(folder.path(), &["join", "job", "--mix-backends"]);
}

/// Processes that are killed at random moments leave parts that go on, and nothing under a final name that is not whole.
#[cfg(unix)]
#[test]
fn parts_that_are_killed_go_on() {
    let folder = folder();
    let slow =
        ["--size", "320x512", "--samples", "3", "--precision", "f64", "--calibrate", "off", "--backend", "cpu", "-q"];
    run(folder.path(), &[&["render", "mandelbox", "-o", "whole.png"], &slow[..]].concat());
    run(
        folder.path(),
        &[&["job", "mandelbox", "-o", "job", "--picture", "whole.png", "--tiles", "2"], &slow[..]].concat(),
    );
    let size = |name: &str| std::fs::metadata(folder.path().join("job/parts").join(name)).map_or(0, |data| data.len());
    let (mut kills, mut went_on) = (0, 0);
    for (i, signal) in [libc::SIGTERM, libc::SIGKILL, libc::SIGINT, libc::SIGKILL].into_iter().enumerate() {
        let before = size("1.work");
        went_on += usize::from(before > 100);
        let mut child =
            program(folder.path()).args(["render", "job", "-q", "--part", "1/2", "--threads", "1"]).spawn().unwrap();
        // Until a piece more is there, and then at any moment.
        while size("1.work") <= before.max(100) && child.try_wait().unwrap().is_none() {
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
        std::thread::sleep(std::time::Duration::from_millis(7 * i as u64));
        if child.try_wait().unwrap().is_none() {
            // SAFETY: the process is a child that has not been waited for.
            unsafe { libc::kill(child.id() as libc::pid_t, signal) };
            kills += 1;
            let _ = child.wait();
            assert!(!folder.path().join("job/parts/1.part").exists());
        }
    }
    assert!(kills >= 3 && went_on >= 2, "{kills} {went_on}");
    parts(folder.path(), [1, 2], 2);
    assert_eq!(size("1.work"), 0);
    run(folder.path(), &["join", "job", "-q"]);
    assert!(are_same(folder.path(), ["whole.png", "job/whole.png"]));
}

/// Whether programs are there; says so where they are not, and fails where they must be.
fn has(programs: &[&str]) -> bool {
    let is_there = |name: &&&str| {
        let path = std::env::var_os("PATH").unwrap_or_default();
        let more = ["/usr/sbin", "/sbin"].map(PathBuf::from);
        std::env::split_paths(&path).chain(more).any(|folder| folder.join(name).is_file())
    };
    match programs.iter().find(|name| !is_there(name)) {
        None => true,
        Some(missing) => {
            assert!(std::env::var(REQUIRED).as_deref() != Ok("1"), "{missing} is not installed");
            eprintln!("skipped: {missing} is not installed");
            false
        }
    }
}

/// What a program of an engine said, which must succeed.
fn engine(folder: &Path, command: &mut Command) -> String {
    let path = std::env::join_paths(
        std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default()).chain(["/usr/sbin".into()]),
    );
    command.current_dir(folder).env("PATH", path.unwrap()).env("NODEVICE_SELECT", "1").env("BULBFOLD_CACHE", "");
    success(&command.output().expect("it starts"))
}

/// A film of four frames of two parts, and the same of one machine.
fn small_film() -> tempfile::TempDir {
    let folder = folder_with(&[("moving.ron", MOVING)]);
    let frames = ["--frames", "2..5"];
    run(folder.path(), &[&["animate", "moving.ron", "-o", "film.webp"], &SMALL[..], &frames].concat());
    job(folder.path(), "moving.ron", &[&frames[..], &["--picture", "film.webp", "--tiles", "2"]].concat());
    folder
}

#[test]
fn make_runs_a_job() {
    if !has(&["make"]) {
        return;
    }
    let folder = small_film();
    let program = format!("BULBFOLD={}", env!("CARGO_BIN_EXE_bulbfold"));
    engine(folder.path(), Command::new("make").args(["-j2", "-C", "job", &program]));
    assert!(are_same(folder.path(), ["film.webp", "job/film.webp"]));
}

#[test]
fn open_job_description_runs_a_job() {
    if !has(&["openjd"]) {
        return;
    }
    let folder = small_film();
    engine(folder.path(), Command::new("openjd").args(["check", "job/template.yaml"]));
    let summary = engine(folder.path(), Command::new("openjd").args(["summary", "job/template.yaml"]));
    assert!(summary.contains("Total tasks: 9"), "{summary}");
    let program = format!("Bulbfold={}", env!("CARGO_BIN_EXE_bulbfold"));
    let said = engine(folder.path(), Command::new("openjd").args(["run", "job/template.yaml", "-p", &program]));
    assert!(said.contains("openjd_progress: 100") && said.contains("openjd_status: frame 5, rows"), "{said}");
    assert!(are_same(folder.path(), ["film.webp", "job/film.webp"]));
}

/// Two nodes of Slurm, of which one dies in the middle: its task is done again on the other, and no other task is.
#[cfg(target_os = "linux")]
#[test]
fn slurm_runs_a_job_on_nodes_of_which_one_dies() {
    // SAFETY: the call only reads the process's user.
    if unsafe { libc::geteuid() } != 0 {
        assert!(std::env::var(REQUIRED).as_deref() != Ok("1"), "nodes are process namespaces, which only root makes");
        eprintln!("skipped: nodes are process namespaces, which only root makes");
        return;
    }
    if !has(&["slurmctld", "slurmd", "sbatch", "munged", "unshare"]) {
        return;
    }
    let folder = folder();
    let picture =
        ["--size", "480x384", "--samples", "4", "--precision", "f64", "--calibrate", "off", "--backend", "cpu", "-q"];
    run(folder.path(), &[&["render", "mandelbox", "-o", "a.png"], &picture[..]].concat());
    run(
        folder.path(),
        &[&["job", "mandelbox", "-o", "job", "--picture", "a.png", "--tiles", "8"], &picture[..]].concat(),
    );
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/slurm_two_nodes.sh");
    let mut command = Command::new("bash");
    let said = engine(
        folder.path(),
        command.arg(script).args(["job", "kill"]).env("BULBFOLD", env!("CARGO_BIN_EXE_bulbfold")),
    );
    assert!(said.contains("node1 dies") && said.contains("requeued: 1"), "{said}");
    // Every part was finished once; the one that was lost with the node is there from its second try.
    let logs = std::fs::read_dir(folder.path().join("job")).unwrap().map(|entry| entry.unwrap().path());
    let logs = logs.filter(|path| path.extension().is_some_and(|end| end == "log"));
    let logs: String = logs.map(|path| std::fs::read_to_string(path).unwrap()).collect();
    assert_eq!((logs.matches(".part: rows").count(), logs.matches("is there").count()), (8, 0), "{logs}");
    assert!(are_same(folder.path(), ["a.png", "job/a.png"]), "{said}");
}

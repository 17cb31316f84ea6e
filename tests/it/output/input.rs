//! What is read is bounded: nothing that merely lies there blocks or fills the memory, or runs for somebody else.

use std::io::Write;
use std::os::unix::fs::{chown, symlink};
use std::path::Path;

use super::{SMALL, make_pipe, render};

use crate::support::{bulbfold, folder_with, program, stderr};

const FORMULA: &str = "(nodes: { \"a\": bulb_power() })\n";
/// One that uses a step beside it.
const FOLDED: &str =
    "(nodes: { \"a\": other_fold(), \"b\": bulb_power(), \"c\": Sequence([\"a\", \"b\"]) }, output: \"c\")";
const PROBE: [&str; 6] = ["probe", "a.ron", "--point", "0,0,1", "--backend", "cpu"];

/// A fresh folder with a formula.
fn folder() -> tempfile::TempDir {
    folder_with(&[("a.ron", FORMULA)])
}

/// A file of 2 GB that takes no room.
fn sparse(path: &Path) {
    std::fs::File::create(path).unwrap().set_len(2 << 30).unwrap();
}

#[test]
fn special_files_beside_a_formula_are_left_out() {
    for kind in ["pipe", "zero", "large"] {
        let folder = folder();
        let script = folder.path().join("x.rhai");
        match kind {
            "pipe" => make_pipe(&script),
            "zero" => symlink("/dev/zero", &script).unwrap(),
            _ => sparse(&script),
        }
        let output = bulbfold(folder.path(), PROBE);
        assert!(output.status.success(), "{kind}: {}", stderr(&output));
        let why = if kind == "large" { "it is larger than" } else { "it is not a regular file" };
        assert!(stderr(&output).contains("x.rhai is left out"), "{kind}: {}", stderr(&output));
        assert!(stderr(&output).contains(why), "{kind}: {}", stderr(&output));
    }
}

#[test]
fn endless_and_huge_files_are_refused() {
    let folder = folder();
    for name in ["zero.ron", "zero.csv", "zero.fract", "zero.frag", "zero.rhai"] {
        symlink("/dev/zero", folder.path().join(name)).unwrap();
    }
    sparse(&folder.path().join("large.ron"));
    sparse(&folder.path().join("large.csv"));
    for (arguments, text) in [
        (&["render", "zero.ron", "-o", "x.png"][..], "it is larger than"),
        (&["render", "large.ron", "-o", "x.png"], "it is larger than"),
        (&["probe", "a.ron", "--points", "zero.csv"], "it is larger than"),
        (&["probe", "a.ron", "--points", "large.csv"], "it is larger than"),
        (&["truth", "a.ron", "--rays", "zero.csv"], ""),
        (&["import", "zero.fract", "-o", "y.ron"], "it is larger than"),
        (&["import", "zero.frag", "-o", "y.ron"], "it is larger than"),
        (&["explain", "zero.rhai"], ""),
        (&["check", "zero.rhai"], ""),
        (&["probe", "a.ron", "--point", "0,0,1", "--steps", "."], "it is not a regular file"),
    ] {
        let output = bulbfold(folder.path(), arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", stderr(&output));
        assert!(stderr(&output).contains(text), "{arguments:?}: {}", stderr(&output));
    }
}

#[test]
fn a_pipe_may_be_named() {
    let folder = folder();
    let pipe = folder.path().join("pipe.ron");
    make_pipe(&pipe);
    let give = |text: &'static str| {
        let pipe = pipe.clone();
        std::thread::spawn(move || std::fs::File::options().write(true).open(pipe).unwrap().write_all(text.as_bytes()))
    };
    let writer = give(FORMULA);
    let output = bulbfold(folder.path(), ["probe", "pipe.ron", "--point", "0,0,1", "--backend", "cpu"]);
    assert!(output.status.success(), "{}", stderr(&output));
    writer.join().unwrap().unwrap();
    // A sweep reads the formula for each frame, and a pipe gives it once.
    let writer = give(FORMULA);
    let sweep = ["render", "pipe.ron", "--sweep", "fov=40..50", "--frames", "3", "-q"];
    let output = bulbfold(folder.path(), sweep.iter().chain(&SMALL));
    assert!(output.status.success(), "{}", stderr(&output));
    writer.join().unwrap().unwrap();
}

#[test]
fn a_cache_of_special_files_is_no_cache() {
    let folder = folder();
    let cache = folder.path().join("cache");
    std::fs::create_dir(&cache).unwrap();
    let render = || {
        let mut command = program(folder.path());
        command.args(["render", "a.ron", "--size", "32x18", "--samples", "1", "--backend", "cpu", "-q"]);
        command.env("BULBFOLD_CACHE", &cache).output().unwrap()
    };
    assert!(render().status.success());
    let kept: Vec<_> = std::fs::read_dir(&cache).unwrap().flatten().map(|entry| entry.path()).collect();
    assert!(!kept.is_empty());
    for path in kept {
        std::fs::remove_file(&path).unwrap();
        make_pipe(&path);
    }
    let output = render();
    assert!(output.status.success(), "{}", stderr(&output));
}

/// Steps in a folder of another user; root alone can make such a folder, and reads it as warily as others.
#[test]
fn steps_of_other_users_need_trust() {
    let folder = folder();
    assert!(bulbfold(folder.path(), ["new", "other_fold", "--step"]).status.success());
    std::fs::write(folder.path().join("a.ron"), FOLDED).unwrap();
    let with = |arguments: &[&str]| {
        let mut command = program(folder.path());
        command.env_remove("SUDO_UID").args(PROBE).args(arguments).output().unwrap()
    };
    assert!(with(&[]).status.success(), "{}", stderr(&with(&[])));
    let step = folder.path().join("other_fold.rhai");
    for path in [folder.path(), &step] {
        if chown(path, Some(4321), None).is_err() {
            eprintln!("only root can give files away");
            return;
        }
        let output = with(&[]);
        assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
        assert!(stderr(&output).contains("belong to another user"), "{}", stderr(&output));
        assert!(stderr(&output).contains("--trust"), "{}", stderr(&output));
        assert!(with(&["--trust"]).status.success());
        let by_sudo = program(folder.path()).env("SUDO_UID", "4321").args(PROBE).status().unwrap();
        assert!(by_sudo.success(), "the caller of sudo is whom root works for");
        // What is named is wanted.
        let explained = program(folder.path()).env_remove("SUDO_UID").args(["explain", "other_fold.rhai"]).status();
        assert!(explained.unwrap().success());
        chown(path, Some(0), None).unwrap();
    }
    assert!(render(folder.path(), "a.ron", "a.png").status.success());
}

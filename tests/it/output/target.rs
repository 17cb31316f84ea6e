//! What an output's name leads to stays what it is.

use std::ffi::OsString;
use std::os::unix::ffi::OsStringExt;
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt, symlink};
use std::os::unix::net::UnixListener;
use std::path::Path;
use std::process::Command;

use super::{make_pipe, names, png_size, render};

use crate::support::{bulbfold, folder, program, stderr};

#[test]
fn devices_are_written_into() {
    let folder = folder();
    let path = folder.path().join("null.png");
    // Only root may make a device; nobody tries the real one.
    let made = Command::new("mknod").arg(&path).args(["c", "1", "3"]).output();
    if !made.is_ok_and(|made| made.status.success()) {
        eprintln!("no device can be made here");
        return;
    }
    let is_device = || std::fs::symlink_metadata(&path).is_ok_and(|data| data.file_type().is_char_device());
    for arguments in [&["compile", "mandelbulb", "--emit", "graph"][..], &["export", "mandelbulb", "--to", "glsl"]] {
        let output = bulbfold(folder.path(), [arguments, &["-o", "null.png"]].concat());
        assert!(output.status.success() && is_device(), "{}", stderr(&output));
    }
    let output = render(folder.path(), "mandelbulb", "null.png");
    assert!(output.status.success() && is_device(), "{}", stderr(&output));
    assert_eq!(names(folder.path()), ["null.png"]);
}

#[test]
fn named_pipes_and_sockets_stay() {
    let folder = folder();
    let pipe = folder.path().join("pipe.png");
    make_pipe(&pipe);
    let reader = std::thread::spawn({
        let pipe = pipe.clone();
        move || std::fs::read(pipe).unwrap()
    });
    let output = render(folder.path(), "mandelbulb", "pipe.png");
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(png_size(&reader.join().unwrap()), Some((32, 18)));
    assert!(std::fs::symlink_metadata(&pipe).unwrap().file_type().is_fifo());
    let socket = folder.path().join("socket.png");
    let _listener = UnixListener::bind(&socket).unwrap();
    let output = render(folder.path(), "mandelbulb", "socket.png");
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("it is a socket"), "{}", stderr(&output));
    assert!(std::fs::symlink_metadata(&socket).unwrap().file_type().is_socket());
    assert_eq!(names(folder.path()), ["pipe.png", "socket.png"]);
}

#[test]
fn a_pipe_that_nobody_reads_is_refused() {
    let folder = folder();
    make_pipe(&folder.path().join("pipe.png"));
    let output = render(folder.path(), "mandelbulb", "pipe.png");
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("a pipe without a reader"), "{}", stderr(&output));
}

#[test]
fn links_are_followed_and_modes_and_owners_kept() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    std::fs::create_dir(at("far")).unwrap();
    symlink("far/real.png", at("link.png")).unwrap();
    symlink("link.png", at("link of a link.png")).unwrap();
    for _ in 0..2 {
        // The first time nothing is behind the links.
        let output = render(folder.path(), "mandelbulb", "link of a link.png");
        assert!(output.status.success(), "{}", stderr(&output));
        assert!(at("link of a link.png").is_symlink() && at("link.png").is_symlink());
        assert_eq!(png_size(&std::fs::read(at("far/real.png")).unwrap()), Some((32, 18)));
        assert_eq!(names(&at("far")), ["real.png"]);
    }
    let path = at("far/real.png");
    std::fs::write(&path, "old").unwrap();
    std::fs::set_permissions(&path, PermissionsExt::from_mode(0o640)).unwrap();
    // Only root may give files away.
    let owner = std::os::unix::fs::chown(&path, Some(4321), Some(4322)).map(|()| (4321, 4322));
    let owner = owner.unwrap_or_else(|_| std::fs::metadata(&path).map(|data| (data.uid(), data.gid())).unwrap());
    assert!(render(folder.path(), "mandelbulb", "link.png").status.success());
    let data = std::fs::metadata(&path).unwrap();
    assert_eq!((data.mode() & 0o7777, data.uid(), data.gid()), (0o640, owner.0, owner.1));
    assert!(data.len() > 3);
    symlink("round.png", at("round.png")).unwrap();
    let output = render(folder.path(), "mandelbulb", "round.png");
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
}

/// A formula under several names, and commands that would write onto it.
#[test]
fn no_input_is_overwritten() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    assert!(bulbfold(folder.path(), ["new", "a"]).status.success());
    assert!(bulbfold(folder.path(), ["new", "my_fold", "--step"]).status.success());
    let (formula, step) = (std::fs::read(at("a.ron")).unwrap(), std::fs::read(at("my_fold.rhai")).unwrap());
    symlink("a.ron", at("link.png")).unwrap();
    std::fs::hard_link(at("a.ron"), at("hard.png")).unwrap();
    std::fs::create_dir(at("in")).unwrap();
    let compile = ["compile", "a.ron", "--emit", "graph", "-o"];
    let export = ["export", "a.ron", "--to", "glsl", "-o"];
    for output in ["a.ron", "./in/../a.ron", "link.png", "hard.png", "my_fold.rhai"] {
        for command in [compile, export] {
            let run = bulbfold(folder.path(), command.iter().chain([&output]));
            assert_eq!(run.status.code(), Some(2), "{command:?} {output}: {}", stderr(&run));
            assert!(stderr(&run).contains("is an input of this command"), "{}", stderr(&run));
        }
    }
    for output in ["link.png", "hard.png"] {
        assert_eq!(render(folder.path(), "a.ron", output).status.code(), Some(2), "{output}");
    }
    let sweep = ["--sweep", "fov=40..50", "--frames", "2", "-o", "f%d.png"];
    symlink("a.ron", at("f2.png")).unwrap();
    let run = program(folder.path()).args(["render", "a.ron"]).args(super::SMALL).args(sweep).output().unwrap();
    assert_eq!(run.status.code(), Some(2), "{}", stderr(&run));
    // What is there is not overwritten by `new`, under no name.
    let run = bulbfold(folder.path(), ["new", "b", "-o", "link.png"]);
    assert_eq!(run.status.code(), Some(2));
    // A gallery's page must not become of a formula what it is linked to.
    std::fs::create_dir(at("gallery")).unwrap();
    symlink("../a.ron", at("gallery/index.html")).unwrap();
    let gallery =
        ["gallery", "a.ron", "-o", "gallery", "--size", "16x12", "--samples", "1", "--calibrate", "off", "-q"];
    assert_eq!(bulbfold(folder.path(), gallery).status.code(), Some(2));
    assert_eq!(std::fs::read(at("a.ron")).unwrap(), formula);
    assert_eq!(std::fs::read(at("my_fold.rhai")).unwrap(), step);
}

#[test]
fn any_name_that_the_system_takes_will_do() {
    let folder = folder();
    assert!(bulbfold(folder.path(), ["new", "a"]).status.success());
    for length in [246, 251, 255] {
        let name = format!("{}.png", "x".repeat(length - 4));
        let output = render(folder.path(), "a.ron", &name);
        assert!(output.status.success(), "{length} bytes: {}", stderr(&output));
        assert_eq!(png_size(&std::fs::read(folder.path().join(name)).unwrap()), Some((32, 18)));
    }
    let long = format!("{}.png", "x".repeat(252));
    assert_eq!(render(folder.path(), "a.ron", long).status.code(), Some(2), "256 bytes are too many");
    let odd = |ending: &[u8]| OsString::from_vec([&b"caf\xe9"[..], ending].concat());
    let path = folder.path().join(odd(b".ron"));
    if std::fs::copy(folder.path().join("a.ron"), &path).is_err() {
        return; // Some file systems take UTF-8 alone.
    }
    let output = program(folder.path()).arg("render").arg(odd(b".ron")).args(super::SMALL).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(folder.path().join(odd(b".png")).is_file());
    let sweep = ["--sweep", "fov=40..50", "--frames", "2", "-q", "-o"];
    let mut command = program(folder.path());
    command.arg("render").arg(odd(b".ron")).args(super::SMALL).args(sweep).arg(odd(b"_%02d.png"));
    assert!(command.status().unwrap().success());
    assert!(folder.path().join(odd(b"_02.png")).is_file());
    for command in
        [&["check"][..], &["explain"], &["test"], &["probe", "--point", "0,0,1"], &["compile", "--emit", "dot"]]
    {
        let output = program(folder.path()).args(command).arg(odd(b".ron")).output().unwrap();
        assert!(output.status.code().is_some_and(|code| code < 2), "{command:?}: {}", stderr(&output));
    }
}

/// Links under the names that temporary files once had, and files that nobody may write to.
#[test]
fn temporary_files_follow_no_link() {
    let folder = folder();
    std::fs::write(folder.path().join("victim"), "precious").unwrap();
    let script =
        "for n in out.png.$$.tmp .out.png.$$.tmp .bulbfold.$$.tmp; do ln -s victim $n; done; exec \"$0\" \"$@\"";
    let render = ["render", "mandelbulb", "-q", "-o", "out.png"];
    let mut command = Command::new("sh");
    command.current_dir(folder.path()).arg("-c").arg(script).arg(env!("CARGO_BIN_EXE_bulbfold"));
    assert!(command.args(render).args(super::SMALL).status().unwrap().success());
    assert_eq!(std::fs::read(folder.path().join("victim")).unwrap(), b"precious");
    assert!(folder.path().join("out.png").is_file() && !folder.path().join("out.png").is_symlink());
}

#[test]
fn a_protected_file_stays() {
    let folder = folder();
    let path = folder.path().join("a.png");
    std::fs::write(&path, "old").unwrap();
    std::fs::set_permissions(&path, PermissionsExt::from_mode(0o444)).unwrap();
    let is_protected = std::fs::File::options().write(true).open(&path).is_err();
    let output = render(folder.path(), "mandelbulb", "a.png");
    // Nothing is protected from root.
    assert_eq!(output.status.success(), !is_protected, "{}", stderr(&output));
    assert_eq!(std::fs::read(&path).unwrap() == b"old", is_protected);
    assert!(Path::new("/dev/full").exists() || cfg!(not(target_os = "linux")));
    if cfg!(target_os = "linux") {
        symlink("/dev/full", folder.path().join("full.png")).unwrap();
        let output = render(folder.path(), "mandelbulb", "full.png");
        assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    }
}

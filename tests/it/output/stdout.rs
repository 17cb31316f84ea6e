//! `-o -`: results on stdout, talk on stderr.

use std::os::unix::fs::symlink;

use super::{SMALL, names, png_size, render};

use crate::support::{bulbfold, folder, program, stderr, stdout};

#[test]
fn pictures_go_to_stdout() {
    let folder = folder();
    // Not quiet: what is said must not be among the bytes.
    let arguments = [&["render", "mandelbulb", "--stats", "-o", "-"][..], &SMALL].concat();
    let output = bulbfold(folder.path(), arguments);
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(png_size(&output.stdout), Some((32, 18)));
    assert!(stderr(&output).contains("back end"), "{}", stderr(&output));
    assert!(names(folder.path()).is_empty());
    let both = [&["render", "mandelbulb", "--json", "-o", "-"][..], &SMALL].concat();
    assert_eq!(bulbfold(folder.path(), both).status.code(), Some(2));
}

#[cfg(target_os = "linux")]
#[test]
fn a_link_to_stdout_stays() {
    let folder = folder();
    symlink("/proc/self/fd/1", folder.path().join("stdout.png")).unwrap();
    let piped = render(folder.path(), "mandelbulb", "stdout.png");
    assert_eq!(png_size(&piped.stdout), Some((32, 18)), "{}", stderr(&piped));
    // A file behind stdout keeps what was in it before.
    let path = folder.path().join("all");
    std::fs::write(&path, "before").unwrap();
    let file = std::fs::File::options().append(true).open(&path).unwrap();
    let mut command = program(folder.path());
    command.args(["render", "mandelbulb", "-q", "-o", "stdout.png"]).args(SMALL).stdout(file);
    assert!(command.status().unwrap().success());
    let all = std::fs::read(&path).unwrap();
    assert_eq!(all.strip_prefix(b"before").and_then(png_size), Some((32, 18)));
    assert!(folder.path().join("stdout.png").is_symlink());
}

#[test]
fn texts_go_to_stdout() {
    let folder = folder();
    for arguments in [&["compile", "mandelbulb", "--emit", "dot"][..], &["export", "mandelbulb", "--to", "glsl"]] {
        let plain = bulbfold(folder.path(), arguments);
        let named = bulbfold(folder.path(), [arguments, &["-o", "-"]].concat());
        assert!(named.status.success() && named.stdout == plain.stdout && !plain.stdout.is_empty());
    }
    let words = bulbfold(folder.path(), ["export", "mandelbulb", "--to", "spirv", "-o", "-"]);
    assert!(words.stdout.starts_with(&0x0723_0203_u32.to_le_bytes()), "SPIR-V begins with its number");
    let template = bulbfold(folder.path(), ["new", "a", "-o", "-"]);
    assert!(stdout(&template).contains("nodes:"), "{}", stderr(&template));
    assert!(names(folder.path()).is_empty());
}

#[test]
fn frames_go_to_stdout_one_after_the_other() {
    let folder = folder();
    let sweep = ["--sweep", "fov=40..50", "--frames", "3", "-o", "-"];
    let output = bulbfold(folder.path(), [&["render", "mandelbulb"][..], &SMALL, &sweep].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    let starts = output.stdout.windows(8).filter(|bytes| bytes == b"\x89PNG\r\n\x1a\n").count();
    assert_eq!(starts, 3);
    let resumed = bulbfold(folder.path(), [&["render", "mandelbulb", "--resume"][..], &SMALL, &sweep].concat());
    assert_eq!(resumed.status.code(), Some(2));
    let without = ["--sweep", "fov=40..50", "--frames", "3", "-o", "frame.png"];
    let refused = bulbfold(folder.path(), [&["render", "mandelbulb"][..], &SMALL, &without].concat());
    assert_eq!(refused.status.code(), Some(2), "a file has room for one picture");
}

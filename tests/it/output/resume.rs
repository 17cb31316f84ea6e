//! `--resume` keeps whole frames of the same size and settings, and no others.

use super::{names, png_size};

use crate::support::{bulbfold, folder, stderr};

const SWEEP: [&str; 13] = [
    "render",
    "mandelbulb",
    "--frames",
    "4",
    "--samples",
    "1",
    "--calibrate",
    "off",
    "--backend",
    "cpu",
    "-o",
    "f_%02d.png",
    "--resume",
];

/// Renders the frames that are missing; gives what was said.
fn resume(folder: &std::path::Path, size: &str, range: &str) -> String {
    let output = bulbfold(folder, SWEEP.iter().chain(&["--size", size, "--sweep", range]));
    assert!(output.status.success(), "{}", stderr(&output));
    stderr(&output)
}

#[test]
fn broken_frames_are_named_and_made_again() {
    let folder = folder();
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    let said = resume(folder.path(), "48x32", "power=4..8");
    assert!(!said.contains("again"), "{said}");
    let [first, second, third, fourth] = ["f_01.png", "f_02.png", "f_03.png", "f_04.png"].map(read);
    let mut damaged = fourth.clone();
    let at = damaged.len() * 3 / 4;
    damaged[at] ^= 1;
    write("f_02.png", b"garbage");
    write("f_03.png", &third[..third.len() / 2]);
    write("f_04.png", &damaged);
    let said = resume(folder.path(), "48x32", "power=4..8");
    for name in ["f_02.png", "f_03.png", "f_04.png"] {
        assert!(said.contains(&format!("{name} is rendered again: it is no whole PNG")), "{said}");
    }
    assert!(!said.contains("f_01.png is"), "{said}");
    assert!([read("f_02.png"), read("f_03.png"), read("f_04.png")] == [second, third, fourth]);
    assert!(!resume(folder.path(), "48x32", "power=4..8").contains("again"));
    // A whole picture that is no frame.
    let other = bulbfold(
        folder.path(),
        ["render", "mandelbox", "--size", "48x32", "--calibrate", "off", "--force", "-o", "f_01.png"],
    );
    assert!(other.status.success());
    assert!(
        resume(folder.path(), "48x32", "power=4..8").contains("f_01.png is rendered again: it is of other settings")
    );
    assert!(read("f_01.png") == first);
    assert_eq!(names(folder.path()).len(), 4);
}

#[test]
fn frames_of_another_size_or_other_settings_are_made_again() {
    let folder = folder();
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    resume(folder.path(), "48x32", "power=4..8");
    let said = resume(folder.path(), "32x20", "power=4..8");
    assert_eq!(said.matches("its size is 48x32 and not 32x20").count(), 4, "{said}");
    assert!(names(folder.path()).iter().all(|name| png_size(&read(name)) == Some((32, 20))));
    let first = read("f_01.png");
    let said = resume(folder.path(), "32x20", "power=2..8");
    assert_eq!(said.matches("it is of other settings").count(), 3, "the last frame is the same: {said}");
    assert!(read("f_01.png") != first);
}

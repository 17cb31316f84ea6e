//! What is refused, and with which words.

use super::import;
use super::mandelbulber::settings;

use crate::support::{bulbfold, folder, stderr};

#[test]
fn broken_files_are_told_with_their_place() {
    let cases = [
        ("a.fract", "P6 3 4 255", "1:1", "this is not a settings file of Mandelbulber"),
        ("a.fract", "Mandelbulber 1.21;\npower 8;", "1:1", "open them in Mandelbulber 2"),
        ("a.fract", "# Mandelbulber settings file\n[main_parameters]\nfov;\n", "3:4", "`fov` has no value"),
        ("a.fract", "# Mandelbulber settings file\n[main_parameters]\nfov 1\n", "3:6", "does not end with `;`"),
        ("a.fract", "# Mandelbulber settings file\n[main_parameters]\nfov wide;\n", "3:5", "`fov` needs a number"),
        (
            "a.fract",
            "# Mandelbulber settings file\n[main_parameters]\nformula_1 4711;\n",
            "3:11",
            "formula number 4711",
        ),
        ("a.frag", "void main() {}", "1:1", "not a shader of Fragmentarium"),
        ("a.frag", "uniform float Secret; slider[0,1,2]\n", "1:1", "there is no function `float DE(vec3)`"),
        ("Mandelbulb.frag", "uniform float Power; slider[0,8]\n", "1:29", "`Power` has no default value"),
        (
            "Mandelbulb.frag",
            "uniform float Power; slider[0,8,16]\n#preset A\nPower =\n#endpreset\n",
            "3:1",
            "`Power` has no value",
        ),
        ("Mandelbulb.frag", "uniform float Power; slider[0,8,16]\n#preset A\nPower = 3\n", "2:1", "`A` does not end"),
    ];
    for (name, text, place, message) in cases {
        let (folder, output) = import(name, text, &[]);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{text}\n{said}");
        assert!(said.contains(&format!("{name}:{place}")) && said.contains(message), "{text}\n{said}");
        assert!(!folder.path().join("out.ron").exists());
    }
    let (_folder, output) = import("a.txt", "", &[]);
    assert!(stderr(&output).contains("neither a .fract nor a .frag"), "{}", stderr(&output));
}

#[test]
fn values_that_steps_do_not_take_write_nothing() {
    let (folder, output) = import("box.fract", &settings("formula_1 8;", &["mandelbox_scale 1e5;"]), &[]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("values that the steps here do not take"), "{}", stderr(&output));
    assert!(!folder.path().join("out.ron").exists());
}

#[test]
fn nothing_is_overwritten_unless_forced() {
    let folder = folder();
    std::fs::write(folder.path().join("a.fract"), settings("formula_1 8;", &[""])).unwrap();
    let run = |arguments: &[&str]| bulbfold(folder.path(), arguments).status.code();
    assert_eq!(run(&["import", "a.fract"]), Some(0));
    assert_eq!(run(&["import", "a.fract"]), Some(2));
    assert_eq!(run(&["import", "a.fract", "--force"]), Some(0));
    let mut names: Vec<_> = std::fs::read_dir(folder.path()).unwrap().flatten().map(|e| e.file_name()).collect();
    names.sort();
    assert_eq!(names, ["a.fract", "a.ron"]);
}

//! Parameters of Mandelbulb3D, as records that are made here from the published places of their fields.

use super::{import, imported};

use crate::support::{bulbfold, folder, stderr};

/// A formula of a hybrid: its number, iterations and options.
type Slot = (i32, i32, &'static [f64]);

/// A record of version 44 with formulas: number, iterations, options.
fn record(formulas: &[Slot], more: &[(usize, Vec<u8>)]) -> Vec<u8> {
    let mut bytes = vec![0; 840 + 8 + 6 * 188];
    let mut put = |at: usize, value: &[u8]| bytes[at..at + value.len()].copy_from_slice(value);
    let number = |value: f64| value.to_le_bytes();
    for (at, value) in [(0, 44), (4, 640), (8, 480), (12, 60)] {
        put(at, &i32::to_le_bytes(value));
    }
    // Start of the rays, middle, zoom, bailout, view.
    for (at, value) in [(20, -2.0), (28, 9.0), (84, 0.8), (92, 16.0), (108, 40.0)] {
        put(at, &number(value));
    }
    // The matrix: right, down and ahead.
    for (row, axis) in [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]].iter().enumerate() {
        (0..3).for_each(|i| put(246 + 24 * row + 8 * i, &number(axis[i])));
    }
    put(840, &[16, 0, 0, 0, formulas.len() as u8, 0, 0, 0]);
    for (i, (kind, iterations, options)) in formulas.iter().enumerate() {
        let at = 848 + 188 * i;
        put(at, &iterations.to_le_bytes());
        put(at + 4, &kind.to_le_bytes());
        put(at + 8, &(options.len() as i32).to_le_bytes());
        put(at + 12, b"SomeFormula");
        (0..options.len()).for_each(|k| put(at + 60 + 8 * k, &number(options[k])));
    }
    for (at, value) in more {
        put(*at, value);
    }
    bytes
}

/// The record as a block of text.
fn text(record: &[u8]) -> String {
    let letters: Vec<char> = ('.'..='9').chain('A'..='Z').chain('a'..='z').collect();
    assert_eq!(letters.len(), 64);
    let mut block = String::new();
    for three in record.chunks(3) {
        let bits = three.iter().rev().fold(0_usize, |bits, byte| bits << 8 | usize::from(*byte));
        (0..4).for_each(|i| block.push(letters[bits >> (6 * i) & 63]));
        if block.len() % 81 == 80 {
            block.push('\n');
        }
    }
    format!("Look at this:\nMandelbulb3Dv18{{\n{block}}}\n{{Titel: my flower}}\n")
}

fn said(name: &str, text: &str) -> (Option<i32>, String) {
    let (folder, output) = import(name, text, &[]);
    assert_eq!(output.status.success(), folder.path().join("out.ron").exists());
    (output.status.code(), stderr(&output))
}

const BOX: Slot = (4, 1, &[-1.5, 0.5, 1.0]);
const BULB: Slot = (0, 1, &[8.0, 1.0]);

/// One iteration of each in turn: the numbers of `box_bulb`'s own tests.
#[test]
fn hybrids_and_cameras_are_read() {
    let formula = imported("flower.m3p", &text(&record(&[BOX, BULB], &[])), &[]);
    assert!((formula.orbit([0.25, 0.0, 0.0], 1)[0] + 1.25).abs() < 1e-12);
    assert!((formula.orbit([0.25, 0.0, 0.0], 2)[0] - 6.2104644775390625).abs() < 1e-9);
    let graph = formula.graph();
    assert_eq!((graph.orbit.max_iterations, graph.orbit.escape_radius), (60, 16.0));
    let camera = graph.scene.camera.unwrap();
    assert!((camera.fov.to_degrees() - 40.0).abs() < 1e-9);
    assert_eq!(camera.up, [0.0, 0.0, 1.0]);
    // The plane, 480 steps of 2.1345 / (0.8 * 640) high, stands at y = -2, and 40 degrees see just that.
    let back = 240.0 * 2.1345 / (0.8 * 640.0) / 20_f64.to_radians().tan();
    assert!((camera.position[1] + 2.0 + back).abs() < 1e-9 && camera.position[0].abs() < 1e-12, "{camera:?}");
    assert!(camera.target[1] > camera.position[1]);
}

/// Against the program's own powers of 2 and 3, the tricorn and a box fold before a bulb.
#[test]
fn maps_are_the_programs_own() {
    let [x, y, z] = [0.3f64, -0.4, 0.5];
    let rho_sq = x * x + y * y;
    let two = 1.0 - z * z / rho_sq;
    let three = 1.0 - 3.0 * z * z / rho_sq;
    let square = |factor: f64| [(x * x - y * y) * two, 2.0 * x * y * two, 2.0 * factor * rho_sq.sqrt() * z];
    let cases: [(Slot, [f64; 3]); 6] = [
        ((0, 1, &[2.0, -1.0]), square(-1.0)),
        ((0, 1, &[2.0, 1.5]), square(1.5)),
        ((1, 1, &[2.0, -1.0]), square(-1.0)),
        (
            (0, 1, &[3.0, -1.0]),
            [(x * x - 3.0 * y * y) * three * x, three * (3.0 * x * x - y * y) * y, (z * z - 3.0 * rho_sq) * z],
        ),
        ((3, 1, &[-2.0, 1.0]), [x * x - y * y - z * z, 2.0 * x * y, -2.0 * x * z]),
        ((6, 1, &[2.0, -1.0, 2.0]), square(-1.0)),
    ];
    for (slot, image) in cases {
        let found = imported("one.m3p", &text(&record(&[slot], &[])), &[]).orbit([x, y, z], 1);
        for ((found, image), p) in found.iter().zip(image).zip([x, y, z]) {
            assert!((found - image - p).abs() < 1e-12, "{slot:?} {found} {image}");
        }
    }
}

#[test]
fn julia_constants_and_places_to_repeat_from_are_read() {
    let julia = [0.1_f64, -0.2, 0.3].iter().flat_map(|part| part.to_le_bytes()).collect();
    // After the box the bulb runs alone.
    let more = [(190, vec![1]), (191, julia), (845, vec![0x11])];
    let (folder, output) = import("julia.txt", &text(&record(&[(4, 2, BOX.2), BULB], &more)), &[]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let graph = std::fs::read_to_string(folder.path().join("out.ron")).unwrap();
    assert!(graph.contains("constant: Julia((0.1, -0.2, 0.3))") && graph.contains("my flower"), "{graph}");
    assert!(graph.contains(r#"Between(of: "amazing_box_1", from: 0, to: 2, otherwise: "integer_power_2")"#), "{graph}");
}

/// The same record as the program's binary file.
#[test]
fn binary_files_are_read() {
    let folder = folder();
    std::fs::write(folder.path().join("a.m3p"), record(&[BULB], &[])).unwrap();
    let output = bulbfold(folder.path(), ["import", "a.m3p"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(std::fs::read_to_string(folder.path().join("a.ron")).unwrap().contains("bulb_power(power: 8.0"));
}

#[test]
fn what_is_lost_is_listed() {
    let (code, said) = said("a.m3p", &text(&record(&[(3, -2, &[-2.0, 0.5])], &[(176, vec![2])])));
    assert_eq!(code, Some(0), "{said}");
    let shape = said.split("not carried over: light").next().unwrap();
    for words in ["cutting planes", "factor 0.5", "do not count"] {
        assert!(shape.contains(words), "{words}: {said}");
    }
}

#[test]
fn what_cannot_be_read_is_told() {
    let good = text(&record(&[BULB], &[]));
    let cases = [
        (include_str!("cases/scene.m3p").to_string(), "scene.m3p:1:1", "cut off: 18 of 840 bytes"),
        (
            good.replacen("\n.", "\n!", 1).replacen('E', "\u{e9}", 1),
            "scene.m3p:3",
            "a sign that its code does not have",
        ),
        (good.replace("v18{", "v12{"), "scene.m3p:2:1", "of version 12, before 16"),
        (text(&record(&[BULB], &[(0, vec![12])])), "scene.m3p:2:1", "version 12, before 20"),
        (text(&record(&[BULB], &[(4, vec![0; 4])])), "scene.m3p:2:1", "no parameters of Mandelbulb3D that can be read"),
        (text(&record(&[(20, 1, &[2.0])], &[])), "scene.m3p:2:1", "formula SomeFormula has no counterpart"),
        (text(&record(&[BULB], &[(841, vec![2])])), "scene.m3p:2:1", "a combination of two distances"),
        (text(&record(&[], &[])), "scene.m3p:2:1", "runs no formula"),
        ("nothing".to_string(), "scene.m3p:1:1", "no parameters of Mandelbulb3D"),
    ];
    for (text, place, words) in cases {
        let (code, said) = said("scene.m3p", &text);
        assert_eq!(code, Some(2), "{words}: {said}");
        assert!(said.contains("Mandelbulb3D") && said.contains(place) && said.contains(words), "{words}: {said}");
    }
    let (code, said) = said("a.m3p", &text(&record(&[BULB], &[(0, vec![45])])));
    assert_eq!(code, Some(0));
    assert!(said.starts_with("warning: not known to this reader"), "{said}");
}

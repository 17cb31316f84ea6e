//! Rows of Mandelbulber's formulas against states of orbits that were computed outside of this program, from that program's
//! definitions: defaults, and settings drawn at random with most switches and ranges of iterations.

use crate::support::{bulbfold, folder, stderr, stdout};

const CASES: &str = include_str!("rows/orbits.txt");

fn numbers(text: &str) -> Vec<f64> {
    text.split_whitespace().map(|word| word.parse().expect("a number")).collect()
}

/// The graph of a case with the map alone as its output, and with so large an escape radius that nothing stops early.
fn graph(text: &str) -> String {
    let mut name = String::new();
    let mut lines = Vec::new();
    for line in text.lines() {
        let word = line.trim();
        if word.starts_with("\"scene\":") {
            continue;
        }
        if word.starts_with('"') && word.contains("\": ") && !word.contains("(default:") && name.is_empty() {
            name = word[1..].split('"').next().unwrap_or_default().to_string();
        }
        lines.push(match word.split_once(':') {
            Some(("output", _)) => format!("    output: \"{name}\","),
            Some(("escape_radius", _)) => "    escape_radius: 1e6,".into(),
            _ => line.to_string(),
        });
    }
    lines.join("\n")
}

#[test]
fn orbits_are_those_of_the_program() {
    let folder = folder();
    let path = folder.path();
    let mut wrong = Vec::new();
    for case in CASES.lines().filter(|line| !line.starts_with('#')) {
        let parts: Vec<&str> = case.split('|').map(str::trim).collect();
        let [what, settings, start, expect] = parts[..] else { panic!("{case}") };
        let (id, n) = what.split_once(' ').expect("a number and iterations");
        let settings: Vec<String> =
            settings.split("; ").filter(|setting| !setting.is_empty()).map(|setting| format!("{setting};")).collect();
        let file = format!(
            "# Mandelbulber settings file\n# version 2.20\n[main_parameters]\nformula_1 {id};\nN {n};\n[fractal_1]\n{}\n",
            settings.join("\n")
        );
        std::fs::write(path.join("case.fract"), file).expect("a file can be written");
        let imported = bulbfold(path, ["import", "case.fract", "-o", "case.ron", "--force"]);
        assert!(imported.status.success(), "{case}\n{}", stderr(&imported));
        let text = std::fs::read_to_string(path.join("case.ron")).expect("the file was written");
        std::fs::write(path.join("case.ron"), graph(&text)).expect("a file can be written");
        let start: Vec<String> = numbers(start).iter().map(f64::to_string).collect();
        let point = format!("--point={}", start.join(","));
        let probed = bulbfold(path, ["probe", "case.ron", &point, "--json"]);
        assert!(probed.status.success(), "{case}\n{}", stderr(&probed));
        let output = stdout(&probed);
        let json: serde_json::Value = serde_json::from_str(output.trim()).expect("one object");
        let z: Vec<f64> = json["z"].as_array().expect("a state").iter().filter_map(serde_json::Value::as_f64).collect();
        let expect = numbers(expect);
        if expect.len() != z.len() || expect.iter().zip(&z).any(|(a, b)| (a - b).abs() > 1e-6 * a.abs().max(1.0)) {
            wrong.push(format!("{case}\n  found {z:?}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

//! Embeds the formula folders: every file found there becomes part of the program.

use std::fmt::Write as _;
use std::path::Path;
use std::{env, fs};

/// The commit that is built: what is stated, that of the package, or that of a checkout, which later commits may have changed since this
/// ran.
fn commit() -> String {
    println!("cargo::rerun-if-env-changed=BULBFOLD_COMMIT");
    if let Ok(stated) = env::var("BULBFOLD_COMMIT") {
        return stated;
    }
    let digits = |text: &str| text.chars().take_while(char::is_ascii_hexdigit).take(12).collect::<String>();
    if let Ok(text) = fs::read_to_string(".cargo_vcs_info.json")
        && let Some((_, rest)) = text.split_once("\"sha1\":")
    {
        return digits(rest.trim_start().trim_start_matches('"'));
    }
    let head = fs::read_to_string(".git/HEAD").unwrap_or_default();
    let found = match head.trim().strip_prefix("ref: ") {
        Some(name) => fs::read_to_string(Path::new(".git").join(name)).unwrap_or_default(),
        None => head,
    };
    match digits(found.trim()) {
        none if none.is_empty() => "unknown".into(),
        commit => format!("{commit} or later"),
    }
}

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rustc-env=BULBFOLD_COMMIT={}", commit());
    let mut code = String::new();
    const FOLDERS: [(&str, &str); 6] = [
        ("steps", "rhai"),
        ("fractals", "ron"),
        ("scenes", "ron"),
        ("scripts", "rhai"),
        ("palettes", "ron"),
        ("materials", "rhai"),
    ];
    for (folder, extension) in FOLDERS {
        let path = Path::new("formulas").join(folder);
        println!("cargo::rerun-if-changed={}", path.display());
        let _ = writeln!(code, "/// Name and text of each file in `formulas/{folder}/`.");
        let _ = writeln!(code, "pub const {}: &[(&str, &str)] = &[", folder.to_uppercase());
        let mut files: Vec<_> = fs::read_dir(&path).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
        files.sort();
        for file in files.iter().filter(|file| file.extension().is_some_and(|e| e == extension)) {
            println!("cargo::rerun-if-changed={}", file.display());
            let name = file.file_stem().unwrap_or_default().to_string_lossy();
            let absolute = fs::canonicalize(file).expect("a file that was just listed exists");
            let _ = writeln!(code, "    ({name:?}, include_str!({:?})),", absolute.display().to_string());
        }
        code.push_str("];\n");
    }
    let out = env::var("OUT_DIR").expect("cargo sets OUT_DIR for build scripts");
    fs::write(Path::new(&out).join("embedded.rs"), code).expect("OUT_DIR is writable");
}

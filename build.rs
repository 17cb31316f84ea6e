//! Embeds the formula folders: every file found there becomes part of the program.

use std::fmt::Write as _;
use std::path::Path;
use std::{env, fs};

fn main() {
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

//! Holds the one direction of the data: a module imports only those to its left, and `math` and `diag` import nothing.

use std::path::{Path, PathBuf};

/// Modules of the crate; each may import those before it. `film` (pictures) is below `render`, which joins everything.
const ORDER: &[&str] = &[
    "math",
    "memory",
    "diag",
    "files",
    "expr",
    "formula",
    "colour",
    "graph",
    "kernel",
    "compose",
    "march",
    "shade",
    "film",
    "render",
    "precision",
    "load",
    "motion",
    "exchange",
    "check",
    "calibrate",
    "engine",
    "mesh",
    "explore",
    "live",
    "chart",
    "view",
    "cli",
];

fn rust_files(folder: &Path, files: &mut Vec<PathBuf>) {
    let mut entries: Vec<_> = std::fs::read_dir(folder).unwrap().flatten().map(|e| e.path()).collect();
    entries.sort();
    for entry in entries {
        match entry.is_dir() {
            true => rust_files(&entry, files),
            false if entry.extension().is_some_and(|e| e == "rs") => files.push(entry),
            false => {}
        }
    }
}

/// Names that follow `crate::` in code; comments and documentation may speak of anything.
fn imports(text: &str) -> Vec<(usize, String)> {
    let mut found = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let code = line.split("//").next().unwrap_or("");
        for (at, _) in code.match_indices("crate::") {
            let rest = &code[at + "crate::".len()..];
            match rest.strip_prefix('{') {
                Some(list) => found.extend(top_level_names(list).into_iter().map(|name| (i + 1, name))),
                None => found.push((i + 1, first_name(rest))),
            }
        }
    }
    found
}

fn first_name(text: &str) -> String {
    text.trim_start().chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()
}

fn top_level_names(list: &str) -> Vec<String> {
    let mut depth = 0;
    let parts = list.split(|c| {
        depth += i32::from(c == '{') - i32::from(c == '}');
        c == ',' && depth == 0
    });
    parts.map(first_name).filter(|name| !name.is_empty()).collect()
}

#[test]
fn modules_import_only_what_is_before_them() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    rust_files(&root, &mut files);
    let mut wrong = Vec::new();
    for file in &files {
        let inner = file.strip_prefix(&root).unwrap();
        let first = inner.components().next().unwrap().as_os_str().to_string_lossy();
        let module = first.trim_end_matches(".rs");
        let is_tests = inner.iter().any(|part| part == "tests" || part == "tests.rs");
        if module == "lib" || module == "main" || is_tests {
            continue;
        }
        let Some(own) = ORDER.iter().position(|m| *m == module) else {
            wrong.push(format!("{}: the module `{module}` has no place in the order", inner.display()));
            continue;
        };
        // A module's tests may look at all of the program.
        let text = std::fs::read_to_string(file).unwrap();
        let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
        for (line, name) in imports(code) {
            match ORDER.iter().position(|m| *m == name) {
                Some(other) if other <= own => {}
                Some(_) => {
                    wrong.push(format!("{}:{line}: `{module}` imports `{name}`, which comes after it", inner.display()))
                }
                None => {} // macros and items of the crate's root
            }
        }
    }
    assert!(files.len() > 20, "the sources were not found");
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

#[test]
fn math_imports_nothing_of_the_crate_but_itself() {
    let mut files = Vec::new();
    rust_files(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src/math"), &mut files);
    for file in files {
        for (line, name) in imports(&std::fs::read_to_string(&file).unwrap()) {
            assert_eq!(name, "math", "{}:{line}", file.display());
        }
    }
}

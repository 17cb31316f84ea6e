//! Work of other programs in, formulas out, as users see it: the built program in a fresh folder.

mod colours;
mod export;
#[cfg(feature = "gpu")]
mod export_gpu;
mod fragmentarium;
mod mandelbulb3d;
mod mandelbulber;
mod mandelbulber_maps;
mod refusals;
mod versions;

use std::process::Output;

use bulbfold::check::Formula;

use crate::support::{bulbfold, folder, stderr};

/// Imports a text under a name; returns the folder, the run and the name of the graph file.
pub fn import(name: &str, text: &str, arguments: &[&str]) -> (tempfile::TempDir, Output) {
    let folder = folder();
    std::fs::write(folder.path().join(name), text).unwrap();
    let mut all = vec!["import", name, "-o", "out.ron"];
    all.extend(arguments);
    let output = bulbfold(folder.path(), &all);
    (folder, output)
}

/// The formula that an import wrote.
pub fn imported(name: &str, text: &str, arguments: &[&str]) -> Formula {
    let (folder, output) = import(name, text, arguments);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    Formula::open(folder.path().join("out.ron")).unwrap()
}

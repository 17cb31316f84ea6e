//! Files of other programs.

use bulbfold::check::measure_for_import;
use bulbfold::diag::Diagnostics;
use bulbfold::exchange::import::encoding::decode;
use bulbfold::exchange::import::{Imported, fragmentarium, mandelbulb3d, mandelbulber};
use bulbfold::formula::library::Library;
use bulbfold::load::load_text;

use super::{expect_told, with_library};

/// What was made of a file is read, as the command `import` does before it writes.
fn expect_read(library: &mut Library, imported: Option<Imported>, d: &Diagnostics) {
    expect_told(library, d, imported.is_some());
    if let Some(imported) = imported {
        let mut d = Diagnostics::default();
        let loaded = load_text(library, "out.ron", &imported.text, &[], &mut d);
        expect_told(library, &d, loaded.is_some());
    }
}

/// Settings of Mandelbulber 2.
pub fn mandelbulber(bytes: &[u8]) {
    with_library(|library| {
        let mut d = Diagnostics::default();
        let id = library.sources.add("input.fract", decode(bytes).text.as_str());
        let imported = mandelbulber::import(&library.sources, id, "input.fract", &mut d);
        expect_read(library, imported, &d);
    });
}

/// A shader of Fragmentarium, compared with our formulas by its values.
pub fn fragmentarium(bytes: &[u8]) {
    with_library(|library| {
        let mut d = Diagnostics::default();
        let id = library.sources.add("input.frag", decode(bytes).text.as_str());
        let request = fragmentarium::Request { preset: None, taken_for: None };
        let sources = &library.sources;
        let imported = fragmentarium::import(sources, (id, "input.frag"), request, &measure_for_import, &mut d);
        expect_read(library, imported, &d);
    });
}

/// Parameters of Mandelbulb3D, as text or as bytes.
pub fn mandelbulb3d(bytes: &[u8]) {
    with_library(|library| {
        let mut d = Diagnostics::default();
        let id = library.sources.add("input.m3p", decode(bytes).text.as_str());
        let imported = mandelbulb3d::import(&library.sources, (id, "input.m3p"), bytes, &mut d);
        expect_read(library, imported, &d);
    });
}

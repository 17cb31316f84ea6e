//! Which built-in fractals tests run on whose time would grow with the library.
//!
//! What every fractal must keep by itself (its own tests, agreement of back ends, its calibrated estimate) is tested for all
//! of them by `bulbfold test` in tests/it/formulas.rs. What is a property of the program, and not of a fractal, is tested on
//! one fractal of each kind and on others spread over the list.

use bulbfold::formula::embedded::FRACTALS;

/// One of each kind: logarithmic and linear, box and primitives, 3 and 4 components, conformal or not, Julia and Mandelbrot,
/// alternating orbits and ranges, several fields.
const KINDS: [&str; 13] = [
    "box_bulb",
    "bulb_on_floor",
    "icosahedron_kifs",
    "juliabox",
    "mandelbox",
    "mandelbox_negative",
    "mandelbulb",
    "mandelbulb_julia",
    "mandelbulb_power2",
    "menger",
    "menger_bulb",
    "quaternion_julia",
    "sierpinski_tetrahedron",
];

/// One fractal of each kind, and as many others at equal distances in the list of all.
pub fn sampled(others: usize) -> Vec<&'static str> {
    let known = |name: &str| FRACTALS.iter().any(|(fractal, _)| *fractal == name);
    assert!(KINDS.iter().all(|name| known(name)), "a fractal that stands for its kind is gone");
    let rest: Vec<&str> = FRACTALS.iter().map(|(name, _)| *name).filter(|name| !KINDS.contains(name)).collect();
    let count = others.min(rest.len());
    let spread = (0..count).map(|i| rest[i * rest.len() / count]);
    KINDS.into_iter().chain(spread).collect()
}

//! Colours, gradients and pictures of surroundings: spaces, presets, files of other programs, and all of them as expressions.
//!
//! Colours are linear RGB with the primaries of sRGB. A [`Gradient`] is a list of stops that are mixed in OKLab, where equal steps look equal;
//! [`Gradient::compose`] makes the same of it on every back end. Presets are the files in `formulas/palettes/`, found and not
//! listed ([`palettes`]); [`read_gradient`] reads files of GIMP, Ultra Fractal and Fractint, and lists as CSS has them.
//! A [`Panorama`] is an equirectangular picture.
//!
//! ```
//! use bulbfold::colour::{Gradient, palettes};
//!
//! let ember = palettes::named("ember").expect("a preset");
//! assert!(ember.gradient.at(0.0)[0] < ember.gradient.at(0.7)[0]);
//! assert!(palettes::all().len() >= 40);
//! ```

mod file;
mod ggr;
mod gradient;
pub mod palettes;
mod panorama;
mod random;
mod space;
mod written;

pub use file::{FileError, read_gradient};
pub use gradient::{Gradient, MOST_STOPS, Stop};
pub use panorama::{MOST_BYTES, Panorama, place};
pub use random::random_gradient;
pub use space::{Rgb, from_oklab, from_oklch, hex, linear, oklab, srgb};
pub use written::{parse_colour, read_colour, read_stops};

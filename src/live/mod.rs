//! A formula that is changed and seen at the same time: for `bulbfold watch`, and for windows.
//!
//! A [`Viewer`] renders what it is asked for on a thread of its own: first a small picture, fast, then larger ones up to the whole
//! one. A new wish ends the work on the one before. [`Sight`] is what was moved since the file was read: numbers of the formula ([`sliders`] lists them),
//! a preset, the camera ([`Movement`] moves it as a hand does). [`written()`] puts all of it back into the file's text, where everything else stays as it is.

mod movement;
mod sight;
mod viewer;
mod written;

pub use movement::Movement;
pub use sight::{Sight, Slider, sliders};
pub use viewer::{Part, Screen, Shown, Viewer, Wanted};
pub use written::{camera_text, with_changes, with_view, written};

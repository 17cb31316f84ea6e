//! Work for many machines: bundles, their parts, and the texts that engines of farms read.
//!
//! A *bundle* is a folder with everything that its pictures follow from. It is cut into *parts*: some rows, and some samples, of a
//! picture or of a film's frame. Each part is one command, which reads the bundle alone and writes one file; `bulbfold join` puts the
//! files together. What runs the commands is an engine that exists: Open Job Description, Slurm, make.

pub mod bundle;
pub mod engines;
pub mod part;
pub mod parts;
mod told;

pub use told::Told;

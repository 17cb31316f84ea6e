//! Settings of other programs to graph files.
//!
//! In comes the text of a Mandelbulber settings file ([`mandelbulber`]), of a Fragmentarium shader ([`fragmentarium`]) or of
//! Mandelbulb3D's parameters ([`mandelbulb3d`]);
//! out comes an [`Imported`]: the text of a graph file, and everything of the settings that it does not hold. Which formula
//! becomes which steps is data: a [`table`] for each program, where a formula more is a row more.

pub mod encoding;
pub mod evidence;
pub mod fragmentarium;
pub mod mandelbulb3d;
pub mod mandelbulber;
pub mod table;

mod ask;
mod colours;
mod glsl;
mod levels;
mod looks;
mod migrate;
mod objects;
mod place;
mod scene;
mod sequence;
mod settings;
mod shader;
mod text;
mod tree;
mod value;
mod view;

/// What became of a file of another program.
#[derive(Clone, PartialEq, Debug)]
pub struct Imported {
    /// The text of a graph file.
    pub text: String,
    /// What was not carried over, in the order of the file.
    pub lost: Vec<Lost>,
    /// What must be said first.
    pub notes: Vec<String>,
}

/// A part of a file that has no counterpart here.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Lost {
    /// Heading under which reports gather such parts.
    pub kind: LostKind,
    /// The part, as the file writes it.
    pub what: String,
    /// Why, where there is more to say than the heading does.
    pub why: String,
}

/// Kinds of lost parts, from what changes the shape to what changes nothing.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum LostKind {
    /// Nothing is known of it: it may change everything.
    Unknown,
    /// The shape is another one without it.
    Shape,
    /// Light, colour, effects, image and animation.
    Look,
    /// The formulas of the file do not read it.
    Unread,
}

impl LostKind {
    /// All kinds, in the order of reports.
    pub const ALL: [LostKind; 4] = [LostKind::Unknown, LostKind::Shape, LostKind::Look, LostKind::Unread];

    /// The heading in reports.
    pub const fn heading(self) -> &'static str {
        match self {
            LostKind::Unknown => "warning: not known to this reader, so the shape may be another one",
            LostKind::Shape => "not carried over, and the shape depends on it",
            LostKind::Look => "not carried over: light, colour, effects, image and animation",
            LostKind::Unread => "left out: the formulas of this file do not read it here",
        }
    }
}

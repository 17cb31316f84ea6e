//! Formula text: step files, graph files and scripts, read into plain data with a place for every part.
//!
//! In come texts; out come a [`value::Value`] tree for each graph file ([`ron`] or script) a [`step::Step`] for each
//! step file and a [`material::Material`] for each material, all held by a [`library::Library`]. Scripts build, kernels run: a step's script is traced once with
//! [`symbolic`] values and leaves expressions; nothing of it runs for a point of the picture.

pub mod decode;
pub mod edit;
pub mod embedded;
pub mod library;
pub mod material;
pub mod ron;
pub mod script;
pub mod shape;
pub mod step;
pub mod symbolic;
pub mod value;
pub mod written;

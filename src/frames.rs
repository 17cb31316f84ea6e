//! Many pictures with few kernels: the frames of an animation.
//!
//! In come the pipelines of all frames ([`Frames::add`]), each composed by itself. Kernels of the same role and structure are
//! compiled once and differ in their uniforms (see [`template`](crate::kernel::template)), so an animated camera or
//! parameter compiles nothing; a frame whose structure differs brings its own kernels, which [`FrameRenderer::compiled`] counts.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::Arc;

use crate::expr::Arena;
use crate::kernel::template::{Joined, Templates};
use crate::kernel::{Backend, BackendError};
use crate::render::{Pipeline, RenderSettings, Renderer, Role, Shape};

/// Frames that are being gathered.
#[derive(Default)]
pub struct Frames {
    templates: BTreeMap<Role, Templates>,
    /// Frames of each kernel so far.
    counts: BTreeMap<Role, usize>,
    frames: Vec<Frame>,
}

/// What is a frame's own.
struct Frame {
    shape: Shape,
    /// Its kernels, and its number among the frames that have them.
    kernels: Vec<(Role, usize)>,
}

/// The kernels of all frames.
pub struct JoinedFrames {
    joined: BTreeMap<Role, Joined>,
    frames: Vec<Frame>,
}

impl Frames {
    /// Adds the next frame.
    pub fn add(&mut self, arena: &Arc<Arena>, pipeline: &Pipeline) {
        let mut kernels = Vec::new();
        for pass in pipeline.passes.iter() {
            self.templates.entry(pass.role).or_default().add(arena, &pass.kernel);
            let count = self.counts.entry(pass.role).or_default();
            kernels.push((pass.role, *count));
            *count += 1;
        }
        self.frames.push(Frame { shape: pipeline.shape(), kernels });
    }

    /// Joins the kernels of all frames.
    pub fn finish(self) -> JoinedFrames {
        let joined = self.templates.into_iter().map(|(role, templates)| (role, templates.finish())).collect();
        JoinedFrames { joined, frames: self.frames }
    }
}

impl JoinedFrames {
    /// Number of frames.
    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// True without frames.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// Names of the roles, and how many different ones the frames need.
    pub fn families(&self) -> impl Iterator<Item = (&'static str, usize)> + '_ {
        self.joined.iter().map(|(role, joined)| (role.name(), joined.families.len()))
    }
}

/// Makes renderers of frames on a back end. Kernels are compiled when the first frame needs them, and kept.
pub struct FrameRenderer<'a, B: Backend> {
    backend: &'a B,
    frames: &'a JoinedFrames,
    settings: &'a RenderSettings,
    prepared: BTreeMap<(Role, usize), B::Prepared>,
}

impl<'a, B: Backend> FrameRenderer<'a, B> {
    /// Nothing is compiled yet.
    pub fn new(backend: &'a B, frames: &'a JoinedFrames, settings: &'a RenderSettings) -> Self {
        FrameRenderer { backend, frames, settings, prepared: BTreeMap::new() }
    }

    /// Kernels compiled so far.
    pub fn compiled(&self) -> usize {
        self.prepared.len()
    }

    /// The renderer of frame `number`, in the order in which frames were added.
    pub fn frame(&mut self, number: usize) -> Result<Renderer<'a, B>, BackendError> {
        let (backend, frames, prepared) = (self.backend, self.frames, &mut self.prepared);
        let frame = &frames.frames[number];
        Renderer::with_kernels(backend, self.settings, &frame.shape, |wanted| {
            let own = frame.kernels.iter().find(|(role, _)| *role == wanted);
            let &(role, at) = own.expect("a frame has the kernels of its passes");
            let joined = &frames.joined[&role];
            let own = &joined.frames[at];
            let key = (role, own.family);
            if let Entry::Vacant(entry) = prepared.entry(key) {
                let family = &joined.families[own.family];
                entry.insert(backend.prepare(&family.arena, &family.kernel)?);
            }
            backend.bind(&prepared[&key], &own.uniforms)
        })
    }
}

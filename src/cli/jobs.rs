//! Pictures as work for any back end: into a file, which goes on at its finished rows where a back end fails, and into memory.

use std::time::Duration;

use bulbfold::expr::Arena;
use bulbfold::files::Target;
#[cfg(feature = "chart")]
use bulbfold::film::Image;
use bulbfold::film::PngFile;
use bulbfold::kernel::{Backend, BackendError};
use bulbfold::render::{Pipeline, RenderSettings, Renderer, Stats};

use super::backend::Job;
use super::progress::Progress;

/// A picture and how much of it is in its file.
pub(super) struct FileJob<'a> {
    arena: &'a Arena,
    pipeline: &'a Pipeline,
    settings: &'a RenderSettings,
    quiet: bool,
    /// The file; none once it is finished.
    file: Option<PngFile>,
    /// Rows that it has.
    rows: u32,
}

impl<'a> FileJob<'a> {
    /// Nothing is rendered yet.
    pub(super) fn new(
        arena: &'a Arena,
        (pipeline, settings): (&'a Pipeline, &'a RenderSettings),
        output: &Target,
        quiet: bool,
    ) -> FileJob<'a> {
        let file = Some(PngFile::at(output, settings.size, None));
        FileJob { arena, pipeline, settings, quiet, file, rows: 0 }
    }
}

impl Job for FileJob<'_> {
    /// What was counted, and the time that the file took or why it could not be written.
    type Output = (Stats, std::io::Result<Duration>);

    fn run<B: Backend>(&mut self, backend: &B) -> Result<Self::Output, BackendError> {
        let mut renderer = Renderer::new(backend, self.arena, self.pipeline, self.settings)?;
        let mut progress = Progress::new(self.quiet);
        let (first, bytes) = (self.rows, 3 * self.settings.size.width as usize);
        let (file, rows) = (&mut self.file, &mut self.rows);
        let mut sink = |pixels: Vec<u8>| {
            *rows += (pixels.len() / bytes) as u32;
            file.as_mut().is_some_and(|file| file.push(pixels))
        };
        // A file that cannot be written on stops the render, and then says why.
        let done = renderer.render_rows_from(first, &mut sink, &mut |share| {
            progress.update(share);
            true
        });
        progress.finish();
        done?;
        let closed = || Err(std::io::Error::other("the file is closed"));
        Ok((renderer.stats, self.file.take().map_or_else(closed, PngFile::finish)))
    }
}

/// A picture in memory.
#[cfg(feature = "chart")]
pub(super) struct PictureJob<'a> {
    pub(super) arena: &'a Arena,
    pub(super) pipeline: &'a Pipeline,
    pub(super) settings: &'a RenderSettings,
    /// Is told the share that is done.
    pub(super) progress: &'a mut (dyn FnMut(f64) + Send),
}

#[cfg(feature = "chart")]
impl Job for PictureJob<'_> {
    type Output = Image;

    fn run<B: Backend>(&mut self, backend: &B) -> Result<Image, BackendError> {
        let mut renderer = Renderer::new(backend, self.arena, self.pipeline, self.settings)?;
        let image = renderer.render(&mut |share| {
            (self.progress)(share);
            true
        })?;
        Ok(image.unwrap_or_else(|| Image::new(self.settings.size)))
    }
}

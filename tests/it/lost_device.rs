//! Devices that are lost in the middle of a picture: it goes on at its finished rows on a new device and is the same.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};

use bulbfold::check::Formula;
use bulbfold::compose::Composer;
use bulbfold::expr::Arena;
use bulbfold::kernel::cpu::Cpu;
use bulbfold::kernel::{Backend, BackendError, Batch, Kernel, Results, Wanted};
use bulbfold::math::Precision;
use bulbfold::render::{Cut, RenderSettings, Renderer, Sampling, compose_pipeline};
use bulbfold::shade::Size;

/// Some bands, each of some tiles.
const SIZE: Size = Size { width: 61, height: 45 };
const CUT: Cut = Cut { band: 16, tile: 16, rays: 256 };

/// A back end whose device is lost at one of its dispatches, and stays so.
struct Failing {
    inner: Cpu,
    /// Dispatches until then.
    left: AtomicI64,
    /// Dispatches that were asked for.
    asked: AtomicU64,
}

impl Failing {
    fn at(dispatch: i64) -> Failing {
        Failing { inner: Cpu::new(Precision::F32), left: AtomicI64::new(dispatch), asked: AtomicU64::new(0) }
    }

    fn lost() -> BackendError {
        BackendError::DeviceLost("for a test".into())
    }

    fn check(&self) -> Result<(), BackendError> {
        if self.left.load(Ordering::Relaxed) < 0 { Err(Failing::lost()) } else { Ok(()) }
    }
}

impl Backend for Failing {
    type Prepared = <Cpu as Backend>::Prepared;
    type Columns = <Cpu as Backend>::Columns;

    fn batch(&self) -> Batch {
        self.inner.batch()
    }

    fn prepare(&self, arena: &Arena, kernel: &Kernel) -> Result<Self::Prepared, BackendError> {
        self.check()?;
        self.inner.prepare(arena, kernel)
    }

    fn bind(&self, kernel: &Self::Prepared, uniforms: &[f64]) -> Result<Self::Prepared, BackendError> {
        self.check()?;
        self.inner.bind(kernel, uniforms)
    }

    fn upload(&self, columns: &[impl AsRef<[f64]>]) -> Result<Self::Columns, BackendError> {
        self.check()?;
        self.inner.upload(columns)
    }

    fn download(&self, columns: &Self::Columns) -> Result<Vec<Vec<f64>>, BackendError> {
        self.check()?;
        self.inner.download(columns)
    }

    fn read<R>(&self, wanted: &[Wanted<Self::Columns>], take: impl FnOnce(Results) -> R) -> Result<R, BackendError> {
        self.check()?;
        self.inner.read(wanted, take)
    }

    fn run(&self, kernel: &Self::Prepared, inputs: &[&Self::Columns]) -> Result<Self::Columns, BackendError> {
        self.asked.fetch_add(1, Ordering::Relaxed);
        if self.left.fetch_sub(1, Ordering::Relaxed) <= 0 {
            self.left.store(-1, Ordering::Relaxed);
            return Err(Failing::lost());
        }
        self.inner.run(kernel, inputs)
    }
}

/// Rows on the first device, then the rest on the second; and how many rows the first one finished.
fn picture(formula: &Formula, samples: u32, devices: [&Failing; 2]) -> (Vec<u8>, u32) {
    let settings = RenderSettings { size: SIZE, samples, sampling: Sampling::Adaptive, ..RenderSettings::default() };
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library: formula.library(), graph: formula.graph() };
    let pipeline = compose_pipeline(&composer, &settings).unwrap_or_else(|error| panic!("{}", error.message));
    let (mut rgb, mut finished) = (Vec::new(), Vec::new());
    for device in devices {
        let done = (rgb.len() / SIZE.width as usize / 3) as u32;
        finished.push(done);
        let result = Renderer::new(device, &arena, &pipeline, &settings).and_then(|mut renderer| {
            renderer.cut = CUT;
            let mut sink = |mut rows: Vec<u8>| {
                rgb.append(&mut rows);
                true
            };
            renderer.render_rows_from(done, &mut sink, &mut |_| true)
        });
        match result {
            Ok(is_whole) => {
                assert!(is_whole);
                break;
            }
            Err(error) => assert_eq!(error, Failing::lost()),
        }
    }
    (rgb, finished.get(1).copied().unwrap_or(SIZE.height))
}

/// The device is lost at each of the first 200 dispatches in turn, with one sample a pixel and with more.
#[test]
fn a_picture_goes_on_at_its_finished_rows() {
    for (name, samples) in [("mandelbulb", 2), ("menger", 1)] {
        // With fewer dispatches a band, so that some of the first 200 are behind the first band.
        let formula = Formula::with(name, &[("look.occlusion", "0.0")]).unwrap();
        let undisturbed = Failing::at(i64::MAX);
        let (whole, _) = picture(&formula, samples, [&undisturbed, &Failing::at(0)]);
        assert_eq!(whole.len(), (SIZE.width * SIZE.height * 3) as usize);
        let all = undisturbed.asked.load(Ordering::Relaxed);
        let mut went_on = 0;
        for dispatch in 0..all.min(200) {
            let (rgb, finished) = picture(&formula, samples, [&Failing::at(dispatch as i64), &Failing::at(i64::MAX)]);
            assert!(rgb == whole, "{name}: lost at dispatch {dispatch}, {finished} rows done");
            went_on += u32::from(finished > 0 && finished < SIZE.height);
        }
        assert!(went_on > 0, "{name}: no loss fell behind the first band ({all} dispatches)");
    }
}

/// From every row on, the rows are those of the whole picture.
#[test]
fn rows_are_the_same_from_any_row_on() {
    let formula = Formula::builtin("box_bulb").unwrap();
    let settings = RenderSettings { size: SIZE, samples: 2, ..RenderSettings::default() };
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library: formula.library(), graph: formula.graph() };
    let pipeline = compose_pipeline(&composer, &settings).unwrap_or_else(|error| panic!("{}", error.message));
    let cpu = Cpu::new(Precision::F32);
    let mut renderer = Renderer::new(&cpu, &arena, &pipeline, &settings).unwrap();
    let mut rows = |first: u32| {
        let mut rgb = Vec::new();
        let mut sink = |mut rows: Vec<u8>| {
            rgb.append(&mut rows);
            true
        };
        renderer.render_rows_from(first, &mut sink, &mut |_| true).unwrap();
        rgb
    };
    let whole = rows(0);
    for first in [1, 2, 7, 8, 31, SIZE.height - 1, SIZE.height] {
        assert!(rows(first) == whole[(first * SIZE.width * 3) as usize..], "from row {first}");
    }
}

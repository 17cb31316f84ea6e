//! Marching at 640x480: the scalar f64 tape, machine code or wide tape in f32, and the generated WGSL on whatever adapter there is.
//!
//! The CPU runs on one thread (`RAYON_NUM_THREADS` is set to 1 unless given), so that its precisions compare lane with
//! lane; lavapipe uses all cores, as drivers do. `cargo bench` prints the times side by side.

use std::sync::Arc;

use bulbfold::compose::Composer;
use bulbfold::diag::Diagnostics;
use bulbfold::expr::Arena;
use bulbfold::formula::library::Library;
use bulbfold::kernel::Backend;
use bulbfold::kernel::cpu::Cpu;
use bulbfold::load::load;
use bulbfold::math::Precision;
use bulbfold::render::{RenderSettings, Role, compose_pipeline};
use bulbfold::shade::Size;

const FRACTALS: &[&str] = &["mandelbulb", "mandelbox", "box_bulb"];

fn main() {
    if std::env::var_os("RAYON_NUM_THREADS").is_none() {
        rayon::ThreadPoolBuilder::new().num_threads(1).build_global().expect("the pool is made once, here");
    }
    divan::main();
}

/// Times the march of every pixel's ray on a back end.
fn bench_march<B: Backend>(bencher: divan::Bencher, name: &str, backend: &B) {
    let mut library = Library::builtin();
    let mut diagnostics = Diagnostics::default();
    let loaded = load(&mut library, name, &[], &mut diagnostics).expect("built-in fractals load");
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library: &library, graph: &loaded.graph };
    let settings = RenderSettings { size: Size { width: 640, height: 480 }, ..RenderSettings::default() };
    let pipeline = compose_pipeline(&composer, &settings).expect("built-in fractals compose");
    let pixels: Vec<(u32, u32)> = bulbfold::film::tiles(settings.size).iter().flat_map(|tile| tile.pixels()).collect();
    let column = |f: fn(&(u32, u32)) -> u32| pixels.iter().map(|p| f64::from(f(p)) + 0.5).collect::<Vec<f64>>();
    let upload = backend.upload(&[column(|p| p.0), column(|p| p.1)]).expect("columns fit");
    let camera = backend.prepare(&arena, pipeline.kernel(Role::Camera)).expect("kernels compile");
    let march = backend.prepare(&arena, pipeline.kernel(Role::March)).expect("kernels compile");
    let rays = backend.run(&camera, &[&upload]).expect("kernels run");
    bencher.counter(divan::counter::ItemsCount::new(pixels.len())).bench_local(|| backend.run(&march, &[&rays]));
}

#[divan::bench(args = FRACTALS, sample_count = 3, sample_size = 1)]
fn cpu_f64(bencher: divan::Bencher, name: &str) {
    bench_march(bencher, name, &Cpu::new(Precision::F64).interpreted());
}

#[divan::bench(args = FRACTALS, sample_count = 3, sample_size = 1)]
fn cpu_f64_compiled(bencher: divan::Bencher, name: &str) {
    bench_march(bencher, name, &Cpu::new(Precision::F64));
}

#[divan::bench(args = FRACTALS, sample_count = 9, sample_size = 1)]
fn cpu_f32_interpreted(bencher: divan::Bencher, name: &str) {
    bench_march(bencher, name, &Cpu::new(Precision::F32).interpreted());
}

#[divan::bench(args = FRACTALS, sample_count = 9, sample_size = 1)]
fn cpu_f32(bencher: divan::Bencher, name: &str) {
    bench_march(bencher, name, &Cpu::new(Precision::F32));
}

#[cfg(feature = "gpu")]
#[divan::bench(args = FRACTALS, sample_count = 9, sample_size = 1)]
fn gpu(bencher: divan::Bencher, name: &str) {
    use bulbfold::kernel::gpu::{AdapterWanted, Gpu};
    match Gpu::new(AdapterWanted::Any) {
        Ok(gpu) => bench_march(bencher, name, &gpu),
        Err(error) => eprintln!("skipped: {error}"),
    }
}

//! Pictures of any size, whatever they are cut into, and with fewer samples where fewer do.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use bulbfold::check::Formula;
use bulbfold::compose::Composer;
use bulbfold::expr::Arena;
use bulbfold::film::{Image, Layer, Layers, PngFile, Rows};
use bulbfold::graph::Camera;
use bulbfold::kernel::cpu::Cpu;
use bulbfold::kernel::{Backend, BackendError, Batch, Kernel, Results, Wanted};
use bulbfold::math::Precision;
use bulbfold::render::{Cut, RenderSettings, Renderer, Sampling, Stats, compose_pipeline};
use bulbfold::shade::Size;

use crate::support::{folder, program, stderr};

/// No multiple of anything that pictures are cut into.
const SIZE: Size = Size { width: 83, height: 61 };

/// One piece for everything, so no borders.
const UNCUT: Cut = Cut { band: u32::MAX, tile: 1 << 20, rays: usize::MAX };

fn settings(samples: u32, sampling: Sampling) -> RenderSettings {
    RenderSettings { size: SIZE, samples, sampling, ..RenderSettings::default() }
}

/// The picture of a formula in its own view or another, with the cut of the back end or another.
fn picture(
    backend: &impl Backend,
    formula: &Formula,
    camera: Option<Camera>,
    settings: &RenderSettings,
    cut: Option<Cut>,
) -> (Image, Stats) {
    let graph = match camera {
        Some(camera) => formula.graph().clone().with_camera(camera),
        None => formula.graph().clone(),
    };
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library: formula.library(), graph: &graph };
    let pipeline = compose_pipeline(&composer, settings).unwrap_or_else(|error| panic!("{}", error.message));
    let mut renderer = Renderer::new(backend, &arena, &pipeline, settings).unwrap();
    renderer.cut = cut.unwrap_or(renderer.cut);
    let image = renderer.render(&mut |_| true).unwrap().expect("nobody stops it");
    (image, renderer.stats)
}

fn builtin(name: &str) -> Formula {
    Formula::builtin(name).unwrap()
}

const BALL: &str = r#"(nodes: { "ball": Sphere(centre: (0, 0, 0), radius: 1) }, output: "ball", bounding_radius: 1.5)"#;

fn ball() -> Formula {
    Formula::from_ron(BALL).unwrap_or_else(|error| panic!("{error}"))
}

/// From 5 below, straight up.
const CAMERA: Camera = Camera::new([0.0, -5.0, 0.0], [0.0; 3], [0.0, 0.0, 1.0], 0.5);

/// What the cut may not change: everything but times.
fn counts(stats: &Stats) -> [u64; 8] {
    let s = stats;
    [s.rays, s.refined, s.hits, s.unfinished, s.estimates, s.max_steps, s.iterations, s.shadow_estimates]
}

const CUTS: [Cut; 5] = [
    Cut { band: 13, tile: 40, rays: 1000 },
    Cut { band: 60, tile: 64, rays: 300 },
    Cut { band: 1, tile: 8, rays: 7 },
    Cut { band: 8, tile: 16, rays: 100 },
    Cut { band: 61, tile: 83, rays: 1 },
];

fn no_cut_shows(backend: &impl Backend, precision: Precision, cuts: &[Cut], most_samples: u32) {
    for name in ["mandelbulb", "mandelbox"] {
        for samples in 1..=most_samples {
            let settings = RenderSettings { precision, ..settings(samples, Sampling::Adaptive) };
            let formula = builtin(name);
            let (whole, uncut) = picture(backend, &formula, None, &settings, Some(UNCUT));
            for cut in cuts.iter().copied().map(Some).chain([None]) {
                let (image, stats) = picture(backend, &formula, None, &settings, cut);
                assert!(image == whole, "{name} with {samples} samples differs where it is cut as {cut:?}");
                assert_eq!(counts(&stats), counts(&uncut), "{name}, {samples}, {cut:?}");
            }
        }
    }
}

#[test]
fn no_cut_shows_on_the_cpu() {
    no_cut_shows(&Cpu::new(Precision::F32), Precision::F32, &CUTS, 3);
    no_cut_shows(&Cpu::new(Precision::F32).interpreted(), Precision::F32, &CUTS[..2], 2);
    no_cut_shows(&Cpu::new(Precision::F64), Precision::F64, &CUTS[..2], 2);
}

/// The machine's GPU or its software; `None` where there is none and none is required. Never closed: drivers cannot be while
/// a thread ends.
#[cfg(feature = "gpu")]
fn gpu() -> Option<&'static bulbfold::kernel::gpu::Gpu> {
    use bulbfold::kernel::gpu::{AdapterWanted, Gpu};
    match Gpu::new(AdapterWanted::Any) {
        Ok(gpu) => Some(Box::leak(Box::new(gpu))),
        Err(BackendError::NoAdapter(text)) if std::env::var("BULBFOLD_REQUIRE_GPU").as_deref() != Ok("1") => {
            eprintln!("skipped: {text}");
            None
        }
        Err(error) => panic!("{error}"),
    }
}

#[cfg(feature = "gpu")]
#[test]
fn no_cut_shows_on_the_gpu() {
    if let Some(gpu) = gpu() {
        no_cut_shows(gpu, Precision::F32, &CUTS[..2], 2);
    }
}

#[cfg(feature = "gpu")]
#[test]
fn what_is_empty_is_not_marched_on_the_gpu() {
    if let Some(gpu) = gpu() {
        // Each kernel may be contracted in its own way.
        what_is_empty_is_not_marched(gpu, Precision::F32, 1);
    }
}

/// A back end that counts the elements of its marches.
struct Counting<'b, B> {
    inner: &'b B,
    marched: AtomicUsize,
}

impl<B: Backend> Backend for Counting<'_, B> {
    type Prepared = (bool, B::Prepared);
    type Columns = (usize, B::Columns);

    fn batch(&self) -> Batch {
        self.inner.batch()
    }

    fn prepare(&self, arena: &Arena, kernel: &Kernel) -> Result<Self::Prepared, BackendError> {
        Ok((matches!(kernel, Kernel::March(_)), self.inner.prepare(arena, kernel)?))
    }

    fn bind(&self, kernel: &Self::Prepared, uniforms: &[f64]) -> Result<Self::Prepared, BackendError> {
        Ok((kernel.0, self.inner.bind(&kernel.1, uniforms)?))
    }

    fn upload(&self, columns: &[impl AsRef<[f64]>]) -> Result<Self::Columns, BackendError> {
        Ok((columns[0].as_ref().len(), self.inner.upload(columns)?))
    }

    fn read<R>(&self, wanted: &[Wanted<Self::Columns>], take: impl FnOnce(Results) -> R) -> Result<R, BackendError> {
        let wanted: Vec<Wanted<B::Columns>> = wanted.iter().map(|(columns, numbers)| (&columns.1, *numbers)).collect();
        self.inner.read(&wanted, take)
    }

    fn download(&self, columns: &Self::Columns) -> Result<Vec<Vec<f64>>, BackendError> {
        self.inner.download(&columns.1)
    }

    fn run(&self, kernel: &Self::Prepared, inputs: &[&Self::Columns]) -> Result<Self::Columns, BackendError> {
        if kernel.0 {
            self.marched.fetch_add(inputs[0].0, Ordering::Relaxed);
        }
        let columns: Vec<&B::Columns> = inputs.iter().map(|columns| &columns.1).collect();
        Ok((inputs[0].0, self.inner.run(&kernel.1, &columns)?))
    }
}

/// A ball of radius 1 from 5 away covers half of a square view of 0.5 radians: a disc of 38.4 of 96 pixels. Beams leave most of
/// the other half out, and what is seen there is what marches of its rays would have led to.
fn what_is_empty_is_not_marched(backend: &impl Backend, precision: Precision, most: u8) {
    // Without marches to the sun and along normals.
    let unlit = BALL.replace("output:", "look: (shadows: false, occlusion: 0.0), output:");
    let ball = Formula::from_ron(&unlit).unwrap_or_else(|error| panic!("{error}"));
    for samples in [1, 2] {
        let size = Size { width: 96, height: 96 };
        let settings = RenderSettings { size, precision, ..settings(samples, Sampling::Full) };
        let plain = RenderSettings { plain: true, ..settings.clone() };
        let (expected, without) = picture(backend, &ball, Some(CAMERA), &plain, None);
        let counting = Counting { inner: backend, marched: AtomicUsize::new(0) };
        let (image, stats) = picture(&counting, &ball, Some(CAMERA), &settings, None);
        assert_eq!(stats.rays, u64::from(96 * 96 * samples * samples));
        assert_eq!(stats.rays, without.rays);
        let marched = counting.marched.into_inner() as u64 - stats.beams;
        assert!(stats.hits <= marched && marched < stats.rays * 7 / 10, "{marched} of {} rays", stats.rays);
        let is_outside = |i: &usize| (*i as f64 % 96.0 - 47.5).hypot((i / 96) as f64 - 47.5) > 40.0;
        for i in (0..96 * 96).filter(is_outside) {
            let [expected, found] = [&expected, &image].map(|image| &image.rgb[3 * i..3 * i + 3]);
            assert!(
                expected.iter().zip(found).all(|(a, b)| a.abs_diff(*b) <= most),
                "pixel {i}: {expected:?}, {found:?}"
            );
        }
    }
}

#[test]
fn what_is_empty_is_not_marched_on_the_cpu() {
    what_is_empty_is_not_marched(&Cpu::new(Precision::F32), Precision::F32, 0);
    what_is_empty_is_not_marched(&Cpu::new(Precision::F64), Precision::F64, 0);
}

#[test]
fn the_light_of_all_samples_is_averaged_and_then_developed() {
    // Single pictures of the samples, each as the first of its own: a pixel is their average.
    let formula = builtin("menger");
    // Beams of larger tiles end elsewhere, and rays from there stop elsewhere within their threshold.
    let cpu = Cpu::new(Precision::F64);
    let plain = RenderSettings { plain: true, ..settings(2, Sampling::Full) };
    let (full, stats) = picture(&cpu, &formula, None, &plain, None);
    let pixels = u64::from(SIZE.width * SIZE.height);
    assert_eq!((stats.rays, stats.refined), (4 * pixels, pixels));
    // A picture of twice the size has a pixel for each sample; hit thresholds are those of the larger pixels by `detail`.
    let large = RenderSettings {
        size: Size { width: 2 * SIZE.width, height: 2 * SIZE.height },
        detail: 2.0,
        plain: true,
        ..settings(1, Sampling::Full)
    };
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library: formula.library(), graph: formula.graph() };
    let pipeline = compose_pipeline(&composer, &large).unwrap_or_else(|error| panic!("{}", error.message));
    let mut renderer = Renderer::new(&cpu, &arena, &pipeline, &large).unwrap();
    let mut light: Vec<f32> = Vec::new();
    let mut take = |mut rows: Rows| {
        light.append(&mut rows.radiance);
        true
    };
    renderer.render_layers(0..large.size.height, Layers::NONE.and(Layer::Radiance), &mut take, &mut |_| true).unwrap();
    // The film's curve, as its author wrote it down.
    let shown = |light: f64| {
        let x = 0.62 * light;
        (x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)).clamp(0.0, 1.0)
    };
    let encoded = |x: f64| if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    let at = |x: usize, y: usize, width: u32, k: usize| (y * width as usize + x) * 3 + k;
    for y in 0..SIZE.height as usize {
        for (x, k) in (0..SIZE.width as usize).flat_map(|x| [0, 1, 2].map(|k| (x, k))) {
            let sample = |(i, j)| f64::from(light[at(2 * x + i, 2 * y + j, large.size.width, k)]);
            let sum: f64 = [(0, 0), (0, 1), (1, 0), (1, 1)].map(sample).iter().sum();
            let expected = 255.0 * encoded(shown(sum / 4.0));
            let found = f64::from(full.rgb[at(x, y, SIZE.width, k)]);
            assert!((found - expected).abs() < 0.6, "pixel {x}, {y}: {found} instead of {expected}");
        }
    }
}

/// Share of pixels off by more than 2 of 255 in a channel, and the mean error.
fn difference(a: &Image, b: &Image) -> (f64, f64) {
    let worst = |(a, b): (&[u8], &[u8])| a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0);
    let errors: Vec<u8> = a.rgb.chunks(3).zip(b.rgb.chunks(3)).map(worst).collect();
    let count = errors.len() as f64;
    let off = errors.iter().filter(|&&error| error > 2).count() as f64;
    (off / count, errors.iter().map(|&error| f64::from(error)).sum::<f64>() / count)
}

#[test]
fn adaptive_samples_are_hard_to_tell_from_all() {
    let cpu = Cpu::new(Precision::F32);
    let mut samples = 0.0;
    let names = crate::sampled::sampled(12);
    for &name in &names {
        let render = |sampling| {
            let size = Size { width: 240, height: 135 };
            picture(&cpu, &builtin(name), None, &RenderSettings { size, ..settings(2, sampling) }, None)
        };
        let ((adaptive, few), (full, all)) = (render(Sampling::Adaptive), render(Sampling::Full));
        let (off, mean) = difference(&adaptive, &full);
        println!("{name}: {:.4} % off by more than 2, {mean:.3} on average, {few:?}", 100.0 * off);
        assert!(off < 0.005 && mean < 0.3, "{name}: {off}, {mean}");
        assert!(few.rays < all.rays * 3 / 4 && few.estimates < all.estimates, "{name}: {few:?}");
        samples += few.rays as f64 / all.rays as f64;
    }
    let mean = samples / names.len() as f64;
    assert!(mean < 0.6, "{mean} of all samples");
}

#[test]
fn only_edges_are_refined() {
    // Nothing to see but the smooth background.
    let cpu = Cpu::new(Precision::F32);
    let away = Camera { target: [0.0, -10.0, 0.0], ..CAMERA };
    let (_, stats) = picture(&cpu, &ball(), Some(away), &settings(4, Sampling::Adaptive), None);
    assert_eq!((stats.rays, stats.refined), (u64::from(SIZE.width * SIZE.height), 0));
    // The outline of a ball, two pixels wide, and where light changes fastest.
    let radius = 1.0 / (24f64.sqrt() * 0.25f64.tan()) * f64::from(SIZE.height) / 2.0;
    let (image, stats) = picture(&cpu, &ball(), Some(CAMERA), &settings(4, Sampling::Adaptive), None);
    let (full, _) = picture(&cpu, &ball(), Some(CAMERA), &settings(4, Sampling::Full), None);
    assert!(stats.refined as f64 > 2.0 * std::f64::consts::TAU * radius, "{stats:?}");
    assert!((stats.refined as f64) < 0.4 * f64::from(SIZE.width * SIZE.height), "{stats:?}");
    assert!(difference(&image, &full).0 < 0.003);
}

#[test]
fn renders_stop_when_they_are_told_to() {
    let formula = builtin("mandelbulb");
    let subject = formula.subject();
    let settings = settings(2, Sampling::Adaptive);
    let pipeline = compose_pipeline(&subject.composer(), &settings).unwrap();
    let cpu = Cpu::new(Precision::F32);
    let mut renderer = Renderer::new(&cpu, subject.arena, &pipeline, &settings).unwrap();
    renderer.cut = Cut { band: 8, tile: 8, rays: 64 };
    let mut told = Vec::new();
    assert!(
        renderer
            .render(&mut |share| {
                told.push(share);
                true
            })
            .unwrap()
            .is_some()
    );
    assert!(told.is_sorted() && told[0] < 0.1 && told[told.len() / 2] > 0.2 && told.last() == Some(&1.0), "{told:?}");
    assert!(renderer.render(&mut |share| share < 0.5).unwrap().is_none());
    let mut bands = 0;
    let mut sink = |rows: Vec<u8>| {
        assert_eq!(rows.len(), 8 * SIZE.width as usize * 3);
        bands += 1;
        bands < 3
    };
    assert!(!renderer.render_rows(&mut sink, &mut |_| true).unwrap());
    assert_eq!(bands, 3);
}

fn decode(path: &Path) -> (u32, u32, Vec<u8>) {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    assert_eq!(info.color_type, png::ColorType::Rgb);
    (info.width, info.height, bytes)
}

#[test]
fn files_depend_on_the_picture_alone() {
    let folder = folder();
    let (image, _) =
        picture(&Cpu::new(Precision::F32), &builtin("mandelbox"), None, &settings(1, Sampling::Full), None);
    let whole = folder.path().join("whole.png");
    image.write_png(&whole).unwrap();
    assert_eq!(decode(&whole), (SIZE.width, SIZE.height, image.rgb.clone()));
    for rows in [1, 7, 60] {
        let path = folder.path().join("parts.png");
        let mut file = PngFile::new(&path, SIZE);
        assert!(image.rgb.chunks(rows * SIZE.width as usize * 3).all(|rows| file.push(rows.to_vec())));
        file.finish().unwrap();
        assert!(std::fs::read(&path).unwrap() == std::fs::read(&whole).unwrap(), "{rows} rows at a time");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
}

#[test]
fn unfinished_files_leave_the_old_one() {
    let folder = folder();
    let path = folder.path().join("picture.png");
    std::fs::write(&path, "old").unwrap();
    let row = vec![0; SIZE.width as usize * 3];
    let mut broken_off = PngFile::new(&path, SIZE);
    assert!(broken_off.push(row.clone()));
    drop(broken_off);
    let mut short = PngFile::new(&path, SIZE);
    assert!(short.push(row.clone()));
    assert!(short.finish().unwrap_err().to_string().contains("too few rows"));
    let mut long = PngFile::new(&path, SIZE);
    let pushed = (0..SIZE.height + 9).all(|_| long.push(row.clone()));
    assert!(!pushed && long.finish().unwrap_err().to_string().contains("too many rows"));
    let mut nowhere = PngFile::new(&folder.path().join("no folder/picture.png"), SIZE);
    while nowhere.push(row.clone()) {}
    assert_eq!(nowhere.finish().unwrap_err().kind(), std::io::ErrorKind::NotFound);
    assert_eq!(std::fs::read(&path).unwrap(), b"old");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

/// Runs `render` and gives its JSON.
fn rendered(folder: &Path, arguments: &[&str]) -> serde_json::Value {
    let output = program(folder)
        .args(["render", "--backend", "cpu", "--json", "--calibrate", "off", "--force"])
        .args(arguments)
        .env("BULBFOLD_CACHE", folder)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[cfg(target_os = "linux")]
#[test]
fn memory_does_not_grow_with_the_picture() {
    let folder = folder();
    std::fs::write(folder.path().join("ball.ron"), BALL).unwrap();
    let peak = |size: &str, samples: &str| {
        // Each thread has columns of its own.
        let ball = ["ball.ron", "-o", "ball.png", "--size", size, "--samples", samples, "--threads", "2"];
        let json = rendered(folder.path(), &ball);
        json["peak_memory_bytes"].as_f64().unwrap() / f64::from(1 << 20)
    };
    // As many bands as there can be at the same time, and 72 MiB of picture.
    let (small, large) = (peak("16384x320", "1"), peak("16384x1536", "1"));
    println!("{small:.0} MiB and {large:.0} MiB");
    assert!(large < 200.0 && large < small + 30.0, "{small:.0} MiB, then {large:.0} MiB");
    let bytes = std::fs::read(folder.path().join("ball.png")).unwrap();
    assert_eq!(bytes[16..24], [0, 0, 0x40, 0, 0, 0, 0x06, 0]);
}

#[test]
fn the_command_tells_samples_and_stages() {
    let folder = folder();
    let small = ["mandelbulb", "-o", "bulb.png", "--size", "80x60", "--samples", "3"];
    let adaptive = rendered(folder.path(), &small);
    let full = rendered(folder.path(), &[&small[..], &["--sampling", "full"]].concat());
    assert_eq!(full["samples_per_pixel"], 9.0);
    assert_eq!(full["refined"], 80 * 60);
    let samples = adaptive["samples_per_pixel"].as_f64().unwrap();
    assert!(1.0 < samples && samples < 7.0, "{samples}");
    let refined = adaptive["refined"].as_f64().unwrap();
    assert!((samples - (1.0 + 8.0 * refined / 4800.0)).abs() < 1e-9, "{samples} with {refined} refined");
    for stage in ["march", "shadows", "shading", "results", "encoding"] {
        assert!(full["stage_seconds"][stage].as_f64().unwrap() > 0.0, "{stage}");
    }
}

/// Orbits of a march end where their detail is below a pixel, so a higher limit costs next to nothing and moves no surface.
/// Orbits that go on to the limit take half as many iterations again with 40 as with 20, those of proofs up to 60 times as many.
#[test]
fn iterations_that_no_pixel_shows_cost_nothing() {
    let folder = folder();
    let carried =
        [("mandelbulb", "gradient"), ("mandelbulb", "jacobian"), ("mandelbox", "scalar"), ("box_bulb", "combined")];
    // By a derivative that is carried for that alone: the scalar rules', or along the ray for gnarled_box, whose rules
    // grow faster than its orbits.
    let beside = [
        ("menger", "certified-ball"),
        ("mandelbulb", "certified-ball"),
        ("box_bulb", "certified"),
        ("mandelbox", "certified"),
        ("mandelbox", "delta"),
        ("gnarled_box", "delta"),
        ("gnarled_box", "scalar"),
        ("gnarled_box", "certified"),
    ];
    for (name, method) in carried.into_iter().chain(beside) {
        let [low, high] = ["20", "40"].map(|limit| {
            let limit = format!("max_iterations={limit}");
            let small = ["-o", "a.png", "--size", "160x120", "--samples", "1", "--de", method];
            let json = rendered(folder.path(), &[&[name, "--set", &limit], &small[..]].concat());
            let number = |key: &str| json[key].as_f64().unwrap_or_else(|| panic!("{key} in {json}"));
            let iterations = json["estimates_per_pixel"]["primary"].as_f64().unwrap() * number("iterations_mean");
            (iterations, number("hits"))
        });
        assert!(high.0 < 1.1 * low.0, "{name} by {method}: {} iterations a pixel, then {}", low.0, high.0);
        assert!((high.1 - low.1).abs() < 0.01 * low.1, "{name} by {method}: {} hits, then {}", low.1, high.1);
    }
}

/// Proofs get stuck at an eighth of this one's hits and walk on in small steps, which tell nothing of the place. A picture
/// whose occlusion counted all of them was a tenth darker.
#[test]
fn proofs_are_as_bright_as_estimates() {
    let folder = folder();
    let light = |method: &str| {
        let small = ["quick_dudley", "-o", "dudley.png", "--size", "96x72", "--samples", "1", "--de", method];
        rendered(folder.path(), &small);
        let (_, _, bytes) = decode(&folder.path().join("dudley.png"));
        bytes.iter().map(|byte| f64::from(*byte)).sum::<f64>()
    };
    let ratio = light("certified") / light("gradient");
    assert!((0.94..1.03).contains(&ratio), "{ratio}");
}

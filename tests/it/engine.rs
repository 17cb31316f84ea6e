//! The engine as other programs call it: the same picture as the command's, jobs that travel, work that can be ended.

use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::mpsc::channel;
use std::time::Instant;

use bulbfold::engine::{BackendChoice, CameraChange, Engine, Error, Formula, Job, Observer, Request, Stage};
use bulbfold::film::{Image, Rows};
#[cfg(feature = "gpu")]
use bulbfold::kernel::gpu::{AdapterWanted, Gpu};
use bulbfold::shade::Size;

const SIZE: Size = Size { width: 96, height: 54 };

fn request() -> Request {
    Request { size: SIZE, backend: BackendChoice::Cpu, ..Request::default() }
}

/// The pixels of the picture that the command makes of a formula.
fn commanded(folder: &Path, arguments: &[&str]) -> Vec<u8> {
    let output = folder.join("command.png");
    let mut command = Command::new(env!("CARGO_BIN_EXE_bulbfold"));
    command.args(["render", "-q", "--backend", "cpu", "--size", "96x54", "--force", "-o"]).arg(&output).args(arguments);
    assert!(command.current_dir(folder).status().unwrap().success());
    crate::support::pixels(&output)
}

/// A picture in memory, by rows from the top.
fn rendered(engine: &Engine, job: &Job, cuts: &[u32]) -> Image {
    let mut image = Image { size: job.size(), rgb: Vec::new() };
    let (mut first, height) = (0, job.size().height);
    for end in cuts.iter().copied().chain([height]) {
        engine.render(job, first..end, &mut image, &mut ()).unwrap();
        first = end;
    }
    image
}

#[test]
fn pictures_are_those_of_the_command() {
    let folder = tempfile::tempdir().unwrap();
    let engine = Engine::new();
    let turned =
        CameraChange { position: Some([1.5, -2.0, 1.0]), fov: Some(30_f64.to_radians()), ..Default::default() };
    for (name, camera, arguments) in [
        ("mandelbulb", CameraChange::default(), &["mandelbulb"][..]),
        ("menger", CameraChange::default(), &["menger"]),
        ("mandelbulb", turned, &["mandelbulb", "--camera", "1.5,-2,1", "--fov", "30"]),
    ] {
        let formula = engine.open(name).unwrap();
        let image = engine.picture(&formula, &Request { camera, ..request() }, &mut ()).unwrap();
        let path = folder.path().join("engine.png");
        image.write_png(&path).unwrap();
        assert!(crate::support::pixels(&path) == commanded(folder.path(), arguments), "{name}");
    }
}

#[test]
fn jobs_travel_as_text_and_their_rows_join() {
    let folder = tempfile::tempdir().unwrap();
    // A step that no other machine has.
    std::fs::write(
        folder.path().join("lean.rhai"),
        "fn step(z, c, p) { vec3(z.x + p.by * z.y, z.y, z.z) }\nfn derivative(z, dr, p) { dr * (1.0 + abs(p.by)) }\n\
         #{ group: \"transform\", summary: \"Leans.\", source: \"A test\", growth: \"linear\", scalar_rule: \"exact\",\n\
         params: [#{ name: \"by\", type: \"float\", \"default\": 0.1, min: -1.0, max: 1.0, unit: \"\", help: \"How far.\" }], examples: [] }\n",
    )
    .unwrap();
    let file = folder.path().join("leaning.ron");
    let graph = r#"(nodes: { "lean": lean(by: 0.2), "bulb": bulb_power(power: 8), "map": Sequence(["lean", "bulb"]) },
        output: "map", escape_radius: 10)"#;
    std::fs::write(&file, graph).unwrap();
    let engine = Engine::new();
    let set = [("lean.by".to_string(), "0.15".to_string())];
    for formula in [engine.open_with(&file, &set).unwrap(), engine.open("box_bulb").unwrap()] {
        let job = engine.settle(&formula, &request(), &mut ()).unwrap();
        let whole = rendered(&engine, &job, &[]);
        assert!(whole.rgb.chunks(3).any(|pixel| pixel != &whole.rgb[..3]), "the picture shows something");
        for text in [serde_json::to_string(&job).unwrap(), ron::to_string(&job).unwrap()] {
            let sent: Job = match text.starts_with('{') {
                true => serde_json::from_str(&text).unwrap(),
                false => ron::from_str(&text).unwrap(),
            };
            // Another engine knows nothing of the folder, and cuts the picture elsewhere.
            assert!(sent.plan == job.plan && sent.camera == job.camera);
            assert!(rendered(&Engine::new(), &sent, &[7, 8, 31]) == whole);
        }
    }
}

#[test]
fn a_broken_bundle_says_where() {
    let engine = Engine::new();
    let job = engine.settle(&engine.open("menger").unwrap(), &request(), &mut ()).unwrap();
    let text = serde_json::to_string(&job).unwrap().replace("escape_radius", "escape_radios");
    let error = serde_json::from_str::<Job>(&text).err().expect("the formula is broken").to_string();
    assert!(error.contains("escape_radios") && error.contains("menger.ron"), "{error}");
}

/// Remembers what it is told, and ends the work at a share.
#[derive(Default)]
struct Ends {
    at: f64,
    shares: Vec<f64>,
}

impl Observer for Ends {
    fn progress(&mut self, stage: Stage, share: f64) {
        if stage == Stage::Rendering {
            self.shares.push(share);
        }
    }

    fn is_cancelled(&self) -> bool {
        self.shares.last().is_some_and(|share| *share >= self.at)
    }
}

#[test]
fn work_ends_where_its_observer_says() {
    let engine = Engine::new();
    let formula = engine.open("mandelbulb").unwrap();
    let large = Request { size: Size { width: 640, height: 360 }, ..request() };
    let job = engine.settle(&formula, &large, &mut ()).unwrap();
    let mut image = Image { size: job.size(), rgb: Vec::new() };
    let mut ends = Ends { at: 0.2, ..Ends::default() };
    assert!(matches!(engine.render(&job, job.rows(), &mut image, &mut ends), Err(Error::Cancelled)));
    assert!(ends.shares.iter().all(|share| *share < 0.6), "{:?}", ends.shares);
    let mut all = Ends { at: 2.0, ..Ends::default() };
    assert!(engine.render(&job, job.rows(), &mut image, &mut all).is_ok());
    assert_eq!(all.shares.last(), Some(&1.0));
    assert!(matches!(engine.render(&job, 3..361, &mut image, &mut ()), Err(Error::Request { .. })));
}

#[test]
fn numbers_that_have_moved_before_compile_nothing() {
    moved_numbers_compile_nothing(BackendChoice::Cpu, Engine::new().keeping_kernels());
}

#[cfg(feature = "gpu")]
#[test]
fn numbers_that_have_moved_before_compile_nothing_on_the_gpu() {
    match Gpu::new(AdapterWanted::Any) {
        Ok(gpu) => {
            moved_numbers_compile_nothing(BackendChoice::Gpu, Engine::new().keeping_kernels().with_gpu(gpu));
        }
        Err(error) => {
            assert!(std::env::var("BULBFOLD_REQUIRE_GPU").as_deref() != Ok("1"), "{error}");
            println!("skipped: {error}");
        }
    }
}

fn moved_numbers_compile_nothing(backend: BackendChoice, engine: Engine) {
    let formula = engine.open("mandelbulb").unwrap();
    let request = Request { calibrate: false, backend, ..request() };
    let job = engine.settle(&formula, &request, &mut ()).unwrap();
    let base = job.camera.expect("a solid has a camera");
    let turned = |angle: f64| {
        let change = CameraChange { turn: Some(angle), ..CameraChange::default() };
        job.with_camera(change.apply(base).unwrap())
    };
    let angles = [0.0, 0.3, 0.6, 0.9, 1.2];
    for angle in angles {
        let kept = rendered(&engine, &turned(angle), &[]);
        let off =
            kept.rgb.iter().zip(&rendered(&Engine::new(), &turned(angle), &[]).rgb).filter(|(a, b)| a != b).count();
        // A driver may fold a constant where it cannot fold a uniform.
        let may = if backend == BackendChoice::Gpu { kept.rgb.len() / 100 } else { 0 };
        assert!(off <= may, "kernels of its own make the same picture: {off} bytes differ");
    }
    let compiled = engine.backends().compiled();
    // Each frame by itself takes some ten.
    assert!((10..30).contains(&compiled), "{compiled}");
    angles.iter().for_each(|&angle| drop(rendered(&engine, &turned(angle), &[])));
    assert_eq!(engine.backends().compiled(), compiled);
}

#[test]
fn running_jobs_can_be_cancelled_and_the_engine_goes_on() {
    let engine = Arc::new(Engine::new().keeping_kernels());
    let formula = engine.open("mandelbulb").unwrap();
    let large = Request { size: Size { width: 4096, height: 4096 }, samples: 16, calibrate: false, ..request() };
    let job = engine.settle(&formula, &large, &mut ()).unwrap();
    let (sender, began) = channel();
    let told = move |rows: Rows| {
        let _ = sender.send(rows.srgb.len());
        Ok(())
    };
    let running = engine.start(job, 0..4096, told, ());
    began.recv().expect("rows come");
    running.cancel();
    let asked = Instant::now();
    let (_, done) = running.join();
    println!("the job ended {:?} after it was asked to", asked.elapsed());
    assert!(matches!(done, Err(Error::Cancelled)));
    let small = engine.settle(&formula, &request(), &mut ()).unwrap();
    assert_eq!(rendered(&engine, &small, &[]).rgb.len(), 96 * 54 * 3);
}

#[test]
fn errors_of_requests_say_what_to_do() {
    let engine = Engine::new();
    let formula = engine.open("mandelbulb").unwrap();
    let error = |request: &Request| engine.settle(&formula, request, &mut ()).err().expect("it fails").to_string();
    let camera = CameraChange { position: Some([0.0; 3]), target: Some([0.0; 3]), ..CameraChange::default() };
    assert!(error(&Request { camera, ..request() }).contains("one line"));
    let broken = engine.read("mine.ron", "(nodes: { \"a\": bulb_pover() })", &[]).err().expect("there is no such step");
    assert!(broken.to_string().contains("mine.ron:1:16") && broken.to_string().contains("bulb_power"), "{broken}");
    assert!(engine.open("no_such_fractal").is_err());
}

#[test]
fn everything_goes_between_threads() {
    fn shared<T: Send + Sync>() {}
    shared::<Engine>();
    shared::<Formula>();
    shared::<Job>();
    shared::<Request>();
}

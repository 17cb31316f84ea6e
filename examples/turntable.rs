//! An animation: frames around a fractal, whose kernels are compiled once. `cargo run --release --example turntable -- menger 24`

use bulbfold::engine::{CameraChange, Engine, Request};
use bulbfold::film::Image;
use bulbfold::shade::Size;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let what = arguments.next().unwrap_or("menger".into());
    let frames: u32 = arguments.next().map_or(Ok(12), |text| text.parse())?;
    let engine = Engine::new().keeping_kernels();
    let request = Request { size: Size { width: 320, height: 180 }, ..Request::default() };
    let job = engine.settle(&engine.open(&what)?, &request, &mut ())?;
    let camera = job.camera.ok_or("pictures of a plane have no camera")?;
    for frame in 0..frames {
        let angle = std::f64::consts::TAU * f64::from(frame) / f64::from(frames);
        let turned = CameraChange { turn: Some(angle), ..CameraChange::default() }.apply(camera)?;
        let mut image = Image { size: request.size, rgb: Vec::new() };
        engine.render(&job.with_camera(turned), job.rows(), &mut image, &mut ())?;
        image.write_png(format!("turn_{frame:04}.png").as_ref())?;
    }
    println!("{frames} frames, {} kernels compiled", engine.backends().compiled());
    Ok(())
}

//! A picture in ten lines: `cargo run --release --example render -- mandelbulb bulb.png`

use bulbfold::engine::{Engine, Request};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let what = arguments.next().unwrap_or("mandelbulb".into());
    let engine = Engine::new();
    let image = engine.picture(&engine.open(&what)?, &Request::default(), &mut ())?;
    println!("{} bytes of RGBA", image.rgba().len());
    Ok(image.write_png(arguments.next().unwrap_or("picture.png".into()).as_ref())?)
}

//! Distances for another program: a grid of them as CSV on stdout. `cargo run --release --example distances -- mandelbox 16`

use bulbfold::engine::Engine;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let what = arguments.next().unwrap_or("mandelbulb".into());
    let edge: u32 = arguments.next().map_or(Ok(8), |text| text.parse())?;
    let formula = Engine::new().open(&what)?;
    let radius = formula.plan().bounding_radius;
    let at = |i: u32| radius * (2.0 * (f64::from(i) + 0.5) / f64::from(edge) - 1.0);
    let grid = || 0..edge;
    let points: Vec<[f64; 3]> =
        grid().flat_map(|x| grid().flat_map(move |y| grid().map(move |z| [at(x), at(y), at(z)]))).collect();
    println!("x,y,z,distance");
    for ([x, y, z], distance) in points.iter().zip(formula.estimates(&points)) {
        println!("{x},{y},{z},{distance}");
    }
    Ok(())
}

use bulbfold::*;
fn main() {
    for file in std::env::args().skip(1) {
        let mut library = formula::library::Library::builtin();
        let mut d = diag::Diagnostics::default();
        let loaded = load::load(&mut library, &file, &[], &mut d);
        let Some(loaded) = loaded else {
            print!("{}", d.render(&library.sources, false));
            continue;
        };
        let arena = std::rc::Rc::new(expr::Arena::default());
        let composer = compose::Composer { arena: &arena, library: &library, graph: &loaded.graph };
        for (w, h) in [(64, 48), (200, 150)] {
            let settings = render::RenderSettings { size: shade::Size { width: w, height: h }, ..Default::default() };
            let pipeline = render::compose_pipeline(&composer, &settings).unwrap();
            let pixels: Vec<(u32, u32)> = (0..h).flat_map(|y| (0..w).map(move |x| (x, y))).collect();
            let run = |p| {
                let cpu = kernel::cpu::Cpu::new(p);
                render::Renderer::new(&cpu, &arena, &pipeline, &settings).unwrap().depths(&pixels).unwrap()
            };
            let a = run(kernel::cpu::Precision::F64);
            let b = run(kernel::cpu::Precision::F32);
            let (mut bad, mut hm, mut hits) = (0, 0, 0);
            for (x, y) in a.iter().zip(&b) {
                match (x, y) {
                    (Some(x), Some(y)) => {
                        hits += 1;
                        if (x - y).abs() > pipeline.pixel_radius * x {
                            bad += 1
                        }
                    }
                    (None, None) => {}
                    _ => hm += 1,
                }
            }
            println!(
                "{file} {w}x{h}: hits {hits} depth differs {bad} hit/miss differs {hm} = {:.3} % of {}",
                100.0 * (bad + hm) as f64 / a.len() as f64,
                a.len()
            );
        }
    }
}

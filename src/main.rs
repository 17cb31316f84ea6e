use bulbfold::*;
fn main() {
    let file = std::env::args().nth(1).unwrap();
    let precision = if std::env::args().nth(2).as_deref() == Some("f64") {
        kernel::cpu::Precision::F64
    } else {
        kernel::cpu::Precision::F32
    };
    let mut library = formula::library::Library::builtin();
    let text = std::fs::read_to_string(&file).unwrap();
    let id = library.sources.add(&*file, text);
    let mut d = diag::Diagnostics::default();
    let value = formula::ron::read_ron(&library.sources, id, &Default::default(), &mut d);
    let graph = value.and_then(|v| graph::read(&library, &v, "x", &[], &mut d));
    print!("{}", d.render(&library.sources, false));
    let graph = graph.unwrap();
    let arena = std::rc::Rc::new(expr::Arena::default());
    let composer = compose::Composer { arena: &arena, library: &library, graph: &graph };
    let settings = render::RenderSettings { size: shade::Size { width: 640, height: 480 }, ..Default::default() };
    let t = std::time::Instant::now();
    let pipeline = match render::compose_pipeline(&composer, &settings) {
        Ok(p) => p,
        Err(e) => {
            let mut d = diag::Diagnostics::default();
            d.push(e);
            print!("{}", d.render(&library.sources, false));
            return;
        }
    };
    println!("compose {:?} nodes {}", t.elapsed(), arena.len());
    println!("{:?}", pipeline.plan);
    let cpu = kernel::cpu::Cpu::new(precision);
    println!("{}", cpu.description());
    let mut r = render::Renderer::new(&cpu, &arena, &pipeline, &settings).unwrap();
    let image = r.render(&mut |_| true).unwrap().unwrap();
    println!("{:?}", r.stats);
    image.write_png(std::path::Path::new("/tmp/out.png")).unwrap();
}

//! Files of pictures: formats, depths, layers, coverage, and which of them are replaced.

use std::io::BufReader;
use std::path::Path;

use bulbfold::engine::{BackendChoice, Engine, Request, Sink};
use bulbfold::film::{Layer, Layers, Rows, read_made};
use bulbfold::shade::Size;

use crate::support::{bulbfold, folder, folder_with, pixels, stderr, success};

/// A ball whose every number is known: radius 0.5, seen from 3 away.
const BALL: &str = r#"(
    nodes: { "ball": Sphere(radius: 0.5) },
    output: "ball",
    camera: (position: (0.0, -3.0, 0.0), fov: 30.0),
    look: (palette: [(0.6, 0.3, 0.1)], occlusion: 0.0, shadows: false, background: [(0.1, 0.2, 0.3), (0.1, 0.2, 0.3)]),
)"#;
/// How pictures of it are rendered.
const QUICK: [&str; 6] = ["-q", "--backend", "cpu", "--calibrate", "off", "--size"];

fn render(folder: &Path, formula: &str, size: &str, arguments: &[&str]) {
    let first = ["render", formula].into_iter().chain(QUICK).chain([size]);
    success(&bulbfold(folder, first.chain(arguments.iter().copied())));
}

/// The numbers of an EXR file's channel.
fn channel(path: &Path, name: &str) -> Vec<f32> {
    use exr::prelude::{ReadChannels, ReadLayers};
    let read = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer();
    let image = read.all_attributes().from_file(path).unwrap();
    let channels = &image.layer_data.channel_data.list;
    let found = channels.iter().find(|channel| channel.name.to_string() == name);
    let names: Vec<String> = channels.iter().map(|channel| channel.name.to_string()).collect();
    found.unwrap_or_else(|| panic!("no {name} among {names:?}")).sample_data.values_as_f32().collect()
}

/// The names of an EXR file's channels.
fn channels(path: &Path) -> Vec<String> {
    let meta = exr::meta::MetaData::read_from_file(path, true).unwrap();
    meta.headers[0].channels.list.iter().map(|channel| channel.name.to_string()).collect()
}

/// Light as the film shows it where files say nothing: a byte that is not rounded.
fn developed(radiance: f64) -> f64 {
    let x = 0.62 * radiance;
    let shown = (x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)).clamp(0.0, 1.0);
    255.0 * if shown <= 0.003_130_8 { shown * 12.92 } else { 1.055 * shown.powf(1.0 / 2.4) - 0.055 }
}

#[test]
fn one_render_goes_into_files_of_all_formats() {
    let folder = folder_with(&[("ball.ron", BALL)]);
    let names = ["a.png", "a.tif", "a.webp", "a.jpg", "a.exr", "a.hdr"];
    let arguments: Vec<&str> = names.iter().flat_map(|name| ["-o", name]).collect();
    render(folder.path(), "ball.ron", "64x48", &arguments);
    let at = |name: &str| folder.path().join(name);
    let png = pixels(&at("a.png"));
    let mut tiff = tiff::decoder::Decoder::new(std::fs::File::open(at("a.tif")).unwrap()).unwrap();
    let tiff::decoder::DecodingResult::U8(bytes) = tiff.read_image().unwrap() else { panic!("not bytes") };
    assert!(bytes == png, "TIFF");
    let mut webp = image_webp::WebPDecoder::new(BufReader::new(std::fs::File::open(at("a.webp")).unwrap())).unwrap();
    let mut bytes = vec![0; webp.output_buffer_size().unwrap()];
    webp.read_image(&mut bytes).unwrap();
    assert!(bytes == png, "WebP");
    let jpeg = image::ImageReader::open(at("a.jpg")).unwrap().decode().unwrap().to_rgb8().into_raw();
    let error: f64 = jpeg.iter().zip(&png).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / png.len() as f64;
    assert!(error < 3.0, "JPEG is off by {error} on average");
    let hdr = image::ImageReader::open(at("a.hdr")).unwrap().decode().unwrap().to_rgb32f().into_raw();
    for (k, name) in ["R", "G", "B"].into_iter().enumerate() {
        let light = channel(&at("a.exr"), name);
        for (i, light) in light.iter().enumerate() {
            let shown = developed(f64::from(*light));
            assert!((shown - f64::from(png[3 * i + k])).abs() < 0.51, "{name} of pixel {i}: {light}");
            assert!((light - hdr[3 * i + k]).abs() <= 0.02, "{name} of pixel {i}: {light} and {}", hdr[3 * i + k]);
        }
    }
    // All of them say the same of how they were made.
    let made = names.map(|name| read_made(&at(name)).unwrap_or_else(|error| panic!("{name}: {error}")));
    assert!(made[0].key.is_some() && made[0].recipe.as_ref().is_some_and(|text| text.contains("Sphere")));
    assert!(made.iter().all(|other| other == &made[0]));
}

#[test]
fn layers_hold_what_is_known_of_a_ball() {
    let folder = folder_with(&[("ball.ron", BALL)]);
    let exr = folder.path().join("ball.exr");
    let all = "alpha,depth,position,normal,albedo,trap,iterations,steps,confidence";
    render(
        folder.path(),
        "ball.ron",
        "65x65",
        &["-o", "ball.exr", "--layers", all, "--sampling", "full", "--samples", "3"],
    );
    let middle = 32 * 65 + 32;
    let at = |name: &str, pixel: usize| f64::from(channel(&exr, name)[pixel]);
    let near = |name: &str, pixel: usize, expected: f64| {
        let found = at(name, pixel);
        assert!((found - expected).abs() < 0.01, "{name}: {found} instead of {expected}");
    };
    near("Z", middle, 2.5);
    [("P.X", 0.0), ("P.Y", -0.5), ("P.Z", 0.0)].into_iter().for_each(|(name, x)| near(name, middle, x));
    [("N.X", 0.0), ("N.Y", -1.0), ("N.Z", 0.0)].into_iter().for_each(|(name, x)| near(name, middle, x));
    [("albedo.R", 0.6), ("albedo.G", 0.3), ("albedo.B", 0.1)].into_iter().for_each(|(name, x)| near(name, middle, x));
    assert!(at("steps.Y", middle) >= 1.0);
    // The corner shows nothing.
    let corner = [("coverage.A", 0.0), ("N.X", 0.0), ("albedo.R", 0.0), ("P.Y", 0.0)];
    corner.into_iter().for_each(|(name, x)| near(name, 0, x));
    assert_eq!(channel(&exr, "Z")[0], 1e10);
    // A ball of radius r seen from d away is a disk of the tangent of its angle.
    let covered: f32 = channel(&exr, "coverage.A").iter().sum();
    let radius = (0.5_f64 / 3.0).asin().tan() / 15.0_f64.to_radians().tan() * 32.5;
    let area = std::f64::consts::PI * radius * radius;
    assert!((f64::from(covered) / area - 1.0).abs() < 0.01, "{covered} pixels are covered, not {area}");
    // Every other pixel of the disk points away from the centre of the ball.
    let (x, y, z) = (channel(&exr, "P.X"), channel(&exr, "P.Y"), channel(&exr, "P.Z"));
    let hits =
        channel(&exr, "coverage.A").iter().enumerate().filter(|(_, a)| **a == 1.0).map(|(i, _)| i).collect::<Vec<_>>();
    assert!(hits.len() > 500);
    for i in hits {
        let length = (x[i] * x[i] + y[i] * y[i] + z[i] * z[i]).sqrt();
        assert!((length - 0.5).abs() < 0.005, "pixel {i} lies {length} from the centre");
    }
}

#[test]
fn only_layers_that_are_asked_for_are_there() {
    let folder = folder_with(&[("ball.ron", BALL)]);
    let path = folder.path().join("a.exr");
    render(folder.path(), "ball.ron", "16x12", &["-o", "a.exr"]);
    let usual = ["B", "G", "N.X", "N.Y", "N.Z", "R", "Z", "albedo.B", "albedo.G", "albedo.R", "coverage.A"];
    assert_eq!(channels(&path), usual);
    render(folder.path(), "ball.ron", "16x12", &["-o", "a.exr", "--layers", "none"]);
    assert_eq!(channels(&path), ["B", "G", "R"]);
    render(folder.path(), "ball.ron", "16x12", &["-o", "a.exr", "--layers", "depth", "--transparent"]);
    assert_eq!(channels(&path), ["A", "B", "G", "R", "Z"]);
}

#[test]
fn layers_of_all_back_ends_agree() {
    struct Numbers(Layers, Vec<f32>);
    impl Sink for Numbers {
        fn layers(&self) -> Layers {
            self.0
        }
        fn push(&mut self, rows: Rows) -> std::io::Result<()> {
            assert_eq!(rows.data.len(), rows.srgb.len() / 3 * self.0.data().channels());
            self.1.extend(rows.data);
            Ok(())
        }
    }
    let engine = Engine::new();
    let formula = engine.open("mandelbulb").unwrap();
    let layers: Layers = [Layer::Alpha, Layer::Depth, Layer::Normal, Layer::Albedo].into_iter().collect();
    let numbers = |backend| {
        let size = Size { width: 48, height: 27 };
        let request = Request { size, samples: 2, backend, calibrate: false, layers, ..Request::default() };
        let job = engine.settle(&formula, &request, &mut ()).unwrap();
        let mut sink = Numbers(layers, Vec::new());
        engine.render(&job, job.rows(), &mut sink, &mut ()).map(|_| sink.1)
    };
    let cpu = numbers(BackendChoice::Cpu).unwrap();
    assert_eq!(cpu.len(), 48 * 27 * layers.channels());
    let gpu = match numbers(BackendChoice::Gpu) {
        Ok(gpu) => gpu,
        Err(error) => {
            assert!(std::env::var_os("BULBFOLD_REQUIRE_GPU").is_none(), "{error}");
            eprintln!("skipped: {error}");
            return;
        }
    };
    let differs = |(a, b): &(&f32, &f32)| (*a - *b).abs() > 0.02 * a.abs().max(1.0);
    let off = cpu.iter().zip(&gpu).filter(differs).count();
    assert!(off * 200 < cpu.len(), "{off} of {} numbers differ", cpu.len());
    // What the request leaves out cannot be had.
    let plain = Request { size: Size { width: 8, height: 6 }, calibrate: false, ..Request::default() };
    let job = engine.settle(&formula, &plain, &mut ()).unwrap();
    let refused = engine.render(&job, job.rows(), &mut Numbers(layers, Vec::new()), &mut ());
    assert!(refused.err().unwrap().to_string().contains("alpha"));
}

#[test]
fn a_transparent_background_leaves_the_colours_of_edges() {
    let folder = folder_with(&[("ball.ron", BALL)]);
    let arguments =
        ["--transparent", "--sampling", "full", "--samples", "4", "-o", "a.png", "-o", "a.webp", "-o", "a.tif"];
    render(folder.path(), "ball.ron", "40x40", &arguments);
    let png = pixels(&folder.path().join("a.png"));
    assert_eq!(png.len(), 40 * 40 * 4);
    let pixel = |x: usize, y: usize| &png[(y * 40 + x) * 4..][..4];
    assert_eq!((pixel(0, 0)[3], pixel(20, 20)[3]), (0, 255));
    let partly = (0..40 * 40).filter(|i| (1..255).contains(&png[4 * i + 3])).count();
    assert!(partly > 20, "{partly} pixels are partly covered");
    // The background is blue, the ball brown: where the background has left something, blue is above red.
    let brown = |i: &usize| png[4 * i] > png[4 * i + 2];
    let covered: Vec<usize> = (0..40 * 40).filter(|i| png[4 * i + 3] > 8 && png[4 * i] > 30).collect();
    assert!(covered.len() > 200 && covered.iter().all(brown));
    let mut webp =
        image_webp::WebPDecoder::new(BufReader::new(std::fs::File::open(folder.path().join("a.webp")).unwrap()))
            .unwrap();
    assert!(webp.has_alpha());
    let mut bytes = vec![0; webp.output_buffer_size().unwrap()];
    webp.read_image(&mut bytes).unwrap();
    let shown = |bytes: &[u8]| bytes.chunks(4).filter(|p| p[3] > 0).map(<[u8]>::to_vec).collect::<Vec<_>>();
    assert!(shown(&bytes) == shown(&png));
    for (name, expected) in [("a.jpg", "transparent"), ("a.hdr", "transparent")] {
        let output = bulbfold(folder.path(), ["render", "ball.ron", "--transparent", "-o", name]);
        assert!(output.status.code() == Some(2) && stderr(&output).contains(expected), "{}", stderr(&output));
    }
}

#[test]
fn sixteen_bits_are_the_same_picture_finer() {
    let folder = folder_with(&[("ball.ron", BALL)]);
    render(folder.path(), "ball.ron", "32x24", &["-o", "a.png"]);
    render(folder.path(), "ball.ron", "32x24", &["-o", "b.png", "-o", "b.tif", "--depth", "16", "--dpi", "300"]);
    let bytes = pixels(&folder.path().join("a.png"));
    let file = std::fs::File::open(folder.path().join("b.png")).unwrap();
    let mut reader = png::Decoder::new(BufReader::new(file)).read_info().unwrap();
    assert_eq!(reader.info().bit_depth, png::BitDepth::Sixteen);
    assert_eq!(reader.info().pixel_dims.map(|dims| dims.xppu), Some(11811));
    let mut deep = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut deep).unwrap();
    let words: Vec<u16> = deep.chunks_exact(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]])).collect();
    let mut finer = 0;
    for (word, byte) in words.iter().zip(&bytes) {
        assert!((f64::from(*word) / 257.0 - f64::from(*byte)).abs() < 0.51, "{word} and {byte}");
        finer += usize::from(word % 257 != 0);
    }
    assert!(finer * 2 > words.len());
    let mut tiff = tiff::decoder::Decoder::new(std::fs::File::open(folder.path().join("b.tif")).unwrap()).unwrap();
    let tiff::decoder::DecodingResult::U16(same) = tiff.read_image().unwrap() else { panic!("not 16 bits") };
    assert!(same == words);
}

#[test]
fn films_of_files_and_flags_do_as_they_say() {
    let folder = folder_with(&[("ball.ron", BALL)]);
    let bytes = |arguments: &[&str]| {
        let all: Vec<&str> = arguments.iter().copied().chain(["--force", "-o", "a.png"]).collect();
        render(folder.path(), "ball.ron", "32x24", &all);
        pixels(&folder.path().join("a.png"))
    };
    let linear = |byte: u8| {
        let y = f64::from(byte) / 255.0;
        if y <= 0.04045 { y / 12.92 } else { ((y + 0.055) / 1.055).powf(2.4) }
    };
    let plain = bytes(&["--curve", "none"]);
    let brighter = bytes(&["--curve", "none", "--exposure", "1"]);
    assert!(brighter == bytes(&["--set", "film=(curve: none, exposure: 1)"]));
    // A stop is twice the light, of the background too.
    for (a, b) in plain.iter().zip(&brighter).filter(|(_, b)| **b < 255) {
        assert!((2.0 * linear(*a) - linear(*b)).abs() < 0.01, "{a} and {b}");
    }
    // Light of 3000 K that is to look white: the picture turns blue.
    let cold = bytes(&["--white-balance", "3000"]);
    let warm = bytes(&["--white-balance", "15000"]);
    let mean = |bytes: &[u8], k: usize| bytes.iter().skip(k).step_by(3).map(|&x| f64::from(x)).sum::<f64>();
    assert!(mean(&cold, 2) > 1.2 * mean(&warm, 2) && mean(&cold, 0) < 0.9 * mean(&warm, 0));
    let agx = bytes(&["--curve", "agx", "--exposure", "6"]);
    let filmic = bytes(&["--exposure", "6"]);
    // Bright brown goes to white by one curve and to yellow by the other.
    let colour = |bytes: &[u8]| bytes[(12 * 32 + 16) * 3..][..3].to_vec();
    let spread = |c: &[u8]| c.iter().max().unwrap() - c.iter().min().unwrap();
    assert!(spread(&colour(&agx)) < 40, "{:?}", colour(&agx));
    assert!(colour(&filmic) != colour(&agx));
    for (argument, expected) in [
        (["--exposure", "21"], "from -20 to 20"),
        (["--white-balance", "500"], "from 1667 to 25000"),
        (["--curve", "aces"], "none, filmic, agx"),
        (["--set", "film.exposer=1"], "exposure"),
        (["--set", "film.curve=aces"], "none, filmic, agx"),
        (["--depth", "12"], "8 or 16"),
        (["--layers", "deep"], "depth"),
        (["--layers", "depth"], "only EXR"),
    ] {
        let output = bulbfold(folder.path(), ["render", "ball.ron", "-q", argument[0], argument[1]]);
        assert!(output.status.code() == Some(2) && stderr(&output).contains(expected), "{}", stderr(&output));
    }
}

#[test]
fn display_p3_is_named_and_wider() {
    let folder = folder_with(&[("ball.ron", BALL)]);
    let names = ["p.png", "p.jpg", "p.tif", "p.webp"];
    let outputs: Vec<&str> = names.iter().flat_map(|name| ["-o", name]).chain(["--set", "film.encoding=p3"]).collect();
    render(folder.path(), "ball.ron", "32x24", &outputs);
    render(folder.path(), "ball.ron", "32x24", &["-o", "s.png"]);
    let bytes = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    let has = |bytes: &[u8], what: &[u8]| bytes.windows(what.len()).any(|window| window == what);
    assert!(has(&bytes("p.png"), b"cICP\x0c\x0d\x00\x01") && !has(&bytes("s.png"), b"cICP"));
    for name in &names[1..] {
        assert!(has(&bytes(name), b"D\0i\0s\0p\0l\0a\0y\0 \0P\x003") && has(&bytes(name), b"acsp"), "{name}");
    }
    // Brown is farther from the edge of the wider space: its bytes lie nearer to each other.
    let (p3, srgb) = (pixels(&folder.path().join("p.png")), pixels(&folder.path().join("s.png")));
    let spread = |bytes: &[u8]| {
        let colour = &bytes[(12 * 32 + 16) * 3..][..3];
        i32::from(colour[0]) - i32::from(colour[2])
    };
    assert!(spread(&p3) < spread(&srgb) && spread(&p3) > 20);
}

#[test]
fn what_is_no_picture_is_not_overwritten() {
    let folder = folder_with(&[("ball.ron", BALL)]);
    for name in ["a.png", "a.exr", "a.jpg", "a.webp", "a.tif", "a.hdr"] {
        let file = folder.path().join(name);
        let run = |more: &[&str]| {
            let first = ["render", "ball.ron"].into_iter().chain(QUICK).chain(["16x12", "-o", name]);
            bulbfold(folder.path(), first.chain(more.iter().copied()))
        };
        success(&run(&[]));
        let before = std::fs::read(&file).unwrap();
        success(&run(&[]));
        assert!(std::fs::read(&file).unwrap() == before, "{name}: the same picture has other bytes");
        // Another picture takes a name that was given.
        success(&run(&["--fov", "20"]));
        assert!(std::fs::read(&file).unwrap() != before);
        std::fs::write(&file, "notes").unwrap();
        assert!(stderr(&run(&[])).contains("is something else"));
        std::fs::write(&file, "").unwrap();
        success(&run(&[]));
    }
}

#[test]
fn folders_take_pictures_by_their_own_names() {
    let folder = folder();
    std::fs::create_dir(folder.path().join("out")).unwrap();
    render(folder.path(), "mandelbrot", "16x12", &["-o", "out/"]);
    assert_eq!(pixels(&folder.path().join("out/mandelbrot.png")).len(), 16 * 12 * 3);
    // Another picture takes another name, the same one the same.
    for size in ["8x6", "16x12", "8x6"] {
        render(folder.path(), "mandelbrot", size, &["-o", "out/"]);
    }
    assert_eq!(pixels(&folder.path().join("out/mandelbrot_2.png")).len(), 8 * 6 * 3);
    assert_eq!(std::fs::read_dir(folder.path().join("out")).unwrap().count(), 2);
    let twice = bulbfold(folder.path(), ["render", "mandelbrot", "-o", "a.png", "-o", "a.png"]);
    assert!(stderr(&twice).contains("named twice"));
    let plane = bulbfold(folder.path(), ["render", "mandelbrot", "-o", "a.png", "--transparent"]);
    assert!(stderr(&plane).contains("plane"), "{}", stderr(&plane));
}

#[test]
fn sweeps_write_any_format() {
    let folder = folder_with(&[("ball.ron", BALL)]);
    let sweep = ["--sweep", "film.exposure=0..1", "--frames", "2", "-o", "f%d.exr", "--layers", "depth"];
    render(folder.path(), "ball.ron", "16x12", &sweep);
    let (first, second) = (folder.path().join("f1.exr"), folder.path().join("f2.exr"));
    assert!(channel(&first, "R") == channel(&second, "R"), "light knows no exposure");
    assert!((channel(&first, "Z")[6 * 16 + 8] - 2.5).abs() < 0.02);
}

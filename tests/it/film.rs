//! The film: what is kept of a picture is light, and what is shown of it is developed from the average of the samples.

use bulbfold::engine::{BackendChoice, Engine, Request};
use bulbfold::expr::Arena;
use bulbfold::film::{Develop, Image, Layer, Radiance, compose_develop};
use bulbfold::kernel::Kernel;
use bulbfold::render::Sampling;
use bulbfold::shade::Size;

const SIZE: Size = Size { width: 80, height: 45 };

fn request(samples: u32) -> Request {
    let backend = BackendChoice::Cpu;
    Request { size: SIZE, samples, sampling: Sampling::Full, backend, calibrate: false, ..Request::default() }
}

/// The curve of the film as its author wrote it down, and sRGB as its standard has it, as a byte that is not rounded.
fn developed(radiance: f64, is_filmic: bool) -> f64 {
    let x = 0.62 * radiance;
    let shown = if is_filmic { x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14) } else { radiance };
    let shown = shown.clamp(0.0, 1.0);
    255.0 * if shown <= 0.003_130_8 { shown * 12.92 } else { 1.055 * shown.powf(1.0 / 2.4) - 0.055 }
}

#[test]
fn bytes_are_developed_from_the_light_of_all_samples() {
    let engine = Engine::new();
    for (name, is_filmic) in [("mandelbulb", true), ("menger", true), ("mandelbrot", false)] {
        let formula = engine.open(name).unwrap();
        for samples in [1, 3] {
            let job = engine.settle(&formula, &request(samples), &mut ()).unwrap();
            let (mut image, mut light) = (Image { size: SIZE, rgb: Vec::new() }, Radiance::new(SIZE));
            engine.render(&job, job.rows(), &mut image, &mut ()).unwrap();
            engine.render(&job, job.rows(), &mut light, &mut ()).unwrap();
            assert_eq!(light.rgb.len(), image.rgb.len());
            let off = |(byte, light): (&u8, &f32)| (f64::from(*byte) - developed(f64::from(*light), is_filmic)).abs();
            let most = image.rgb.iter().zip(&light.rgb).map(off).fold(0.0, f64::max);
            assert!(most < 0.51, "{name} with {samples} samples: a byte is off by {most}");
            let brightest = light.rgb.iter().copied().fold(0.0, f32::max);
            assert!(!is_filmic || brightest > 1.0, "{name}: light has no upper end, and the brightest is {brightest}");
        }
    }
}

#[test]
fn one_sample_is_a_part_of_many() {
    // What differs between the light of one sample and of nine is what eight of them add.
    let engine = Engine::new();
    let formula = engine.open("menger").unwrap();
    let light = |samples: u32| {
        let job = engine.settle(&formula, &request(samples), &mut ()).unwrap();
        let mut light = Radiance::new(SIZE);
        engine.render(&job, job.rows(), &mut light, &mut ()).unwrap();
        light.rgb
    };
    let (one, nine) = (light(1), light(3));
    assert!(one != nine);
    // The centre of the pixel is one of the nine, and none is below 0.
    assert!(one.iter().zip(&nine).all(|(one, nine)| *nine >= one / 9.0 - 1e-6));
}

#[test]
fn backgrounds_look_as_files_state_them() {
    let engine = Engine::new();
    let shown = [0.1, 0.35, 0.8];
    for fog in ["0", "0.5"] {
        let set = |path: &str, value: &str| (path.to_string(), value.to_string());
        let background = "[(0.1, 0.35, 0.8), (0.1, 0.35, 0.8)]";
        let changes = [set("look.background", background), set("look.fog", fog)];
        let formula = engine.open_with("mandelbulb", &changes).unwrap();
        let image = engine.picture(&formula, &request(2), &mut ()).unwrap();
        let byte = |x: f64| (255.0 * (1.055 * x.powf(1.0 / 2.4) - 0.055)).round();
        for (found, shown) in image.rgb[..3].iter().zip(shown) {
            assert!((f64::from(*found) - byte(shown)).abs() <= 1.0, "{found} stands for {shown}");
        }
    }
}

#[test]
fn light_and_look_are_inverse_to_each_other() {
    let arena = Arena::default();
    let cpu = bulbfold::check::Backends::cpu_only();
    let shown: Vec<f64> = (0..=1000).map(|i| f64::from(i) / 1000.0).collect();
    for develop in [Develop::SOLID, Develop::PLANE] {
        let light: Vec<f64> = shown.iter().map(|&x| develop.radiance_of([x; 3])[0]).collect();
        assert!(light.windows(2).all(|pair| pair[0] < pair[1]));
        let columns = [light.clone(), light.clone(), light];
        let straight = [shown.clone(), shown.clone(), shown.clone()];
        let run = |develop, columns: &[Vec<f64>; 3]| {
            let kernel = Kernel::Map(compose_develop(&arena, develop));
            cpu.run(bulbfold::check::Target::CPU_F64, &arena, &kernel, columns).unwrap().swap_remove(0)
        };
        for (a, b) in run(develop, &columns).into_iter().zip(run(Develop::PLANE, &straight)) {
            let bytes = |x: f64| [(x / 65536.0).floor(), (x / 256.0).floor() % 256.0, x % 256.0];
            assert!(bytes(a).iter().zip(bytes(b)).all(|(a, b)| (a - b).abs() <= 1.0), "{a} and {b}");
        }
        // What is no light is black, and what has no end is white.
        let odd = vec![f64::NAN, -1.0, f64::INFINITY, 1e30];
        assert_eq!(run(develop, &[odd.clone(), odd.clone(), odd])[..], [0.0, 0.0, 16_777_215.0, 16_777_215.0]);
    }
}

#[test]
fn layers_say_what_they_hold() {
    assert_eq!(Layer::Srgb.bytes() + Layer::Radiance.bytes(), 5);
    for layer in Layer::ALL {
        assert_eq!(serde_json::to_string(&layer).unwrap(), format!("{:?}", layer.name()));
        assert!((1..=4).contains(&layer.channels().len()));
    }
}

#[test]
fn agx_shows_middle_grey_in_the_middle_and_bright_light_white() {
    let arena = Arena::default();
    let cpu = bulbfold::check::Backends::cpu_only();
    let develop = Develop { curve: bulbfold::graph::Curve::Agx, ..Develop::SOLID };
    let kernel = Kernel::Map(compose_develop(&arena, develop));
    let shown = |light: [f64; 3]| {
        let columns = light.map(|x| vec![x]);
        let srgb = cpu.run(bulbfold::check::Target::CPU_F64, &arena, &kernel, &columns).unwrap()[0][0] as u32;
        [srgb >> 16, srgb >> 8 & 255, srgb & 255]
    };
    // The curve takes middle grey to half of what an exponent of 2.2 encodes: its author's pivot.
    for byte in shown([0.18; 3]) {
        assert!(byte.abs_diff(127) <= 2, "{byte}");
    }
    let [red, green, blue] = shown([3000.0, 30.0, 30.0]);
    assert!(red > 245 && green > 215 && blue > 215, "{red} {green} {blue}");
    assert_eq!(shown([0.0; 3]).map(|byte| byte < 2), [true; 3]);
    let [mut before, steps] = [0, 60];
    for i in 0..steps {
        let [grey, ..] = shown([2_f64.powf(f64::from(i) / 4.0 - 11.0); 3]);
        assert!(grey >= before, "step {i} is darker");
        before = grey;
    }
    // Light is the inverse of what is shown, for what the curve can show.
    for colour in [[0.2, 0.2, 0.2], [0.3, 0.25, 0.2], [0.05, 0.07, 0.1]] {
        let light = develop.radiance_of(colour);
        for (byte, shown) in shown(light).into_iter().zip(colour) {
            let expected = 255.0 * (1.055 * f64::powf(shown, 1.0 / 2.4) - 0.055);
            assert!((f64::from(byte) - expected).abs() < 1.6, "{byte} stands for {shown}");
        }
    }
}

//! Inputs for each target: damaged ones of the corpus, and ones that are made with the structure that breaks things.

use std::fmt::Write as _;

use bulbfold::check::Random;
use bulbfold::formula::embedded::STEPS;

use crate::Corpus;
use crate::mutate::{MAX_LEN, mutate};

fn damaged(random: &mut Random, corpus: &Corpus) -> Vec<u8> {
    mutate(corpus.pick(random), random, corpus)
}

fn text(mut text: String, random: &mut Random, corpus: &Corpus) -> Vec<u8> {
    text.truncate(MAX_LEN);
    match random.below(4) {
        0 => mutate(text.as_bytes(), random, corpus),
        _ => text.into_bytes(),
    }
}

/// Arbitrary bytes, for targets that read them as numbers.
pub fn bytes(random: &mut Random, _: &Corpus) -> Vec<u8> {
    let len = 8 + random.below(248);
    (0..len).map(|_| random.next_u64() as u8).collect()
}

/// A graph file.
pub fn graph(random: &mut Random, corpus: &Corpus) -> Vec<u8> {
    match random.below(10) {
        0..6 => damaged(random, corpus),
        6 => text(chain(random), random, corpus),
        _ => text(random_graph(random), random, corpus),
    }
}

/// The word of one of the built-in steps.
fn step_name(random: &mut Random) -> &'static str {
    STEPS[random.below(STEPS.len())].0
}

/// A name of one of the nodes before.
fn wire(random: &mut Random, before: usize) -> String {
    format!("\"a{}\"", random.below(before.max(1)))
}

/// A node over wires to earlier ones, which may be the same one twice.
fn node(random: &mut Random, before: usize) -> String {
    let (a, b) = (wire(random, before), wire(random, before));
    let x = random.range(0.1, 2.0);
    match random.below(if before == 0 { 5 } else { 18 }) {
        0..3 => format!("{}()", step_name(random)),
        3 => format!("Sphere(radius: {x:.3})"),
        4 => format!("Box(half_size: ({x:.3}, 1, 0.5))"),
        5 => format!("Sequence([{a}, {b}])"),
        6 => format!("Sequence([{a}, {a}])"),
        7 => format!("Repeat(of: {a}, times: {})", 1 + random.below(4)),
        8 => format!("Blend(a: {a}, b: {b}, weight: {x:.3})"),
        9 => format!("Choose(when: RadiusBelow({x:.3}), then: {a}, otherwise: {b})"),
        10 => format!("Alternate([({a}, 2), {b}])"),
        11 => format!("Between(of: {a}, from: {}, to: 4, otherwise: {b})", random.below(4)),
        12 => format!("Union([{a}, {b}])"),
        13 => format!("Difference(a: {a}, b: {b})"),
        14 => format!("SmoothUnion(of: [{a}, {b}], radius: {x:.3})"),
        15 => format!("Transform(of: {a}, translate: ({x:.3}, 0, 0), axis: (1, 1, 0), angle: 30, scale: 0.5)"),
        16 => format!("Tile(of: {a}, period: ({x:.3}, 2, 0))"),
        _ => format!("Orbit(of: {a}, max_iterations: {}, constant: Off)", 1 + random.below(9)),
    }
}

fn random_graph(random: &mut Random) -> String {
    let count = 1 + random.below(7);
    let mut text = "(nodes: {\n".to_string();
    for i in 0..count {
        let node = node(random, i);
        let _ = writeln!(text, "\"a{i}\": {node},");
    }
    let _ = write!(text, "}}, output: \"a{}\"", count - 1);
    let x = random.range(-1.0, 1.0);
    if random.below(3) == 0 {
        let _ = write!(text, ", constant: Julia(({x:.3}, 0.2, {:.3}))", random.range(-1.0, 1.0));
    }
    if random.below(6) == 0 {
        let _ = write!(text, ", pre: [{}]", wire(random, count));
    }
    if random.below(6) == 0 {
        let _ = write!(text, ", end: {}", wire(random, count));
    }
    let _ =
        write!(text, ", escape_radius: {}, max_iterations: {})", [4, 10, 100][random.below(3)], 1 + random.below(12));
    text
}

/// A chain of nodes, each made of the one before, more than once.
fn chain(random: &mut Random) -> String {
    let length = [3, 7, 12, 26, 60, 900][random.below(6)];
    let kind = random.below(8);
    let first = if random.below(2) == 0 { "box_fold(limit: 1)" } else { "Sphere(radius: 0.5)" };
    let mut text = format!("(nodes: {{\n\"a0\": {first},\n");
    for i in 1..=length {
        let a = format!("\"a{}\"", i - 1);
        let node = match if random.below(6) == 0 { random.below(8) } else { kind } {
            0 => format!("Sequence([{a}, {a}])"),
            1 => format!("Blend(a: {a}, b: {a}, weight: 0.5)"),
            2 => format!("Union([{a}, {a}])"),
            3 => format!("Repeat(of: {a}, times: 3)"),
            4 => format!("Tile(of: {a}, period: (2, 2, 2))"),
            5 => format!("Transform(of: {a}, translate: (1, 0, 0))"),
            6 => format!("Alternate([{a}, {a}])"),
            _ => format!("Choose(when: Negative(\"x\"), then: {a}, otherwise: {a})"),
        };
        let _ = writeln!(text, "\"a{i}\": {node},");
    }
    let _ = write!(text, "}}, output: \"a{length}\", max_iterations: {})", 1 + random.below(9));
    text
}

/// A script that makes a graph.
pub fn script(random: &mut Random, corpus: &Corpus) -> Vec<u8> {
    if random.below(1_000) != 0 {
        return if random.below(4) == 0 { text(short_script(random), random, corpus) } else { damaged(random, corpus) };
    }
    let n = [10, 300, 9_000, 1_000_000][random.below(4)];
    let made = match random.below(11) {
        9.. => return mutate(corpus.pick_heavy(random), random, corpus),
        0 => format!("let x = 1.0; for i in 0..{n} {{ x = [x]; }} x"),
        1 => format!("let x = 1.0; for i in 0..{n} {{ x = #{{ a: x }}; }} x"),
        2 => format!("let f = || 1; for i in 0..{n} {{ let g = f; f = |x| g; }} bulb_power()"),
        3 => format!("let a = []; for i in 0..{n} {{ a.push((i * 7919) % 10007); }} a.sort(); a.sort(|x, y| y - x); a"),
        4 => format!("let s = \"a\"; s.pad({n}, \"a\"); for i in 0..{n} {{ let t = s.to_upper(); }} bulb_power()"),
        5 => format!("sleep({n}); bulb_power()"),
        6 => format!("fn f(x) {{ f(x + 1) }} f({n})"),
        7 => format!("let x = box_fold(); for i in 0..{n} {{ x = Sequence([x, x]); }} x"),
        _ => format!("let a = [1]; for i in 0..{n} {{ a += a; }} a"),
    };
    text(made, random, corpus)
}

/// A script of a few nodes.
fn short_script(random: &mut Random) -> String {
    let mut text = String::new();
    let count = 1 + random.below(5);
    for i in 0..count {
        let before = if i == 0 { "1.0".to_string() } else { format!("v{}", random.below(i)) };
        let value = match random.below(8) {
            0 | 1 => format!("{}()", step_name(random)),
            2 => format!("Sequence([{before}, {before}])"),
            3 => format!("[{before}, {before}]"),
            4 => format!("#{{ of: {before}, times: {} }}", random.below(9)),
            5 => format!("Repeat(#{{ of: {before}, times: {} }})", random.below(9)),
            6 => format!("|x| {before}"),
            _ => format!("{:.3} * 2.0", random.range(-3.0, 3.0)),
        };
        let _ = writeln!(text, "let v{i} = {value};");
    }
    let _ = write!(text, "#{{ nodes: #{{ a: v{} }}, output: \"a\" }}", count - 1);
    text
}

/// A step's script.
pub fn step(random: &mut Random, corpus: &Corpus) -> Vec<u8> {
    if random.below(100) != 0 {
        return damaged(random, corpus);
    }
    let n = [3, 100, 700, 3_000, 100_000][random.below(5)];
    let body = match random.below(5) {
        0 => format!("let x = z; for i in 0..{n} {{ x = sin(x) * 1.01 + z; }} x"),
        1 => format!("let x = z; for i in 0..{n} {{ x = x * x + c; }} x"),
        2 => format!("let x = [z]; for i in 0..{n} {{ x = [x]; }} z"),
        3 => format!("let x = z; for i in 0..{n} {{ x = if(x.x > 0.0, x.yzx, x.zxy * 1.1); }} x"),
        _ => format!("let x = z; for i in 0..{n} {{ x = mix(x, z / length(x), 0.{i}); }} x", i = random.below(10)),
    };
    text(format!("fn step(z, c, p) {{\n    {body}\n}}\n#{{ state: \"any\" }}\n"), random, corpus)
}

/// A list of tests.
pub fn tests(random: &mut Random, corpus: &Corpus) -> Vec<u8> {
    damaged(random, corpus)
}

/// Lines of `--set` values.
pub fn set(random: &mut Random, corpus: &Corpus) -> Vec<u8> {
    let damaged = damaged(random, corpus);
    let lines: Vec<&[u8]> = damaged.split(|byte| *byte == b'\n').collect();
    let from = random.below(lines.len());
    lines[from..(from + 1 + random.below(3)).min(lines.len())].join(&b'\n')
}

/// Settings of Mandelbulber: lines of its corpus in any order, with values out of range.
pub fn mandelbulber(random: &mut Random, corpus: &Corpus) -> Vec<u8> {
    if random.below(2) == 0 {
        return damaged(random, corpus);
    }
    let mut text =
        "# Mandelbulber settings file\n# version 2.30\n# only modified parameters\n[main_parameters]\n".to_string();
    for i in 1..=1 + random.below(4) {
        let _ = writeln!(text, "formula_{i} {};\nformula_iterations_{i} {};", random.below(300), random.below(6));
    }
    let _ = writeln!(text, "hybrid_fractal_enable {};\nN {};", random.below(2), random.below(400));
    for i in 1..=random.below(3) {
        let _ = writeln!(
            text,
            "primitive_sphere_{i}_enabled true;\nprimitive_sphere_{i}_radius {:.3};",
            random.range(-1.0, 3.0)
        );
    }
    for i in 1..=1 + random.below(4) {
        let _ = writeln!(
            text,
            "[fractal_{i}]\npower {:.2};\nmandelbox_scale {:.2};",
            random.range(-9.0, 9.0),
            random.range(-3.0, 3.0)
        );
    }
    self::text(text, random, corpus)
}

/// A shader of Fragmentarium.
pub fn fragmentarium(random: &mut Random, corpus: &Corpus) -> Vec<u8> {
    damaged(random, corpus)
}

/// Parameters of Mandelbulb3D: a whole record with some bytes changed, as text or as bytes.
pub fn mandelbulb3d(random: &mut Random, corpus: &Corpus) -> Vec<u8> {
    if random.below(8) == 0 {
        return damaged(random, corpus);
    }
    let mut record = record(random);
    for _ in 0..random.below(5) {
        let at = random.below(record.len());
        record[at] =
            if random.below(2) == 0 { random.next_u64() as u8 } else { [0, 1, 0x7f, 0x80, 0xff][random.below(5)] };
    }
    if random.below(10) == 0 {
        record.truncate(random.below(record.len()));
    }
    if random.below(3) == 0 {
        return record;
    }
    let letters: Vec<char> = ('.'..='9').chain('A'..='Z').chain('a'..='z').collect();
    let mut text = format!("Mandelbulb3Dv{}{{\n", [16, 17, 18, 99][random.below(4)]);
    for three in record.chunks(3) {
        let bits = three.iter().rev().fold(0_usize, |bits, byte| bits << 8 | usize::from(*byte));
        text.extend((0..4).map(|i| letters[bits >> (6 * i) & 63]));
    }
    text.push_str("\n}\n{Titel: flower}\n");
    self::text(text, random, corpus)
}

/// A record of Mandelbulb3D with formulas of its own.
fn record(random: &mut Random) -> Vec<u8> {
    let mut bytes = vec![0; 840 + 8 + 6 * 188];
    let mut put = |at: usize, value: &[u8]| bytes[at..at + value.len()].copy_from_slice(value);
    for (at, value) in [(0, 44), (4, 640), (8, 480), (12, random.below(200) as i32)] {
        put(at, &i32::to_le_bytes(value));
    }
    for (at, value) in [(20, -2.0), (28, 9.0), (84, 0.8), (92, random.range(1.0, 99.0)), (108, 40.0)] {
        put(at, &f64::to_le_bytes(value));
    }
    for row in 0..3 {
        (0..3).for_each(|i| put(246 + 24 * row + 8 * i, &random.range(-1.0, 1.0).to_le_bytes()));
    }
    let count = 1 + random.below(6);
    put(840, &[16, random.below(3) as u8, 0, 0, count as u8, 0, 0, random.below(6) as u8]);
    for i in 0..count {
        let at = 848 + 188 * i;
        put(at, &(random.below(5) as i32 - 1).to_le_bytes());
        put(at + 4, &(random.below(30) as i32).to_le_bytes());
        put(at + 8, &(random.below(17) as i32).to_le_bytes());
        put(at + 12, b"Formula");
        (0..16).for_each(|k| put(at + 60 + 8 * k, &random.range(-3.0, 9.0).to_le_bytes()));
    }
    bytes
}

/// A PNG behind two bytes for the size that is expected, with some bytes changed; checksums are mended mostly.
pub fn png(random: &mut Random, _: &Corpus) -> Vec<u8> {
    let (width, height) = (1 + random.below(9), 1 + random.below(9));
    let mut file = Vec::new();
    let (color, bytes) = [(png::ColorType::Rgb, 3), (png::ColorType::Rgba, 4), (png::ColorType::Grayscale, 1)]
        [[0, 0, 0, 1, 2][random.below(5)]];
    let mut encoder = png::Encoder::new(&mut file, width as u32, height as u32);
    encoder.set_color(color);
    encoder.set_depth(png::BitDepth::Eight);
    let key = "k".repeat([0, 1, 40, 3000][random.below(4)]);
    let is_written = encoder.add_text_chunk("bulbfold-job".into(), key).is_ok();
    let pixels: Vec<u8> = (0..width * height * bytes).map(|_| random.next_u64() as u8).collect();
    if let (true, Ok(mut writer)) = (is_written, encoder.write_header()) {
        let _ = writer.write_image_data(&pixels).and_then(|()| writer.finish());
    }
    for _ in 0..random.below(4) {
        let at = random.below(file.len());
        file[at] = if random.below(2) == 0 { file[at] ^ (1 << random.below(8)) } else { random.next_u64() as u8 };
    }
    if random.below(8) == 0 {
        file.truncate(random.below(file.len()));
    }
    if random.below(4) != 0 {
        mend_checksums(&mut file);
    }
    let expected = if random.below(9) == 0 { [random.below(9) as u8, 3] } else { [width as u8, height as u8] };
    [&expected[..], &file].concat()
}

/// Sets the checksum of each chunk to that of its bytes.
fn mend_checksums(file: &mut [u8]) {
    let mut at = 8;
    while at + 12 <= file.len() {
        let length = file[at..at + 4].iter().fold(0_usize, |length, byte| length << 8 | usize::from(*byte));
        let Some(end) = at.checked_add(8).and_then(|at| at.checked_add(length)).filter(|end| end + 4 <= file.len())
        else {
            return;
        };
        let sum = crc(&file[at + 4..end]);
        file[end..end + 4].copy_from_slice(&sum.to_be_bytes());
        at = end + 4;
    }
}

/// The checksum of PNG: CRC-32 of the polynomial 0xEDB88320.
fn crc(bytes: &[u8]) -> u32 {
    let byte = |crc: u32, byte: &u8| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 })
    };
    !bytes.iter().fold(!0, byte)
}

/// An entry of the calibration cache.
pub fn cache(random: &mut Random, corpus: &Corpus) -> Vec<u8> {
    damaged(random, corpus)
}

//! Meshes: closed, where the surface is, as large as theory says, the same in every format and on every run.

use std::collections::HashMap;
use std::io::Read;
use std::path::Path;

use bulbfold::check::Formula;
use serde_json::Value;

use crate::support::{bulbfold, folder, folder_with, program, stderr, success};

const BALL: &str = r#"(nodes: { "ball": Sphere(radius: 1.0) }, output: "ball")"#;
const BOX: &str = r#"(nodes: { "box": Box(centre: (0.1, 0.05, 0.0), half_size: (1.0, 0.7, 0.4)) }, output: "box")"#;
const SHEET: &str = r#"(nodes: { "sheet": Box(half_size: (1.0, 1.0, 0.00001)) }, output: "sheet")"#;

/// A mesh as files hold it.
#[derive(Clone, PartialEq, Debug, Default)]
struct Mesh {
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    colours: Vec<[u8; 3]>,
    triangles: Vec<[u32; 3]>,
}

fn floats(bytes: &[u8]) -> [f32; 3] {
    [0, 4, 8].map(|at| f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()))
}

fn numbers(bytes: &[u8]) -> [u32; 3] {
    [0, 4, 8].map(|at| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()))
}

fn number(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

fn ply(bytes: &[u8]) -> Mesh {
    let end = bytes.windows(11).position(|part| part == b"end_header\n").unwrap() + 11;
    let head = std::str::from_utf8(&bytes[..end]).unwrap();
    let count = |what: &str| head.split(what).nth(1).unwrap().lines().next().unwrap().trim().parse::<usize>().unwrap();
    let (vertices, faces) = bytes[end..].split_at(27 * count("element vertex "));
    let mut mesh = Mesh::default();
    for vertex in vertices.chunks(27) {
        mesh.positions.push(floats(vertex));
        mesh.normals.push(floats(&vertex[12..]));
        mesh.colours.push([vertex[24], vertex[25], vertex[26]]);
    }
    assert_eq!(faces.len(), 13 * count("element face "));
    mesh.triangles = faces.chunks(13).map(|face| numbers(&face[1..])).collect();
    mesh
}

fn made(folder: &Path, arguments: &[&str]) -> Mesh {
    let output = bulbfold(folder, ["mesh"].iter().chain(arguments).chain(&["-o", "mesh.ply"]));
    success(&output);
    ply(&std::fs::read(folder.join("mesh.ply")).unwrap())
}

/// Every edge is in two triangles, once in each direction, and every vertex has one ring of triangles around it.
fn assert_closed(mesh: &Mesh) {
    let mut next: HashMap<(u32, u32), u32> = HashMap::new();
    for [a, b, c] in &mesh.triangles {
        for (from, to, third) in [(a, b, c), (b, c, a), (c, a, b)] {
            assert!(next.insert((*from, *to), *third).is_none(), "an edge is in two triangles that go the same way");
        }
    }
    assert!(next.keys().all(|(from, to)| next.contains_key(&(*to, *from))), "an edge is in one triangle alone");
    let mut degrees = vec![0u32; mesh.positions.len()];
    mesh.triangles.iter().flatten().for_each(|corner| degrees[*corner as usize] += 1);
    let mut first: HashMap<u32, u32> = HashMap::new();
    next.keys().for_each(|(from, to)| {
        first.entry(*from).or_insert(*to);
    });
    for (vertex, start) in first {
        let (mut at, mut steps) = (next[&(vertex, start)], 1);
        while at != start {
            at = next[&(vertex, at)];
            steps += 1;
        }
        assert_eq!(steps, degrees[vertex as usize], "a vertex joins two rings of triangles");
    }
    assert!(degrees.iter().all(|degree| *degree >= 3), "a vertex is in no triangle");
}

fn corners(mesh: &Mesh) -> impl Iterator<Item = [glam::DVec3; 3]> {
    mesh.triangles.iter().map(|corners| corners.map(|i| glam::DVec3::from(mesh.positions[i as usize].map(f64::from))))
}

fn area(mesh: &Mesh) -> f64 {
    corners(mesh).map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0).sum()
}

fn volume(mesh: &Mesh) -> f64 {
    corners(mesh).map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
}

fn assert_near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found} is not {expected} within {tolerance}");
}

#[test]
fn a_ball_is_as_large_as_theory_says() {
    let folder = folder_with(&[("ball.ron", BALL)]);
    let mesh = made(folder.path(), &["ball.ron", "--resolution", "64"]);
    assert_closed(&mesh);
    let cell = 2.0 / 64.0;
    let pi = std::f64::consts::PI;
    assert_near(area(&mesh), 4.0 * pi, 4.0 * pi * cell * cell * 4.0);
    assert_near(volume(&mesh), 4.0 / 3.0 * pi, 4.0 * pi * cell / 32.0);
    for (p, normal) in mesh.positions.iter().zip(&mesh.normals) {
        let (p, normal) = (glam::Vec3::from(*p), glam::Vec3::from(*normal));
        assert!((f64::from(p.length()) - 1.0).abs() < cell / 50.0);
        assert!(p.normalize().dot(normal) > 0.999, "{p} {normal}");
    }
}

#[test]
fn a_box_is_as_large_as_theory_says() {
    let folder = folder_with(&[("box.ron", BOX)]);
    let mesh = made(folder.path(), &["box.ron", "--resolution", "50"]);
    assert_closed(&mesh);
    let cell = 0.05;
    // Edges are cut off by less than a cell.
    assert_near(volume(&mesh), 8.0 * 0.28, 11.0 * cell / 30.0 + 17.0 * cell * cell);
    assert_near(area(&mesh), 8.0 * (0.7 + 0.4 + 0.28), 17.0 * cell);
    let high = |k: usize| mesh.positions.iter().map(|p| f64::from(p[k])).fold(-9.0, f64::max);
    assert_near(high(0), 1.1, cell / 30.0);
    assert_near(high(1), 0.75, cell / 30.0);
    assert_near(high(2), 0.4, cell / 30.0);
}

/// Vertices of fractals have points that are in and points that are not beside them, and the f64 estimate there is below half a cell.
#[test]
fn vertices_of_fractals_are_on_their_surfaces() {
    let folder = folder();
    for (name, cells, region) in
        [("mandelbulb", 80, None), ("mandelbox", 60, Some("0,0,0,7,7,7")), ("menger_cross", 54, None)]
    {
        let cells = cells.to_string();
        let mut arguments = vec![name, "--resolution", &cells, "--report", "mesh.json"];
        region.iter().for_each(|region| arguments.extend(["--region", region]));
        let mesh = made(folder.path(), &arguments);
        assert_closed(&mesh);
        let report = report(&folder.path().join("mesh.json"));
        let cell = report["cell"].as_f64().unwrap();
        assert_near(report["area"].as_f64().unwrap(), area(&mesh), area(&mesh) * 1e-5);
        assert_near(report["volume"].as_f64().unwrap(), volume(&mesh), volume(&mesh).abs() * 1e-4);
        let formula = Formula::builtin(name).unwrap();
        let cut = |p: &[f32; 3]| region.is_some() && p.iter().any(|x| x.abs() < 1e-3 || (x - 7.0).abs() < 1e-3);
        let points: Vec<[f64; 3]> = mesh.positions.iter().filter(|p| !cut(p)).map(|p| p.map(f64::from)).collect();
        assert!(points.len() > 1000);
        let half = cell / 2.0;
        let far = formula.estimates(&points).into_iter().filter(|de| *de >= half).count();
        assert_eq!(far, 0, "{name}");
        let is_between = |p: &[f64; 3]| {
            let beside = |i: usize| {
                let mut beside = *p;
                beside[i / 2] += if i.is_multiple_of(2) { cell / 50.0 } else { -cell / 50.0 };
                formula.inside(beside)
            };
            let inside: Vec<bool> = (0..6).map(beside).collect();
            inside.contains(&true) && inside.contains(&false)
        };
        let tried: Vec<&[f64; 3]> = points.iter().step_by(points.len() / 100).collect();
        let between = tried.iter().filter(|p| is_between(p)).count();
        // The mesh is computed in single precision.
        assert!(between * 100 >= tried.len() * 97, "{name}: {between} of {}", tried.len());
    }
}

fn report(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

#[test]
fn every_format_holds_the_same_mesh() {
    let folder = folder_with(&[("box.ron", BOX)]);
    let path = |name: &str| folder.path().join(name);
    let mesh = made(folder.path(), &["box.ron", "--resolution", "20"]);
    for ending in ["stl", "obj", "glb", "3mf"] {
        success(&bulbfold(folder.path(), ["mesh", "box.ron", "--resolution", "20", "-o", &format!("mesh.{ending}")]));
    }
    let bytes = std::fs::read(path("mesh.stl")).unwrap();
    assert_eq!((number(&bytes, 80), bytes.len()), (mesh.triangles.len(), 84 + 50 * mesh.triangles.len()));
    let mut facets: Vec<[u8; 36]> = bytes[84..].chunks(50).map(|facet| facet[12..48].try_into().unwrap()).collect();
    let bytes_of = |corners: &[u32; 3]| {
        let floats = corners.iter().flat_map(|i| mesh.positions[*i as usize]).flat_map(f32::to_le_bytes);
        <[u8; 36]>::try_from(floats.collect::<Vec<u8>>()).unwrap()
    };
    let mut expected: Vec<[u8; 36]> = mesh.triangles.iter().map(bytes_of).collect();
    facets.sort_unstable();
    expected.sort_unstable();
    assert!(facets == expected, "the facets are those of the mesh");
    assert_eq!(
        obj(&std::fs::read_to_string(path("mesh.obj")).unwrap()),
        (mesh.positions.clone(), mesh.triangles.clone())
    );
    assert_eq!(glb(&std::fs::read(path("mesh.glb")).unwrap()), (mesh.positions.clone(), mesh.triangles.clone()));
    let text = three_mf(&path("mesh.3mf"));
    assert!(text.contains("unit=\"centimeter\""));
    let vertices: Vec<[f32; 3]> = text.split("<vertex ").skip(1).map(attributes).collect();
    assert_eq!(vertices, mesh.positions);
    let triangles: Vec<[f32; 3]> = text.split("<triangle ").skip(1).map(attributes).collect();
    assert_eq!(triangles, mesh.triangles.iter().map(|corners| corners.map(|i| i as f32)).collect::<Vec<_>>());
}

/// The first three numbers in quotation marks.
fn attributes(text: &str) -> [f32; 3] {
    let numbers: Vec<f32> = text.split('"').skip(1).step_by(2).take(3).map(|part| part.parse().unwrap()).collect();
    numbers.try_into().unwrap()
}

fn obj(text: &str) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let parts = |line: &str| line.split_whitespace().skip(1).take(3).map(str::to_string).collect::<Vec<_>>();
    let lines = |of: &'static str| text.lines().filter(move |line| line.starts_with(of)).map(parts);
    let vertices = lines("v ").map(|parts| [0, 1, 2].map(|k| parts[k].parse().unwrap()));
    let corner = |part: &String| part.split('/').next().unwrap().parse::<u32>().unwrap() - 1;
    (vertices.collect(), lines("f ").map(|parts| [0, 1, 2].map(|k| corner(&parts[k]))).collect())
}

fn glb(bytes: &[u8]) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    assert_eq!((&bytes[..4], number(bytes, 8)), (&b"glTF"[..], bytes.len()));
    let json = number(bytes, 12);
    let described: Value = serde_json::from_slice(&bytes[20..20 + json]).unwrap();
    assert_eq!(number(bytes, 20 + json), bytes.len() - 28 - json);
    let data = &bytes[28 + json..];
    let accessor = |i: usize| &described["accessors"][i];
    let count = |i: usize| accessor(i)["count"].as_u64().unwrap() as usize;
    let positions: Vec<[f32; 3]> = (0..count(0)).map(|i| floats(&data[32 * i..])).collect();
    let least = positions.iter().map(|p| p[1]).fold(9.0, f32::min);
    assert_eq!(accessor(0)["min"][1].as_f64().unwrap() as f32, least);
    let begin = described["bufferViews"][1]["byteOffset"].as_u64().unwrap() as usize;
    (positions, (0..count(3) / 3).map(|i| numbers(&data[begin + 12 * i..])).collect())
}

fn three_mf(path: &Path) -> String {
    let mut archive = zip::ZipArchive::new(std::fs::File::open(path).unwrap()).unwrap();
    assert!(archive.by_name("[Content_Types].xml").is_ok() && archive.by_name("_rels/.rels").is_ok());
    let mut text = String::new();
    archive.by_name("3D/3dmodel.model").unwrap().read_to_string(&mut text).unwrap();
    text
}

#[test]
fn surfaces_have_the_colours_of_their_look() {
    let folder = folder_with(&[("ball.ron", BALL)]);
    let look = ["--set", "look.palette=[(1,0,0),(1,0,0),(1,0,0),(1,0,0),(1,0,0)]"];
    let mesh = made(folder.path(), &["ball.ron", "--resolution", "12", look[0], look[1]]);
    assert!(mesh.colours.iter().all(|colour| *colour == [255, 0, 0]), "{:?}", mesh.colours[0]);
    let mesh = made(folder.path(), &["mandelbulb", "--resolution", "24"]);
    let kinds: std::collections::BTreeSet<[u8; 3]> = mesh.colours.iter().copied().collect();
    assert!(kinds.len() > 20, "a bulb has many colours");
}

#[test]
fn bytes_do_not_depend_on_threads() {
    let folder = folder();
    let bytes = |threads: &str, name: &str| {
        let mut command = program(folder.path());
        command.args(["mesh", "mandelbulb", "--resolution", "40", "-o", name]).env("RAYON_NUM_THREADS", threads);
        success(&command.output().unwrap());
        std::fs::read(folder.path().join(name)).unwrap()
    };
    let one = bytes("1", "a.glb");
    assert!(one == bytes("3", "b.glb") && one == bytes("3", "c.glb"));
    assert!(bytes("1", "a.stl") == bytes("2", "b.stl"));
}

#[test]
fn thin_sets_are_made_bodies_and_that_is_said() {
    let folder = folder_with(&[("sheet.ron", SHEET)]);
    let output = bulbfold(
        folder.path(),
        ["mesh", "sheet.ron", "--resolution", "40", "--region", "-1.5,-1.5,-1,1.5,1.5,1", "-o", "mesh.ply"],
    );
    success(&output);
    assert!(stderr(&output).contains("the set is thin"), "{}", stderr(&output));
    let mesh = ply(&std::fs::read(folder.path().join("mesh.ply")).unwrap());
    assert_closed(&mesh);
    assert_near(area(&mesh), 8.0, 1.4);
    let cell = 3.0 / 40.0;
    assert!(mesh.positions.iter().all(|p| f64::from(p[2].abs()) < 0.6 * cell));
    let output = bulbfold(
        folder.path(),
        [
            "mesh",
            "sheet.ron",
            "--resolution",
            "40",
            "--region",
            "-1.5,-1.5,-1,1.5,1.5,1",
            "--thicken",
            "2",
            "-o",
            "mesh.ply",
        ],
    );
    success(&output);
    let thick = ply(&std::fs::read(folder.path().join("mesh.ply")).unwrap());
    let high = thick.positions.iter().map(|p| f64::from(p[2])).fold(0.0, f64::max);
    assert_near(high, 2.0 * cell, 0.2 * cell);
}

const PRINTED: &str = r#"(nodes: {
    "ball": Sphere(radius: 0.5),
    "plate": Box(centre: (0.0, 0.0, 1.0), half_size: (1.0, 1.0, 0.1)),
    "both": Union(["ball", "plate"]),
}, output: "both")"#;

#[test]
fn reports_say_what_printers_ask() {
    let folder = folder_with(&[("both.ron", PRINTED)]);
    let arguments = ["both.ron", "--resolution", "80", "--report", "both.json", "--scale", "80mm"];
    let mesh = made(folder.path(), &arguments);
    let found = report(&folder.path().join("both.json"));
    let printed = &found["printability"];
    assert_eq!(printed["islands"], 2);
    assert_near(printed["thinnest_wall"].as_f64().unwrap(), 8.0, 1.5);
    // Below the plate all, below the ball what leans out by more than 45 degrees.
    let (ball, plate) = (std::f64::consts::PI, 8.0 + 1.6);
    let share = (4.0 + ball * (1.0 - 0.5f64.sqrt()) / 2.0) / (ball + plate);
    assert_near(printed["overhang"].as_f64().unwrap(), share, 0.02);
    let size = [0, 1, 2].map(|k| found["high"][k].as_f64().unwrap() - found["low"][k].as_f64().unwrap());
    assert_near(size[0], 80.0, 0.02);
    assert_near(size[2], 64.0, 0.5);
    assert_near(volume(&mesh), (4.0 / 3.0 * std::f64::consts::PI * 0.125 + 0.8) * 40f64.powi(3), 2500.0);
}

/// Memory, time and size are said before it starts, and memory is what it may be.
#[test]
fn what_it_takes_is_said_and_bounded() {
    let folder = folder();
    let output = bulbfold(folder.path(), ["mesh", "menger_cross", "--resolution", "100", "-o", "a.stl"]);
    success(&output);
    let text = stderr(&output);
    assert!(text.contains("100 cells of") && text.contains("MiB of memory") && text.contains("proofs"), "{text}");
    let refused =
        bulbfold(folder.path(), ["mesh", "mandelbulb", "--resolution", "4096", "--memory", "0.5", "-o", "b.stl"]);
    assert_eq!(refused.status.code(), Some(2), "{}", stderr(&refused));
    assert!(stderr(&refused).contains("of memory, and may take"), "{}", stderr(&refused));
    assert!(!folder.path().join("b.stl").exists());
}

#[test]
fn broken_input_is_refused() {
    let plane = r#"(nodes: { "floor": Plane(normal: (0.0, 0.0, 1.0)) }, output: "floor")"#;
    let folder = folder_with(&[("ball.ron", BALL), ("floor.ron", plane)]);
    let cases: [(&[&str], &str); 9] = [
        (&["ball.ron", "--resolution", "0", "-o", "a.ply"], "0 is not in 4..=4096"),
        (&["ball.ron", "--resolution", "100000", "-o", "a.ply"], "100000 is not in 4..=4096"),
        (&["ball.ron", "-o", "a.txt"], ".ply, .obj, .stl, .glb, .3mf"),
        (&["ball.ron", "-o", "a"], "says no format"),
        (&["floor.ron", "-o", "a.ply"], "name a box: --region"),
        (&["mandelbrot", "-o", "a.ply"], "is a formula of a plane"),
        (&["ball.ron", "--region", "0,0,0,0,1,1", "-o", "a.ply"], "each edge must be longer than 0"),
        (&["ball.ron", "--region", "5,5,5,6,6,6", "-o", "a.ply"], "there is no surface"),
        (&["ball.ron", "--scale", "big", "-o", "a.ply"], "write a length such as 80mm"),
    ];
    for (arguments, expected) in cases {
        let output = bulbfold(folder.path(), ["mesh"].iter().chain(arguments));
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{arguments:?} {text}");
        assert!(text.contains(expected), "{arguments:?} {text}");
        assert!(!folder.path().join("a.ply").exists());
    }
}

/// What is cut by a region is closed by flat faces.
#[test]
fn regions_cut_and_close() {
    let folder = folder_with(&[("ball.ron", BALL)]);
    let mesh = made(folder.path(), &["ball.ron", "--resolution", "40", "--region", "-2,-2,0,2,2,2"]);
    assert_closed(&mesh);
    let pi = std::f64::consts::PI;
    assert_near(volume(&mesh), 2.0 / 3.0 * pi, 0.1);
    assert_near(area(&mesh), 3.0 * pi, 0.4);
    assert!(mesh.positions.iter().all(|p| p[2] > -0.01));
}

#[test]
fn simplified_meshes_stay_closed_and_near() {
    let folder = folder_with(&[("ball.ron", BALL)]);
    let whole = made(folder.path(), &["ball.ron", "--resolution", "40"]);
    let mesh = made(folder.path(), &["ball.ron", "--resolution", "40", "--simplify", "0.1"]);
    assert_closed(&mesh);
    assert!(mesh.triangles.len() <= whole.triangles.len() / 10);
    assert_near(volume(&mesh), volume(&whole), 0.02);
    let cell = 2.0 / 40.0;
    assert!(mesh.positions.iter().all(|p| (f64::from(glam::Vec3::from(*p).length()) - 1.0).abs() < cell / 2.0));
    for name in ["mandelbulb", "menger_cross"] {
        assert_closed(&made(folder.path(), &[name, "--resolution", "40", "--simplify", "0.2"]));
    }
    success(&bulbfold(
        folder.path(),
        ["mesh", "ball.ron", "--resolution", "40", "--simplify", "0.1", "-o", "mesh.stl"],
    ));
    assert_eq!(std::fs::metadata(folder.path().join("mesh.stl")).unwrap().len(), 84 + 50 * mesh.triangles.len() as u64);
}

#[test]
fn hollow_bodies_have_a_wall() {
    let folder = folder_with(&[("ball.ron", BALL)]);
    let arguments = ["ball.ron", "--resolution", "80", "--scale", "80mm", "--hollow", "10mm", "--report", "mesh.json"];
    let mesh = made(folder.path(), &arguments);
    assert_closed(&mesh);
    let ball = |radius: f64| 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
    assert_near(volume(&mesh), ball(40.0) - ball(30.0), 0.04 * ball(40.0));
    let printed = &report(&folder.path().join("mesh.json"))["printability"];
    assert_eq!(printed["islands"], 2);
    assert_near(printed["thinnest_wall"].as_f64().unwrap(), 10.0, 2.0);
    let inner = mesh.positions.iter().zip(&mesh.normals).filter(|(p, _)| glam::Vec3::from(**p).length() < 35.0);
    assert!(inner.clone().count() > 100);
    for (p, normal) in inner {
        assert!(glam::Vec3::from(*p).normalize().dot(glam::Vec3::from(*normal)) < -0.9, "it faces the cavity");
    }
}

/// A volume of bytes and its array for numpy say the same as the formula; distances are those of a ball.
#[test]
fn volumes_say_what_is_inside_and_how_far() {
    let folder = folder_with(&[("ball.ron", BALL)]);
    let run = |arguments: &[&str]| {
        let output = bulbfold(folder.path(), ["slices", "ball.ron", "--resolution", "40"].iter().chain(arguments));
        success(&output);
        stderr(&output)
    };
    let said = run(&["-o", "ball.raw"]);
    assert!(said.contains("43 x 43 x 43 points"), "{said}");
    let bytes = std::fs::read(folder.path().join("ball.raw")).unwrap();
    let cell = 2.0 / 40.0 * (1.0 + 1.0 / 40.0);
    let first = said.split("the first point is at ").nth(1).unwrap().lines().next().unwrap().to_string();
    let first: Vec<f64> = first.split(',').map(|number| number.parse().unwrap()).collect();
    let place = |i: usize| [0, 1, 2].map(|k| first[k] + (i / 43usize.pow(k as u32) % 43) as f64 * cell);
    let radius = |i: usize| place(i).iter().map(|x| x * x).sum::<f64>().sqrt();
    assert_eq!(bytes.len(), 43 * 43 * 43);
    assert!(
        bytes
            .iter()
            .enumerate()
            .all(|(i, byte)| (*byte == 255) == (radius(i) <= 1.0) || (radius(i) - 1.0).abs() < 1e-5)
    );
    run(&["-o", "ball.npy"]);
    let array = std::fs::read(folder.path().join("ball.npy")).unwrap();
    assert!(array.starts_with(b"\x93NUMPY\x01\x00"));
    assert_eq!(array[array.len() - bytes.len()..], bytes);
    run(&["--values", "distance", "-o", "distance.npy"]);
    let array = std::fs::read(folder.path().join("distance.npy")).unwrap();
    let head = String::from_utf8_lossy(&array[10..array.len() - 4 * bytes.len()]).into_owned();
    assert!(head.contains("'descr': '<f4'") && head.contains("(43, 43, 43)") && (head.len() + 10).is_multiple_of(64));
    let numbers =
        array[array.len() - 4 * bytes.len()..].chunks(4).map(|four| f32::from_le_bytes(four.try_into().unwrap()));
    for (i, number) in numbers.enumerate() {
        assert_near(f64::from(number), radius(i) - 1.0, cell);
    }
    run(&["-o", "slices"]);
    let middle = crate::support::pixels(&folder.path().join("slices/slice_0021.png"));
    assert_eq!(
        middle.iter().filter(|pixel| **pixel == 255).count(),
        bytes[21 * 43 * 43..22 * 43 * 43].iter().filter(|b| **b == 255).count()
    );
    assert!(
        folder.path().join("slices/slice_0042.png").exists() && !folder.path().join("slices/slice_0043.png").exists()
    );
}

#[test]
fn volumes_refuse_what_they_cannot_hold() {
    let folder = folder_with(&[("ball.ron", BALL)]);
    let cases: [(&[&str], &str); 5] = [
        (&["-o", "a.txt"], "a file that ends in .npy, .raw or .vdb"),
        (&["-o", "a", "--values", "distance"], "pictures of slices show what is inside"),
        (&["-o", "a.vdb", "--values", "inside"], "a .vdb holds distances"),
        (&["-o", "a.npy", "--values", "distance", "--resolution", "2000"], "of memory, and may take"),
        (&["-o", "a.vdb", "--python", "no_such_python"], "apt install python3-openvdb"),
    ];
    for (arguments, expected) in cases {
        let output = bulbfold(folder.path(), ["slices", "ball.ron"].iter().chain(arguments));
        assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
        assert!(stderr(&output).contains(expected), "{}", stderr(&output));
    }
}

/// The Pythons of this machine that know openvdb.
fn python_with_openvdb() -> Option<&'static str> {
    let knows = |python: &&str| {
        let tried = std::process::Command::new(python).args(["-c", "import numpy, pyopenvdb"]).output();
        tried.is_ok_and(|output| output.status.success())
    };
    ["python3", "/usr/bin/python3"].into_iter().find(knows)
}

#[test]
fn volumes_for_openvdb_are_read_by_it() {
    let Some(python) = python_with_openvdb() else {
        assert!(std::env::var_os("BULBFOLD_REQUIRE_OPENVDB").is_none(), "no Python knows openvdb");
        eprintln!("skipped: no Python knows openvdb (Debian: python3-openvdb)");
        return;
    };
    let folder = folder_with(&[("ball.ron", BALL)]);
    let arguments = ["slices", "ball.ron", "--resolution", "40", "--python", python, "-o", "ball.vdb"];
    success(&bulbfold(folder.path(), arguments));
    let script = "
import pyopenvdb, sys
grid = pyopenvdb.read('ball.vdb', 'surface')
assert grid.gridClass == pyopenvdb.GridClass.LEVEL_SET
at = lambda *p: grid.getConstAccessor().getValue(tuple(round(x) for x in grid.transform.worldToIndex(p)))
print(at(0, 0, 0), at(1, 0, 0), at(0, 2, 0), at(0, 0, 0.95))
";
    let output = std::process::Command::new(python).args(["-c", script]).current_dir(folder.path()).output().unwrap();
    let numbers: Vec<f64> = success(&output).split_whitespace().map(|number| number.parse().unwrap()).collect();
    let cell = 2.0 / 40.0 * (1.0 + 1.0 / 40.0);
    for (number, expected) in numbers.iter().zip([-3.0 * cell, 0.0, 3.0 * cell, -0.05]) {
        assert_near(*number, expected, cell);
    }
}

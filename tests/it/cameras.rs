//! Lenses and eyes: where rays go, what pictures measure, and that short cuts follow the lens.

use std::f64::consts::{PI, TAU};

use bulbfold::check::Formula;
use bulbfold::compose::Bounds;
use bulbfold::expr::Arena;
use bulbfold::graph::{Camera, CubeLayout, Lens, Stereo, StereoLayout};
use bulbfold::kernel::cost::Cost;
use bulbfold::kernel::{Kernel, wgsl};
use bulbfold::render::{BeamUse, RenderSettings, Renderer, Sampling, compose_pipeline};
use bulbfold::shade::{Size, beam_radius, compose_camera, rays, threshold};
use glam::DVec3;

use crate::support::{bulbfold, folder_with, formula, pixels, success};

const SIZE: Size = Size { width: 80, height: 60 };

/// Looks along +y, with x to the right and z up.
const CAMERA: Camera = Camera::new([0.0, -5.0, 0.0], [0.0; 3], [0.0, 0.0, 1.0], 0.5);

fn with(lens: Lens) -> Camera {
    Camera { lens, ..CAMERA }
}

/// The ray through a share of the picture: origin and direction.
fn ray_at(camera: &Camera, [u, v]: [f64; 2]) -> (DVec3, DVec3) {
    let (origin, direction) = rays(camera, SIZE, &[[u * 80.0, v * 60.0]])[0];
    (DVec3::from(origin), DVec3::from(direction))
}

fn is_near(a: DVec3, b: [f64; 3]) {
    assert!((a - DVec3::from(b)).length() < 1e-9, "{a} is not {b:?}");
}

#[test]
fn every_lens_sends_rays_where_its_definition_says() {
    let middle = [0.5, 0.5];
    for (_, lens) in Lens::NAMES {
        let lens = if lens.name() == "orthographic" { Lens::Orthographic { height: 3.0 } } else { lens };
        let camera = Camera { fov: lens.usual_fov(), ..with(lens) };
        let places: Vec<[f64; 2]> =
            (0..200).map(|i| [f64::from(i * 37 % 80) + 0.3, f64::from(i * 13 % 60) + 0.7]).collect();
        for (_, direction) in rays(&camera, SIZE, &places) {
            assert!((DVec3::from(direction).length() - 1.0).abs() < 1e-9, "{lens:?} has directions of length 1");
        }
        if !matches!(lens, Lens::CubeMap(_)) {
            is_near(ray_at(&camera, middle).1, [0.0, 1.0, 0.0]);
        }
    }
    // Perspective: the top is half of the angle up; a shift of half the height puts what was at the top into the middle.
    is_near(ray_at(&CAMERA, [0.5, 0.0]).1, [0.0, 0.25f64.cos(), 0.25f64.sin()]);
    is_near(ray_at(&with(Lens::Perspective { shift: [0.0, 0.5] }), middle).1, [0.0, 0.25f64.cos(), 0.25f64.sin()]);
    let right = ray_at(&with(Lens::Perspective { shift: [0.25, 0.0] }), middle).1;
    assert!((right.x / right.y - 0.5 * 0.25f64.tan()).abs() < 1e-12, "to the right: {right}");
    // Orthographic: parallel rays, 3 units from the bottom to the top and 4 from side to side.
    let (origin, direction) = ray_at(&with(Lens::Orthographic { height: 3.0 }), [1.0, 0.0]);
    is_near(direction, [0.0, 1.0, 0.0]);
    is_near(origin, [2.0, -5.0, 1.5]);
    // Fisheye: the angle grows with the distance from the middle.
    let fisheye = Camera { fov: PI, ..with(Lens::Fisheye) };
    is_near(ray_at(&fisheye, [0.5, 0.0]).1, [0.0, 0.0, 1.0]);
    is_near(ray_at(&fisheye, [0.5, 0.25]).1, [0.0, 0.5f64.sqrt(), 0.5f64.sqrt()]);
    // Equirectangular: columns are longitudes, rows latitudes.
    let around = Camera { fov: PI, ..with(Lens::Equirectangular { width: TAU }) };
    is_near(ray_at(&around, [0.75, 0.5]).1, [1.0, 0.0, 0.0]);
    is_near(ray_at(&around, [0.0, 0.5]).1, [0.0, -1.0, 0.0]);
    is_near(ray_at(&around, [0.3, 0.0]).1, [0.0, 0.0, 1.0]);
}

#[test]
fn faces_of_cube_maps_look_along_their_axes_and_join() {
    let [strip, cross] = [CubeLayout::Strip, CubeLayout::Cross].map(|layout| with(Lens::CubeMap(layout)));
    let [right, left, up, down, front, back] =
        [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]];
    let [sixth, half, quarter, eighth] = [1.0 / 6.0, 0.5, 0.25, 0.125];
    for (u, v, axis) in [
        (sixth, quarter, right),
        (half, quarter, left),
        (1.0 - sixth, quarter, up),
        (sixth, 0.75, down),
        (half, 0.75, front),
        (1.0 - sixth, 0.75, back),
    ] {
        is_near(ray_at(&strip, [u, v]).1, axis);
    }
    for (u, v, axis) in [
        (eighth, half, left),
        (3.0 * eighth, half, front),
        (5.0 * eighth, half, right),
        (7.0 * eighth, half, back),
        (3.0 * eighth, sixth, up),
        (3.0 * eighth, 1.0 - sixth, down),
    ] {
        is_near(ray_at(&cross, [u, v]).1, axis);
    }
    // Neighbours in the cross see the same along their edge.
    let [a, b] = [1.0 - 1e-9, 1.0 + 1e-9];
    for (p, q) in [
        ([quarter * a, 0.4], [quarter * b, 0.4]),
        ([half * a, 0.6], [half * b, 0.6]),
        ([0.75 * a, 0.45], [0.75 * b, 0.45]),
        ([0.3, a / 3.0], [0.3, b / 3.0]),
        ([0.45, a * 2.0 / 3.0], [0.45, b * 2.0 / 3.0]),
    ] {
        let (p, q) = (ray_at(&cross, p).1, ray_at(&cross, q).1);
        assert!((p - q).length() < 1e-7, "{p} and {q}");
    }
}

/// Both eyes of a camera that look at a place of each half.
fn eyes(lens: Lens, fov: f64, place: [f64; 2]) -> [(DVec3, DVec3); 2] {
    let of = |layout| Camera { stereo: Some(Stereo { eyes: 0.4, layout }), fov, ..with(lens) };
    let alone = [StereoLayout::Left, StereoLayout::Right].map(|layout| ray_at(&of(layout), place));
    let beside = of(StereoLayout::SideBySide);
    // A half is as high and half as wide: the same columns of the picture, in the same number of rows.
    let wide = Size { width: 160, ..SIZE };
    let at = |offset: f64| {
        let (origin, direction) = rays(&beside, wide, &[[offset + place[0] * 80.0, place[1] * 60.0]])[0];
        (DVec3::from(origin), DVec3::from(direction))
    };
    let tall = Size { height: 120, ..SIZE };
    let below = |offset: f64| {
        let (origin, direction) =
            rays(&of(StereoLayout::OverUnder), tall, &[[place[0] * 80.0, offset + place[1] * 60.0]])[0];
        (DVec3::from(origin), DVec3::from(direction))
    };
    for (alone, others) in alone.iter().zip([[at(0.0), below(0.0)], [at(80.0), below(60.0)]]) {
        for other in others {
            assert!((alone.0 - other.0).length() < 1e-9 && (alone.1 - other.1).length() < 1e-9, "{lens:?}");
        }
    }
    alone
}

#[test]
fn two_eyes_converge_on_the_target_or_turn_with_the_longitude() {
    for lens in [Lens::default(), Lens::Orthographic { height: 3.0 }] {
        for place in [[0.5, 0.5], [0.2, 0.8]] {
            let [(a, along_a), (b, along_b)] = eyes(lens, 0.5, place);
            is_near(b - a, [0.4, 0.0, 0.0]);
            // Both meet the plane through the target in one point.
            let at = |origin: DVec3, along: DVec3| origin - along * (origin.y / along.y);
            assert!((at(a, along_a) - at(b, along_b)).length() < 1e-9, "{lens:?} at {place:?}");
        }
    }
    // Omnidirectional: to the right of the camera, the right eye is behind it.
    let [(a, along_a), (b, along_b)] = eyes(Lens::Equirectangular { width: TAU }, PI, [0.75, 0.5]);
    is_near(along_a, [1.0, 0.0, 0.0]);
    is_near(along_b, [1.0, 0.0, 0.0]);
    is_near(b - a, [0.0, -0.4, 0.0]);
    let cube = eyes(Lens::CubeMap(CubeLayout::Cross), 0.5, [5.0 / 8.0, 0.5]);
    is_near(cube[1].0 - cube[0].0, [0.0, -0.4, 0.0]);
}

/// A ball of radius 1, from 5 away.
pub const BALL: &str = r#"(nodes: { "ball": Sphere(centre: (0, 0, 0), radius: 1) }, output: "ball", bounding_radius: 1.5,
    camera: (position: (0, -5, 0), fov: 28.64788975654116))"#;

fn image(formula: &Formula, camera: Camera, size: Size, change: impl Fn(&mut RenderSettings)) -> (Vec<u8>, u64) {
    let graph = formula.graph().clone().with_camera(camera);
    let subject = formula.subject();
    let composer = bulbfold::compose::Composer { graph: &graph, ..subject.composer() };
    let mut settings = RenderSettings { size, samples: 1, sampling: Sampling::Full, ..RenderSettings::default() };
    change(&mut settings);
    let pipeline = compose_pipeline(&composer, &settings).unwrap_or_else(|error| panic!("{}", error.message));
    let cpu = bulbfold::kernel::cpu::Cpu::new(settings.precision);
    let mut renderer = Renderer::new(&cpu, composer.arena, &pipeline, &settings).expect("it is prepared");
    let image = renderer.render(&mut |_| true).expect("it renders").expect("nothing stops it");
    (image.rgb, renderer.stats.hits)
}

/// A ball of radius 1 covers as many pixels as its lens says.
#[test]
fn a_ball_is_as_large_as_each_lens_makes_it() {
    let ball = formula(BALL);
    let size = Size { width: 400, height: 300 };
    let hits = |camera: Camera| image(&ball, camera, size, |_| {}).1 as f64;
    let is_about = |name: &str, found: f64, expected: f64| {
        assert!((found / expected - 1.0).abs() < 0.01, "{name}: {found} pixels, and not {expected}");
    };
    // The half angle of the ball's outline.
    let angle = (1.0f64 / 5.0).asin();
    let perspective = angle.tan() / 0.25f64.tan() * 150.0;
    is_about("perspective", hits(CAMERA), PI * perspective * perspective);
    is_about("orthographic", hits(with(Lens::Orthographic { height: 3.0 })), PI * 100.0 * 100.0);
    let far = Camera { position: [0.0, -500.0, 0.0], ..with(Lens::Orthographic { height: 3.0 }) };
    is_about("orthographic from afar", hits(far), PI * 100.0 * 100.0);
    let fisheye = Camera { fov: 2.0, ..with(Lens::Fisheye) };
    is_about("fisheye", hits(fisheye), PI * (angle * 150.0).powi(2));
    // Looking at it along the equator, 1 rad of latitude is 150 rows and 1 rad of longitude 100 columns of an almost flat part.
    let around = Camera { fov: 2.0, ..with(Lens::Equirectangular { width: 4.0 }) };
    is_about("equirectangular", hits(around), PI * (angle * 150.0) * (angle * 100.0) * 1.01);
    let shifted = with(Lens::Perspective { shift: [0.2, -0.05] });
    assert!((hits(shifted) / hits(CAMERA) - 1.0).abs() < 0.01, "a shift in the picture's plane changes no size there");
}

#[test]
fn thresholds_and_beams_follow_the_lens() {
    let grows = |camera: &Camera| threshold(camera, SIZE).pixel_radius;
    assert_eq!(grows(&CAMERA), 0.25f64.tan() / 60.0);
    let flat = threshold(&with(Lens::Orthographic { height: 3.0 }), SIZE);
    assert_eq!((flat.pixel_radius, flat.fixed), (0.0, 1.5 / 60.0));
    let around = Camera { fov: PI, ..with(Lens::Equirectangular { width: TAU }) };
    assert!((grows(&around) - PI / 120.0).abs() < 1e-15);
    let stereo = |camera: Camera, layout| Camera { stereo: Some(Stereo { eyes: 0.1, layout }), ..camera };
    assert_eq!(grows(&stereo(CAMERA, StereoLayout::OverUnder)), 2.0 * grows(&CAMERA));
    assert_eq!(beam_radius(&CAMERA, SIZE), Some(grows(&CAMERA)));
    for camera in [
        with(Lens::Orthographic { height: 3.0 }),
        with(Lens::CubeMap(CubeLayout::Strip)),
        stereo(CAMERA, StereoLayout::SideBySide),
        stereo(around, StereoLayout::Left),
    ] {
        assert_eq!(beam_radius(&camera, SIZE), None, "{camera:?}");
    }
    // No two rays of a tile point further apart than its beam holds.
    for camera in [Camera { fov: 5.0, ..with(Lens::Fisheye) }, around, Camera { fov: 2.5, ..CAMERA }] {
        let radius = beam_radius(&camera, SIZE).expect("these have beams");
        let edge = 8.0;
        for tile in 0..70 {
            let corner = [f64::from(tile % 10) * edge, f64::from(tile / 10) * edge];
            let places: Vec<[f64; 2]> = (0..=16)
                .flat_map(|i| (0..=16).map(move |j| [f64::from(i) / 16.0, f64::from(j) / 16.0]))
                .map(|[x, y]| [corner[0] + edge * x, corner[1] + edge * y])
                .collect();
            let all = rays(&camera, SIZE, &places);
            let middle = rays(&camera, SIZE, &[[corner[0] + edge / 2.0, corner[1] + edge / 2.0]])[0].1;
            let most = all.iter().map(|(_, d)| (DVec3::from(*d) - DVec3::from(middle)).length()).fold(0.0, f64::max);
            assert!(most <= edge * radius * 2f64.sqrt() * 1.0001, "{camera:?}: {most} in the tile at {corner:?}");
        }
    }
}

#[test]
fn planes_and_cuts_take_away_what_they_say() {
    let size = Size { width: 400, height: 300 };
    let flat = with(Lens::Orthographic { height: 3.0 });
    let disc = PI * 100.0 * 100.0;
    let is_about = |what: &str, ball: &Formula, camera: Camera, expected: f64| {
        let hits = image(ball, camera, size, |_| {}).1 as f64;
        assert!((hits / expected - 1.0).abs() < 0.02, "{what}: {hits} pixels, and not {expected}");
    };
    let ball = formula(BALL);
    // A plane half a radius before or behind the middle leaves a cap.
    is_about("far", &ball, Camera { far: Some(4.5), ..flat }, 0.75 * disc);
    is_about("near", &ball, Camera { near: 5.5, ..flat }, 0.75 * disc);
    is_about("both", &ball, Camera { near: 4.5, far: Some(5.5), ..flat }, disc);
    // Planes lie across the view direction, so a wide lens sees a cap: at depth 0.7 the ball has radius 0.6.
    let wide = Camera { fov: 2.0, position: [0.0, -1.5, 0.0], far: Some(0.7), ..CAMERA };
    let cap = 0.6 / 0.7 / 1f64.tan() * 150.0;
    is_about("far plane of a wide lens", &ball, wide, PI * cap * cap);
    let around = Camera { lens: Lens::Fisheye, far: Some(0.8), ..wide };
    // The sphere of radius 0.8 meets the ball of radius 1 at 1.5 in a circle at this angle.
    let angle = ((1.5f64 * 1.5 + 0.8 * 0.8 - 1.0) / (2.0 * 1.5 * 0.8)).acos();
    is_about("far sphere of a fisheye", &ball, around, PI * (angle * 150.0).powi(2));
    let with_field = |field: &str| formula(&BALL.replacen('(', &format!("({field}, "), 1));
    is_about("clip", &with_field("clip: [Plane(normal: (0, 0, 1), offset: 0)]"), flat, disc / 2.0);
    is_about("cut", &with_field("cut: [Plane(normal: (0, 0, 1), offset: 0)]"), flat, disc / 2.0);
    let both =
        with_field("clip: [Plane(normal: (0, 0, 1), offset: 0)], cut: [Box(half_size: (1, 2, 1), centre: (1, 0, 0))]");
    is_about("clip and cut", &both, flat, disc / 4.0);
    // The face is closed: from above one sees the whole disc, in the plane.
    let above = Camera { position: [0.0, -0.01, 5.0], ..flat };
    is_about("the face", &with_field("clip: [Plane(normal: (0, 0, 1), offset: 0)]"), above, disc);
}

/// Ordinary cameras pay for nothing that others have.
#[test]
fn ordinary_cameras_have_no_operation_of_others() {
    let made = |camera: &Camera| {
        let arena = Arena::default();
        let function = compose_camera(&arena, camera, SIZE, &Bounds::ball(2.0));
        let cost = Cost::of(&arena, &function);
        (format!("{cost:?}"), wgsl::write(&arena, &Kernel::Map(function)))
    };
    let (cost, text) = made(&CAMERA);
    for word in ["sin(", "cos(", "floor("] {
        assert!(!text.contains(word), "{text}");
    }
    assert_eq!(made(&with(Lens::Perspective { shift: [0.2, 0.1] })).0, cost, "a shift is two other constants");
    assert_eq!(made(&Camera { near: 1.0, ..CAMERA }).0, cost, "near planes are in the field");
    let left = Stereo { eyes: 0.1, layout: StereoLayout::Left };
    for other in [Camera { far: Some(1.0), ..CAMERA }, Camera { stereo: Some(left), ..CAMERA }, with(Lens::Fisheye)] {
        assert!(made(&other).1.len() > text.len(), "{other:?}");
    }
}

/// With exact estimates short cuts (beams, boxes, longer steps) change nothing of any lens's pictures.
#[test]
fn short_cuts_hold_for_every_lens() {
    let ball = formula(BALL);
    let close = Camera { position: [0.0, -2.5, 0.0], ..CAMERA };
    for (lens, fov) in [
        (Lens::Orthographic { height: 3.0 }, 0.5),
        (Lens::Fisheye, 2.0),
        (Lens::Equirectangular { width: 3.0 }, 2.0),
        (Lens::CubeMap(CubeLayout::Cross), 0.5),
        (Lens::Perspective { shift: [0.2, 0.1] }, 0.5),
    ] {
        let camera = Camera { lens, fov, ..close };
        let size = Size { width: 240, height: 180 };
        let (quick, hits) = image(&ball, camera, size, |settings| settings.beams = BeamUse::Untried);
        let (plain, _) = image(&ball, camera, size, |settings| settings.plain = true);
        let is_apart = |(a, b): &(&[u8], &[u8])| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > 8);
        let differ = quick.chunks(3).zip(plain.chunks(3)).filter(is_apart).count();
        assert!(hits > 500 && differ < 20, "{lens:?}: {differ} pixels differ, {hits} hits");
    }
}

#[test]
fn back_ends_agree_on_every_lens() {
    let folder = folder_with(&[("ball.ron", BALL)]);
    for lens in ["orthographic", "fisheye", "equirectangular", "cube-strip", "cube-cross"] {
        for stereo in [&[][..], &["--stereo", "over-under", "--eyes", "0.2"]] {
            let mut pictures = Vec::new();
            for backend in ["cpu", "gpu"] {
                let mut line = vec![
                    "render",
                    "--force",
                    "ball.ron",
                    "--lens",
                    lens,
                    "--size",
                    "96x96",
                    "--samples",
                    "1",
                    "--backend",
                    backend,
                ];
                line.extend(["--camera=0,-1.6,0", "-o", "ball.png"]);
                line.extend(stereo);
                success(&bulbfold(folder.path(), &line));
                pictures.push(pixels(&folder.path().join("ball.png")));
            }
            let differ = pictures[0].iter().zip(&pictures[1]).filter(|(a, b)| a.abs_diff(**b) > 2).count();
            assert!(differ * 200 < pictures[0].len(), "{lens} {stereo:?}: {differ} bytes differ");
        }
    }
}

#[test]
fn cameras_of_files_say_their_lens() {
    let read = |lens: &str| {
        let camera = format!("camera: (position: (0, -5, 0), {lens})");
        let text = BALL.replace("camera: (position: (0, -5, 0), fov: 28.64788975654116)", &camera);
        Formula::from_ron(&text).map(|formula| formula.graph().scene.camera.expect("it has a camera"))
    };
    let lens = |text: &str| read(text).unwrap_or_else(|error| panic!("{text}: {error}")).lens;
    assert_eq!(lens("fov: 20"), Lens::default());
    assert_eq!(lens("lens: Perspective(shift: (0, 0.25))"), Lens::Perspective { shift: [0.0, 0.25] });
    assert_eq!(lens("lens: Orthographic(height: 3)"), Lens::Orthographic { height: 3.0 });
    assert!(
        matches!(lens("lens: Orthographic, fov: 90"), Lens::Orthographic { height } if (height - 10.0).abs() < 1e-9)
    );
    assert_eq!(lens("lens: Fisheye, fov: 360"), Lens::Fisheye);
    assert_eq!(lens("lens: Equirectangular(width: 180)"), Lens::Equirectangular { width: PI });
    assert_eq!(lens("lens: CubeMap(\"cross\")"), Lens::CubeMap(CubeLayout::Cross));
    let focal = read("lens: Perspective(focal_length: 12, sensor: 24)").expect("it is read");
    assert!((focal.fov - PI / 2.0).abs() < 1e-12, "a sensor of twice the focal length sees a right angle");
    let stereo = read("stereo: (eyes: 0.06, layout: \"over_under\")").expect("it is read").stereo;
    assert_eq!(stereo, Some(Stereo { eyes: 0.06, layout: StereoLayout::OverUnder }));
    for (wrong, what) in [
        ("lens: Fishy", "lenses are"),
        ("lens: Orthographic(height: 0)", "0"),
        ("fov: 200", "175"),
        ("fov: 30, lens: Perspective(focal_length: 35)", "not both"),
        ("stereo: (layout: \"left\")", "eyes"),
        ("stereo: (eyes: 1, layout: \"up\")", "side-by-side"),
        ("lens: CubeMap(\"ring\")", "strip"),
        ("lens: Perspective(shift: 1)", "shift"),
    ] {
        let message = read(wrong).expect_err(wrong).to_string();
        assert!(message.contains(what), "{wrong}: {message}");
    }
}

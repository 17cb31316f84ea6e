//! The proven box: where it lies for sets whose box is known, that nothing of a set is outside, and what it saves.

use bulbfold::check::truth::Members;
use bulbfold::check::{Backends, Formula, Target};
use bulbfold::compose::{Bounds, Sides};
use bulbfold::kernel::cpu::Cpu;
use bulbfold::math::Precision;
use bulbfold::render::{Pipeline, RenderSettings, Renderer, Stats, compose_planned};
use bulbfold::shade::Size;

fn proven(formula: &Formula) -> Bounds {
    Bounds::prove(&formula.subject().composer(), formula.plan()).unwrap_or_else(|error| panic!("{}", error.message))
}

fn sides(name: &str) -> Option<Sides> {
    proven(&Formula::builtin(name).unwrap()).sides
}

#[test]
fn boxes_of_known_sets_are_tight() {
    // The sponge and the tetrahedron fill a cube of half-side 1, the Koch cube reaches 1 + 2/3 + 2/9 + ... = 2; the Mandelbox
    // of scale 2 one of 6, of which proofs of balls fall short.
    for (name, half, excess) in [
        ("menger", 1.0, 1.02),
        ("sierpinski_tetrahedron", 1.0, 1.03),
        ("koch_cube", 2.0, 1.02),
        ("mandelbox", 6.0, 1.4),
    ] {
        let sides = sides(name).unwrap_or_else(|| panic!("{name} has a box"));
        for face in sides.low.map(|low| -low).into_iter().chain(sides.high) {
            assert!(half <= face && face < excess * half, "{name}: {sides:?}");
        }
    }
}

#[test]
fn what_fills_the_ball_has_no_box() {
    // A floor that reaches to the ball's surface on all sides, and a set that almost does.
    assert_eq!(sides("bulb_on_floor"), None);
    assert_eq!(sides("mandelbulb"), None);
}

/// Points spread over the bounding ball, by the sequence of R. Roberts.
fn spread(radius: f64, count: usize) -> Vec<[f64; 3]> {
    let point = |i: usize| {
        [0.819_172_513_4, 0.671_043_606_7, 0.549_700_477_9]
            .map(|step: f64| radius * (2.0 * (0.137 + step * i as f64).fract() - 1.0))
    };
    let in_ball = |p: &[f64; 3]| p.iter().map(|x| x * x).sum::<f64>() < radius * radius;
    (0..count).map(point).filter(in_ball).collect()
}

#[test]
fn no_member_is_outside() {
    let mut boxes = 0;
    for name in crate::sampled::sampled(40) {
        let formula = Formula::builtin(name).unwrap();
        let bounds = proven(&formula);
        let Some(sides) = bounds.sides else { continue };
        boxes += 1;
        let members = Members::new(&formula.subject().composer(), &formula.plan().choices).unwrap();
        let points: Vec<[f64; 3]> = spread(bounds.radius, 100_000).into_iter().filter(|p| !sides.holds(p)).collect();
        let inside = members.inside(&points, &vec![0.0; points.len()]);
        let lost = inside.iter().filter(|inside| **inside).count();
        assert_eq!(lost, 0, "{name}: {sides:?} of {}", bounds.radius);
        println!("{name}: {sides:?} of {}", bounds.radius);
    }
    assert!(boxes >= 8, "{boxes} boxes");
}

/// As few pixels as a box is looked for with 2 x 2 samples.
const SIZE: Size = Size { width: 512, height: 512 };

/// A picture's kernels with a box and without.
fn pipelines(formula: &Formula, target: Target, size: Size) -> [(RenderSettings, Pipeline); 2] {
    [true, false].map(|boxed| {
        let precision = target.precision();
        let settings = RenderSettings { size, samples: 2, boxed, precision, ..RenderSettings::default() };
        let pipeline = compose_planned(&formula.subject().composer(), &settings, formula.plan().clone());
        let pipeline = pipeline.unwrap_or_else(|e| panic!("{}", e.message));
        assert_eq!(pipeline.bounds.sides.is_some(), boxed);
        (settings, pipeline)
    })
}

#[test]
fn a_box_loses_no_hit() {
    let backends = Backends::new();
    for name in ["menger", "mandelbox", "mandelbox_negative", "koch_cube"] {
        let formula = Formula::builtin(name).unwrap();
        for target in backends.targets() {
            let [with, without] = pipelines(&formula, target, SIZE).map(|(settings, pipeline)| {
                backends.depths(target, formula.subject().arena, &pipeline, &settings).unwrap()
            });
            // Rays that begin elsewhere come to points that differ, and so do some of those that graze.
            let differ = with.iter().zip(&without).filter(|(a, b)| a.is_some() != b.is_some()).count();
            let hits = without.iter().flatten().count();
            println!("{name} on {}: {differ} of {hits} hits differ", target.name());
            assert!(hits > 20_000 && differ * 500 < hits, "{name} on {}: {differ} of {hits} hits", target.name());
        }
    }
}

#[test]
fn a_box_saves_estimates() {
    for (name, most) in [("menger", 0.75), ("sierpinski_tetrahedron", 0.95)] {
        let formula = Formula::builtin(name).unwrap();
        let cpu = Cpu::new(Precision::F32);
        let [with, without] = pipelines(&formula, Target::CPU_F32, SIZE).map(|(settings, pipeline)| {
            let mut renderer = Renderer::new(&cpu, formula.subject().arena, &pipeline, &settings).unwrap();
            renderer.render(&mut |_| true).unwrap();
            renderer.stats
        });
        let all = |stats: &Stats| (stats.beam_estimates + stats.estimates + stats.shadow_estimates) as f64;
        let share = all(&with) / all(&without);
        println!("{name}: {share:.3} of the estimates");
        assert!(share < most, "{name}: {share}");
    }
}

#[test]
fn small_pictures_are_not_searched() {
    let formula = Formula::builtin("menger").unwrap();
    let size = Size { width: 320, height: 240 };
    let settings = RenderSettings { size, boxed: true, ..RenderSettings::default() };
    let pipeline = compose_planned(&formula.subject().composer(), &settings, formula.plan().clone());
    assert_eq!(pipeline.unwrap_or_else(|e| panic!("{}", e.message)).bounds.sides, None);
}

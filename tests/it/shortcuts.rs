//! Beams, boxes and early ends of orbits: pictures with and without them, hit by hit.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::random_graphs::random_graph;
use crate::sampled::sampled;
use bulbfold::check::truth::{Scale, Truth, Truths, view_rays};
use bulbfold::check::{Backends, Formula, Target};
use bulbfold::formula::embedded::FRACTALS;
use bulbfold::formula::library::Library;
use bulbfold::render::{BeamUse, RenderSettings, compose_planned};
use bulbfold::shade::{Size, frame_automatically, threshold};

const SIZE: Size = Size { width: 112, height: 84 };
const PIXELS: usize = (SIZE.width * SIZE.height) as usize;

/// Formulas that are tried: built-in fractals by name, and as many random graphs.
struct Cases {
    names: Vec<&'static str>,
    graphs: usize,
}

impl Cases {
    /// One fractal of each kind and some others, and a few graphs.
    fn some() -> Cases {
        Cases { names: sampled(27), graphs: 40 }
    }

    /// All that there are.
    fn all() -> Cases {
        Cases { names: FRACTALS.iter().map(|(name, _)| *name).collect(), graphs: 200 }
    }

    fn count(&self) -> usize {
        self.names.len() + self.graphs
    }
}

/// Every ray by itself; the number of samples says how many beams would pay, and whether a box would.
fn alone(samples: u32) -> RenderSettings {
    RenderSettings { size: SIZE, samples, beams: BeamUse::Off, ..RenderSettings::default() }
}

fn depths(formula: &Formula, settings: &RenderSettings) -> Vec<Option<f64>> {
    let subject = formula.subject();
    let pipeline = compose_planned(&subject.composer(), settings, formula.plan().clone());
    let pipeline = pipeline.unwrap_or_else(|e| panic!("{}", e.message));
    Backends::cpu_only().depths(Target::CPU_F32, subject.arena, &pipeline, settings).unwrap()
}

fn footprint(formula: &Formula) -> f64 {
    let camera = formula.graph().scene.camera.unwrap_or_else(|| frame_automatically(formula.plan().bounding_radius));
    2.0 * threshold(&camera, SIZE).pixel_radius
}

/// Pixels of which one alone has a hit, or whose hits are more than two footprints apart.
fn differing(formula: &Formula, a: &[Option<f64>], b: &[Option<f64>]) -> usize {
    let footprint = footprint(formula);
    let differs = |(a, b): &(&Option<f64>, &Option<f64>)| match (a, b) {
        (Some(a), Some(b)) => (a - b).abs() > 2.0 * footprint * a,
        (a, b) => a.is_some() != b.is_some(),
    };
    a.iter().zip(b).filter(differs).count()
}

/// Tests the cases whose rays are marched, on all threads; `test` gives a complaint if it has one.
fn complaints<T: Send>(cases: &Cases, test: impl Fn(&str, &Formula) -> Option<T> + Sync) -> Vec<T> {
    let (next, found) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    let formula = |i: usize| match cases.names.get(i) {
        Some(name) => (name.to_string(), Formula::builtin(name).unwrap()),
        None => {
            let seed = i - cases.names.len();
            let text = random_graph(&Library::builtin(), seed as u64);
            (format!("graph {seed}"), Formula::from_ron(&text).unwrap_or_else(|e| panic!("{text}: {e}")))
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(2, usize::from) {
            scope.spawn(|| {
                loop {
                    let i = next.fetch_add(1, Ordering::SeqCst);
                    if i >= cases.count() {
                        break;
                    }
                    let (name, formula) = formula(i);
                    if formula.graph().scene.plane.is_none() {
                        found.lock().unwrap().extend(test(&name, &formula));
                    }
                }
            });
        }
    });
    found.into_inner().unwrap()
}

#[test]
fn beams_and_boxes_change_no_hits() {
    beams_and_boxes(&Cases::some());
}

#[test]
#[ignore = "minutes: all built-in fractals and 200 random graphs"]
fn beams_and_boxes_change_no_hits_of_any() {
    beams_and_boxes(&Cases::all());
}

/// Marches each case with beams, with a box and without either, and compares the hits.
fn beams_and_boxes(cases: &Cases) {
    let (beamed, all) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let wrong = complaints(cases, |name, formula| {
        let single = depths(formula, &alone(2));
        let beams = RenderSettings { beams: BeamUse::Tried, ..alone(2) };
        let box_pays = RenderSettings { boxed: true, ..alone(12) };
        let [beams, boxed] = [beams, box_pays].map(|settings| differing(formula, &single, &depths(formula, &settings)));
        let subject = formula.subject();
        let settings = RenderSettings { beams: BeamUse::Tried, ..alone(2) };
        let pipeline = compose_planned(&subject.composer(), &settings, formula.plan().clone()).ok()?;
        let hold = bulbfold::render::beams_hold(subject.arena, &pipeline, &settings).unwrap();
        beamed.fetch_add(usize::from(hold && pipeline.tiles.is_some()), Ordering::SeqCst);
        println!("{name}: {beams} pixels differ with beams, {boxed} with a box");
        all.fetch_add(beams.max(boxed), Ordering::SeqCst);
        let counts = || format!("{name}: {beams} with beams, {boxed} with a box");
        (1000 * beams.max(boxed) > PIXELS).then(|| (beams.max(boxed), counts()))
    });
    // The trial's 2,352 rays cannot tell 0.1 % from a little more, so one in fifty may be beyond, up to 0.3 %.
    let few = wrong.len() * 50 <= cases.count();
    assert!(few && wrong.iter().all(|(count, _)| 1000 * count <= 3 * PIXELS), "{wrong:#?}");
    let all = all.into_inner();
    println!("{all} of {} pixels differ", cases.count() * PIXELS);
    assert!(all * 4000 <= cases.count() * PIXELS, "{all} pixels differ");
    let beamed = beamed.into_inner();
    println!("{beamed} of {} have beams", cases.count());
    assert!(5 * beamed > 2 * cases.count(), "only {beamed} have beams");
}

/// What was lost in square tiles: the estimate of a negative power is not 0 at the escape sphere, which is the set's surface.
#[test]
fn estimates_that_do_not_end_at_the_set_have_no_beams() {
    for (power, radius) in [(-5, 4.2), (-5, 5.0), (-2, 4.2)] {
        let formula = Formula::from_ron(&format!(
            r#"(nodes: {{ "bulb": bulb_power(power: {power}) }}, output: "bulb", escape_radius: 4, max_iterations: 10, bounding_radius: {radius})"#
        ))
        .unwrap();
        let single = depths(&formula, &alone(2));
        let count = |beams| differing(&formula, &single, &depths(&formula, &RenderSettings { beams, ..alone(2) }));
        let (tried, untried) = (count(BeamUse::Tried), count(BeamUse::Untried));
        println!("power {power}, bounds {radius}: {tried} with beams, {untried} with beams that nobody tried");
        assert!(1000 * tried <= PIXELS && 100 * untried > PIXELS);
    }
}

/// A ripple stretches along x alone.
const RIPPLE: &str = r#"(nodes: { "wave": wave(WAVE), "square": quaternion_square(), "all": Sequence(["wave", "square"]) },
    output: "all", constant: CONSTANT, escape_radius: 8, max_iterations: 40)"#;

/// Stops of a march in front of the truth of orbits that run to their ends, of all its stops.
fn early(formula: &Formula) -> (usize, usize) {
    let subject = formula.subject();
    let composer = subject.composer();
    let plan = formula.plan();
    let camera = formula.graph().scene.camera.unwrap_or_else(|| frame_automatically(plan.bounding_radius));
    let scale = Scale::of_view(&camera, SIZE, plan.bounding_radius);
    let rays = view_rays(&camera, SIZE, 150, 4);
    let truths =
        Truths::find(&composer, &plan.choices, &rays, scale, &mut |_| true).unwrap_or_else(|e| panic!("{}", e.message));
    let late = plan.clone().with_late_ends();
    let late =
        Truths::find(&composer, &late.choices, &rays, scale, &mut |_| true).unwrap_or_else(|e| panic!("{}", e.message));
    let stops = truths.depths.iter().zip(&late.depths).filter(|(a, _)| a.depth().is_some());
    let is_early = |(a, b): &(&Truth, &Truth)| match (a, b) {
        (Truth::Hit(a), Truth::Hit(b)) => *a < b - 4.0 * scale.footprint(*b),
        (Truth::Hit(_), Truth::Miss) => true,
        _ => false,
    };
    (stops.clone().filter(is_early).count(), stops.count())
}

/// Orbits end early only where members are near: every stop of a ripple was in front of the set.
#[test]
fn orbits_run_on_where_a_map_stretches_one_way() {
    for (wave, constant) in [
        (r#"amplitude: (0.3, 0, 0), frequency: (8, 8, 8), along: "next""#, "Mandelbrot"),
        (r#"amplitude: (0.3, 0, 0), frequency: (8, 8, 8), along: "next""#, "Julia((-0.4, 0.3, 0.2))"),
        (r#"amplitude: (0, 0.25, 0), frequency: (9, 9, 9), along: "next""#, "Mandelbrot"),
    ] {
        let formula = Formula::from_ron(&RIPPLE.replace("WAVE", wave).replace("CONSTANT", constant)).unwrap();
        let (early, stops) = early(&formula);
        println!("{wave} {constant}: ends {}, {early} of {stops} early", formula.plan().choices[0].ends);
        assert!(!formula.plan().choices[0].ends, "{wave} {constant}");
        assert_eq!(early, 0, "{wave} {constant}");
    }
}

/// Where early ends are right they stay, whatever the limit is.
#[test]
fn orbits_end_early_where_that_is_right() {
    for name in ["menger", "mandelbox", "mandelbulb", "box_bulb"] {
        for limit in ["40", "250"] {
            let formula = Formula::with(name, &[("max_iterations", limit)]).unwrap();
            assert!(formula.plan().choices.iter().all(|choice| choice.ends), "{name} with {limit} iterations");
        }
    }
}

//! Brute force is right where the answer is known, and says which marches are not.

use std::path::Path;

use bulbfold::check::exact::{Limit, ball_depth, polytope_depth};
use bulbfold::check::truth::{Budget, Members, Ray, Scale, Truth, Truths, candidate, march_rays, point, view_rays};
use bulbfold::check::{Formula, Random};
use bulbfold::graph::{Camera, Method};
use bulbfold::kernel::cpu::Cpu;
use bulbfold::march::MarchSettings;
use bulbfold::math::Precision;
use bulbfold::shade::{Size, frame_automatically};

use crate::support::{bulbfold, folder, stderr, stdout};

const SIZE: Size = Size { width: 160, height: 120 };

fn camera(formula: &Formula) -> Camera {
    formula.graph().scene.camera.unwrap_or_else(|| frame_automatically(formula.plan().bounding_radius))
}

fn truths(formula: &Formula, count: usize) -> Truths {
    let subject = formula.subject();
    let camera = camera(formula);
    let scale = Scale::of_view(&camera, SIZE, subject.plan.bounding_radius);
    let rays = view_rays(&camera, SIZE, count, 1);
    let found = Truths::find(&subject.composer(), &subject.plan.choices, &rays, scale, &mut |_| true);
    found.unwrap_or_else(|error| panic!("{}", error.message))
}

/// Every settled truth is that of a known depth, to a hundredth of a footprint.
fn expect_depths(formula: &Formula, known: impl Fn(Ray) -> Option<f64>) {
    let truths = truths(formula, 300);
    let (mut hits, mut misses) = (0, 0);
    for (ray, truth) in truths.rays.iter().zip(&truths.depths) {
        match (*truth, known(*ray)) {
            (Truth::Hit(t), Some(depth)) => {
                hits += 1;
                assert!((t - depth).abs() < 0.01 * truths.scale.footprint(depth), "{ray:?}: {t} {depth}");
            }
            (Truth::Miss, None) => misses += 1,
            (Truth::Ambiguous, _) => {}
            // A ray may cut less than an eighth of a footprint off an edge.
            (Truth::Miss, Some(depth)) => {
                let behind = point(*ray, depth + 0.126 * truths.scale.footprint(depth));
                assert!(known((behind, ray.1)).is_none_or(|t| t > 0.0), "{ray:?} passed {depth}");
            }
            (truth, known) => panic!("{ray:?}: {truth:?}, expected {known:?}"),
        }
    }
    assert!(hits > 30 && misses > 30, "{hits} {misses}");
}

#[test]
fn a_ball_is_met_where_the_quadratic_formula_says() {
    let formula = Formula::from_ron(
        r#"(nodes: { "ball": Sphere(centre: (0.2, 0.1, -0.3), radius: 0.8) }, output: "ball", bounding_radius: 2.0)"#,
    );
    expect_depths(&formula.unwrap(), |ray| ball_depth(ray, [0.2, 0.1, -0.3], 0.8));
}

#[test]
fn a_cut_cube_is_met_where_clipping_says() {
    let formula = Formula::from_ron(
        r#"(nodes: {
            "cube": Box(centre: (0, 0, 0), half_size: (1, 0.7, 0.5)),
            "cut": Plane(normal: (0.6, 0.0, 0.8), offset: 0.5),
            "both": Intersection(["cube", "cut"]),
        }, output: "both", bounding_radius: 2.0)"#,
    );
    let mut faces = vec![([0.6, 0.0, 0.8], 0.5)];
    for (axis, half) in [1.0, 0.7, 0.5].into_iter().enumerate() {
        for sign in [-1.0, 1.0] {
            let mut normal = [0.0; 3];
            normal[axis] = sign;
            faces.push((normal, half));
        }
    }
    expect_depths(&formula.unwrap(), |ray| polytope_depth(ray, &faces));
}

#[test]
fn the_bulb_without_a_constant_is_the_unit_ball() {
    // |z| after n iterations is r^(8^n): with escape radius 10 and 3 iterations, 10^(1/512) is the ball's radius.
    let formula = Formula::from_ron(
        r#"(nodes: { "bulb": bulb_power(power: 8) }, constant: Off, escape_radius: 10, max_iterations: 3, bounding_radius: 2.0)"#,
    );
    expect_depths(&formula.unwrap(), |ray| ball_depth(ray, [0.0; 3], 10f64.powf(1.0 / 512.0)));
}

#[test]
fn exact_distances_have_known_values() {
    let menger = Limit::menger();
    let tetra = Limit::sierpinski_tetrahedron(2.0);
    let (octa, icosa, dodeca) = (Limit::octahedron(2.0), Limit::icosahedron(3.0), Limit::dodecahedron(4.0));
    let corner = |r: f64, along: [f64; 3]| (glam::DVec3::from(along).normalize() * r).to_array();
    let known = [
        (&menger, [2.0, 2.0, 2.0], 3f64.sqrt()),
        (&menger, [1.0, 1.0, 1.0], 0.0),
        (&menger, [3.0, 0.5, 0.5], 2.0),
        // The centre is in the cross of the tunnels, a third wide; an edge of four of them is nearest.
        (&menger, [0.0, 0.0, 0.0], 2f64.sqrt() / 3.0),
        (&menger, [1.0, 0.0, 0.0], 1.0 / 3.0),
        (&tetra, [2.0, 2.0, 2.0], 3f64.sqrt()),
        (&tetra, [0.0, 0.0, 1.0], 0.0),
        // An edge is whole: its points are dyadic sums of corners.
        (&tetra, [0.3, 0.3, 1.0], 0.0),
        (&tetra, [0.0, 0.0, 3.0], 2.0),
        // The octahedron in the middle is empty. Its faces are Sierpinski triangles, whose own middles are empty, too: the
        // nearest point is half way between (1/2, 1/2, 0) and (1/2, 0, 1/2).
        (&tetra, [0.0, 0.0, 0.0], 0.375f64.sqrt()),
        // Edges of an octahedron of scale 2 are whole; its six parts meet in its middle.
        (&octa, [0.0, 0.0, 0.0], 0.0),
        (&octa, [2.0, 0.0, 0.0], 1.0),
        (&octa, [1.0, 1.0, 0.0], 0.5f64.sqrt()),
        (&octa, [0.3, 0.7, 0.0], 0.0),
        // On the axis of a face, of which a Sierpinski triangle is left, the middle of an edge of its hole is nearest,
        // (1/2, 1/4, 1/4).
        (&octa, [1.0, 1.0, 1.0], 1.375f64.sqrt()),
        // Outside along a corner, and the middle: parts reach in to 1 - 2 / scale of the radius.
        (&icosa, [0.0, 0.0, 0.0], 1.0 - 2.0 / 3.0),
        (&icosa, corner(2.5, [PHI, 1.0, 0.0]), 1.5),
        (&dodeca, [0.0, 0.0, 0.0], 0.5),
        (&dodeca, corner(1.5, [1.0, -1.0, 1.0]), 0.5),
    ];
    for (limit, p, expected) in known {
        let found = limit.distance(p);
        assert!((found - expected).abs() < 1e-8, "{} {p:?}: {found}, expected {expected}", limit.name());
    }
}

const PHI: f64 = 1.618_033_988_749_895;

/// Systems whose limit is known: escape radius plus radius, over scale^iterations, is how much thicker they are.
fn known() -> Vec<(&'static str, Formula, f64)> {
    let polytope = |name, text: &str, grain| (name, Formula::from_ron(text).unwrap(), grain);
    vec![
        ("menger", Formula::builtin("menger").unwrap(), 0.00445),
        ("sierpinski_tetrahedron", Formula::builtin("sierpinski_tetrahedron").unwrap(), 0.0191),
        polytope(
            "octahedron",
            r#"(nodes: {"a": Sequence([octa_fold(), scale(scale: 2, centre: (1, 0, 0))])}, constant: Off, escape_radius: 3, max_iterations: 8, bounding_radius: 1.05)"#,
            0.0157,
        ),
        polytope(
            "icosahedron",
            r#"(nodes: {"a": Sequence([icosa_fold(), scale(scale: 2.7, centre: (0.8506508083520400, 0.5257311121191336, 0))])}, constant: Off, escape_radius: 3, max_iterations: 6, bounding_radius: 1.05)"#,
            0.0104,
        ),
        polytope(
            "dodecahedron",
            r#"(nodes: {"a": Sequence([dodeca_fold(), scale(scale: 3.7, centre: (0.5773502691896258, 0.5773502691896258, 0.5773502691896258))])}, constant: Off, escape_radius: 3, max_iterations: 5, bounding_radius: 1.05)"#,
            0.00577,
        ),
    ]
}

#[test]
fn truths_lie_on_the_known_limit_sets() {
    for (name, formula, grain) in known() {
        let limit = Limit::of(formula.graph()).expect(name);
        let truths = truths(&formula, 200);
        let mut hits = 0;
        for (ray, truth) in truths.rays.iter().zip(&truths.depths) {
            let exact = limit.depth(*ray, 20.0, 1e-7);
            match (*truth, exact) {
                (Truth::Hit(t), _) => {
                    hits += 1;
                    assert!(limit.distance(point(*ray, t)) <= grain, "{name} {ray:?} at {t}");
                    assert!(exact.is_none_or(|depth| t <= depth + 1e-6), "{name} {ray:?}: {t} is behind {exact:?}");
                }
                (Truth::Miss, Some(depth)) => panic!("{name} {ray:?}: a miss, but the set is at {depth}"),
                _ => {}
            }
        }
        assert!(hits > 25, "{name}: {hits}");
    }
}

#[test]
fn no_estimate_exceeds_the_exact_distance() {
    for (name, formula, _) in known() {
        let limit = Limit::of(formula.graph()).expect(name);
        let mut random = Random::new(11);
        for method in formula.plan().choices[0].applicable.clone() {
            for _ in 0..60 {
                let p = random.in_ball(3.0);
                let (estimate, exact) = (formula.estimate(p, method), limit.distance(p));
                // One-sided differences over h, a hundredth of the distance, are off by that share at most: r is bent.
                let slack = if method.is_difference() { 1e-2 } else { 1e-9 };
                assert!(estimate <= exact * (1.0 + slack) + 1e-9, "{name} {method:?} at {p:?}: {estimate} > {exact}");
            }
        }
    }
}

#[test]
fn other_formulas_have_no_known_limit() {
    for name in ["mandelbox", "mandelbulb", "icosahedron_kifs", "bulb_on_floor"] {
        assert_eq!(Limit::of(Formula::builtin(name).unwrap().graph()), None, "{name}");
    }
    let other = Formula::with("sierpinski_tetrahedron", &[("scale", "1.8")]).unwrap();
    assert_eq!(Limit::of(other.graph()), None);
    // Without its turn the built-in kaleidoscope is still too large: its parts overlap, and the fold cuts them.
    let overlapping = r#"(nodes: {"a": Sequence([icosa_fold(), scale(scale: 2.3, centre: (0.8506508083520400, 0.5257311121191336, 0))])}, constant: Off, escape_radius: 6, max_iterations: 6)"#;
    assert_eq!(Limit::of(Formula::from_ron(overlapping).unwrap().graph()), None);
}

/// The lean kernel says what the whole estimator says.
#[test]
fn membership_without_derivatives_is_the_same() {
    for name in ["mandelbulb", "mandelbox", "quaternion_julia", "box_bulb", "bulb_on_floor", "menger_bulb"] {
        let formula = Formula::builtin(name).unwrap();
        let subject = formula.subject();
        let members =
            Members::new(&subject.composer(), &subject.plan.choices).unwrap_or_else(|e| panic!("{}", e.message));
        let mut random = Random::new(5);
        let points: Vec<[f64; 3]> = (0..400).map(|_| random.in_ball(subject.plan.bounding_radius.min(8.0))).collect();
        let kernel = subject.estimator(&subject.plan.choices).unwrap_or_else(|e| panic!("{}", e.message));
        let backends = bulbfold::check::Backends::cpu_only();
        let whole = subject.estimates(&backends, bulbfold::check::Target::CPU_F64, &kernel, &points).unwrap();
        let lean = members.inside(&points, &vec![1e-9; points.len()]);
        assert!(lean.iter().any(|x| *x) && lean.iter().any(|x| !*x), "{name}");
        assert!(whole.iter().zip(&lean).all(|((_, inside), lean)| inside == lean), "{name}");
    }
}

fn march(
    formula: &Formula,
    truths: &Truths,
    method: Method,
    fudge: f64,
    radius: f64,
) -> bulbfold::check::truth::Judgement {
    let subject = formula.subject();
    let mut choices = subject.choices(Some(method)).expect("it applies");
    for choice in &mut choices {
        choice.radius = radius;
    }
    let settings = MarchSettings {
        fudge,
        pixel_radius: truths.scale.pixel.pixel_radius,
        precision: Precision::F64,
        ..MarchSettings::default()
    };
    let kernel = candidate(&subject.composer(), &choices, &settings).unwrap_or_else(|e| panic!("{}", e.message));
    let cpu = Cpu::new(Precision::F64);
    let ends = march_rays(&cpu, subject.arena, &kernel, &truths.rays, truths.scale.bounding_radius).unwrap();
    truths.judge(&ends)
}

/// One truth judges several candidates, and tells a march that overestimates from one that does not.
#[test]
fn a_march_that_overestimates_is_seen() {
    let formula = Formula::builtin("sierpinski_tetrahedron").unwrap();
    let truths = truths(&formula, 600);
    let right = march(&formula, &truths, Method::Scalar, 1.0, 3f64.sqrt());
    // (r + 30) / dr: several times the true distance.
    let wrong = march(&formula, &truths, Method::Scalar, 1.0, -30.0);
    assert!(right.missed < 0.005 && right.early < 0.05 && right.median_error < 0.5, "{right:?}");
    assert!(wrong.missed > 0.1, "{wrong:?}");
    assert!(right.is_within(&Budget::default()) && !wrong.is_within(&Budget::default()));
    let slow = march(&formula, &truths, Method::Scalar, 0.5, 3f64.sqrt());
    assert!(slow.estimates > 1.3 * right.estimates, "{} {}", slow.estimates, right.estimates);
}

/// Stops in front of the truth are early by half a percent of the bounding radius, whatever the pixel.
#[test]
fn early_stops_are_counted_by_the_bounding_radius() {
    let formula = Formula::from_ron(
        r#"(nodes: { "ball": Sphere(centre: (0, 0, 0), radius: 1.0) }, output: "ball", bounding_radius: 2.0)"#,
    )
    .unwrap();
    let truths = truths(&formula, 200);
    let end_at = |shift: f64, undecided: bool| {
        let ends: Vec<_> = truths
            .depths
            .iter()
            .map(|truth| bulbfold::check::truth::End {
                status: if truth.depth().is_some() {
                    bulbfold::kernel::Status::Hit
                } else {
                    bulbfold::kernel::Status::Miss
                },
                t: truth.depth().map_or(9.0, |t| t + shift),
                estimates: 10,
                iterations: 20,
                nan: false,
                undecided,
            })
            .collect();
        truths.judge(&ends)
    };
    let stop = |shift: f64| end_at(shift, false);
    assert_eq!((stop(-0.009).early, stop(-0.009).missed), (0.0, 0.0));
    assert_eq!((stop(-0.011).early, stop(-0.011).missed), (1.0, 0.0));
    assert_eq!((stop(0.0).median_error, stop(0.0).estimates, stop(0.0).iterations), (0.0, 10.0, 20.0));
    assert_eq!((stop(0.2).missed, stop(0.2).early), (1.0, 0.0));
    let settled = truths.counts()[0] + truths.counts()[1];
    assert!(settled > 180, "{settled}");
    // What a march of proofs passed speaks against the proofs, unless it says that it is not sure.
    assert_eq!((stop(0.2).disproven, stop(0.2).undecided), (truths.counts()[0], 0));
    assert_eq!((end_at(0.2, true).disproven, end_at(0.2, true).undecided), (0, settled));
}

#[test]
fn finding_can_be_stopped() {
    let formula = Formula::builtin("mandelbulb").unwrap();
    let subject = formula.subject();
    let view = camera(&formula);
    let scale = Scale::of_view(&view, SIZE, subject.plan.bounding_radius);
    let rays = view_rays(&view, SIZE, 400, 1);
    let mut shares = Vec::new();
    let found = Truths::find(&subject.composer(), &subject.plan.choices, &rays, scale, &mut |share| {
        shares.push(share);
        share < 0.5
    });
    let found = found.unwrap_or_else(|error| panic!("{}", error.message));
    assert!(!found.rays.is_empty() && found.rays.len() < 400, "{}", found.rays.len());
    assert_eq!(found.rays.len(), found.depths.len());
    assert!(shares.windows(2).all(|pair| pair[0] <= pair[1] + 1e-9), "{shares:?}");
    // What was found is what would have been found.
    let whole = Truths::find(&subject.composer(), &subject.plan.choices, &rays, scale, &mut |_| true);
    let whole = whole.unwrap_or_else(|error| panic!("{}", error.message));
    assert_eq!(whole.depths[..found.depths.len()], found.depths[..]);
}

#[test]
fn the_command_prints_a_table_and_json_lines() {
    let output = bulbfold(
        Path::new("."),
        ["truth", "menger", "--rays", "60", "--size", "160x120", "--de", "scalar", "--fudge", "0.9"],
    );
    let text = stdout(&output);
    assert!(output.status.success(), "{text}");
    for word in
        ["truth of 60 rays", "rays meet the Menger sponge", "march by scalar linear, fudge 0.9", "missed", "early"]
    {
        assert!(text.contains(word), "{word}\n{text}");
    }
    let output = bulbfold(Path::new("."), ["truth", "menger", "--rays", "60", "--size", "160x120", "--json"]);
    let text = stdout(&output);
    let lines: Vec<serde_json::Value> = text.lines().map(|line| serde_json::from_str(line).expect(line)).collect();
    assert_eq!(lines.len(), 61);
    let hits = lines.iter().filter(|line| line["truth"] == "hit").count();
    assert_eq!(lines[60]["summary"]["hits"], hits);
    assert_eq!(lines[60]["summary"]["exact"]["passed"], 0);
}

#[test]
fn proofs_tell_what_they_did_not_decide() {
    let run = |de: &str, more: &[&str]| {
        let output =
            bulbfold(Path::new("."), [&["truth", "chebyshev_turned", "--rays", "60", "--de", de], more].concat());
        stdout(&output)
    };
    let summary = |de: &str| -> serde_json::Value {
        let text = run(de, &["--json"]);
        serde_json::from_str(text.lines().last().unwrap()).unwrap()
    };
    let of_proofs = summary("certified");
    assert!(of_proofs["summary"]["undecided"].as_u64().is_some_and(|rays| (10..60).contains(&rays)), "{of_proofs}");
    assert_eq!(of_proofs["summary"]["disproven"], 0);
    assert!(summary("scalar")["summary"]["undecided"].is_null());
    assert!(run("certified", &[]).contains("rays crossed something unproven; hits passed by the others: 0"));
    assert!(!run("scalar", &[]).contains("unproven"));
}

#[test]
fn one_formula_fails_where_it_breaks_the_budget() {
    let run = |more: &[&str]| {
        bulbfold(
            Path::new("."),
            [&["truth", "menger", "--rays", "60", "--size", "160x120", "--de", "scalar", "--fudge", "1"], more]
                .concat(),
        )
    };
    for more in [&["--error-budget", "0.5%,5%,0.000001"][..], &["--error-budget", "0.5%,5%,0.000001", "--json"]] {
        let output = run(more);
        assert_eq!(output.status.code(), Some(1));
        let said = stderr(&output);
        assert!(said.contains("menger: a median depth error") && said.contains("bulbfold calibrate"), "{said}");
        assert!(!output.stdout.is_empty(), "what was measured is told all the same");
    }
    // A view of nothing.
    let output = run(&["--set", "camera=(position: (9, 9, 9), target: (10, 10, 10))"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("no ray of the view hits anything"));
}

#[test]
fn the_command_takes_rays_from_a_file() {
    let folder = folder();
    let path = folder.path().join("rays.csv");
    // Onto the rim of a face, and through the hole in its middle.
    std::fs::write(&path, "ox,oy,oz,dx,dy,dz\n0.99,-3,0.93,0,2,0\n0,-3,0,0,1,0\n").unwrap();
    let output = bulbfold(Path::new("."), ["truth", "menger", "--rays-file", &path.display().to_string(), "--json"]);
    let text = stdout(&output);
    let lines: Vec<serde_json::Value> = text.lines().map(|line| serde_json::from_str(line).expect(line)).collect();
    assert!(lines[0]["t"].as_f64().is_some_and(|t| (t - 2.0).abs() < 0.01), "{text}");
    assert_eq!(lines[1]["truth"], "miss");
    std::fs::write(&path, "0,0,0,0,0,0\n").unwrap();
    let output = bulbfold(Path::new("."), ["truth", "menger", "--rays-file", &path.display().to_string()]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("ray 1 has a direction of length 0"));
}

/// Beyond what a pixel resolves more iterations leave the truth where it is. Members of what 200 iterations leave are dust, and no
/// fixed steps meet any of it on the sponge and the box.
#[test]
fn more_iterations_than_a_pixel_resolves_move_no_truth() {
    for name in ["menger", "mandelbox", "mandelbulb"] {
        let [low, high] = ["30", "200"].map(|limit| {
            let formula = Formula::with(name, &[("max_iterations", limit)]).unwrap();
            truths(&formula, 300)
        });
        assert!(low.counts()[0] > 80, "{name}: {:?}", low.counts());
        let pairs = low.depths.iter().zip(&high.depths);
        let agree = pairs.filter(|(a, b)| match (a.depth(), b.depth()) {
            (Some(a), Some(b)) => (a - b).abs() < 0.1 * low.scale.footprint(a),
            (a, b) => a == b,
        });
        let agree = agree.count();
        assert!(agree >= 297, "{name}: {agree} of 300 rays agree; {:?} and {:?}", low.counts(), high.counts());
    }
    let formula = Formula::with("menger", &[("max_iterations", "200")]).unwrap();
    let (truths, limit) = (truths(&formula, 300), Limit::menger());
    for (ray, truth) in truths.rays.iter().zip(&truths.depths) {
        let Some(t) = truth.depth() else { continue };
        let distance = limit.distance(point(*ray, t));
        assert!(distance < 0.01 * truths.scale.footprint(t), "{ray:?}: {distance} at {t}");
    }
}

/// With thresholds of 0 membership is what the iterations say.
#[test]
fn membership_at_the_footprint_is_exact_for_a_threshold_of_0() {
    let formula = Formula::with("menger", &[("max_iterations", "12")]).unwrap();
    let subject = formula.subject();
    let (composer, choices) = (subject.composer(), &subject.plan.choices);
    let exact = Members::new(&composer, choices).unwrap_or_else(|e| panic!("{}", e.message));
    let shown = Members::at_footprint(&composer, choices).unwrap_or_else(|e| panic!("{}", e.message));
    let mut random = Random::new(8);
    // Points just beside the corner (1, 1, 1), which belongs to the sponge.
    let near = |random: &mut Random| random.in_ball(1e-3).map(|x| 1.0 - x.abs());
    let points: Vec<[f64; 3]> = (0..300).map(|_| near(&mut random)).collect();
    let members = |members: &Members, eps: f64| members.inside(&points, &vec![eps; points.len()]);
    assert_eq!(members(&exact, 0.0), members(&shown, 0.0));
    assert_eq!(members(&exact, 0.01), members(&exact, 0.0));
    let count = |of: Vec<bool>| of.into_iter().filter(|inside| *inside).count();
    let (few, many) = (count(members(&exact, 0.0)), count(members(&shown, 0.01)));
    assert!(few < many, "{few} points are members, {many} are with a threshold of 0.01");
}

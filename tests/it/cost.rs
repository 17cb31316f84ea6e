//! No more than the scene needs: what is switched off leaves no operation on the tape and no line in the WGSL, and hybrids
//! cost what their steps cost. Everything here is counted, nothing timed.

use std::path::Path;
use std::sync::Arc;

use bulbfold::compose::{Composer, choose, field_orbits, iteration_parts};
use bulbfold::diag::Diagnostics;
use bulbfold::expr::{Arena, Function, Op};
use bulbfold::formula::library::Library;
use bulbfold::graph::{EstimateSettings, Method};
use bulbfold::kernel::cost::{Cost, MarchCost};
use bulbfold::kernel::{Kernel, wgsl};
use bulbfold::load::{load, load_text};
use bulbfold::render::{Pipeline, RenderSettings, Role, compose_pipeline};

use crate::support::{bulbfold, stderr, stdout};

/// A formula's picture, and what it was made of.
struct Made {
    arena: Arc<Arena>,
    pipeline: Pipeline,
}

/// Composes a file's text with a method.
fn make(text: &str, method: Option<Method>) -> Made {
    let mut library = Library::builtin();
    let mut d = Diagnostics::default();
    let loaded = load_text(&mut library, "cost.ron", text, &[], &mut d);
    let graph = loaded.unwrap_or_else(|| panic!("{}\n{text}", d.render(&library.sources, false))).graph;
    let arena = Arc::new(Arena::default());
    let composer = Composer { arena: &arena, library: &library, graph: &graph };
    let estimate = EstimateSettings { method, ..EstimateSettings::default() };
    let settings = RenderSettings { estimate, ..RenderSettings::default() };
    let pipeline = compose_pipeline(&composer, &settings).expect("it composes");
    Made { arena, pipeline }
}

/// A Mandelbulb with a look and other fields.
fn bulb(look: &str, fields: &str) -> String {
    format!("(nodes: {{\"bulb\": bulb_power(power: 8.0)}}, output: \"bulb\", {fields} look: ({look}))")
}

const PLAIN: &str = "shadows: false, occlusion: 0.0, palette: [(0.8, 0.8, 0.8), (0.8, 0.8, 0.8), (0.8, 0.8, 0.8), (0.8, 0.8, 0.8), (0.8, 0.8, 0.8)],";

impl Made {
    fn kernel(&self, name: &str) -> &Kernel {
        let found = self.pipeline.kernels().into_iter().find(|(found, _)| *found == name);
        found.unwrap_or_else(|| panic!("there is no kernel {name}")).1
    }

    fn cost(&self, name: &str) -> Cost {
        let cost = |sum: Cost, function: &Function| sum + Cost::of(&self.arena, function);
        self.kernel(name).functions().into_iter().fold(Cost::default(), cost)
    }

    fn wgsl(&self, name: &str) -> String {
        wgsl::write(&self.arena, self.kernel(name))
    }

    fn march(&self) -> MarchCost {
        let march = self.pipeline.march();
        MarchCost::of(&self.arena, march)
    }

    /// Whether a port of the kernel's only function is read.
    fn reads(&self, name: &str, port: &str) -> bool {
        let Kernel::Map(function) = self.kernel(name) else { panic!("{name} is a map") };
        let at = function.inputs.iter().position(|p| p.name == port);
        at.is_some_and(|at| function.reads(&self.arena, at))
    }
}

#[test]
fn a_scene_without_shadows_has_no_shadow_code() {
    let (with, without) = (make(&bulb("shadows: true,", ""), None), make(&bulb("shadows: false,", ""), None));
    let shadow = Role::ShadowRay(0);
    assert!(with.pipeline.passes.get(shadow).is_some() && without.pipeline.passes.get(shadow).is_none());
    assert!(with.wgsl("colour").contains("shadow"));
    assert!(!without.wgsl("colour").contains("shadow"));
    assert!(without.cost("colour").operations() < with.cost("colour").operations());
}

#[test]
fn fog_occlusion_and_traps_that_are_off_cost_nothing() {
    let foggy = make(&bulb(&format!("{PLAIN} fog: 0.5"), ""), None);
    let plain = make(&bulb(PLAIN, ""), None);
    assert!(plain.cost("colour").operations() < foggy.cost("colour").operations());
    assert_eq!(plain.cost("colour").exp, 0.0, "fog, occlusion and traps are what exponentials are for");
    assert!(!plain.wgsl("colour").contains("exp("));
    let occluded = make(&bulb(&PLAIN.replace("occlusion: 0.0", "occlusion: 0.5"), ""), None);
    for (made, has_corners) in [(&plain, false), (&occluded, true)] {
        assert!(!made.reads("colour", "trap") && !made.reads("colour", "steps"));
        assert_eq!(made.pipeline.passes.get(Role::CornerMarch).is_some(), has_corners);
    }
    assert!(occluded.reads("colour", "corner_t_outside"));
}

#[test]
fn only_pictures_of_surroundings_leave_tables() {
    let has_tables = |made: &Made, name: &str| made.wgsl(name).contains("tables");
    let plain = make(&bulb(PLAIN, "environment: Uniform((1, 1, 1)),"), None);
    assert!(plain.pipeline.kernels().iter().all(|(name, _)| !has_tables(&plain, name)));
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("white.png");
    let picture =
        bulbfold::film::Image { size: bulbfold::shade::Size { width: 16, height: 8 }, rgb: vec![255; 16 * 8 * 3] };
    picture.write_png(&file).unwrap();
    let pictured = make(&bulb(PLAIN, &format!("environment: Picture(file: {:?}),", file.display().to_string())), None);
    let with: Vec<&str> = pictured
        .pipeline
        .kernels()
        .into_iter()
        .map(|(name, _)| name)
        .filter(|name| has_tables(&pictured, name))
        .collect();
    assert_eq!(with, ["background", "colour"]);
    assert!(pictured.cost("march").operations() == plain.cost("march").operations());
}

#[test]
fn lamps_glow_and_ground_fog_leave_nothing_where_they_are_off() {
    let names = |made: &Made| made.pipeline.kernels().into_iter().map(|(name, _)| name).collect::<Vec<_>>();
    let plain = make(&bulb(PLAIN, ""), None);
    let glowing = make(&bulb(PLAIN, "atmosphere: (glow: ()),"), None);
    assert!(!names(&plain).contains(&"passing_march") && names(&glowing).contains(&"passing_march"));
    let lamps = "light: {\"a\": Point(at: (2, 0, 0)), \"b\": Point(at: (0, 2, 0), shadows: false)},";
    let lit = make(&bulb(PLAIN, lamps), None);
    assert_eq!(names(&lit).iter().filter(|name| **name == "shadow_march").count(), 1);
    let dark = make(&bulb(PLAIN, "light: {\"a\": Point(at: (2, 0, 0), strength: 0.0)},"), None);
    assert!(!names(&dark).contains(&"shadow_march"), "a light of strength 0 is no light");
    // A matter that is all constants needs one reflection, and no coat, metal or emission.
    let coated = |made: &Made| made.cost("colour").operations();
    assert!(coated(&dark) < coated(&plain) && coated(&plain) < coated(&lit));
}

#[test]
fn what_mirrors_nothing_has_no_mirrored_rays() {
    let has_mirrors = |look: &str| {
        let made = make(&bulb(look, ""), None);
        made.pipeline.kernels().iter().any(|(name, _)| name.starts_with("mirror"))
    };
    for dull in [PLAIN, "material: \"clay\"", "material: \"matte\""] {
        assert!(!has_mirrors(dull), "{dull}");
    }
    for smooth in ["material: \"polished_steel\"", "material: \"lacquer\"", "material: \"glass\""] {
        assert!(has_mirrors(smooth), "{smooth}");
    }
}

#[test]
fn a_look_without_traps_computes_none() {
    let trapped = make(&bulb("shadows: false,", ""), None);
    let plain = make(&bulb(PLAIN, ""), None);
    let has_trap = |made: &Made| {
        let Kernel::Estimate(surface) = made.kernel("surface") else { panic!("an estimate") };
        surface.orbits.iter().any(|orbit| orbit.state.iter().any(|port| port.name == "trap"))
    };
    assert!(has_trap(&trapped) && !has_trap(&plain));
    // Each iteration: r², three sizes and four minima.
    let per_iteration = |made: &Made| {
        let Kernel::Estimate(surface) = made.kernel("surface") else { panic!("an estimate") };
        MarchCost::of_estimator(&made.arena, surface).iteration.operations()
    };
    assert!(per_iteration(&trapped) >= per_iteration(&plain) + 7.0);
    assert!(!plain.wgsl("surface").contains("trap ="), "no line of the orbit's code makes a trap");
}

#[test]
fn marches_carry_no_traps_and_no_colours() {
    let made = make(&bulb("", ""), None);
    for word in ["trap", "gradient", "palette"] {
        assert!(!made.wgsl("march").contains(word), "{word}");
    }
}

#[test]
fn a_julia_set_carries_no_one_and_no_start_point() {
    let mandelbrot = make(&bulb("", ""), Some(Method::Scalar));
    let julia = make(&bulb("", "constant: Julia((0.0, 0.0, 0.0)),"), Some(Method::Scalar));
    let orbit = |made: &Made| {
        let march = made.pipeline.march();
        march.estimator.orbits[0].clone()
    };
    assert!(!orbit(&mandelbrot).frozen.is_empty());
    let kept = |made: &Made| orbit(made).frozen.into_iter().map(|port| port.name).collect::<Vec<_>>();
    assert_eq!(kept(&julia), ["hit_eps"], "nothing of the start point is kept");
    // With c = 0 neither c nor the derivative's 1 is added: four sums less, and none of them hides in another operation.
    let [all, none] = [&mandelbrot, &julia].map(|made| made.march().iteration);
    assert_eq!(all.add + all.mul_add - none.add - none.mul_add, 4.0);
    assert_eq!(all.operations(), none.operations() + 4.0 - (all.mul_add - none.mul_add));
    let gradient = make(&bulb("", "constant: Julia((0.3, 0.0, 0.1)),"), Some(Method::Gradient));
    assert_eq!(kept(&gradient), ["hit_eps"]);
}

#[test]
fn an_estimate_is_told_only_what_it_reads() {
    // The scalar method takes no finite differences and does not ask for the ray's direction; the hit threshold matters to all
    // orbits, since they end where their detail is below it.
    let scalar = make(&bulb("", ""), Some(Method::Scalar));
    let delta = make(&bulb("", ""), Some(Method::Delta));
    let ray = make(&bulb("", ""), Some(Method::Directional));
    let is_constant = |made: &Made, name: &str| {
        let march = made.pipeline.march();
        let output = march.locate.outputs.iter().find(|(port, _)| port.name == name).expect("a port of the estimator");
        matches!(made.arena.node(output.1).op, Op::Const(_))
    };
    for (made, d, h, hit_eps) in
        [(&scalar, true, true, false), (&delta, true, false, false), (&ray, false, true, false)]
    {
        assert!(!is_constant(made, "p"));
        assert_eq!(["d", "h", "hit_eps"].map(|name| is_constant(made, name)), [d, h, hit_eps]);
    }
    assert!(scalar.march().step.operations() < delta.march().step.operations());
}

#[test]
fn surfaces_compute_no_distance_that_nothing_reads() {
    let single = make(&bulb(PLAIN, ""), None);
    assert_eq!(single.cost("surface").exp, 0.0, "the logarithm of the estimate is the only one");
}

/// Built-in fractals whose iterations are sequences of steps.
const FRACTALS: [&str; 10] = [
    "box_bulb",
    "icosahedron_kifs",
    "juliabox",
    "mandelbox",
    "mandelbox_negative",
    "mandelbulb",
    "menger",
    "menger_bulb",
    "quaternion_julia",
    "sierpinski_tetrahedron",
];

#[test]
fn a_hybrid_costs_no_more_than_its_steps() {
    let mut hybrids: Vec<(String, Vec<(String, String)>)> = FRACTALS.map(|name| (name.to_string(), Vec::new())).into();
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/formulas/scripts/random_hybrid.rhai");
    hybrids.extend((1..9).map(|seed| (script.to_string(), vec![("seed".to_string(), seed.to_string())])));
    let methods = [Method::Scalar, Method::Gradient, Method::Combined, Method::Directional, Method::Delta];
    let mut compared = 0;
    for (file, set) in &hybrids {
        let mut library = Library::builtin();
        let mut d = Diagnostics::default();
        let loaded = load(&mut library, file, set, &mut d);
        let graph = loaded.unwrap_or_else(|| panic!("{}", d.render(&library.sources, false))).graph;
        let arena = Arc::new(Arena::default());
        let composer = Composer { arena: &arena, library: &library, graph: &graph };
        for method in methods {
            let settings = EstimateSettings { method: Some(method), ..EstimateSettings::default() };
            let plan = choose(&composer, &settings).expect("it composes");
            let estimator =
                bulbfold::compose::compose_estimator(&composer, &plan.choices, bulbfold::compose::Purpose::March);
            let estimator = estimator.expect("it composes");
            for ((field, choice), orbit) in field_orbits(&composer).iter().zip(&plan.choices).zip(&estimator.orbits) {
                let parts = iteration_parts(&composer, field, choice).expect("it composes");
                assert_eq!(parts.len(), orbit.items.len());
                for (parts, item) in parts.iter().zip(&orbit.items) {
                    let sum = parts.parts.iter().map(|part| Cost::of(&arena, &part.all).products).sum::<f64>();
                    let whole = Cost::of(&arena, item).products;
                    assert!(whole <= 1.1 * sum, "{file} {set:?}, {}: {whole} against {sum}", choice.method.name());
                    compared += 1;
                }
            }
        }
    }
    assert!(compared >= 90, "{compared} iterations were compared");
}

#[test]
fn emit_cost_names_every_step() {
    let output = bulbfold(Path::new("."), ["compile", "box_bulb", "--emit", "cost", "--de", "scalar"]);
    let text = stdout(&output);
    assert!(output.status.success(), "{}", stderr(&output));
    for line in
        ["fold (box_fold)", "ball (sphere_fold)", "grow (scale)", "bulb (bulb_power)", "constant", "escape test"]
    {
        assert!(text.contains(line), "{line} is missing:\n{text}");
    }
    // A box fold is a clamp and 2 c - z on three components, and keeps the derivative.
    let fold: Vec<&str> =
        text.lines().find(|line| line.contains("box_fold")).unwrap_or_default().split_whitespace().collect();
    assert_eq!(fold[2..5], ["6", "6", "0"], "{text}");
    let row = |name: &str| {
        let line = text.lines().find(|line| line.trim_start().starts_with(name)).unwrap_or_default();
        line[34..]
            .split_whitespace()
            .next()
            .and_then(|n| n.parse::<f64>().ok())
            .unwrap_or_else(|| panic!("{name}: {line}"))
    };
    assert!(row("together, as it runs") <= row("sum of these"));
    assert!(row("sum of these") < row("together, as written"));
}

#[test]
fn emit_cost_says_that_steps_of_proofs_are_bare() {
    for (method, is_said) in [("certified-ball", true), ("certified", true), ("scalar", false)] {
        let output = bulbfold(Path::new("."), ["compile", "box_bulb", "--emit", "cost", "--de", method]);
        let text = stdout(&output);
        assert!(output.status.success(), "{}", stderr(&output));
        assert_eq!(text.contains("Steps are listed without the bounds"), is_said, "{method}:\n{text}");
    }
}

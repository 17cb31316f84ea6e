//! A graph through every writer.

use std::sync::Arc;

use bulbfold::calibrate::Calibration;
use bulbfold::calibrate::written::{with_outcome, without_outcome};
use bulbfold::check::Subject;
use bulbfold::compose::{Composer, Plan, Purpose, choose, compose_estimator};
use bulbfold::diag::Diagnostics;
use bulbfold::exchange::export::{ExportError, Target, export};
use bulbfold::expr::{Arena, notation, print as expr_print};
use bulbfold::formula::library::Library;
use bulbfold::graph::{Camera, EstimateSettings, ValidGraph};
use bulbfold::kernel::cost::MarchCost;
use bulbfold::kernel::{Kernel, listing, wgsl};
use bulbfold::load::load_text;
use bulbfold::march::{MarchSettings, compose_march};
use bulbfold::render::automatic_camera;

use super::{as_text, composer, fixed_plan, salt, with_library};

/// A camera for graphs that have none: the writers do not ask where it stands.
const CAMERA: Camera = Camera::new([4.0, -4.0, 3.0], [0.0; 3], [0.0, 0.0, 1.0], 0.7);

/// Every writer, of what loads.
pub fn writers(bytes: &[u8]) {
    with_library(|library| {
        let loaded = load_text(library, "input.ron", &as_text(bytes), &[], &mut Diagnostics::default());
        let Some(loaded) = loaded else { return };
        let graph = loaded.graph.with_orbit_settings(|s| s.max_iterations = s.max_iterations.min(12));
        let arena = Arc::new(Arena::default());
        let composer = composer(&arena, library, &graph);
        // The automatic choice costs many times the rest.
        let plan = match salt(bytes) % 16 {
            0 => choose(&composer, &EstimateSettings::default()),
            other => Ok(fixed_plan(&composer, other)),
        };
        let Ok(plan) = plan else { return };
        let camera = graph.scene.camera.unwrap_or(CAMERA);
        if salt(bytes) % 64 == 0 {
            let _ = automatic_camera(&composer, &plan);
        }
        for target in Target::ALL {
            if let Err(ExportError::Writer(text)) = export(&composer, &plan, &camera, target) {
                panic!("{}: {text}", target.name());
            }
        }
        kernels(library, &graph, &composer, &plan);
    });
}

/// The march's shader and its listings.
fn kernels(library: &Library, graph: &ValidGraph, composer: &Composer, plan: &Plan) {
    let arena = composer.arena;
    let Ok(estimator) = compose_estimator(composer, &plan.choices, Purpose::March) else { return };
    let march = compose_march(arena, estimator, &MarchSettings::default());
    assert!(MarchCost::of(arena, &march).operations(1.0, 1.0).is_finite(), "a cost is no number");
    let kernel = Kernel::March(march);
    let text = wgsl::write(arena, &kernel);
    wgsl::validate(&text).unwrap_or_else(|error| panic!("{error}\n{text}"));
    assert!(!listing::listing(arena, &kernel).is_empty());
    for function in kernel.functions() {
        let texts = [
            expr_print::listing(arena, function, &library.sources),
            notation::plain(arena, function),
            notation::latex(arena, function),
        ];
        assert!(texts.iter().all(|text| !text.is_empty()), "{} has an empty listing", graph.name);
    }
}

/// The editing of `calibrate --write`: what is written reads again as the same graph, also without the outcome.
pub fn edit(bytes: &[u8]) {
    with_library(|library| {
        let text = as_text(bytes);
        let Some(loaded) = load_text(library, "input.ron", &text, &[], &mut Diagnostics::default()) else { return };
        let (graph, id) = (loaded.graph, loaded.text);
        let graph = graph.with_orbit_settings(|s| s.max_iterations = s.max_iterations.min(12));
        let arena = Arc::new(Arena::default());
        let composer = composer(&arena, library, &graph);
        let plan = fixed_plan(&composer, salt(bytes));
        let subject = Subject { library, graph: &graph, arena: &arena, plan };
        let calibration = Calibration::by_rule(&subject);
        let texts = [with_outcome(&subject, id, &calibration), without_outcome(&subject, id)];
        let shape = |graph: &ValidGraph| bulbfold::graph::print::listing(graph);
        let expected = nodes(&shape(&loaded_again(library, &text)));
        for written in texts.into_iter().flatten() {
            let again = nodes(&shape(&loaded_again(library, &written)));
            assert_eq!(expected, again, "editing changed more than the estimate:\n{written}");
        }
    });
}

/// A text that must load.
fn loaded_again(_: &Library, text: &str) -> ValidGraph {
    let (mut library, mut d) = (Library::builtin(), Diagnostics::default());
    let loaded = load_text(&mut library, "input.ron", text, &[], &mut d);
    loaded.unwrap_or_else(|| panic!("{}\n{text}", d.render(&library.sources, false))).graph
}

/// A listing without its estimates.
fn nodes(listing: &str) -> String {
    listing.lines().filter(|line| !line.contains("estimate")).map(|line| format!("{line}\n")).collect()
}

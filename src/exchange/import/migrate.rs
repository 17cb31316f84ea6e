//! Older and newer settings of Mandelbulber as this reader expects them: each change of a name or a unit by its version.
//!
//! The program states them in its own reader (`Compatibility` in settings.cpp): what follows are those that bear on shape, view
//! and main light. `fov` and the light are distinguished where they are read, see [`view`](super::view).

use super::settings::{Entry, Settings};
use super::value::number;
use crate::diag::{Diagnostic, Diagnostics};

/// The newest version whose settings are known.
pub const NEWEST: f64 = 2.35;

/// The first version that writes `fov` in degrees.
pub const FOV_IN_DEGREES: f64 = 2.21;

/// The first version whose main light is `light1_*`.
pub const NUMBERED_LIGHTS: f64 = 2.25;

/// The first version whose scene is a tree of objects (`node_..._definition`).
pub const OBJECT_TREE: f64 = 2.35;

/// The last version whose kaleidoscopic IFS turns without a switch.
const LAST_WITHOUT_ROTATION_SWITCH: f64 = 2.06;

/// The first version with a switch for the edges of a kaleidoscopic IFS.
const FIRST_EDGE_SWITCH: f64 = 2.22;

/// The last version with one factor of the constant for all coordinates.
const LAST_SINGLE_FACTOR: f64 = 2.04;

/// Settings of a formula's place in the scene. New files write them in the formula's section, `name`; old ones in the main
/// section, `name_1`, which is where this reader looks.
pub const OF_PLACE: &[&str] = &[
    "formula",
    "fractal_enable",
    "formula_iterations",
    "formula_weight",
    "formula_start_iteration",
    "formula_stop_iteration",
    "formula_position",
    "formula_rotation",
    "formula_scale",
    "formula_repeat",
    "formula_maxiter",
    "formula_material_id",
    "dont_add_c_constant",
    "check_for_bailout",
    "julia_mode",
    "julia_c",
    "fractal_constant_factor",
    "initial_waxis",
    "smooth_de_combine_enable",
    "smooth_de_combine_distance",
];

/// Brings settings to the form that the rest of this reader knows. A version that is newer than any known one is an error.
pub fn migrate(settings: &mut Settings, d: &mut Diagnostics) {
    let version = settings.version.clone();
    if version.number > NEWEST {
        let message = format!(
            "these settings are of version {}, which is newer than {NEWEST}, the newest that this reader knows",
            version.text
        );
        d.push(
            Diagnostic::error(message)
                .label(version.span, "newer versions may say the same things in other words")
                .help(format!(
                    "save them with Mandelbulber {NEWEST}, or, at your own risk, write {NEWEST} in that line"
                )),
        );
        return;
    }
    for section in settings.sections.iter_mut().filter(|section| section.name.starts_with("fractal_")) {
        let implied = |name: &str| section.entries.iter().find(|entry| entry.name == name).map(|entry| entry.span);
        let turns = version.number <= LAST_WITHOUT_ROTATION_SWITCH;
        let (rotation, edge) = (implied("IFS_rotation").filter(|_| turns), implied("IFS_edge"));
        if let Some(span) = rotation {
            section.imply("IFS_rotation_enabled", "true", span);
        }
        if let Some(span) = edge.filter(|_| version.before(FIRST_EDGE_SWITCH)) {
            section.imply("IFS_edge_enabled", "true", span);
        }
    }
    move_places(settings);
    if version.number <= LAST_SINGLE_FACTOR {
        let factors = settings.sections.iter_mut().flat_map(|section| &mut section.entries);
        for entry in factors.filter(|entry| entry.name.starts_with("fractal_constant_factor")) {
            if number(&entry.value).is_some() {
                entry.value = [entry.value.as_str(); 3].join(" ");
            }
        }
    }
}

/// Moves a formula's place in the scene from its own section to the main one.
fn move_places(settings: &mut Settings) {
    let mut moved: Vec<Entry> = Vec::new();
    for section in &mut settings.sections {
        let Some(slot) = section.name.strip_prefix("fractal_").filter(|slot| slot.parse::<u32>().is_ok()) else {
            continue;
        };
        let own = format!("formula_{slot}");
        let (places, others) = std::mem::take(&mut section.entries)
            .into_iter()
            .partition(|entry: &Entry| OF_PLACE.contains(&entry.name.as_str()) || entry.name == own);
        section.entries = others;
        let named = |entry: Entry| match entry.name == own {
            true => entry,
            false => Entry { name: format!("{}_{slot}", entry.name), ..entry },
        };
        moved.extend(Vec::into_iter(places).map(named));
    }
    let main = settings.section_mut("main_parameters");
    main.entries.extend(moved);
}

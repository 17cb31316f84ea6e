//! What was moved, put into the file's text.

use super::Sight;
use crate::diag::{Diagnostics, Sources};
use crate::formula::edit::Edits;
use crate::formula::ron::{Limits, read_ron};
use crate::formula::value::{Value, ValueKind};
use crate::graph::{Camera, Lens, PRESET, place_of, preset_values};

/// The text of a formula's file (RON) with what was moved in it: a preset's values, numbers, the camera. All else stays, comments included.
///
/// Errors: the text is no formula, or has no place for a change; the message says which.
pub fn written(text: &str, sight: &Sight) -> Result<String, String> {
    let text = with_changes(text, &sight.changes())?;
    match &sight.camera {
        Some(camera) => with_camera(&text, camera),
        None => Ok(text),
    }
}

/// The text of a formula's file with changes as `--set` makes them: pairs of a path and a value in RON; the path `preset` stands for a preset's
/// values. All else stays.
///
/// Errors: the text is no formula, or has no place for a change.
pub fn with_changes(text: &str, changes: &[(String, String)]) -> Result<String, String> {
    let mut text = text.to_string();
    for (path, value) in changes {
        text = match path == PRESET {
            true => with_values_of(&text, value.trim_matches('"'))?,
            false => with(&text, path, value)?,
        };
    }
    Ok(text)
}

/// The text with a preset's values as the file's own.
fn with_values_of(text: &str, name: &str) -> Result<String, String> {
    let (sources, tree) = tree(text)?;
    let values = preset_values(&tree, name).ok_or_else(|| format!("there is no preset `{name}`"))?;
    let as_text = |value: &Value| sources.text(value.span.source)[value.span.range()].to_string();
    let values: Vec<(String, String)> = values.into_iter().map(|(path, value)| (path, as_text(value))).collect();
    values.iter().try_fold(text.to_string(), |text, (path, value)| with(&text, path, value))
}

/// The text with a view as a preset, which takes the place of one of this name.
///
/// Errors: the text is no formula.
pub fn with_view(text: &str, (name, help): (&str, &str), camera: &Camera) -> Result<String, String> {
    let (_, tree) = tree(text)?;
    let camera = camera_text(camera);
    let preset = format!("(help: {help:?}, {})", camera.trim_end_matches(','));
    let mut edits = Edits::default();
    if !edits.set_entry(text, &tree, ("presets", &["look", "camera", "output"]), (name, &preset)) {
        return Err("the file has no place for a preset".into());
    }
    Ok(edits.apply(text))
}

/// A camera as files have it.
pub fn camera_text(camera: &Camera) -> String {
    let entries: Vec<String> =
        entries(camera, true).into_iter().map(|(name, value)| format!("{name}: {value}")).collect();
    format!("camera: ({}),", entries.join(", "))
}

/// The fields of a camera that moves change, and its lens where the file has none.
fn entries(camera: &Camera, is_whole: bool) -> Vec<(&'static str, String)> {
    let vector = |v: [f64; 3]| {
        let [x, y, z] = v.map(|x| x + 0.0);
        format!("({x}, {y}, {z})")
    };
    let mut entries = vec![("position", vector(camera.position)), ("target", vector(camera.target))];
    if camera.up != [0.0, 0.0, 1.0] || !is_whole {
        entries.push(("up", vector(camera.up)));
    }
    let degrees = (camera.fov.to_degrees() * 1e9).round() / 1e9;
    match camera.lens {
        Lens::Orthographic { height } => entries.push(("lens", format!("Orthographic(height: {height})"))),
        Lens::Perspective { shift: [0.0, 0.0] } if is_whole => entries.push(("fov", degrees.to_string())),
        Lens::Perspective { shift: [x, y] } if is_whole => {
            entries.extend([("fov", degrees.to_string()), ("lens", format!("Perspective(shift: ({x}, {y}))"))]);
        }
        Lens::Fisheye if is_whole => entries.extend([("fov", degrees.to_string()), ("lens", "Fisheye".into())]),
        Lens::Equirectangular { width } if is_whole => {
            let width = (width.to_degrees() * 1e9).round() / 1e9;
            entries.extend([("fov", degrees.to_string()), ("lens", format!("Equirectangular(width: {width})"))]);
        }
        Lens::CubeMap(_) if is_whole => {
            let layout = camera.lens.name().trim_start_matches("cube-");
            entries.push(("lens", format!("CubeMap({layout:?})")));
        }
        _ => {}
    }
    entries
}

/// Fields that would say otherwise where a camera looks.
const OTHERS: [&str; 2] = ["orientation", "distance"];
/// Fields that a camera is written behind.
const BEFORE: [&str; 5] = ["nodes", "output", "max_iterations", "bounding_radius", "estimate"];

fn with_camera(text: &str, camera: &Camera) -> Result<String, String> {
    let (_, tree) = tree(text)?;
    let ValueKind::Struct { fields, .. } = &tree.kind else { return Err("the formula has no fields".into()) };
    let has_camera = fields.iter().any(|(name, _)| name.text == "camera");
    let mut edits = Edits::default();
    edits.set_struct(text, &tree, "camera", &entries(camera, !has_camera), &OTHERS, &BEFORE);
    Ok(edits.apply(text))
}

/// The text with one value changed.
fn with(text: &str, path: &str, value: &str) -> Result<String, String> {
    let (_, tree) = tree(text)?;
    let place = place_of(&tree, path);
    let parts: Vec<&str> = place.iter().map(String::as_str).collect();
    let mut edits = Edits::default();
    if !edits.set_part(text, &tree, &parts, value) {
        return Err(format!("the file has no place for `{path}`"));
    }
    Ok(edits.apply(text))
}

fn tree(text: &str) -> Result<(Sources, Value), String> {
    let (mut sources, mut d) = (Sources::default(), Diagnostics::default());
    let id = sources.add("formula.ron", text);
    match read_ron(&sources, id, &Limits::default(), &mut d).filter(|_| !d.has_errors()) {
        Some(tree) => Ok((sources, tree)),
        None => Err(d.render(&sources, false)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "// a box\n(\n    params: { \"scale\": (default: 2.0, min: 1.5, max: 4.0) }, // one\n    nodes: {\n        \"fold\": box_fold, // bare\n        \"ball\": sphere_fold(min_radius: 0.5),\n        \"all\": Sequence([\"fold\", \"ball\"]),\n    },\n    output: \"all\",\n    constant: Julia((0.1, 0.2, 0.3)),\n    camera: (position: (1, 2, 3), fov: 50), // near\n    presets: { \"far\": (set: { \"scale\": 3.0 /* big */, \"max_iterations\": 9 }) },\n)\n";

    fn numbers(all: &[(&str, f64)]) -> Sight {
        Sight { numbers: all.iter().map(|(path, value)| (path.to_string(), *value)).collect(), ..Sight::default() }
    }

    #[test]
    fn numbers_are_changed_where_they_stand() {
        let new =
            written(FILE, &numbers(&[("scale", 2.5), ("ball.min_radius", 0.25), ("constant.0.y", -0.5)])).unwrap();
        let expected = FILE.replace("default: 2.0", "default: 2.5").replace("min_radius: 0.5", "min_radius: 0.25");
        assert_eq!(new, expected.replace("0.1, 0.2, 0.3", "0.1, -0.5, 0.3"));
    }

    #[test]
    fn parameters_that_a_step_leaves_out_are_added() {
        let new = written(FILE, &numbers(&[("fold.limit", 1.5), ("ball.fixed_radius", 2.0)])).unwrap();
        assert!(new.contains("\"fold\": box_fold(limit: 1.5), // bare"), "{new}");
        assert!(new.contains("sphere_fold(min_radius: 0.5, fixed_radius: 2)"), "{new}");
    }

    #[test]
    fn a_camera_is_changed_or_added() {
        let camera = Camera::new([0.0, -4.0, 0.5], [0.0; 3], [0.0, 0.0, 1.0], 50f64.to_radians());
        let sight = Sight { camera: Some(camera), ..Sight::default() };
        let new = written(FILE, &sight).unwrap();
        assert!(new.contains("position: (0, -4, 0.5), target: (0, 0, 0), up: (0, 0, 1), fov: 50), // near"), "{new}");
        let bare = FILE.replace("    camera: (position: (1, 2, 3), fov: 50), // near\n", "");
        let new = written(&bare, &sight).unwrap();
        assert!(new.contains("    camera: (position: (0, -4, 0.5), target: (0, 0, 0), fov: 50),\n"), "{new}");
    }

    #[test]
    fn presets_are_written_out() {
        let new = written(FILE, &Sight { preset: Some("far".into()), ..Sight::default() }).unwrap();
        assert!(new.contains("default: 3.0, min") && new.contains("max_iterations: 9,"), "{new}");
        assert!(written(FILE, &Sight { preset: Some("near".into()), ..Sight::default() }).is_err());
    }

    #[test]
    fn views_become_presets() {
        let camera = Camera::new([0.0, -4.0, 0.5], [0.0; 3], [0.0, 0.0, 1.0], 50f64.to_radians());
        let view = "(help: \"A gate\", camera: (position: (0, -4, 0.5), target: (0, 0, 0), fov: 50))";
        let new = with_view(FILE, ("gate", "A gate"), &camera).unwrap();
        assert!(new.contains(&format!("\"max_iterations\": 9 }}), \"gate\": {view} }},")), "{new}");
        let bare = "(\n    output: \"a\",\n    camera: (position: (1, 2, 3)),\n    tests: [],\n)\n";
        let new = with_view(bare, ("gate", "A gate"), &camera).unwrap();
        assert!(
            new.contains(&format!("(1, 2, 3)),\n    presets: {{\n        \"gate\": {view},\n    }},\n    tests")),
            "{new}"
        );
        let again = with_view(&new, ("gate", "A gate"), &camera).unwrap();
        assert_eq!(again, new);
        let more = with_view(&new, ("hall", "A gate"), &camera).unwrap();
        assert!(more.contains(&format!("\"gate\": {view},\n        \"hall\": {view},\n    }}")), "{more}");
    }

    #[test]
    fn places_that_are_not_there_are_refused() {
        for path in ["nothing.there", "ball.min_radius.x", "constant.7"] {
            let error = written(FILE, &numbers(&[(path, 1.0)])).unwrap_err();
            assert!(error.contains("no place"), "{path}: {error}");
        }
    }
}

//! The subjects of Mandelbulber's settings that are not read: shape, looks, or unknown.

use super::LostKind;

/// Settings of the main section that the shape or the view depends on, or beginnings of their names.
const SHAPE: &[&str] = &[
    "repeat",
    "box_folding",
    "spherical_folding",
    "fractal_",
    "formula",
    "julia",
    "limit",
    "iteration_threshold_mode",
    "constant_DE_threshold",
    "DE_",
    "delta_DE",
    "linear_DE",
    "interior_mode",
    "minN",
    "N",
    "c_add",
    "smoothness",
    "smooth_de",
    "initial_waxis",
    "perspective_type",
    "sweet_spot",
    "primitive_",
    "all_primitives",
    "check_for_bailout",
    "dont_add_c",
    "view_distance_min",
    "boolean_",
    "hybrid_",
    "node_",
    "advanced_quality",
    "use_default_bailout",
    "bailout",
];

/// Beginnings of such names that are about looks all the same.
const NOT_SHAPE: &[&str] = &["formula_material_id", "julia_preview", "fractal_color", "limit_CPU"];

/// Parts of the names of primitives' and objects' settings that are about looks.
const OBJECT_LOOK: &[&str] =
    &["_color", "_reflection", "_material", "_texture", "_object_id", "_calculation_order", "_name"];

/// Beginnings of names about light, colour, effects, image, animation, marching effort and the program itself.
const LOOK: &[&str] = &[
    "DOF_",
    "MC_",
    "SSAO_",
    "abs_m",
    "all_lights",
    "alpha_",
    "ambient_",
    "analityc_DE_mode",
    "anim",
    "antialiasing",
    "append_",
    "auto_",
    "aux_light",
    "background",
    "basic_fog",
    "brightness",
    "camera_",
    "clouds",
    "color",
    "connect_",
    "contrast",
    "default_",
    "denoiser",
    "description",
    "distance_fog",
    "env_mapping",
    "fake_lights",
    "file_",
    "flight_",
    "fog_",
    "fractal_color",
    "frame",
    "fresnel",
    "gamma",
    "gl_",
    "global_illum",
    "glow",
    "gpu_",
    "grid_",
    "hdr",
    "hue",
    "image_",
    "iteration_fog",
    "jpeg_",
    "keyframe",
    "language",
    "light",
    "logging",
    "main_light",
    "mat",
    "meas_",
    "mesh_",
    "monte_carlo",
    "mouse_",
    "nebula",
    "net",
    "normal_",
    "ocl_",
    "opencl",
    "penetrating",
    "post_",
    "quit_",
    "queue_",
    "random_lights",
    "raytraced",
    "reflect",
    "relMin",
    "rel_m",
    "saturation",
    "save_",
    "shading",
    "shadow",
    "show_",
    "slow_shading",
    "sound",
    "specular",
    "stereo",
    "surface_color",
    "system_",
    "textured",
    "threads_",
    "tile",
    "toolbar",
    "transparency",
    "ui_",
    "upgrade_",
    "volumetric",
    "voxel",
    "zbuffer",
];

/// What a setting is about, by its name: [`LostKind::Shape`], [`LostKind::Look`] or, where the name is not known,
/// [`LostKind::Unknown`].
pub fn about(name: &str) -> LostKind {
    let begins = |list: &[&str]| list.iter().any(|beginning| name.starts_with(beginning));
    let is_object = name.starts_with("primitive_") || name.starts_with("node_");
    let is_look = begins(NOT_SHAPE) || (is_object && OBJECT_LOOK.iter().any(|part| name.contains(part)));
    // Single letters are whole names.
    let is_shape = SHAPE.iter().any(|shape| if shape.len() == 1 { name == *shape } else { name.starts_with(shape) });
    match (is_look || begins(LOOK), is_shape) {
        (true, _) => LostKind::Look,
        (false, true) => LostKind::Shape,
        (false, false) => LostKind::Unknown,
    }
}

/// A line of a report, without the end of long ones.
pub fn shortened(line: &str) -> String {
    match line.char_indices().nth(100) {
        Some((end, _)) => format!("{}...", &line[..end]),
        None => line.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::{LostKind, about};

    #[test]
    fn names_that_nobody_knows_are_not_about_light() {
        assert_eq!(about("some_list_of_objects"), LostKind::Unknown);
        assert_eq!(about("node_0001_repeat"), LostKind::Shape);
        assert_eq!(about("node_0001_material"), LostKind::Look);
        assert_eq!(about("light2_position"), LostKind::Look);
        assert_eq!(about("limit_CPU_cores"), LostKind::Look);
        assert_eq!(about("primitive_box_1_rounding"), LostKind::Shape);
        assert_eq!(about("minN"), LostKind::Shape);
    }
}

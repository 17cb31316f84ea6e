//! Mandelbulber's camera, light and background.
//!
//! Its frame is ours: right-handed, z up. `fov` is the picture's height at distance 1, so 1 is 53.13 degrees. Old settings
//! (`legacy_coordinate_system`) show the picture upside down in a mirror; [`Mandelbulber`](super::mandelbulber) then mirrors
//! the world in z = 0, and the camera with it.

use super::ask::Ask;
use super::place::{cross, dot, norm};
use super::settings::Section;
use super::value::{number, written_vector};
use crate::diag::{Diagnostic, Diagnostics};
use crate::graph::Camera;

/// The camera of the settings.
pub fn camera(main: &Section, is_mirrored: bool, d: &mut Diagnostics) -> Camera {
    let position = main.vector("camera", [3.0, -6.0, 2.0], d);
    let target = main.vector("target", [0.0; 3], d);
    let up = main.vector("camera_top", [-0.1277753, 0.2555506, 0.958314], d);
    let fov = main.number("fov", 1.0, d);
    // They follow from the others.
    let angles = main.vector("camera_rotation", [26.565, -16.60154, 0.0], d);
    main.number("camera_distance_to_target", 7.0, d);
    let mirror = |v: [f64; 3], sign: f64| if is_mirrored { [sign * v[0], sign * v[1], -sign * v[2]] } else { v };
    let forward: [f64; 3] = std::array::from_fn(|i| target[i] - position[i]);
    let is_usable = norm(cross(forward, up)) > 1e-6 * norm(forward) * norm(up) && norm(forward) > 0.0;
    let (target, up) = if is_usable { (target, up) } else { turned(position, angles) };
    Camera {
        position: mirror(position, 1.0),
        target: mirror(target, 1.0),
        up: mirror(up, -1.0),
        fov: 2.0 * (fov / 2.0).atan(),
    }
}

/// Target and up direction of a camera that is turned by yaw, pitch and roll, in degrees, from looking along y.
fn turned(position: [f64; 3], degrees: [f64; 3]) -> ([f64; 3], [f64; 3]) {
    let [(sy, cy), (sp, cp), (sr, cr)] = degrees.map(|angle| angle.to_radians().sin_cos());
    let forward = [-sy * cp, cy * cp, sp];
    let level_up = [sy * sp, -cy * sp, cp];
    let right = cross(forward, level_up);
    let up = std::array::from_fn(|i| cr * level_up[i] + sr * right[i]);
    (std::array::from_fn(|i| position[i] + forward[i]), up)
}

/// Light and background, as the fields of `look`.
pub fn look(main: &Section, camera: &Camera, is_mirrored: bool, d: &mut Diagnostics) -> Vec<String> {
    let mut fields = vec![format!("sun_direction: {}", written_vector(&sun(main, camera, is_mirrored, d)))];
    let colour = colour(main, "main_light_colour", [1.0; 3], d);
    let intensity = main.number("main_light_intensity", 1.0, d);
    let strength = if main.switch("main_light_enable", true, d) { intensity.clamp(0.0, 20.0) } else { 0.0 };
    fields.push(format!("sun: {}", written_vector(&colour.map(|part| 2.0 * part * strength))));
    fields.push(format!("shadows: {}", main.switch("shadows_enabled", true, d)));
    let bottom = ["background_color_3", "background_color_1"].map(|name| main.has(name));
    if bottom.iter().any(|given| *given) {
        let ends = [("background_color_3", [0.0; 3]), ("background_color_1", [0.0; 3])];
        let ends = ends.map(|(name, default)| written_vector(&self::colour(main, name, default, d)));
        fields.push(format!("background: [{}]", ends.join(", ")));
    }
    fields
}

/// Direction towards the sun in the camera's frame: right, up, back.
fn sun(main: &Section, camera: &Camera, is_mirrored: bool, d: &mut Diagnostics) -> [f64; 3] {
    let (sa, ca) = main.number("main_light_alpha", -45.0, d).to_radians().sin_cos();
    let (sb, cb) = main.number("main_light_beta", 45.0, d).to_radians().sin_cos();
    let light = [sa * cb, -ca * cb, sb];
    if main.switch("main_light_position_relative", true, d) {
        return [light[0], if is_mirrored { -light[2] } else { light[2] }, -light[1]];
    }
    let light = if is_mirrored { [light[0], light[1], -light[2]] } else { light };
    let forward = std::array::from_fn(|i| camera.target[i] - camera.position[i]);
    let right = cross(forward, camera.up);
    let up = cross(right, forward);
    let along = |axis: [f64; 3]| dot(light, axis) / norm(axis).max(1e-300);
    [along(right), along(up), -along(forward)]
}

/// A colour of three hexadecimal numbers up to ffff, as linear RGB.
fn colour(main: &Section, name: &str, default: [f64; 3], d: &mut Diagnostics) -> [f64; 3] {
    let Some(entry) = main.raw(name) else { return default };
    let parts: Vec<f64> = entry
        .value
        .split_whitespace()
        .filter_map(|part| u16::from_str_radix(part, 16).ok().map(f64::from).or_else(|| number(part)))
        .collect();
    if parts.len() != 3 {
        let message = format!("`{name}` needs a colour, found `{}`", entry.value);
        d.push(Diagnostic::error(message).label(entry.span, "expected three hexadecimal numbers such as ff00 8000 0"));
        return default;
    }
    [0, 1, 2].map(|i| (parts[i] / 65535.0).clamp(0.0, 1.0).powf(2.2))
}

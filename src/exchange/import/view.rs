//! Mandelbulber's camera, light and background.
//!
//! Its frame is ours: right-handed, z up. Old settings
//! (`legacy_coordinate_system`) show the picture upside down in a mirror; [`Mandelbulber`](super::mandelbulber) then mirrors
//! the world in z = 0, and the camera with it.

use super::ask::Ask;
use super::colours::colours;
use super::migrate::{FOV_IN_DEGREES, NUMBERED_LIGHTS};
use super::place::{cross, dot, norm};
use super::settings::{Section, Version};
use super::value::{number, written_vector};
use super::{Lost, LostKind};
use crate::diag::{Diagnostic, Diagnostics};
use crate::graph::Camera;

/// The default of `fov`, in degrees: the picture is as high as it is far away.
const DEFAULT_FOV: f64 = 53.13010235415598;

/// Widest view that a flat projection is drawn with, in degrees.
const WIDEST_DEG: f64 = 170.0;

/// The camera of the settings.
pub fn camera(
    main: &Section,
    (version, is_mirrored): (&Version, bool),
    lost: &mut Vec<Lost>,
    d: &mut Diagnostics,
) -> Camera {
    let position = main.vector("camera", [3.0, -6.0, 2.0], d);
    let target = main.vector("target", [0.0; 3], d);
    let up = main.vector("camera_top", [-0.1277753, 0.2555506, 0.958314], d);
    let fov = field_of_view(main, version, lost, d);
    // They follow from the others.
    let angles = main.vector("camera_rotation", [26.565, -16.60154, 0.0], d);
    main.number("camera_distance_to_target", 7.0, d);
    let mirror = |v: [f64; 3], sign: f64| if is_mirrored { [sign * v[0], sign * v[1], -sign * v[2]] } else { v };
    let forward: [f64; 3] = std::array::from_fn(|i| target[i] - position[i]);
    let is_usable = norm(cross(forward, up)) > 1e-6 * norm(forward) * norm(up) && norm(forward) > 0.0;
    let (target, up) = if is_usable { (target, up) } else { turned(position, angles) };
    Camera::new(mirror(position, 1.0), mirror(target, 1.0), mirror(up, -1.0), fov)
}

/// The angle from bottom to top, in radians: stated in degrees since 2.21, before as the picture's height at distance 1, for
/// projections that are not flat as the share of a half or a whole turn. Ours is flat, so wider ones are cut.
fn field_of_view(main: &Section, version: &Version, lost: &mut Vec<Lost>, d: &mut Diagnostics) -> f64 {
    let is_old = version.before(FOV_IN_DEGREES);
    let stated = main.number("fov", if is_old { 1.0 } else { DEFAULT_FOV }, d);
    let projection = main.entries.iter().rev().find(|entry| entry.name == "perspective_type");
    let degrees = match projection.map(|entry| entry.value.as_str()) {
        _ if !is_old => stated,
        Some("1" | "3" | "fish_eye" | "fish_eye_cut") => 180.0 * stated,
        Some("2" | "equirectangular") => 360.0 * stated,
        // Files of the first versions hold the default in degrees.
        _ if stated == 53.13 => DEFAULT_FOV,
        _ => 2.0 * (stated / 2.0).atan().to_degrees(),
    };
    let kept = degrees.abs().clamp(0.01, WIDEST_DEG);
    if kept != degrees {
        let why = format!("a view of {degrees:.4} degrees; it is drawn with {kept}, between 0.01 and {WIDEST_DEG}");
        lost.push(Lost { kind: LostKind::Shape, what: format!("fov {stated}"), why });
    }
    if version.text.is_empty() && main.has("fov") {
        let why = "the file states no version; it is read as the picture's height at distance 1, as before 2.21".into();
        lost.push(Lost { kind: LostKind::Shape, what: format!("fov {stated}"), why });
    }
    kept.to_radians()
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
pub fn look(
    main: &Section,
    (version, camera, is_mirrored): (&Version, &Camera, bool),
    lost: &mut Vec<Lost>,
    d: &mut Diagnostics,
) -> Vec<String> {
    let light = match version.before(NUMBERED_LIGHTS) {
        true => old_light(main, d),
        false => numbered_light(main, lost, d),
    };
    let mut fields = vec![format!("sun_direction: {}", written_vector(&sun(&light, camera, is_mirrored)))];
    fields.push(format!("sun: {}", written_vector(&light.colour.map(|part| 2.0 * part * light.strength))));
    fields.push(format!("shadows: {}", light.casts_shadows));
    let bottom = ["background_color_3", "background_color_1"].map(|name| main.has(name));
    if bottom.iter().any(|given| *given) {
        let ends = [("background_color_3", [0.0; 3]), ("background_color_1", [0.0; 3])];
        let ends = ends.map(|(name, default)| written_vector(&self::colour(main, name, default, d)));
        fields.push(format!("background: [{}]", ends.join(", ")));
    }
    fields.extend(colours(main, lost, d));
    fields
}

/// The main light.
struct Light {
    /// Angles about the vertical axis and above the horizon, in degrees.
    angles: [f64; 2],
    /// Whether they are counted from the camera.
    is_relative: bool,
    colour: [f64; 3],
    strength: f64,
    casts_shadows: bool,
}

fn old_light(main: &Section, d: &mut Diagnostics) -> Light {
    let strength = main.number("main_light_intensity", 1.0, d).clamp(0.0, 20.0);
    Light {
        angles: [main.number("main_light_alpha", -45.0, d), main.number("main_light_beta", 45.0, d)],
        is_relative: main.switch("main_light_position_relative", true, d),
        colour: colour(main, "main_light_colour", [1.0; 3], d),
        strength: if main.switch("main_light_enable", true, d) { strength } else { 0.0 },
        casts_shadows: main.switch("shadows_enabled", true, d),
    }
}

/// The first of the lights that files since 2.25 number.
fn numbered_light(main: &Section, lost: &mut Vec<Lost>, d: &mut Diagnostics) -> Light {
    let is_defined = main.switch("light1_is_defined", false, d);
    if !is_defined && !main.entries.iter().any(|entry| entry.name.starts_with("light1_")) {
        let why = "the file defines no light, so that of this program's default is drawn".into();
        lost.push(Lost { kind: LostKind::Look, what: "light1".into(), why });
    }
    // Directional; the others stand somewhere, which the sun does not.
    let kind = main.raw("light1_type").map_or("directional", |entry| entry.value.as_str());
    if !matches!(kind, "0" | "directional") {
        let why = "the light is drawn as a sun from its direction".into();
        lost.push(Lost { kind: LostKind::Look, what: format!("light1_type {kind}"), why });
    }
    let [alpha, beta, _] = main.vector("light1_rotation", [-45.0, 45.0, 0.0], d);
    let strength = main.number("light1_intensity", 1.0, d) * main.number("all_lights_intensity", 1.0, d);
    Light {
        angles: [alpha, beta],
        is_relative: main.switch("light1_relative_position", true, d),
        colour: colour(main, "light1_color", [1.0; 3], d),
        strength: if main.switch("light1_enabled", true, d) { strength.clamp(0.0, 20.0) } else { 0.0 },
        casts_shadows: main.switch("light1_cast_shadows", true, d),
    }
}

/// Direction towards the sun in the camera's frame: right, up, back.
fn sun(light: &Light, camera: &Camera, is_mirrored: bool) -> [f64; 3] {
    let is_relative = light.is_relative;
    let [(sa, ca), (sb, cb)] = light.angles.map(|angle| angle.to_radians().sin_cos());
    let light = [sa * cb, -ca * cb, sb];
    if is_relative {
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
pub(super) fn colour(main: &Section, name: &str, default: [f64; 3], d: &mut Diagnostics) -> [f64; 3] {
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

//! The picture around a distance function on shadertoy.com: the file's camera, a march, normals, the sun and the sky.

use crate::graph::{Camera, Look};
use crate::shade::{CameraFrame, sun_direction};

/// The functions `mainImage` and what it calls, which call `distance_estimate`.
pub fn picture(camera: &Camera, look: &Look, bounding_radius: f64) -> String {
    let frame = CameraFrame::new(camera);
    let vector = |v: [f64; 3]| format!("vec3({:?}, {:?}, {:?})", v[0] as f32, v[1] as f32, v[2] as f32);
    let sun = sun_direction(look, &frame);
    let template = include_str!("shadertoy.glsl");
    let values = [
        ("$POSITION", vector(camera.position)),
        ("$TARGET", vector(camera.target)),
        ("$UP", vector(camera.up)),
        ("$HEIGHT", format!("{:?}", 2.0 * (camera.fov / 2.0).tan() as f32)),
        ("$RADIUS", format!("{:?}", bounding_radius as f32)),
        ("$SUN_DIRECTION", vector(sun)),
        ("$SUN", vector(look.sun)),
        ("$SKY", vector(look.sky)),
        ("$COLOUR", vector(look.palette[0])),
        ("$BOTTOM", vector(look.background[0])),
        ("$TOP", vector(look.background[1])),
    ];
    // Longer names first would be needed where one begins another; `$SUN` stands behind `$SUN_DIRECTION`.
    values.iter().fold(template.to_string(), |text, (name, value)| text.replace(name, value))
}

//! The picture around a distance function on shadertoy.com: the file's camera, a march, normals, the sun and the sky.

use crate::graph::{Camera, Environment, LightKind, Scene};
use crate::shade::placed;

/// The functions `mainImage` and what it calls, which call `distance_estimate`.
pub fn picture(camera: &Camera, scene: &Scene, bounding_radius: f64) -> String {
    let camera = &camera.flat();
    let vector = |v: [f64; 3]| format!("vec3({:?}, {:?}, {:?})", v[0] as f32, v[1] as f32, v[2] as f32);
    let home = scene.home.unwrap_or(*camera);
    let sun = scene.sun().map(|light| placed(light, camera, &home));
    let (direction, sun) = match sun.map(|light| (light.kind, light.colour)) {
        Some((LightKind::Sun { direction, .. }, colour)) => (direction, colour),
        _ => ([0.0, 0.0, 1.0], [0.0; 3]),
    };
    let sky = match &scene.environment {
        Environment::Dome { sky, .. } => *sky,
        Environment::Gradient { horizon, zenith, .. } => [0, 1, 2].map(|i| (horizon[i] + zenith[i]) / 2.0),
        Environment::Daylight { strength, .. } => [0.2, 0.3, 0.5].map(|part| part * strength),
        Environment::Picture { panorama, strength, .. } => panorama.mean().map(|part| part * strength),
    };
    let background = scene.backdrop.unwrap_or([sky; 2]);
    let paint = &scene.look.paint;
    let colour = paint.layers.first().map_or(paint.palette[0], |layer| layer.gradient.at(0.5));
    let template = include_str!("shadertoy.glsl");
    let values = [
        ("$POSITION", vector(camera.position)),
        ("$TARGET", vector(camera.target)),
        ("$UP", vector(camera.up)),
        ("$HEIGHT", format!("{:?}", 2.0 * (camera.fov / 2.0).tan() as f32)),
        ("$RADIUS", format!("{:?}", bounding_radius as f32)),
        ("$SUN_DIRECTION", vector(direction)),
        ("$SUN", vector(sun)),
        ("$SKY", vector(sky)),
        ("$COLOUR", vector(colour)),
        ("$BOTTOM", vector(background[0])),
        ("$TOP", vector(background[1])),
    ];
    // Longer names first would be needed where one begins another; `$SUN` stands behind `$SUN_DIRECTION`.
    values.iter().fold(template.to_string(), |text, (name, value)| text.replace(name, value))
}

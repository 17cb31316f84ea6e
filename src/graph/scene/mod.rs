//! The scene: what a picture shows of a formula, from where, and in which light.
//!
//! A fractal's file holds its default scene beside its nodes. In comes the file's value tree; out comes a [`Scene`], which the
//! expressions of pictures are composed from. Formulas, their tests and their estimates do not depend on it.

mod camera;
mod environment;
mod fields;
mod film;
mod light;
mod look;
pub mod motion;
mod paint;
mod traps;

pub use camera::{Aperture, Camera, CubeLayout, Lens, Stereo, StereoLayout};
pub use environment::{Atmosphere, Environment, Glow, wanted_picture};
pub use film::{Curve, Encoding, Film};
pub use light::{Cone, Light, LightKind, SUN_ANGLE, Space};
pub use look::{Look, Part};
pub(super) use paint::read_paint;
pub use paint::{Blend, By, Layer, MOST_LAYERS, Marks, MaterialUse, Paint, Palette, Spread};
pub use traps::{TRAPS, Trap};

use self::camera::read_camera;
use self::environment::{read_atmosphere, read_environment};
use self::fields::read_plane;
use self::film::read_film;
use self::light::read_lights;
pub(super) use self::look::has_orbits;
use self::look::read_look;
use super::objects::Objects;
use super::read::Reader;
use crate::diag::Diagnostic;
use crate::formula::decode::Fields;
use crate::formula::value::{Value, ValueKind};

/// What a picture shows, from where, and in which light.
#[derive(Clone, PartialEq, Debug)]
pub struct Scene {
    /// Where to look from; found automatically where absent.
    pub camera: Option<Camera>,
    /// The plane that pictures show; absent where they are seen through the camera.
    pub plane: Option<Plane>,
    /// What surfaces look like.
    pub look: Look,
    /// What shines.
    pub lights: Vec<Light>,
    /// What surrounds everything.
    pub environment: Environment,
    /// Colours that are shown where nothing is, at the bottom and the top of the picture; the environment where absent.
    pub backdrop: Option<[[f64; 3]; 2]>,
    /// What is between the camera and what it sees.
    pub atmosphere: Atmosphere,
    /// The view that the file itself shows, where the camera has left it.
    pub home: Option<Camera>,
    /// How light becomes a picture.
    pub film: Film,
    /// What moves in a film of it.
    pub motion: Option<motion::Motion>,
}

impl Scene {
    /// The scene that a look alone makes: its sun under its sky.
    fn of_look(look: Look) -> Scene {
        Scene {
            camera: None,
            plane: None,
            lights: vec![Light::sun_of_look(look.sun_direction, look.sun, look.shadows)],
            environment: Environment::Dome { sky: look.sky, sun: look.sun },
            backdrop: Some(look.background),
            atmosphere: Atmosphere { fog: look.fog, ..Atmosphere::default() },
            home: None,
            film: Film::default(),
            motion: None,
            look,
        }
    }

    /// Takes the paints of objects. Traps that one of them needs are those of all, where the file gives none.
    pub(super) fn take_objects(&mut self, objects: Objects) {
        self.look.parts.extend(objects.parts);
        if let Some(traps) = objects.traps.filter(|_| self.look.traps == TRAPS) {
            self.look.traps = traps;
        }
    }

    /// The first light that stands far away.
    pub fn sun(&self) -> Option<&Light> {
        self.lights.iter().find(|light| matches!(light.kind, LightKind::Sun { .. }))
    }

    /// The scene seen from elsewhere; lights of the file's own view stay where they were.
    pub fn move_camera(&mut self, camera: Camera) {
        self.home = self.home.or(self.camera);
        self.camera = Some(camera);
    }
}

/// A rectangle of a plane through space, which a picture shows instead of a camera's view.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Plane {
    /// The point in the middle of the picture.
    pub center: [f64; 3],
    /// From its bottom to its top, in world units.
    pub height: f64,
    /// Unit vector to the right of the picture.
    pub right: [f64; 3],
    /// Unit vector to its top, across `right`.
    pub up: [f64; 3],
}

/// Fields of a scene, in a fractal's file beside its nodes or in `scene: (...)`.
const FIELDS: [&str; 8] = ["camera", "plane", "look", "light", "environment", "atmosphere", "film", "animation"];

/// Reads the fields of a scene: those among a file's own, and those in its `scene: (...)`.
///
/// `has_orbits` says that surfaces have orbits to be coloured by ([`has_orbits`]).
pub(super) fn read_scene(reader: &mut Reader, fields: &mut Fields, has_orbits: bool) -> Scene {
    let scene = fields.optional_value("scene");
    let mut inner = scene.and_then(|v| Fields::new(v, "a scene", reader.d));
    let mut take = |reader: &mut Reader, name: &'static str| {
        let outer = fields.optional_value(name);
        let inside = inner.as_mut().and_then(|inner| inner.optional_value(name));
        if let (Some(one), Some(other)) = (outer, inside) {
            let message = format!("`{name}` is given twice");
            let diagnostic = Diagnostic::error(message).label(one.span, "here").label(other.span, "and in `scene`");
            reader.d.push(diagnostic.help("keep one of them"));
        }
        inside.or(outer)
    };
    let [camera, plane, look, light, environment, atmosphere, film, animation] = FIELDS.map(|name| take(reader, name));
    if let Some(inner) = inner {
        inner.finish(reader.d);
    }
    // Planes show sets in the lower colour of the background, which has to differ from what is around.
    let base = if reader.has_look || plane.is_some() { Look::default() } else { Look::of_none(has_orbits) };
    let given = look.and_then(|v| read_look(reader, v, &base));
    let mut scene = Scene::of_look(given.unwrap_or(base));
    scene.film = film.and_then(|v| read_film(reader, v)).unwrap_or_default();
    scene.camera = camera.and_then(|v| read_camera(reader, v));
    scene.plane = plane.and_then(|v| read_plane(reader, v));
    scene.motion = animation.and_then(|v| motion::read_motion(reader, v));
    if let Some(value) = light {
        scene.lights = read_lights(reader, value);
        for name in
            ["sun", "sun_direction", "shadows"].into_iter().filter(|name| look.is_some_and(|v| has_field(v, name)))
        {
            let message = format!("`look.{name}` has no effect beside `light`");
            reader
                .d
                .push(Diagnostic::warning(message).label(value.span, "these are all lights").help("drop one of them"));
        }
        scene.environment = Environment::Dome { sky: scene.look.sky, sun: [0.0; 3] };
    }
    if let Some(found) = environment.and_then(|v| read_environment(reader, v)) {
        scene.environment = found;
        let has_background = look.is_some_and(|look| has_field(look, "background"));
        scene.backdrop = scene.backdrop.filter(|_| has_background);
    }
    if let Some(found) = atmosphere.and_then(|v| read_atmosphere(reader, v)) {
        scene.atmosphere = Atmosphere { fog: if found.fog > 0.0 { found.fog } else { scene.atmosphere.fog }, ..found };
    }
    scene
}

/// Whether a struct of a file gives a field.
fn has_field(value: &Value, name: &str) -> bool {
    matches!(&value.kind, ValueKind::Struct { fields, .. } if fields.iter().any(|(field, _)| field.text == name))
}

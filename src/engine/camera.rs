//! What is wanted of the camera beside the file's: other values, another lens, and moves.

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use super::Error;
use crate::graph::{Camera, Lens, Stereo, StereoLayout};
use crate::shade::{CameraFrame, turned};

/// What replaces parts of a fractal's camera, and moves it; what is `None` stays as it is. Values come first, then the moves in the order
/// of the fields.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct CameraChange {
    /// Position, in world units.
    pub position: Option<[f64; 3]>,
    /// The point in the middle of the picture.
    pub target: Option<[f64; 3]>,
    /// Roughly upwards.
    pub up: Option<[f64; 3]>,
    /// The lens. One that states no height or angle keeps the size of the target where that can be.
    pub lens: Option<Lens>,
    /// Angle from the bottom to the top of the picture, in radians.
    pub fov: Option<f64>,
    /// How the pictures of two eyes are put together.
    pub stereo: Option<StereoLayout>,
    /// Distance between the eyes, in world units; `None` is a 30th of the distance to the target where there was one eye.
    pub eyes: Option<f64>,
    /// What is nearer is not seen, in world units.
    pub near: Option<f64>,
    /// What is farther is not seen, in world units.
    pub far: Option<f64>,
    /// Angle of a turn around the target about the up direction, in radians.
    pub turn: Option<f64>,
    /// Angles of a turn around the target, in radians: about the up direction (counter-clockwise seen from there), then upwards.
    pub orbit: Option<[f64; 2]>,
    /// Angle by which the camera turns to the right where it stands, in radians.
    pub yaw: Option<f64>,
    /// Angle by which it turns up, in radians.
    pub pitch: Option<f64>,
    /// Angle by which it turns clockwise about its view direction, in radians.
    pub roll: Option<f64>,
    /// What the distance to the target is multiplied by; above 0.
    pub dolly: Option<f64>,
    /// A place of the picture that comes nearer.
    pub zoom: Option<Zoom>,
}

/// A place of the picture that comes nearer: the camera moves towards the surface that is seen there, and looks at it.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub struct Zoom {
    /// How many times as large the surface is to appear, from 0.001 to 1e12.
    pub factor: f64,
    /// The place: 0, 0 is the upper left corner and 1, 1 the lower right one.
    pub at: [f64; 2],
}

/// The most that a zoom takes at once: then the surface is looked for again.
const MOST_AT_ONCE: f64 = 8.0;

impl Zoom {
    /// Factors of equal steps that give the whole one.
    pub(super) fn steps(&self) -> impl Iterator<Item = f64> {
        let count = (self.factor.ln() / MOST_AT_ONCE.ln()).ceil().max(1.0);
        std::iter::repeat_n(self.factor.powf(1.0 / count), count as usize)
    }
}

impl CameraChange {
    /// The change that gives whatever camera the view of this one; clipping and openings of lenses stay, where this one has none.
    pub fn to(camera: Camera) -> CameraChange {
        let has_angle = !matches!(camera.lens, Lens::Orthographic { .. } | Lens::CubeMap(_));
        CameraChange {
            position: Some(camera.position),
            target: Some(camera.target),
            up: Some(camera.up),
            lens: Some(camera.lens),
            fov: has_angle.then_some(camera.fov),
            stereo: camera.stereo.map(|stereo| stereo.layout),
            eyes: camera.stereo.map(|stereo| stereo.eyes),
            near: (camera.near > 0.0).then_some(camera.near),
            far: camera.far,
            ..CameraChange::default()
        }
    }

    /// True where nothing changes.
    pub fn is_empty(&self) -> bool {
        *self == CameraChange::default()
    }

    /// Whether the camera moves from where values put it.
    pub fn is_move(&self) -> bool {
        let turns = [self.yaw, self.pitch, self.roll, self.dolly];
        self.orbit.is_some() || self.zoom.is_some() || turns.iter().any(Option::is_some)
    }

    /// The camera after the change, but for its zoom, which needs to know the surface.
    ///
    /// Errors: [`Error::Request`] where position, target and up direction lie on one line, or the lens has no such angle.
    pub fn apply(&self, base: Camera) -> Result<Camera, Error> {
        let mut camera = Camera {
            position: self.position.unwrap_or(base.position),
            target: self.target.unwrap_or(base.target),
            up: self.up.unwrap_or(base.up),
            near: self.near.unwrap_or(base.near),
            far: self.far.or(base.far),
            ..base
        };
        if let Some(lens) = self.lens {
            camera = camera.with_lens(lens);
        }
        camera.stereo = self.both_eyes(&camera)?;
        if let Some(fov) = self.fov {
            camera = with_fov(camera, fov)?;
        }
        if let Some(angle) = self.turn {
            camera = turned(&camera, angle);
        }
        let camera = checked(camera)?;
        if self.is_move() { rounded(self.moved(camera)?) } else { Ok(camera) }
    }

    /// The eyes of a camera after the change.
    fn both_eyes(&self, camera: &Camera) -> Result<Option<Stereo>, Error> {
        let Some(layout) = self.stereo.or(camera.stereo.map(|own| own.layout)) else {
            return match self.eyes {
                None => Ok(None),
                Some(_) => Err(Error::request(
                    "`--eyes` is for pictures of two eyes",
                    "say how they are put together: `--stereo side-by-side`",
                )),
            };
        };
        let eyes = self.eyes.or(camera.stereo.map(|own| own.eyes)).unwrap_or(camera.distance() * USUAL_EYES);
        Ok(Some(Stereo { eyes, layout }))
    }

    /// The camera after its moves.
    fn moved(&self, camera: Camera) -> Result<Camera, Error> {
        let mut camera = camera;
        if let Some([around, upwards]) = self.orbit {
            camera = checked(turned(&camera, around))?;
            let lift = DQuat::from_axis_angle(DVec3::from(CameraFrame::new(&camera).right), -upwards);
            let arm = lift * (DVec3::from(camera.position) - DVec3::from(camera.target));
            camera.position = (DVec3::from(camera.target) + arm).to_array();
            if upwards != 0.0 {
                camera.up = (lift * DVec3::from(camera.up)).to_array();
            }
        }
        let [yaw, pitch, roll] = [self.yaw, self.pitch, self.roll].map(|angle| angle.unwrap_or(0.0));
        if [yaw, pitch, roll] != [0.0; 3] {
            let level = DQuat::from_axis_angle(DVec3::from(camera.up).normalize(), -yaw);
            let view = level * (DVec3::from(camera.target) - DVec3::from(camera.position));
            camera.target = (DVec3::from(camera.position) + view).to_array();
            let frame = CameraFrame::new(&camera);
            let tilt = DQuat::from_axis_angle(DVec3::from(frame.right), pitch);
            let roll = DQuat::from_axis_angle(tilt * DVec3::from(frame.forward), roll);
            camera.target = (DVec3::from(camera.position) + tilt * view).to_array();
            if self.pitch.is_some() || self.roll.is_some() {
                camera.up = (roll * tilt * DVec3::from(frame.up)).to_array();
            }
        }
        if let Some(share) = self.dolly {
            let arm = DVec3::from(camera.position) - DVec3::from(camera.target);
            camera.position = (DVec3::from(camera.target) + arm * share).to_array();
        }
        checked(camera)
    }
}

/// Distance between eyes as a share of the distance to what they look at, where none is given: what photographers call the rule of one
/// in thirty.
const USUAL_EYES: f64 = 1.0 / 30.0;

/// The camera with another angle of view.
fn with_fov(camera: Camera, fov: f64) -> Result<Camera, Error> {
    let (name, most) = (camera.lens.name(), camera.lens.most_fov());
    match camera.lens {
        Lens::Orthographic { .. } => {
            Err(Error::request("an orthographic picture has no angle of view", "give its height: `--ortho 3`"))
        }
        Lens::CubeMap(_) => Err(Error::request("a cube map shows all directions", "drop `--fov`")),
        _ if fov.to_degrees() > most + 1e-9 => {
            let text = format!("the angle of view of the {name} lens goes up to {most} degrees");
            Err(Error::request(text, "choose a smaller `--fov`, or `--lens fisheye`"))
        }
        _ => Ok(Camera { fov, ..camera }),
    }
}

/// The camera, if it has a frame.
fn checked(camera: Camera) -> Result<Camera, Error> {
    let frame = CameraFrame::new(&camera);
    if [frame.right, frame.up, frame.forward].iter().flatten().all(|x| x.is_finite()) {
        return Ok(camera);
    }
    let help = "move --camera away from --target, or choose another --up";
    Err(Error::request("the camera's position, target and up direction lie on one line", help))
}

/// The camera nearer to a surface, which then appears `factor` times as large in the middle of the picture. Where rays are parallel
/// the picture is smaller and the camera is as far away as before.
pub(super) fn approached(camera: Camera, surface: [f64; 3], factor: f64) -> Camera {
    let (position, surface) = (DVec3::from(camera.position), DVec3::from(surface));
    let forward = DVec3::from(CameraFrame::new(&camera).forward);
    let position = match camera.lens {
        Lens::Orthographic { .. } => surface - forward * (surface - position).dot(forward),
        _ => surface + (position - surface) / factor,
    };
    let lens = match camera.lens {
        Lens::Orthographic { height } => Lens::Orthographic { height: height / factor },
        lens => lens,
    };
    // Eyes that are as far apart as before would see double.
    let stereo = camera.stereo.map(|stereo| Stereo { eyes: stereo.eyes / factor, ..stereo });
    let near = camera.near / factor;
    Camera { position: position.to_array(), target: surface.to_array(), lens, stereo, near, ..camera }
}

/// Significant digits of the distance to the target that moved cameras keep.
const DIGITS: f64 = 1e-7;

/// The camera in numbers with few digits, so that it can be written down and comes back as it is.
pub(super) fn rounded(camera: Camera) -> Result<Camera, Error> {
    let step = 10f64.powf((camera.distance() * DIGITS).log10().floor());
    let to = |x: f64, step: f64| match step {
        // 1 / step is exact where step is not.
        step if step < 1.0 => (x * (1.0 / step).round()).round() / (1.0 / step).round(),
        step => (x / step).round() * step,
    };
    let few = |x: f64| to(x, 10f64.powf((x.abs().max(1e-300) * 1e-9).log10().floor()));
    let lens = match camera.lens {
        Lens::Orthographic { height } => Lens::Orthographic { height: few(height) },
        lens => lens,
    };
    checked(Camera {
        position: camera.position.map(|x| to(x, step)),
        target: camera.target.map(|x| to(x, step)),
        up: camera.up.map(|x| to(x, 1e-7)),
        fov: to(camera.fov.to_degrees(), 1e-9).to_radians(),
        lens,
        near: if camera.near > 0.0 { few(camera.near) } else { 0.0 },
        stereo: camera.stereo.map(|stereo| Stereo { eyes: few(stereo.eyes), ..stereo }),
        ..camera
    })
}

#[cfg(test)]
mod tests {
    use super::{CameraChange, Zoom};
    use crate::graph::{Camera, Lens};

    const CAMERA: Camera = Camera::new([0.0, -4.0, 0.0], [0.0; 3], [0.0, 0.0, 1.0], 0.5);

    fn close(a: [f64; 3], b: [f64; 3]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6)
    }

    #[test]
    fn moves_are_those_of_their_names() {
        let quarter = Some(std::f64::consts::FRAC_PI_2);
        let moved = |change: CameraChange| change.apply(CAMERA).expect("it applies");
        let yaw = moved(CameraChange { yaw: quarter, ..CameraChange::default() });
        assert!(close(yaw.target, [4.0, -4.0, 0.0]) && close(yaw.up, CAMERA.up), "{yaw:?}");
        let pitch = moved(CameraChange { pitch: quarter, ..CameraChange::default() });
        assert!(close(pitch.target, [0.0, -4.0, 4.0]) && close(pitch.up, [0.0, -1.0, 0.0]), "{pitch:?}");
        let roll = moved(CameraChange { roll: quarter, ..CameraChange::default() });
        assert!(close(roll.target, [0.0; 3]) && close(roll.up, [1.0, 0.0, 0.0]), "{roll:?}");
        let dolly = moved(CameraChange { dolly: Some(0.5), ..CameraChange::default() });
        assert!(close(dolly.position, [0.0, -2.0, 0.0]), "{dolly:?}");
        let orbit = moved(CameraChange { orbit: Some([0.0, 0.5]), ..CameraChange::default() });
        assert!(close(orbit.position, [0.0, -4.0 * 0.5f64.cos(), 4.0 * 0.5f64.sin()]), "{orbit:?}");
        let around = moved(CameraChange { orbit: quarter.map(|a| [a, 0.0]), ..CameraChange::default() });
        assert!(close(around.position, [4.0, 0.0, 0.0]), "{around:?}");
    }

    #[test]
    fn a_lens_without_a_height_keeps_the_size_of_the_target() {
        let lens = Some(Lens::Orthographic { height: 0.0 });
        let flat = CameraChange { lens, ..CameraChange::default() }.apply(CAMERA).expect("it applies");
        let expected = 8.0 * 0.25f64.tan();
        assert!(matches!(flat.lens, Lens::Orthographic { height } if (height - expected).abs() < 1e-12));
        assert!((flat.with_lens(Lens::default()).fov - CAMERA.fov).abs() < 1e-12);
        let wide = CameraChange { lens: Some(Lens::Fisheye), fov: Some(6.0), ..CameraChange::default() };
        assert!((wide.apply(CAMERA).expect("it applies").fov - 6.0).abs() < 1e-12);
        let wrong = CameraChange { lens: Some(Lens::default()), fov: Some(6.0), ..CameraChange::default() };
        assert!(wrong.apply(CAMERA).is_err());
    }

    #[test]
    fn zooms_are_taken_in_steps() {
        let steps = |factor: f64| Zoom { factor, at: [0.5; 2] }.steps().collect::<Vec<f64>>();
        assert_eq!((steps(2.0).len(), steps(0.5).len(), steps(1000.0).len()), (1, 1, 4));
        assert!((steps(1000.0).iter().product::<f64>() - 1000.0).abs() < 1e-9);
    }
}

//! Arguments of the camera, and the camera as arguments.

use bulbfold::engine::{CameraChange, Zoom};
use bulbfold::graph::{Camera, CubeLayout, Lens, StereoLayout};
use bulbfold::shade::Size;
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};

use super::arguments::{parse_fov, parse_number, parse_pair, parse_positive, parse_vector};
use super::picture_args::DEFAULT_SIZE;

/// What replaces parts of the file's camera, and moves it.
#[derive(Args, Clone, Copy, Default, Debug)]
pub struct CameraArgs {
    /// Position of the camera, in world units
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_vector, help_heading = "Camera")]
    pub camera: Option<[f64; 3]>,
    /// The point in the middle of the picture
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_vector, help_heading = "Camera")]
    pub target: Option<[f64; 3]>,
    /// Roughly upwards
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_vector, help_heading = "Camera")]
    pub up: Option<[f64; 3]>,
    /// Angle from the bottom to the top of the picture, in degrees
    #[arg(long, value_name = "DEG", value_parser = parse_fov, help_heading = "Camera")]
    pub fov: Option<f64>,
    /// The lens
    #[arg(long, value_name = "LENS", value_parser = lens_parser(), help_heading = "Camera")]
    lens: Option<Lens>,
    /// An orthographic picture, H world units high
    #[arg(long, value_name = "H", value_parser = parse_positive, conflicts_with_all = ["lens", "fov"], help_heading = "Camera")]
    ortho: Option<f64>,
    /// A perspective lens by its focal length in millimetres, and the height of the sensor [default: 24]
    #[arg(long, value_name = "MM[/MM]", value_parser = parse_focal, conflicts_with_all = ["lens", "fov", "ortho"], help_heading = "Camera")]
    focal_length: Option<f64>,
    /// Move a perspective lens to the right and up, by shares of the picture's height
    #[arg(long, value_name = "X,Y", allow_hyphen_values = true, value_parser = parse_pair, conflicts_with_all = ["lens", "ortho"], help_heading = "Camera")]
    shift: Option<[f64; 2]>,
    /// An equirectangular picture of fewer longitudes than 360 degrees
    #[arg(long, value_name = "DEG", value_parser = parse_fov, conflicts_with_all = ["ortho", "shift", "focal_length"], help_heading = "Camera")]
    longitudes: Option<f64>,
    /// Pictures of two eyes that converge on the target
    #[arg(long, value_name = "LAYOUT", value_parser = layout_parser(), help_heading = "Camera")]
    stereo: Option<StereoLayout>,
    /// Distance between the eyes, in world units [default: a 30th of the distance to the target]
    #[arg(long, value_name = "E", value_parser = parse_positive, help_heading = "Camera")]
    eyes: Option<f64>,
    /// Cut off what is nearer, in world units
    #[arg(long, value_name = "T", value_parser = parse_positive, help_heading = "Camera")]
    near: Option<f64>,
    /// Cut off what is farther, in world units
    #[arg(long, value_name = "T", value_parser = parse_positive, help_heading = "Camera")]
    far: Option<f64>,
    /// Angle of a turn around the target about the up direction, in radians: of sweeps.
    #[arg(skip)]
    pub turn: Option<f64>,
    /// Move towards the surface at --at until it appears F times as large
    #[arg(long, value_name = "F", value_parser = parse_zoom, help_heading = "Moves")]
    zoom: Option<f64>,
    /// The place to zoom to in the picture before: 0,0 is its upper left corner [default: 0.5,0.5]
    #[arg(long, value_name = "U,V", value_parser = parse_place, requires = "zoom", help_heading = "Moves")]
    at: Option<[f64; 2]>,
    /// Multiply the distance to the target
    #[arg(long, value_name = "F", value_parser = parse_positive, help_heading = "Moves")]
    dolly: Option<f64>,
    /// Turn the camera to the right, in degrees
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, value_parser = parse_number, help_heading = "Moves")]
    yaw: Option<f64>,
    /// Turn the camera up, in degrees
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, value_parser = parse_number, help_heading = "Moves")]
    pitch: Option<f64>,
    /// Turn the camera clockwise about its view direction, in degrees
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, value_parser = parse_number, help_heading = "Moves")]
    roll: Option<f64>,
    /// Move around the target by A degrees about the up direction, and B degrees up
    #[arg(long, value_name = "A[,B]", allow_hyphen_values = true, value_parser = parse_orbit, help_heading = "Moves")]
    orbit: Option<[f64; 2]>,
}

fn lens_parser() -> impl TypedValueParser<Value = Lens> {
    let named = |name: String| Lens::NAMES.into_iter().find(|(own, _)| *own == name).map(|(_, lens)| lens);
    PossibleValuesParser::new(Lens::NAMES.map(|(name, _)| name)).try_map(move |name| named(name).ok_or("no such lens"))
}

fn layout_parser() -> impl TypedValueParser<Value = StereoLayout> {
    let names = StereoLayout::NAMES;
    let named = move |name: String| names.into_iter().find(|(own, _)| *own == name).map(|(_, layout)| layout);
    PossibleValuesParser::new(names.map(|(name, _)| name)).try_map(move |name| named(name).ok_or("no such layout"))
}

/// Height of a sensor that states none, in millimetres.
const SENSOR: f64 = 24.0;

/// Reads a focal length, with the height of the sensor or without, as the angle that they make, in degrees.
fn parse_focal(text: &str) -> Result<f64, String> {
    let (focal, sensor) = match text.split_once('/') {
        Some((focal, sensor)) => (parse_positive(focal)?, parse_positive(sensor)?),
        None => (parse_positive(text)?, SENSOR),
    };
    let fov = (2.0 * (sensor / 2.0 / focal).atan()).to_degrees();
    if (0.001..=175.0).contains(&fov) { Ok(fov) } else { Err(format!("that is an angle of {fov} degrees")) }
}

fn parse_zoom(text: &str) -> Result<f64, String> {
    let factor = parse_number(text)?;
    if (1e-3..=1e12).contains(&factor) { Ok(factor) } else { Err("it must be from 0.001 to 1e12".into()) }
}

fn parse_place(text: &str) -> Result<[f64; 2], String> {
    let place = parse_pair(text)?;
    if place.iter().all(|x| (0.0..=1.0).contains(x)) { Ok(place) } else { Err("both must be from 0 to 1".into()) }
}

fn parse_orbit(text: &str) -> Result<[f64; 2], String> {
    if text.contains(',') { parse_pair(text) } else { parse_number(text).map(|around| [around, 0.0]) }
}

impl CameraArgs {
    /// Takes a change of a file's camera, which then need not have one. An option of the same meaning wins.
    pub fn takes(&mut self, path: &str, value: &str) -> bool {
        let inside = |[open, close]: [char; 2]| value.strip_prefix(open).and_then(|text| text.strip_suffix(close));
        let inner = inside(['(', ')']).or_else(|| inside(['[', ']'])).unwrap_or(value);
        let vector = |known: &mut Option<[f64; 3]>| parse_vector(inner).map(|new| *known = known.or(Some(new))).is_ok();
        match path {
            "camera.position" => vector(&mut self.camera),
            "camera.target" => vector(&mut self.target),
            "camera.up" => vector(&mut self.up),
            "camera.fov" => parse_fov(value).map(|new| self.fov = self.fov.or(Some(new))).is_ok(),
            _ => false,
        }
    }

    /// As the engine takes it.
    pub fn change(&self) -> CameraChange {
        let flat = self.focal_length.or(self.shift.map(|_| 0.0));
        let lens = self
            .longitudes
            .map(|degrees| Lens::Equirectangular { width: degrees.to_radians() })
            .or(self.ortho.map(|height| Lens::Orthographic { height }))
            .or(flat.map(|_| Lens::Perspective { shift: self.shift.unwrap_or([0.0; 2]) }))
            .or(self.lens);
        CameraChange {
            position: self.camera,
            target: self.target,
            up: self.up,
            lens,
            fov: self.fov.or(self.focal_length).map(f64::to_radians),
            stereo: self.stereo,
            eyes: self.eyes,
            near: self.near,
            far: self.far,
            turn: self.turn,
            orbit: self.orbit.map(|angles| angles.map(f64::to_radians)),
            yaw: self.yaw.map(f64::to_radians),
            pitch: self.pitch.map(f64::to_radians),
            roll: self.roll.map(f64::to_radians),
            dolly: self.dolly,
            zoom: self.zoom.map(|factor| Zoom { factor, at: self.at.unwrap_or([0.5; 2]) }),
        }
    }
}

/// The size of a picture where none is given: whole directions are as wide as they are high.
pub fn usual_size(change: &CameraChange, own: Option<Camera>) -> Size {
    let Size { width, height } = DEFAULT_SIZE;
    let lens = change.lens.or(own.map(|camera| camera.lens)).unwrap_or_default();
    let size = match lens {
        Lens::Equirectangular { .. } => Size { width, height: width / 2 },
        Lens::Fisheye => Size { width: height, height },
        Lens::CubeMap(CubeLayout::Strip) => Size { width: 1152, height: 768 },
        Lens::CubeMap(CubeLayout::Cross) => Size { width, height: width / 4 * 3 },
        Lens::Perspective { .. } | Lens::Orthographic { .. } => DEFAULT_SIZE,
    };
    match change.stereo.or(own.and_then(|camera| camera.stereo).map(|stereo| stereo.layout)) {
        Some(StereoLayout::SideBySide) => Size { width: 2 * size.width, ..size },
        Some(StereoLayout::OverUnder) => Size { height: 2 * size.height, ..size },
        _ => size,
    }
}

/// The arguments that give a camera to a file with its own camera, in two lines: from where it looks where to, and how.
pub fn flags(camera: &Camera, own: Option<Camera>) -> [String; 2] {
    let vector = |v: [f64; 3]| v.map(|x| (x + 0.0).to_string()).join(",");
    let degrees = |angle: f64| (angle.to_degrees() * 1e9).round() / 1e9;
    let mut how = format!("--up={}", vector(camera.up));
    how += &match camera.lens {
        Lens::Orthographic { height } => format!(" --ortho {height}"),
        Lens::CubeMap(_) => format!(" --lens {}", camera.lens.name()),
        lens if lens == Lens::default() => {
            let is_other = own.is_some_and(|own| own.lens != lens);
            format!("{} --fov {}", if is_other { " --lens perspective" } else { "" }, degrees(camera.fov))
        }
        Lens::Perspective { shift: [x, y] } => format!(" --fov {} --shift={x},{y}", degrees(camera.fov)),
        Lens::Equirectangular { width } if width < std::f64::consts::TAU - 1e-3 => {
            format!(" --longitudes {} --fov {}", degrees(width), degrees(camera.fov))
        }
        Lens::Fisheye | Lens::Equirectangular { .. } => {
            format!(" --lens {} --fov {}", camera.lens.name(), degrees(camera.fov))
        }
    };
    if let Some(stereo) = camera.stereo {
        how += &format!(" --stereo {} --eyes {}", stereo.layout.name(), stereo.eyes);
    }
    for (name, value) in [("near", Some(camera.near).filter(|near| *near > 0.0)), ("far", camera.far)] {
        how += &value.map(|value| format!(" --{name} {value}")).unwrap_or_default();
    }
    [format!("--camera={} --target={}", vector(camera.position), vector(camera.target)), how]
}

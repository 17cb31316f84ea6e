//! The moving camera of a film for 3D packages: glTF 2.0, USD (ascii) and JSON.
//!
//! z is upwards, as in formulas; in glTF, where y is, a node around the camera turns the world. Cameras look along their own -z with y upwards.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use glam::{DMat3, DQuat, DVec3};
use serde_json::json;

use crate::graph::{Camera, Lens};
use crate::shade::{CameraFrame, Size};

/// A camera at a time.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Posed {
    /// Seconds from the film's start.
    pub time: f64,
    /// The camera.
    pub camera: Camera,
}

/// A film's camera.
#[derive(Clone, PartialEq, Debug)]
pub struct CameraFilm {
    /// Its name.
    pub name: String,
    /// A pose a frame.
    pub poses: Vec<Posed>,
    /// Frames a second, as a fraction.
    pub rate: (u32, u32),
    /// Columns and rows of the pictures.
    pub size: Size,
}

/// Height of the sensor that angles are told for, in millimetres: that of 36x24 film.
const SENSOR: f64 = 24.0;

/// The turn of a camera: unturned it looks along -z with y upwards. The sign is that of the one before.
fn turns(poses: &[Posed]) -> Vec<DQuat> {
    let mut turns: Vec<DQuat> = Vec::new();
    for pose in poses {
        let frame = CameraFrame::new(&pose.camera);
        let [right, up, forward] = [frame.right, frame.up, frame.forward].map(DVec3::from);
        let turn = DQuat::from_mat3(&DMat3::from_cols(right, up, -forward)).normalize();
        let is_other = turns.last().is_some_and(|before| before.dot(turn) < 0.0);
        turns.push(if is_other { -turn } else { turn });
    }
    turns
}

impl CameraFilm {
    fn aspect(&self) -> f64 {
        f64::from(self.size.width) / f64::from(self.size.height.max(1))
    }

    /// Near and far planes: those of the cameras, else such that all between is seen.
    fn planes(&self) -> [f64; 2] {
        let distances = self.poses.iter().map(|pose| pose.camera.distance());
        let (least, most) = distances.fold((f64::INFINITY, 0.0f64), |(a, b), d| (a.min(d), b.max(d)));
        let near = self.poses.iter().map(|pose| pose.camera.near).filter(|near| *near > 0.0).reduce(f64::min);
        let far = self.poses.iter().filter_map(|pose| pose.camera.far).reduce(f64::max);
        [near.unwrap_or(least * 1e-3), far.unwrap_or(most * 1e3)]
    }

    /// Whether the angle of view changes, which plain glTF cannot say.
    pub fn zooms(&self) -> bool {
        self.poses.windows(2).any(|pair| (pair[0].camera.fov - pair[1].camera.fov).abs() > 1e-9)
    }

    /// As glTF 2.0 with its numbers inside: a node with a camera, and an animation that moves and turns it.
    pub fn gltf(&self) -> String {
        let turns = turns(&self.poses);
        let mut bytes: Vec<u8> = Vec::new();
        let mut put = |numbers: &mut dyn Iterator<Item = f64>| {
            let start = bytes.len();
            numbers.for_each(|x| bytes.extend((x as f32).to_le_bytes()));
            (start, bytes.len() - start)
        };
        let times = put(&mut self.poses.iter().map(|pose| pose.time));
        let places = put(&mut self.poses.iter().flat_map(|pose| pose.camera.position));
        let turned = put(&mut turns.iter().flat_map(|turn| turn.to_array()));
        let count = self.poses.len();
        let [near, far] = self.planes();
        let first = self.poses.first().map(|pose| pose.camera);
        let camera = match first.map(|camera| camera.lens) {
            Some(Lens::Orthographic { height }) => json!({"type": "orthographic", "name": self.name, "orthographic":
                {"xmag": height * self.aspect() / 2.0, "ymag": height / 2.0, "znear": near, "zfar": far}}),
            _ => json!({"type": "perspective", "name": self.name, "perspective":
                {"aspectRatio": self.aspect(), "yfov": first.map_or(0.7, |camera| camera.fov), "znear": near, "zfar": far}}),
        };
        let view = |(offset, length): (usize, usize)| json!({"buffer": 0, "byteOffset": offset, "byteLength": length});
        let [from, to] = [self.poses.first(), self.poses.last()].map(|pose| pose.map_or(0.0, |pose| pose.time as f32));
        let whole = json!({
            "asset": {"version": "2.0", "generator": concat!("Bulbfold ", env!("CARGO_PKG_VERSION"))},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            // z is upwards here, and y in glTF.
            "nodes": [
                {"name": "world", "rotation": [-std::f64::consts::FRAC_1_SQRT_2, 0.0, 0.0, std::f64::consts::FRAC_1_SQRT_2], "children": [1]},
                {"name": self.name, "camera": 0},
            ],
            "cameras": [camera],
            "animations": [{
                "name": self.name,
                "samplers": [{"input": 0, "output": 1, "interpolation": "LINEAR"}, {"input": 0, "output": 2, "interpolation": "LINEAR"}],
                "channels": [
                    {"sampler": 0, "target": {"node": 1, "path": "translation"}},
                    {"sampler": 1, "target": {"node": 1, "path": "rotation"}},
                ],
            }],
            "accessors": [
                {"bufferView": 0, "componentType": 5126, "count": count, "type": "SCALAR", "min": [from], "max": [to]},
                {"bufferView": 1, "componentType": 5126, "count": count, "type": "VEC3"},
                {"bufferView": 2, "componentType": 5126, "count": count, "type": "VEC4"},
            ],
            "bufferViews": [view(times), view(places), view(turned)],
            "buffers": [{
                "byteLength": bytes.len(),
                "uri": format!("data:application/octet-stream;base64,{}", STANDARD.encode(&bytes)),
            }],
        });
        format!("{whole:#}\n")
    }

    /// As a USD layer in ascii: a camera whose place, turn and focal length have a time sample a frame.
    pub fn usda(&self) -> String {
        let fps = f64::from(self.rate.0) / f64::from(self.rate.1);
        let name: String = self.name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
        let name = if name.starts_with(|c: char| c.is_ascii_alphabetic()) { name } else { format!("camera_{name}") };
        let samples = |of: &dyn Fn(usize) -> String| -> String {
            (0..self.poses.len()).map(|i| format!("            {i}: {},\n", of(i))).collect()
        };
        let turns = turns(&self.poses);
        let moved = samples(&|i| {
            let m = DMat3::from_quat(turns[i]).to_cols_array_2d();
            let p = self.poses[i].camera.position;
            let row = |v: [f64; 3], w: f64| format!("({}, {}, {}, {w})", v[0], v[1], v[2]);
            format!("( {}, {}, {}, {} )", row(m[0], 0.0), row(m[1], 0.0), row(m[2], 0.0), row(p, 1.0))
        });
        let focal = samples(&|i| (SENSOR / 2.0 / (self.poses[i].camera.fov / 2.0).tan()).to_string());
        let focus = samples(&|i| self.poses[i].camera.distance().to_string());
        let projection = match self.poses.first().map(|pose| pose.camera.lens) {
            Some(Lens::Orthographic { .. }) => "orthographic",
            _ => "perspective",
        };
        let [near, far] = self.planes();
        let last = self.poses.len().saturating_sub(1);
        format!(
            "#usda 1.0\n(\n    defaultPrim = \"{name}\"\n    doc = \"Bulbfold {}\"\n    metersPerUnit = 1\n    upAxis = \"Z\"\n    \
             startTimeCode = 0\n    endTimeCode = {last}\n    timeCodesPerSecond = {fps}\n    framesPerSecond = {fps}\n)\n\n\
             def Camera \"{name}\"\n{{\n    token projection = \"{projection}\"\n    float2 clippingRange = ({near}, {far})\n    \
             float horizontalAperture = {}\n    float verticalAperture = {SENSOR}\n    float focalLength.timeSamples = {{\n{focal}        }}\n    \
             float focusDistance.timeSamples = {{\n{focus}        }}\n    matrix4d xformOp:transform.timeSamples = {{\n{moved}        }}\n    \
             uniform token[] xformOpOrder = [\"xformOp:transform\"]\n}}\n",
            env!("CARGO_PKG_VERSION"),
            SENSOR * self.aspect()
        )
    }

    /// As JSON: a list of poses with orientation quaternions (x, y, z, w) and angles in degrees.
    pub fn json(&self) -> String {
        let turns = turns(&self.poses);
        let pose = |(i, (pose, turn)): (usize, (&Posed, &DQuat))| {
            json!({
                "frame": i + 1,
                "time": pose.time,
                "position": pose.camera.position,
                "orientation": turn.to_array(),
                "target": pose.camera.target,
                "up": pose.camera.up,
                "fov": pose.camera.fov.to_degrees(),
            })
        };
        let whole = json!({
            "version": 1,
            "name": self.name,
            "rate": [self.rate.0, self.rate.1],
            "size": [self.size.width, self.size.height],
            "sensor": [SENSOR * self.aspect(), SENSOR],
            "lens": self.poses.first().map_or("perspective", |pose| pose.camera.lens.name()),
            "frames": self.poses.iter().zip(&turns).enumerate().map(pose).collect::<Vec<_>>(),
        });
        format!("{whole:#}\n")
    }
}

#[cfg(test)]
mod tests {
    use base64::Engine as _;

    use super::{CameraFilm, Posed};
    use crate::graph::Camera;
    use crate::shade::Size;

    fn film() -> CameraFilm {
        let camera = |x: f64| Camera::new([x, -3.0, 1.0], [x, 0.0, 1.0], [0.0, 0.0, 1.0], 0.8);
        let poses = (0..5u32).map(|i| Posed { time: f64::from(i) / 24.0, camera: camera(f64::from(i)) }).collect();
        CameraFilm { name: "the flight".into(), poses, rate: (24, 1), size: Size { width: 1920, height: 1080 } }
    }

    #[test]
    fn gltf_holds_the_poses() {
        let whole: serde_json::Value = serde_json::from_str(&film().gltf()).expect("it is JSON");
        let uri = whole["buffers"][0]["uri"].as_str().expect("a buffer");
        let bytes =
            base64::engine::general_purpose::STANDARD.decode(uri.split_once(',').expect("data").1).expect("data");
        let numbers: Vec<f32> = bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        assert_eq!(numbers.len(), 5 + 15 + 20);
        assert_eq!(numbers[5 + 12..5 + 15], [4.0, -3.0, 1.0]);
        // A camera that looks along y has been turned from -z about x by a quarter.
        let turn = &numbers[20..24];
        let half = std::f32::consts::FRAC_1_SQRT_2;
        assert!((turn[0] - half).abs() < 1e-6 && (turn[3] - half).abs() < 1e-6, "{turn:?}");
        assert!((whole["cameras"][0]["perspective"]["yfov"].as_f64().expect("an angle") - 0.8).abs() < 1e-12);
    }

    #[test]
    fn usd_has_a_sample_a_frame_and_names_that_it_allows() {
        let text = film().usda();
        assert!(text.contains("def Camera \"the_flight\"") && text.contains("endTimeCode = 4"), "{text}");
        assert!(text.contains("4: ( (1, 0, 0, 0)"), "{text}");
        let [open, close] = ['{', '}'].map(|c| text.matches(c).count());
        assert_eq!(open, close);
    }

    #[test]
    fn json_has_frames_from_one() {
        let whole: serde_json::Value = serde_json::from_str(&film().json()).expect("it is JSON");
        assert_eq!(whole["frames"][4]["frame"], 5);
        assert_eq!(whole["frames"][4]["position"], serde_json::json!([4.0, -3.0, 1.0]));
    }
}

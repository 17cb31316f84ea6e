//! Reading `animation: (...)`.

use super::ease::Ease;
use super::keys::{Key, Keys, Moving, Repeat, Way};
use super::{CameraKey, CameraMotion, CameraPath, Curve, FileName, KeyView, Motion, Rate, Source, Track};
use crate::colour::parse_colour;
use crate::diag::{Diagnostic, Span};
use crate::formula::decode::{Fields, entries};
use crate::formula::value::{Name, Value, ValueKind};
use crate::graph::read::Reader;
use crate::graph::scene::camera::read_camera;

/// Most tracks of a film, and most keys of a track.
const MOST_TRACKS: usize = 1000;
const MOST_KEYS: usize = 100_000;
/// Degrees of a shutter that is never closed.
const WHOLE: f64 = 360.0;

/// Reads the motion of a scene.
pub fn read_motion(reader: &mut Reader, value: &Value) -> Option<Motion> {
    let mut fields = Fields::new(value, "an animation", reader.d)?;
    let rate = fields.optional_value("fps").map_or(Some(Rate::FILM), |v| read_rate(reader, v));
    let seconds = fields.optional_value("seconds").map(|v| reader.number(v, 1e-6, Motion::LONGEST));
    let frames = fields.optional_value("frames").map(|v| reader.number(v, 1.0, f64::from(Motion::MOST_FRAMES)));
    let shutter = fields.optional_value("shutter").map_or(Some(0.0), |v| reader.number(v, 0.0, WHOLE));
    let samples = fields.optional_value("shutter_samples");
    let samples = samples.map_or(Some(8.0), |v| reader.number(v, 1.0, f64::from(Motion::MOST_SAMPLES)));
    let script = fields.optional_value("script").and_then(|v| read_name(reader, v));
    let audio = fields.optional_value("audio").and_then(|v| read_name(reader, v));
    let (tracks, camera) = (fields.optional_value("tracks"), fields.optional_value("camera"));
    fields.finish(reader.d);
    let rate = rate?;
    let length = match (seconds, frames) {
        (Some(_), Some(_)) => {
            let message = "an animation has `seconds` or `frames`, not both";
            bad(reader, value.span, message, "drop one of them");
            return None;
        }
        (Some(seconds), None) => seconds?,
        (None, Some(frames)) => rate.time(frames?.round()),
        (None, None) => {
            bad(reader, value.span, "an animation needs its length", "add `seconds: 10`, or `frames: 240`");
            return None;
        }
    };
    let mut motion = Motion { shutter: shutter? / WHOLE, samples: samples? as u32, ..Motion::still(length, rate) };
    if motion.seconds * rate.fps() > f64::from(Motion::MOST_FRAMES) {
        let message = format!("the animation has more than {} frames", Motion::MOST_FRAMES);
        bad(reader, value.span, &message, "make it shorter, or lower `fps`");
        return None;
    }
    motion.tracks = tracks.map_or(Some(Vec::new()), |v| read_tracks(reader, v, rate))?;
    motion.camera = camera.map_or(Some(None), |v| read_way(reader, v, rate).map(Some))?;
    (motion.script, motion.audio, motion.span) = (script, audio, value.span);
    Some(motion)
}

/// Reads `24`, `29.97`, or `(24000, 1001)`.
fn read_rate(reader: &mut Reader, value: &Value) -> Option<Rate> {
    if let [frames, seconds] = items(value) {
        let [frames, seconds] = [reader.number(frames, 1.0, 1e6)?, reader.number(seconds, 1.0, 1e6)?];
        let rate = Rate { frames: frames.round() as u32, seconds: seconds.round() as u32 };
        if rate.fps() <= Rate::MOST {
            return Some(rate);
        }
    } else if let Some(rate) = Rate::of(reader.number(value, 1e-3, Rate::MOST)?) {
        return Some(rate);
    }
    bad(reader, value.span, "there are no films of so many frames a second", "write `fps: 24`");
    None
}

/// The items of a list or of a tuple without a name.
fn items(value: &Value) -> &[Value] {
    match &value.kind {
        ValueKind::List(items) | ValueKind::Tuple { name: None, items } => items,
        _ => &[],
    }
}

fn read_tracks(reader: &mut Reader, value: &Value, rate: Rate) -> Option<Vec<(Name, Track)>> {
    let named = entries(value, "tracks", reader.d);
    if named.len() > MOST_TRACKS {
        bad(reader, value.span, &format!("there are more than {MOST_TRACKS} tracks"), "leave some out");
        return None;
    }
    let count = named.len();
    let mut tracks = Vec::new();
    for (name, value) in named {
        if name.text == "camera" || name.text.split('.').next() == Some("animation") {
            let help = "the camera moves by `animation: (camera: ...)`, or by tracks such as \"camera.fov\"";
            bad(reader, name.span, &format!("`{}` cannot be a track", name.text), help);
            continue;
        }
        tracks.extend(read_track(reader, value, rate).map(|track| (name, track)));
    }
    (tracks.len() == count).then_some(tracks)
}

/// How tracks are written.
const TRACKS: &str = "tracks are: keys such as [(0, 1.0), (2, 3.0, ease)], Keys(keys: [...], between: catmull_rom, repeat: loop, turn: 360), \
                      an expression of t such as \"4 + sin(t)\", Wave(from: 5, to: 8, seconds: 4), Column(file: \"x.csv\", name: \"power\"), \
                      Band(file: \"x.wav\", from: 20, to: 200)";

fn read_track(reader: &mut Reader, value: &Value, rate: Rate) -> Option<Track> {
    let name = value.name().map(|name| name.text.as_str());
    match (name, &value.kind) {
        (None, ValueKind::Str(text)) => Some(Track::Expression { text: text.clone(), span: value.span }),
        (None, ValueKind::List(_)) => read_keys(reader, value, (Way::Monotone, Repeat::Hold, None), rate),
        (Some("Keys"), ValueKind::Struct { .. }) => {
            let mut fields = Fields::new(value, "a track", reader.d)?;
            let between = fields.optional_value("between");
            let way = between.map_or(Some(Way::Monotone), |v| read_ease(reader, v));
            let repeats = [("hold", Repeat::Hold), ("loop", Repeat::Loop), ("mirror", Repeat::Mirror)];
            let repeat = fields.optional_value("repeat");
            let repeat = repeat.map_or(Some(Repeat::Hold), |v| reader.word(v, "repeat of a track", &repeats));
            let turn = fields.optional_value("turn").map_or(Some(None), |v| reader.number(v, 1e-9, 1e9).map(Some));
            let keys = fields.optional_value("keys");
            fields.finish(reader.d);
            let Some(keys) = keys else {
                bad(reader, value.span, "a track needs `keys`", "write `keys: [(0, 1.0), (2, 3.0)]`");
                return None;
            };
            read_keys(reader, keys, (way?, repeat?, turn?), rate)
        }
        (Some("Wave"), ValueKind::Struct { .. }) => read_wave(reader, value),
        (Some(kind @ ("Column" | "Band")), ValueKind::Struct { .. }) => read_curve(reader, value, kind == "Band"),
        _ => {
            bad(reader, value.span, &format!("expected a track, found {}", value.describe()), TRACKS);
            None
        }
    }
}

fn read_wave(reader: &mut Reader, value: &Value) -> Option<Track> {
    let mut fields = Fields::new(value, "a wave", reader.d)?;
    let [from, to] = ["from", "to"].map(|name| fields.optional_value(name).map(read_value));
    let seconds = reader.required_number(&mut fields, "seconds", 1e-3, Motion::LONGEST);
    fields.finish(reader.d);
    match (from, to) {
        (Some(Moving::Numbers(from)), Some(Moving::Numbers(to))) if from.len() == to.len() => {
            Some(Track::Wave { ends: [from, to], seconds: seconds? })
        }
        _ => {
            let help = "write `Wave(from: 5, to: 8, seconds: 4)`, with as many numbers at both ends";
            bad(reader, value.span, "a wave needs the numbers `from` and `to`", help);
            None
        }
    }
}

fn read_curve(reader: &mut Reader, value: &Value, is_sound: bool) -> Option<Track> {
    let mut fields = Fields::new(value, if is_sound { "a band" } else { "a column" }, reader.d)?;
    let file = fields.optional_value("file").and_then(|v| read_name(reader, v));
    let ends = fields.optional_value("values").map_or(Some([0.0, 1.0]), |v| read_pair(reader, v, [-1e9, 1e9]));
    let source = if is_sound {
        let band = fields.optional_value("band").map_or(Some([20.0, 20_000.0]), |v| read_pair(reader, v, [1.0, 1e5]));
        let fall = fields.optional_value("fall").map_or(Some(0.1), |v| reader.number(v, 0.0, 60.0));
        band.zip(fall).map(|(from_to, fall)| Source::Band { from_to, fall })
    } else {
        let name = fields.required::<String>("name", reader.d);
        let time = fields.or("time", "t".to_string(), reader.d);
        name.map(|name| Source::Column { name, time })
    };
    fields.finish(reader.d);
    let Some(file) = file else {
        bad(reader, value.span, "a track by a file needs the file's name", "add `file: \"...\"`");
        return None;
    };
    Some(Track::Curve(Curve { file, source: source?, ends: ends? }))
}

fn read_pair(reader: &mut Reader, value: &Value, [least, most]: [f64; 2]) -> Option<[f64; 2]> {
    match items(value) {
        [a, b] => Some([reader.number(a, least, most)?, reader.number(b, least, most)?]),
        _ => {
            bad(reader, value.span, "expected two numbers", "write for example (0.0, 1.0)");
            None
        }
    }
}

/// Reads the name of a file beside the formula's.
fn read_name(reader: &mut Reader, value: &Value) -> Option<FileName> {
    match &value.kind {
        ValueKind::Str(name) if !name.is_empty() => Some(FileName { name: name.clone(), span: value.span }),
        _ => {
            bad(reader, value.span, "expected the name of a file in quotes", "write for example \"curves.csv\"");
            None
        }
    }
}

/// Reads keys: a time, a value and the way to it.
fn read_keys(
    reader: &mut Reader,
    value: &Value,
    (way, repeat, turn): (Way, Repeat, Option<f64>),
    rate: Rate,
) -> Option<Track> {
    let written = items(value);
    if written.len() > MOST_KEYS {
        bad(reader, value.span, &format!("a track has at most {MOST_KEYS} keys"), "leave some out");
        return None;
    }
    let mut keys = Vec::new();
    for item in written {
        let (time, what, given) = match items(item) {
            [time, value] => (time, value, None),
            [time, value, way] => (time, value, Some(way)),
            _ => {
                let help = "a key is a time and a value, and may say the way to it: (2, 3.0, ease)";
                bad(reader, item.span, "this is no key", help);
                return None;
            }
        };
        let way = given.map_or(Some(None), |v| read_ease(reader, v).map(Some));
        keys.push(Key { time: read_time(reader, time, rate)?, value: read_value(what), way: way? });
    }
    let keys = Keys::new(keys, way, repeat, turn).map_err(|why| {
        bad(reader, value.span, &why, "keys stand in the order of their times, with values of one kind");
    });
    keys.ok().map(Track::Keys)
}

/// Reads seconds, or `Frame(48)`.
fn read_time(reader: &mut Reader, value: &Value, rate: Rate) -> Option<f64> {
    match &value.kind {
        ValueKind::Tuple { name: Some(name), items } if name.text == "Frame" && items.len() == 1 => {
            Some(rate.time(reader.number(&items[0], 0.0, f64::from(Motion::MOST_FRAMES))?))
        }
        _ => reader.number(value, -Motion::LONGEST, Motion::LONGEST),
    }
}

/// What a value is between keys.
fn read_value(value: &Value) -> Moving {
    let number = |value: &Value| if let ValueKind::Number(number) = value.kind { Some(number) } else { None };
    if let Some(number) = number(value) {
        return Moving::Numbers(vec![number]);
    }
    if let ValueKind::Str(text) = &value.kind
        && let Some(colour) = parse_colour(text)
    {
        return Moving::Colour(colour);
    }
    match items(value).iter().map(number).collect::<Option<Vec<f64>>>().filter(|numbers| !numbers.is_empty()) {
        Some(numbers) => Moving::Numbers(numbers),
        None => Moving::Fixed(value.clone()),
    }
}

/// Reads the way to a key.
fn read_ease(reader: &mut Reader, value: &Value) -> Option<Way> {
    if let ValueKind::Tuple { name: Some(name), items } = &value.kind
        && name.text.eq_ignore_ascii_case("bezier")
        && let [x1, y1, x2, y2] = items.as_slice()
    {
        let (x, y) = ((0.0, 1.0), (-10.0, 10.0));
        let handles = [(x1, x), (y1, y), (x2, x), (y2, y)].map(|(v, (least, most))| reader.number(v, least, most));
        let [x1, y1, x2, y2] = handles;
        return Some(Way::Eased(Ease::Bezier([x1?, y1?, x2?, y2?])));
    }
    let mut words: Vec<(&str, Way)> = Ease::NAMES.iter().map(|(name, ease)| (*name, Way::Eased(*ease))).collect();
    words.extend([("step", Way::Step), ("monotone", Way::Monotone), ("catmull-rom", Way::CatmullRom)]);
    reader.word(value, "way from key to key; bezier(0.3, 0, 0.7, 1) is one, too", &words)
}

/// How the way of a camera is written.
const WAYS: &str = "ways are: keys such as [(0, \"wide\"), (6, (position: (1, -2, 1), target: (0, 0, 0)))], Path(keys: [...], pace: even, \
                    repeat: true, clearance: 0.01), Turntable(turns: 1), Orbit(turns: 1, lift: 20), Dolly(to: 0.5), Dive(at: (0.5, 0.5), zoom: 1000)";

fn read_way(reader: &mut Reader, value: &Value, rate: Rate) -> Option<CameraMotion> {
    let name = value.name().map(|name| name.text.clone());
    if let (None, ValueKind::List(_)) = (&name, &value.kind) {
        let keys = read_views(reader, value, rate)?;
        return Some(CameraMotion::Path(CameraPath { keys, even: false, repeat: false, clearance: None }));
    }
    let Some(name) = name.filter(|name| ["Path", "Turntable", "Orbit", "Dolly", "Dive"].contains(&name.as_str()))
    else {
        bad(reader, value.span, &format!("expected a camera's way, found {}", value.describe()), WAYS);
        return None;
    };
    if let ValueKind::Variant(_) = &value.kind
        && name == "Turntable"
    {
        return Some(CameraMotion::Turntable { turns: 1.0 });
    }
    let mut fields = Fields::new(value, "a camera's way", reader.d)?;
    let mut number = |reader: &mut Reader, field: &'static str, default: f64, [least, most]: [f64; 2]| {
        fields.optional_value(field).map_or(Some(default), |v| reader.number(v, least, most))
    };
    let way = match name.as_str() {
        "Turntable" => number(reader, "turns", 1.0, [-1e4, 1e4]).map(|turns| CameraMotion::Turntable { turns }),
        "Orbit" => {
            let turns = number(reader, "turns", 1.0, [-1e4, 1e4]);
            let lift = number(reader, "lift", 20.0, [-89.0, 89.0]).map(f64::to_radians);
            turns.zip(lift).map(|(turns, lift)| CameraMotion::Orbit { turns, lift })
        }
        "Dolly" => number(reader, "to", 0.5, [1e-12, 1e12]).map(|to| CameraMotion::Dolly { to }),
        "Dive" => {
            let zoom = number(reader, "zoom", 100.0, [1e-3, 1e12]);
            let at = fields.optional_value("at").map_or(Some([0.5; 2]), |v| read_pair(reader, v, [0.0, 1.0]));
            at.zip(zoom).map(|(at, zoom)| CameraMotion::Dive { at, zoom })
        }
        _ => {
            let even = fields.optional_value("pace");
            let even = even.map_or(Some(false), |v| reader.word(v, "pace", &[("keys", false), ("even", true)]));
            let repeat = fields.or("repeat", false, reader.d);
            let clearance = fields.optional_value("clearance");
            let clearance = clearance.map_or(Some(None), |v| reader.number(v, 1e-15, 1e9).map(Some));
            let keys = fields.optional_value("keys").and_then(|v| read_views(reader, v, rate));
            if keys.is_none() && !reader.d.has_errors() {
                bad(reader, value.span, "a path needs `keys`", WAYS);
            }
            let path = |((keys, even), clearance)| CameraMotion::Path(CameraPath { keys, even, repeat, clearance });
            keys.zip(even).zip(clearance).map(path)
        }
    };
    fields.finish(reader.d);
    way
}

/// Reads the views of a path.
fn read_views(reader: &mut Reader, value: &Value, rate: Rate) -> Option<Vec<CameraKey>> {
    let mut keys: Vec<CameraKey> = Vec::new();
    for item in items(value) {
        let [time, view] = items(item) else {
            let help = "a view's key is its time and a camera, the name of a preset, or `Own`: (2, \"close\")";
            bad(reader, item.span, "this is no key", help);
            return None;
        };
        let time = read_time(reader, time, rate)?;
        if let Some(before) = keys.last().filter(|before| before.time >= time) {
            let message = format!("the key at {time} s comes after the one at {} s", before.time);
            bad(reader, item.span, &message, "keys stand in the order of their times");
            return None;
        }
        let view = match &view.kind {
            ValueKind::Str(preset) => KeyView::Preset(preset.clone()),
            ValueKind::Variant(name) if name.text == "Own" => KeyView::Own,
            _ => KeyView::Camera(Box::new(read_camera(reader, view)?)),
        };
        keys.push(CameraKey { time, view, span: item.span });
    }
    if keys.len() < 2 {
        bad(reader, value.span, "a path needs two views at least", "write [(0, Own), (6, \"close\")]");
        return None;
    }
    Some(keys)
}

fn bad(reader: &mut Reader, span: Span, message: &str, help: &str) {
    reader.d.push(Diagnostic::error(message).label(span, "").help(help));
}

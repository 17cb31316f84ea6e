//! Motion: what moves in a film, and how fast the film runs.
//!
//! A file's `animation: (...)` holds tracks, each for a path that `--set` takes too, and a way for the camera. A frame is the file with the
//! tracks' values at its time, so everything that a picture can show can move.

mod ease;
mod keys;
mod read;

pub use ease::Ease;
pub use keys::{Key, Keys, Moving, Repeat, Way, centripetal, mix};
pub(super) use read::read_motion;

use super::Camera;
use crate::diag::Span;
use crate::formula::value::Name;
use crate::graph::Override;

/// What moves in a film.
#[derive(Clone, PartialEq, Debug)]
pub struct Motion {
    /// Length in seconds, above 0.
    pub seconds: f64,
    /// Frames a second.
    pub rate: Rate,
    /// The time that the shutter is open, as a share of a frame: 0 is no motion blur, 0.5 is usual in films.
    pub shutter: f64,
    /// Pictures that a frame with motion blur is the average of, from 1 to [`Motion::MOST_SAMPLES`].
    pub samples: u32,
    /// Paths as `--set` takes them, and what moves there.
    pub tracks: Vec<(Name, Track)>,
    /// The way of the camera.
    pub camera: Option<CameraMotion>,
    /// A script beside the file, whose functions `camera(t)` and `values(t)` are tracks.
    pub script: Option<FileName>,
    /// A sound file beside the file that films are given.
    pub audio: Option<FileName>,
    /// Where it stands in the file.
    pub span: Span,
}

impl Motion {
    /// The longest film, in seconds.
    pub const LONGEST: f64 = 24.0 * 3600.0;
    /// Most frames of a film.
    pub const MOST_FRAMES: u32 = 1_000_000;
    /// Most pictures of a frame with motion blur.
    pub const MOST_SAMPLES: u32 = 256;

    /// A film in which nothing moves.
    pub fn still(seconds: f64, rate: Rate) -> Motion {
        Motion {
            seconds,
            rate,
            shutter: 0.0,
            samples: 8,
            tracks: Vec::new(),
            camera: None,
            script: None,
            audio: None,
            span: Span::NONE,
        }
    }

    /// The first and the last values of all tracks that state them, as changes of the file.
    pub(in crate::graph) fn ends(&self) -> [Vec<Override>; 2] {
        [false, true].map(|is_last| {
            let value = |(name, track): &(Name, Track)| {
                let value = match track {
                    Track::Keys(keys) => keys.keys()[if is_last { keys.keys().len() - 1 } else { 0 }].value.clone(),
                    Track::Wave { ends, .. } => Moving::Numbers(ends[usize::from(is_last)].clone()),
                    Track::Curve(Curve { source: Source::Band { .. }, ends, .. }) => {
                        Moving::Numbers(vec![ends[usize::from(is_last)]])
                    }
                    Track::Expression { .. } | Track::Curve(_) => return None,
                };
                Some(Override { path: name.text.clone(), value: value.value(name.span) })
            };
            self.tracks.iter().filter_map(value).collect()
        })
    }

    /// Frames of the film, at least one.
    pub fn frames(&self) -> u32 {
        ((self.seconds * self.rate.fps()).round() as u32).clamp(1, Motion::MOST_FRAMES)
    }
}

/// Frames a second, as a fraction, so that 29.97 is exact.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Rate {
    /// Frames,
    pub frames: u32,
    /// in so many seconds.
    pub seconds: u32,
}

impl Rate {
    /// The usual rate of films.
    pub const FILM: Rate = Rate { frames: 24, seconds: 1 };
    /// Most frames a second.
    pub const MOST: f64 = 1000.0;

    /// The rate that a number means: whole numbers, the rates of television (23.976, 29.97, 59.94, 119.88), and thousandths.
    pub fn of(fps: f64) -> Option<Rate> {
        if !(fps > 0.0 && fps <= Rate::MOST) {
            return None;
        }
        let television = (fps * 1.001).round();
        Some(match () {
            () if fps.fract() == 0.0 => Rate { frames: fps as u32, seconds: 1 },
            () if (television / 1.001 - fps).abs() < 0.002 => Rate { frames: television as u32 * 1000, seconds: 1001 },
            () => Rate { frames: (fps * 1000.0).round().max(1.0) as u32, seconds: 1000 },
        })
    }

    /// Frames a second.
    pub fn fps(self) -> f64 {
        f64::from(self.frames) / f64::from(self.seconds)
    }

    /// The time of a frame, in seconds; halves are shutter times.
    pub fn time(self, frame: f64) -> f64 {
        frame * f64::from(self.seconds) / f64::from(self.frames)
    }
}

/// A name of a file that lies beside the formula's.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct FileName {
    /// The name, as the file gives it.
    pub name: String,
    /// Where.
    pub span: Span,
}

/// How a value moves.
#[derive(Clone, PartialEq, Debug)]
pub enum Track {
    /// From key to key.
    Keys(Keys),
    /// By an expression of `t` (seconds), `u` (the share of the film) and the parameters.
    Expression {
        /// The expression.
        text: String,
        /// Where it stands.
        span: Span,
    },
    /// To and fro like a breath: a sine that begins at `from`.
    Wave {
        /// The numbers at its ends.
        ends: [Vec<f64>; 2],
        /// Seconds to and fro.
        seconds: f64,
    },
    /// By a file.
    Curve(Curve),
}

/// A number that follows a file.
#[derive(Clone, PartialEq, Debug)]
pub struct Curve {
    /// The file.
    pub file: FileName,
    /// What of it.
    pub source: Source,
    /// What 0 and 1 of the file's numbers become.
    pub ends: [f64; 2],
}

/// What is read of a file.
#[derive(Clone, PartialEq, Debug)]
pub enum Source {
    /// A column of a table with a head (CSV), or a field of the objects of a list (JSON), over another one with seconds.
    Column {
        /// The numbers' name.
        name: String,
        /// The seconds' name.
        time: String,
    },
    /// The loudness of a band of a sound (WAV), as a share of the loudest.
    Band {
        /// Its frequencies, in hertz.
        from_to: [f64; 2],
        /// Seconds in which it falls to a third.
        fall: f64,
    },
}

/// The way of a camera.
#[derive(Clone, PartialEq, Debug)]
pub enum CameraMotion {
    /// From view to view, at a speed that fits the distance to the surface.
    Path(CameraPath),
    /// Around the target, about the up direction.
    Turntable {
        /// Whole turns in the film.
        turns: f64,
    },
    /// Around the target, up and down on the way.
    Orbit {
        /// Whole turns in the film.
        turns: f64,
        /// How far up and down, in radians.
        lift: f64,
    },
    /// Towards the target, or away.
    Dolly {
        /// What the distance to the target is multiplied by at the end; above 0.
        to: f64,
    },
    /// Towards the surface that a place of the first picture shows.
    Dive {
        /// The place: 0, 0 is the upper left corner and 1, 1 the lower right one.
        at: [f64; 2],
        /// How many times as large the surface is at the end.
        zoom: f64,
    },
}

/// A way from view to view.
#[derive(Clone, PartialEq, Debug)]
pub struct CameraPath {
    /// The views, in the order of their times.
    pub keys: Vec<CameraKey>,
    /// Whether the camera keeps one pace from the first to the last, whatever the times of the others.
    pub even: bool,
    /// Whether it goes back to the first view, without a halt.
    pub repeat: bool,
    /// The least distance to the surface, in world units; what suits the keys without it.
    pub clearance: Option<f64>,
}

/// A view at a time.
#[derive(Clone, PartialEq, Debug)]
pub struct CameraKey {
    /// Seconds from the film's start.
    pub time: f64,
    /// The view.
    pub view: KeyView,
    /// Where it stands.
    pub span: Span,
}

/// What a view is given by.
#[derive(Clone, PartialEq, Debug)]
pub enum KeyView {
    /// The file's own camera.
    Own,
    /// The camera of a preset.
    Preset(String),
    /// A camera.
    Camera(Box<Camera>),
}

#[cfg(test)]
mod tests {
    use super::{Motion, Rate};

    #[test]
    fn rates_are_exact() {
        for (fps, frames, seconds) in
            [(24.0, 24, 1), (23.976, 24_000, 1001), (29.97, 30_000, 1001), (59.94, 60_000, 1001), (12.5, 12_500, 1000)]
        {
            assert_eq!(Rate::of(fps), Some(Rate { frames, seconds }), "{fps}");
        }
        assert!([0.0, -1.0, f64::NAN, 2000.0].iter().all(|fps| Rate::of(*fps).is_none()));
        assert_eq!(Motion::still(10.0, Rate { frames: 30_000, seconds: 1001 }).frames(), 300);
    }
}

//! How loud a band of a sound is, over time.

use std::path::Path;

/// Measurements a second.
const RATE: f64 = 100.0;
/// The longest sound, in samples of one channel.
const MOST_SAMPLES: u64 = 500_000_000;

/// Pairs of a time in seconds and the loudness of a band of a WAV file, as a share of the loudest. It rises at once and falls to
/// a third in `fall` seconds.
///
/// Errors: why there is none.
pub fn loudness(path: &Path, [low, high]: [f64; 2], fall: f64) -> Result<Vec<(f64, f64)>, String> {
    let reader = hound::WavReader::open(path).map_err(|error| format!("cannot be read as a WAV file: {error}"))?;
    let spec = reader.spec();
    let (rate, channels) = (f64::from(spec.sample_rate), usize::from(spec.channels.max(1)));
    if u64::from(reader.duration()) > MOST_SAMPLES || rate < 100.0 {
        return Err("the sound is too long, or has too few samples a second".into());
    }
    if low >= high {
        return Err(format!("the band from {low} to {high} Hz is empty"));
    }
    let scale = match spec.sample_format {
        hound::SampleFormat::Float => 1.0,
        hound::SampleFormat::Int => 1.0 / 2f64.powi(i32::from(spec.bits_per_sample) - 1),
    };
    let broken = |error: hound::Error| format!("the sound ends early: {error}");
    let samples: Vec<f32> = match spec.sample_format {
        hound::SampleFormat::Float => reader.into_samples::<f32>().collect::<Result<_, _>>().map_err(broken)?,
        hound::SampleFormat::Int => {
            let samples = reader.into_samples::<i32>();
            samples
                .map(|sample| sample.map(|x| (f64::from(x) * scale) as f32))
                .collect::<Result<_, _>>()
                .map_err(broken)?
        }
    };
    let mono = samples.chunks_exact(channels).map(|frame| frame.iter().map(|x| f64::from(*x)).sum::<f64>());
    let mut filters =
        [Filter::above(low, rate), Filter::above(low, rate), Filter::below(high, rate), Filter::below(high, rate)];
    let filtered: Vec<f64> =
        mono.map(|x| filters.iter_mut().fold(x / channels as f64, |x, filter| filter.next(x))).collect();
    Ok(shares(&filtered, rate, fall))
}

/// The loudness of a sound in steps of a hundredth of a second.
fn shares(sound: &[f64], rate: f64, fall: f64) -> Vec<(f64, f64)> {
    let kept = if fall > 0.0 { (-1.0 / (RATE * fall)).exp() } else { 0.0 };
    let (mut points, mut level) = (Vec::new(), 0.0f64);
    let steps = (sound.len() as f64 / rate * RATE).ceil() as usize;
    for step in 0..steps {
        let part = |step: usize| ((step as f64 / RATE * rate) as usize).min(sound.len());
        let part = &sound[part(step)..part(step + 1)];
        let mean = part.iter().map(|x| x * x).sum::<f64>() / part.len().max(1) as f64;
        level = mean.sqrt().max(level * kept);
        points.push((step as f64 / RATE, level));
    }
    let most = points.iter().map(|(_, level)| *level).fold(0.0, f64::max);
    if most > 0.0 {
        points.iter_mut().for_each(|(_, level)| *level /= most);
    }
    points
}

/// A filter of the second order (Butterworth, by the bilinear transform; R. Bristow-Johnson's cookbook).
struct Filter {
    /// What is taken of the last three inputs.
    taken: [f64; 3],
    /// What is taken away of the last two outputs.
    fed: [f64; 2],
    inputs: [f64; 2],
    outputs: [f64; 2],
}

impl Filter {
    /// Passes what is below a frequency.
    fn below(frequency: f64, rate: f64) -> Filter {
        Filter::new(frequency, rate, |cos| [(1.0 - cos) / 2.0, 1.0 - cos, (1.0 - cos) / 2.0])
    }

    /// Passes what is above a frequency.
    fn above(frequency: f64, rate: f64) -> Filter {
        Filter::new(frequency, rate, |cos| [f64::midpoint(1.0, cos), -1.0 - cos, f64::midpoint(1.0, cos)])
    }

    fn new(frequency: f64, rate: f64, taken: impl Fn(f64) -> [f64; 3]) -> Filter {
        // Nothing is above half of the sampling rate.
        let angle = std::f64::consts::TAU * (frequency / rate).min(0.499);
        let (cos, width) = (angle.cos(), angle.sin() * std::f64::consts::FRAC_1_SQRT_2);
        let whole = 1.0 + width;
        let fed = [-2.0 * cos / whole, (1.0 - width) / whole];
        Filter { taken: taken(cos).map(|x| x / whole), fed, inputs: [0.0; 2], outputs: [0.0; 2] }
    }

    fn next(&mut self, input: f64) -> f64 {
        let ([a, b, c], [d, e]) = (self.taken, self.fed);
        let output = a * input + b * self.inputs[0] + c * self.inputs[1] - d * self.outputs[0] - e * self.outputs[1];
        (self.inputs, self.outputs) = ([input, self.inputs[0]], [output, self.outputs[0]]);
        output
    }
}

#[cfg(test)]
mod tests {
    use super::loudness;

    /// A second of a low tone, and then one of a high one, as 16-bit stereo.
    fn tones(path: &std::path::Path) {
        let spec = hound::WavSpec {
            channels: 2,
            sample_rate: 8000,
            bits_per_sample: 16,
            sample_format: hound::SampleFormat::Int,
        };
        let mut file = hound::WavWriter::create(path, spec).expect("it can be written");
        for i in 0..16_000u32 {
            let frequency = if i < 8000 { 60.0 } else { 1500.0 };
            let sample = (f64::from(i) / 8000.0 * frequency * std::f64::consts::TAU).sin() * 12_000.0;
            file.write_sample(sample as i16).expect("it takes samples");
            file.write_sample(sample as i16).expect("it takes samples");
        }
        file.finalize().expect("it is whole");
    }

    #[test]
    fn bands_hear_their_own_tones() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("tones.wav");
        tones(&path);
        let at = |band, time: f64| {
            let points = loudness(&path, band, 0.05).expect("it can be read");
            points[(time * 100.0) as usize].1
        };
        // The beginning of a tone is louder than the tone itself.
        assert!(at([30.0, 120.0], 0.5) > 0.8 && at([30.0, 120.0], 1.5) < 0.05);
        assert!(at([1000.0, 2000.0], 0.5) < 0.05 && at([1000.0, 2000.0], 1.5) > 0.8);
        assert!(loudness(&path, [200.0, 100.0], 0.1).is_err());
        assert!(loudness(&folder.path().join("none.wav"), [20.0, 100.0], 0.1).is_err());
    }

    #[test]
    fn loudness_falls_slowly() {
        let points = super::shares(&[vec![1.0; 100], vec![0.0; 900]].concat(), 1000.0, 0.2);
        let level = |time: f64| points[(time * 100.0f64).round() as usize].1;
        assert_eq!(level(0.05), 1.0);
        assert!((level(0.29) - (-1.0f64).exp()).abs() < 1e-9, "{}", level(0.29));
    }
}

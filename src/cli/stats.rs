//! What a render chose and counted, as a table for people and as JSON for programs.

use std::fmt::Write as _;
use std::time::Duration;

use bulbfold::calibrate::Calibration;
use bulbfold::compose::{Choice, Plan};
use bulbfold::kernel::Compiling;
use bulbfold::render::{Pipeline, RenderSettings, Stats};
use serde_json::{Map, Value, json};

use super::calibration;

/// Version of the JSON object; it grows when a key changes its meaning or goes.
const VERSION: u32 = 1;

/// Everything there is to tell.
pub struct Report<'a> {
    /// Name of the fractal.
    pub fractal: &'a str,
    /// The back end that did the work.
    pub backend: &'a str,
    /// What was asked for.
    pub settings: &'a RenderSettings,
    /// What was chosen.
    pub pipeline: &'a Pipeline,
    /// How the estimate was chosen.
    pub calibration: Option<&'a Calibration>,
    /// Time that composing the kernels took.
    pub composing: Duration,
    /// What was counted.
    pub stats: &'a Stats,
    /// Time that compressing and writing the files took.
    pub encode: Duration,
    /// The files' names.
    pub files: &'a [String],
}

impl Report<'_> {
    fn pixels(&self) -> f64 {
        f64::from(self.settings.size.width) * f64::from(self.settings.size.height)
    }

    /// Iterations that the orbits have at most: the file's, or those of the view.
    fn limits(&self) -> Vec<u32> {
        self.pipeline.march().estimator.orbits.iter().map(|orbit| orbit.max_iterations).collect()
    }

    /// Where the time of the render went.
    fn stages(&self) -> [(&'static str, Duration); 5] {
        let stats = self.stats;
        [
            ("march", stats.march),
            ("shadows", stats.shadow),
            ("shading", stats.shade),
            ("results", stats.results),
            ("encoding", self.encode),
        ]
    }

    /// One JSON object. Times are in seconds, angles in degrees.
    pub fn json(&self) -> Value {
        let (stats, plan) = (self.stats, &self.pipeline.plan);
        let orbits: Vec<Value> = plan
            .choices
            .iter()
            .map(|choice| {
                json!({
                    "method": choice.method.name(), "form": choice.form.name(), "radius": choice.radius,
                    "fudge": choice.fudge, "reason": choice.reason,
                    "applicable": choice.applicable.iter().map(|m| m.name()).collect::<Vec<_>>(),
                })
            })
            .collect();
        let camera = &self.pipeline.camera;
        json!({
            "version": VERSION,
            "fractal": self.fractal,
            "size": [self.settings.size.width, self.settings.size.height],
            "samples": self.settings.samples,
            "backend": self.backend,
            "files": self.files,
            "orbits": orbits,
            "fudge": plan.fudge,
            "bounding_radius": plan.bounding_radius,
            "bounds": plan.reach.name(),
            "max_iterations": self.limits(),
            "bounding_box": self.pipeline.bounds.sides.map(|sides| [sides.low, sides.high]),
            "camera": {
                "position": camera.position, "target": camera.target, "up": camera.up, "fov": camera.fov.to_degrees(),
                "lens": camera.lens.name(), "stereo": camera.stereo.map(|stereo| stereo.layout.name()),
            },
            "plane": self.pipeline.plane.map(|plane| json!({
                "center": plane.center, "height": plane.height, "right": plane.right, "up": plane.up,
            })),
            "beams": stats.beams,
            "rays": stats.rays,
            "refined": stats.refined,
            "samples_per_pixel": stats.rays as f64 / self.pixels(),
            "hits": stats.hits,
            "unfinished": stats.unfinished,
            "nan": stats.nan,
            "undecided": stats.undecided,
            "march_steps_mean": ratio(stats.estimates as f64, stats.rays as f64),
            "march_steps_max": stats.max_steps,
            "iterations_mean": ratio(stats.iterations as f64, stats.estimates as f64),
            "estimates_per_pixel": {
                "beams": stats.beam_estimates as f64 / self.pixels(),
                "primary": stats.estimates as f64 / self.pixels(),
                "shadow": stats.shadow_estimates as f64 / self.pixels(),
            },
            "compose_seconds": self.composing.as_secs_f64(),
            "compile_seconds": stats.compile.as_secs_f64(),
            "compiling": stats.compiling.map(|c| json!({
                "kernels": c.kernels, "compiled": c.compiled,
                "own_seconds": c.own.as_secs_f64(), "driver_seconds": c.driver.as_secs_f64(),
            })),
            "render_seconds": stats.render.as_secs_f64(),
            "stage_seconds": self.stages().iter().map(|(name, time)| ((*name).into(), json!(time.as_secs_f64()))).collect::<Map<_, _>>(),
            "peak_memory_bytes": peak_memory(),
            "calibration": self.calibration.map(calibration::json),
            "warnings": plan.warnings,
        })
    }

    /// A table with a row a line.
    pub fn table(&self) -> String {
        let (stats, plan) = (self.stats, &self.pipeline.plan);
        let mut text = String::new();
        let mut row = |name: &str, value: String| {
            let _ = writeln!(text, "{name:<20} {value}");
        };
        row("back end", self.backend.to_string());
        for (name, value) in estimate_rows(plan) {
            row(&name, value);
        }
        row("max iterations", self.limits().iter().map(u32::to_string).collect::<Vec<_>>().join(", "));
        row("fudge", plan.fudge.to_string());
        row("shortest step", format!("{} of the hit threshold", plan.least_step));
        if plan.most_step.is_finite() {
            row("longest step", format!("{} hit thresholds", plan.most_step));
        }
        row("bounding radius", format!("{:.4} ({})", plan.bounding_radius, plan.reach.name()));
        if let Some(sides) = self.pipeline.bounds.sides {
            let along = |k: usize| format!("{:.3} to {:.3}", sides.low[k], sides.high[k]);
            row("bounding box", [0, 1, 2].map(along).join(", "));
        }
        let share = |count: u64| format!("{count} ({:.2} %)", 100.0 * ratio(count as f64, stats.rays as f64));
        let refined = 100.0 * stats.refined as f64 / self.pixels();
        row("samples", format!("{:.2} a pixel, {refined:.1} % of pixels refined", stats.rays as f64 / self.pixels()));
        row("rays", stats.rays.to_string());
        row("hits", share(stats.hits));
        row("unfinished rays", share(stats.unfinished));
        row("NaN rays", share(stats.nan));
        if let Some(undecided) = stats.undecided {
            row("undecided rays", share(undecided));
        }
        let mean = ratio(stats.estimates as f64, stats.rays as f64);
        row("march steps", format!("{mean:.1} on average, {} at most", stats.max_steps));
        row("iterations", format!("{:.2} an estimate", ratio(stats.iterations as f64, stats.estimates as f64)));
        let each = |estimates: u64| estimates as f64 / self.pixels();
        if stats.beams > 0 {
            let mean = ratio(stats.beam_estimates as f64, stats.beams as f64);
            row("beams", format!("{}, {mean:.1} estimates each", stats.beams));
        } else if stats.are_beams_wrong {
            row("beams", "none: rays end elsewhere with them, or the picture is too small to tell".to_string());
        }
        let parts = [stats.beam_estimates, stats.estimates, stats.shadow_estimates];
        let [beams, primary, shadow] = parts.map(each);
        let all = beams + primary + shadow;
        row("estimates per pixel", format!("{all:.1}: {beams:.2} beams, {primary:.1} primary, {shadow:.1} shadow"));
        row("compose time", format!("{:.3} s", self.composing.as_secs_f64()));
        row("compile time", format!("{:.3} s", stats.compile.as_secs_f64()));
        if let Some(done) = &stats.compiling {
            row("compiling", compiling(done));
        }
        row("render time", format!("{:.3} s", stats.render.as_secs_f64()));
        let stages: Vec<String> =
            self.stages().iter().map(|(name, time)| format!("{name} {:.3} s", time.as_secs_f64())).collect();
        row("time of all threads", stages.join(", "));
        if let Some(bytes) = peak_memory() {
            row("peak memory", format!("{:.0} MiB", bytes as f64 / f64::from(1 << 20)));
        }
        text.push_str(&self.calibration.map(calibration::table).unwrap_or_default());
        text
    }
}

/// The most memory that the process has held so far; only Linux tells it.
pub fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}

/// What a back end has compiled, and whose time that took.
pub fn compiling(done: &Compiling) -> String {
    let [own, driver] = [done.own, done.driver].map(|time| time.as_secs_f64());
    let Compiling { kernels, compiled, .. } = done;
    format!("{compiled} of {kernels} kernels, the others known; own work {own:.3} s, driver {driver:.3} s")
}

/// What was chosen for each orbit: a name and the choice with its reason.
pub fn estimate_rows(plan: &Plan) -> Vec<(String, String)> {
    if plan.choices.is_empty() {
        return vec![("estimate".into(), "own: primitives know their distance".into())];
    }
    let row = |(i, choice): (usize, &Choice)| {
        let radius = if choice.radius > 0.0 { format!(", radius {:.4}", choice.radius) } else { String::new() };
        let name = if plan.choices.len() == 1 { "estimate".to_string() } else { format!("estimate {}", i + 1) };
        (name, format!("{}, {}{radius}: {}", choice.method.name(), choice.form.name(), choice.reason))
    };
    plan.choices.iter().enumerate().map(row).collect()
}

/// A quotient that is 0 if there is nothing to divide by.
fn ratio(a: f64, b: f64) -> f64 {
    if b > 0.0 { a / b } else { 0.0 }
}

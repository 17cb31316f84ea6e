//! What `bench` measured, as tables for people, and as JSON and CSV for programs.

use std::fmt::Write as _;

use bulbfold::shade::Size;
use serde_json::{Value, json};

use super::super::stats::peak_memory;
use super::{BASELINE, Engine, Measured, Peaks, Row};

/// Version of the JSON object; it grows when a key changes its meaning or goes.
const VERSION: u32 = 1;

impl Engine {
    fn name(self) -> &'static str {
        match self {
            Engine::Cpu(_) => "cpu",
            Engine::Tape(_) => "tape",
            Engine::Gpu => "gpu",
        }
    }

    fn precision_name(self) -> &'static str {
        self.precision().name()
    }
}

impl Measured {
    /// The row of another engine with the same method.
    fn of(&self, row: &Row, engine: Engine) -> Option<&Row> {
        self.rows.iter().find(|other| other.engine == engine && other.method == row.method)
    }

    /// How many times faster a row is than the same method on another engine.
    fn times_faster(&self, row: &Row, than: Engine) -> Option<f64> {
        self.of(row, than).map(|other| other.speed.ns_per_pixel() / row.speed.ns_per_pixel())
    }
}

/// Operations of an estimate with its march step, without iterations.
fn per_estimate(row: &Row) -> f64 {
    (row.cost.step + row.cost.estimate).operations()
}

/// Tables.
pub fn table(all: &[Measured], peaks: &Peaks, size: Size) -> String {
    let mut text = String::new();
    for measured in all {
        let _ = writeln!(text, "{}: {} x {} rays, {}", measured.fractal, size.width, size.height, measured.estimate);
        fractal(&mut text, measured);
        text.push('\n');
    }
    let (threads, together) = peaks.all;
    let _ = writeln!(
        text,
        "a core: {:.1} billion products and sums in one a second in f32, {:.1} in f64; {threads} threads together {:.1} in f32",
        peaks.single / 1e9,
        peaks.double / 1e9,
        together / 1e9
    );
    if let Some(bytes) = peak_memory() {
        let _ = writeln!(text, "memory: {:.0} MiB at most", bytes as f64 / f64::from(1 << 20));
    }
    let _ = writeln!(
        text,
        "ns/pixel: the fastest march of a ray, on one thread (gpu: as the driver does), without shading; spread: how much the\n\
         median is above it; ops: operations on numbers, a product and a sum in one being one; of peak: ops against the core's\n\
         products and sums in one; x tape: against the f64 interpreter, one ray at a time; x gpu: against the GPU or its software."
    );
    text
}

fn fractal(text: &mut String, measured: &Measured) {
    let _ = writeln!(
        text,
        "  {:<6}{:<5}{:<16}{:>9}{:>8}{:>6}{:>10}{:>9}{:>9}{:>9}{:>8}{:>8}{:>7}",
        "",
        "",
        "method",
        "ns/pixel",
        "spread",
        "runs",
        "est/pixel",
        "iter/est",
        "ops/iter",
        "ops/est",
        "of peak",
        "x tape",
        "x gpu"
    );
    let shown = |value: Option<f64>, unit: &str| value.map_or("-".into(), |value| format!("{value:.1}{unit}"));
    for row in &measured.rows {
        let _ = writeln!(
            text,
            "  {:<6}{:<5}{:<16}{:>9.1}{:>8}{:>6}{:>10.1}{:>9.2}{:>9.1}{:>9.0}{:>8}{:>8}{:>7}",
            row.engine.name(),
            row.engine.precision_name(),
            row.method,
            row.speed.ns_per_pixel(),
            format!("{:.0} %", 100.0 * row.speed.times.spread()),
            row.speed.times.runs(),
            row.speed.estimates_per_pixel(),
            row.speed.iterations_per_estimate(),
            row.cost.iteration.operations(),
            per_estimate(row),
            shown(row.of_peak.map(|share| 100.0 * share), " %"),
            shown(measured.times_faster(row, BASELINE), ""),
            shown(measured.times_faster(row, Engine::Gpu), ""),
        );
    }
    let one = measured.threads.first().map_or(0.0, |(_, speed)| speed.ns_per_pixel());
    let line = |(count, speed): &(usize, super::Speed)| {
        let ns = speed.ns_per_pixel();
        format!("{count}: {ns:.1} ns/pixel ({:.2} times)", one / ns)
    };
    let _ = writeln!(text, "  cpu: threads {}", measured.threads.iter().map(line).collect::<Vec<_>>().join("; "));
    let picture = &measured.picture;
    let _ = writeln!(
        text,
        "  cpu: picture {:.1} ms with shading on all threads (spread {:.0} %, {} runs)",
        picture.fastest().as_secs_f64() * 1e3,
        100.0 * picture.spread(),
        picture.runs()
    );
}

/// One JSON object. Times are in nanoseconds, rates in scalars a second.
pub fn json(all: &[Measured], peaks: &Peaks, size: Size) -> Value {
    let row = |measured: &Measured, row: &Row| {
        json!({
            "engine": row.engine.name(), "precision": row.engine.precision_name(), "backend": row.backend,
            "method": row.method,
            "ns_per_pixel": row.speed.ns_per_pixel(),
            "median_ns_per_pixel": row.speed.times.median().as_nanos() as f64 / row.speed.pixels as f64,
            "runs": row.speed.times.runs(), "pixels": row.speed.pixels,
            "estimates_per_pixel": row.speed.estimates_per_pixel(),
            "iterations_per_estimate": row.speed.iterations_per_estimate(),
            "operations_per_iteration": row.cost.iteration.operations(),
            "operations_per_estimate": per_estimate(row),
            "of_peak": row.of_peak,
            "times_tape_f64": measured.times_faster(row, BASELINE),
            "times_gpu": measured.times_faster(row, Engine::Gpu),
        })
    };
    let fractal = |measured: &Measured| {
        json!({
            "fractal": measured.fractal,
            "estimate": measured.estimate,
            "rows": measured.rows.iter().map(|r| row(measured, r)).collect::<Vec<_>>(),
            "threads": measured.threads.iter().map(|(count, speed)| {
                json!({ "threads": count, "ns_per_pixel": speed.ns_per_pixel() })
            }).collect::<Vec<_>>(),
            "picture_ns": measured.picture.fastest().as_nanos() as u64,
            "picture_median_ns": measured.picture.median().as_nanos() as u64,
        })
    };
    json!({
        "version": VERSION,
        "size": [size.width, size.height],
        "peak_mul_adds": { "f32": peaks.single, "f64": peaks.double, "f32_all_threads": peaks.all.1, "threads": peaks.all.0 },
        "peak_memory_bytes": peak_memory(),
        "fractals": all.iter().map(fractal).collect::<Vec<_>>(),
    })
}

/// A header and a line a row.
pub fn csv(all: &[Measured], size: Size) -> String {
    let mut text = String::from(
        "fractal,width,height,engine,precision,method,threads,ns_per_pixel,median_ns_per_pixel,runs,estimates_per_pixel,\
         iterations_per_estimate,operations_per_iteration,operations_per_estimate,of_peak,times_tape_f64,times_gpu\n",
    );
    let optional = |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:.4}"));
    for measured in all {
        for row in &measured.rows {
            let threads = if row.engine == Engine::Gpu { "" } else { "1" };
            let speed = &row.speed;
            let _ = writeln!(
                text,
                "{},{},{},{},{},{},{threads},{:.3},{:.3},{},{:.3},{:.4},{:.2},{:.2},{},{},{}",
                quoted(&measured.fractal),
                size.width,
                size.height,
                row.engine.name(),
                row.engine.precision_name(),
                row.method,
                speed.ns_per_pixel(),
                speed.times.median().as_nanos() as f64 / speed.pixels as f64,
                speed.times.runs(),
                speed.estimates_per_pixel(),
                speed.iterations_per_estimate(),
                row.cost.iteration.operations(),
                per_estimate(row),
                optional(row.of_peak),
                optional(measured.times_faster(row, BASELINE)),
                optional(measured.times_faster(row, Engine::Gpu)),
            );
        }
    }
    text
}

/// A name as a field of CSV.
fn quoted(name: &str) -> String {
    if name.contains([',', '"', '\n']) { format!("\"{}\"", name.replace('"', "\"\"")) } else { name.to_string() }
}

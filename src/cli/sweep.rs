//! `bulbfold render --sweep`: the frames of an animation, with as few kernels as their structures allow.

use std::io::Write;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bulbfold::compose::{Composer, Plan};
use bulbfold::engine::{Animation, Estimates, Frame, Observer, Stage, Work};
use bulbfold::expr::Arena;
use bulbfold::files::Target;
use bulbfold::film::{Form, PictureFile};
use bulbfold::frames::{FrameRenderer, Frames, JoinedFrames};
use bulbfold::graph::{StereoLayout, ValidGraph};
use bulbfold::kernel::template::Kept;
use bulbfold::kernel::{Backend, BackendError, Compiling};
use bulbfold::render::{RenderSettings, Renderer, Stats, beams_hold, compose_planned};
use clap::Args;
use serde_json::json;

use super::frames::{Names, frame_key, frames_to_do, refuse_json};
use super::output::not_written;
use super::pictures::has_layers;
use super::progress::short;
use super::range::Range;
use super::render::Arguments;
use super::session::talk;
use super::{Failure, Outcome, Session, message, usage};

/// What makes a picture an animation.
#[derive(Args, Default, Debug)]
pub struct SweepArgs {
    /// Move what --set sets from frame to frame, or the view: camera, target, up, fov, or turn (degrees around the target);
    /// vectors are X,Y,Z..X,Y,Z. Or a list with a value for each frame, such as seed=3,7,18. May be given several times
    #[arg(long = "sweep", value_name = "NAME=FROM..TO", allow_hyphen_values = true)]
    ranges: Vec<Range>,
    /// Number of frames, that of the values where there is a list; -o is then a name with a place for the frame's number, such as frame_%04d.png
    #[arg(long, value_name = "N", requires = "ranges", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    frames: Option<u32>,
    /// Keep finished rows beside the picture, in OUT.part, and go on with those of an earlier run that was stopped. Of a sweep: keep
    /// the frames that an earlier run of the same settings has made; all others are named and rendered again
    #[arg(long, conflicts_with = "view")]
    pub resume: bool,
}

/// What sweeps may move besides parameters.
const VIEW: [&str; 5] = ["camera", "target", "up", "fov", "turn"];

impl SweepArgs {
    /// How many frames there are; none if a single picture is asked for.
    pub fn frames(&self) -> Result<Option<u32>, Failure> {
        let Some(first) = self.ranges.first() else { return Ok(None) };
        let listed = self.ranges.iter().find_map(|range| Some((range.name.as_str(), range.frames()?)));
        let frames = match (self.frames, listed) {
            (Some(frames), _) => frames as usize,
            (None, Some((_, count))) => count,
            (None, None) => {
                let text = format!("the sweep of `{}` does not say how many frames there are", first.name);
                return Err(usage(text, "give their number: --frames 48"));
            }
        };
        let odd = self.ranges.iter().find_map(|range| Some((&range.name, range.frames().filter(|n| *n != frames)?)));
        match odd {
            None => Ok(Some(frames as u32)),
            Some((name, count)) => {
                let text = format!("the sweep of `{name}` lists {count} values for {frames} frames");
                Err(usage(text, "list a value for each frame, or leave out --frames"))
            }
        }
    }

    /// True when all frames show the same set, which then is measured once.
    fn moves_the_view_alone(&self) -> bool {
        self.ranges.iter().all(|range| VIEW.contains(&range.name.as_str()))
    }
}

/// Renders all frames.
pub fn run(
    arguments: &Arguments,
    sweep: &SweepArgs,
    frames: u32,
    session: &mut Session,
    out: &mut dyn Write,
) -> Outcome {
    if !arguments.is_plain() {
        return Err(usage("a sweep renders pictures, not views of error", "drop `--view` or `--sweep`"));
    }
    arguments.refuse_picture()?;
    let names = Names::new(arguments)?;
    if arguments.json {
        refuse_json(&names)?;
    }
    arguments.prepare();
    let mut request = arguments.request();
    request.first_precision().map_err(|error| session.failed(error))?;
    let (start, mut composing) = (Instant::now(), Duration::ZERO);
    let moved = moved(session, arguments, sweep, frames)?;
    let session = &*session;
    let failed = |error| session.failed(error);
    let have_layers = moved.iter().all(|frame| has_layers(&frame.graph.scene, &request));
    request.layers = arguments.output.layers(names.format(), have_layers)?;
    let mut watch = session.watch(arguments.quiet);
    let animation = Animation::settle(&session.library, &request, moved, &mut watch).map_err(failed)?;
    refuse_anaglyphs(&animation.graphs)?;
    let settings = request.settings(animation.precision);
    let key = |graph| frame_key(session, arguments, &settings, graph);
    let keys: Vec<String> = animation.graphs.iter().map(key).collect();
    let todo = match sweep.resume {
        true => frames_to_do(&names, &keys, &settings)?,
        false => (0..frames).collect(),
    };
    let targets = names.targets(session, &todo)?;
    let estimates = animation.estimates(&mut watch).map_err(failed)?;
    let mut gathered = Frames::default();
    let mut plans = Plans::of(sweep, &estimates);
    for &frame in &todo {
        let arena = Arc::new(Arena::default());
        let graph = &animation.graphs[frame as usize];
        let composer = Composer { arena: &arena, library: &session.library, graph };
        let plan = plans.next(|| animation.plan(frame as usize, &estimates, &arena, &mut watch).map_err(failed))?;
        let begun = Instant::now();
        let pipeline = compose_planned(&composer, &settings, plan);
        let mut pipeline = pipeline.map_err(|diagnostic| session.failure(diagnostic))?;
        let hold = beams_hold(&arena, &pipeline, &settings);
        if !hold.map_err(|error| Failure::Work(message(&error.to_string(), "")))? {
            pipeline.drop_beams();
        }
        gathered.add(&arena, &pipeline);
        composing += begun.elapsed();
    }
    let joined = gathered.finish();
    let form = |&frame: &u32| {
        let (graph, key) = (&animation.graphs[frame as usize], &keys[frame as usize]);
        arguments.output.form(names.format(), &request, &graph.scene, key)
    };
    let forms = todo.iter().map(form).collect();
    let mut job =
        SweepJob { frames: &joined, settings: &settings, targets, forms, next: 0, counted: Counted::default() };
    let done = session.engine.backends().run(request.backend, animation.precision, &mut job, &mut watch);
    let (backend, written) = done.map_err(failed)?;
    written?;
    let report =
        Report { backend, composing, skipped: frames as usize - todo.len(), joined: &joined, counted: &job.counted };
    if arguments.json {
        writeln!(out, "{}", report.json())?;
    }
    if arguments.stats {
        talk(report.table().trim_end());
    }
    if !arguments.quiet {
        talk(&format!("{} ({})", names.shown(frames), short(start.elapsed())));
    }
    Ok(())
}

/// What each frame shows. All are read before anything is rendered, so that a value out of range is reported at once.
fn moved(session: &mut Session, arguments: &Arguments, sweep: &SweepArgs, frames: u32) -> Result<Vec<Frame>, Failure> {
    let mut moved = Vec::new();
    let changes = arguments.changes(session)?;
    for frame in 0..frames {
        let (mut set, mut camera) = (changes.clone(), arguments.camera);
        for range in &sweep.ranges {
            let value = || range.numbers(frame, frames);
            let vector = || <[f64; 3]>::try_from(value()).ok();
            match range.name.as_str() {
                "camera" => camera.camera = vector(),
                "target" => camera.target = vector(),
                "up" => camera.up = vector(),
                "fov" => camera.fov = value().first().copied(),
                "turn" => camera.turn = value().first().map(|degrees| degrees.to_radians()),
                name => set.push((name.to_string(), range.ron(frame, frames))),
            }
        }
        let file = &arguments.formula.file;
        let loaded = if frame == 0 { session.load(file, &set)? } else { session.load_again(file, &set)? };
        moved.push(Frame { graph: loaded.graph, camera: camera.change() });
    }
    Ok(moved)
}

/// Refuses anaglyphs, which are two renders a frame.
fn refuse_anaglyphs(graphs: &[ValidGraph]) -> Outcome {
    let layout = |graph: &ValidGraph| graph.scene.camera.and_then(|camera| camera.stereo).map(|stereo| stereo.layout);
    match graphs.iter().any(|graph| layout(graph) == Some(StereoLayout::Anaglyph)) {
        true => Err(usage(
            "the frames of a sweep cannot be anaglyphs",
            "render `--stereo left` and `--stereo right`, and join them",
        )),
        false => Ok(()),
    }
}

/// The plans of frames that share their estimate.
struct Plans {
    /// Whether all frames show the same set, so that what is measured for the first holds for all.
    are_one: bool,
    kept: Option<Plan>,
}

impl Plans {
    fn of(sweep: &SweepArgs, estimates: &Estimates) -> Plans {
        Plans { are_one: sweep.moves_the_view_alone() && matches!(estimates, Estimates::Shared(_)), kept: None }
    }

    /// The next frame's plan, measured where none is known.
    fn next(&mut self, measure: impl FnOnce() -> Result<Plan, Failure>) -> Result<Plan, Failure> {
        if let Some(plan) = &self.kept {
            return Ok(plan.clone());
        }
        let plan = measure()?;
        self.kept = self.are_one.then(|| plan.clone());
        Ok(plan)
    }
}

/// What was counted in all frames.
#[derive(Default)]
struct Counted {
    rendered: usize,
    compiled: usize,
    compiling: Option<Compiling>,
    /// Time to compile and to render.
    times: [Duration; 2],
    rays: u64,
    unfinished: u64,
    nan: u64,
    estimates: u64,
}

impl Counted {
    fn add(&mut self, stats: &Stats) {
        self.rendered += 1;
        self.times[1] += stats.render;
        self.rays += stats.rays;
        self.unfinished += stats.unfinished;
        self.nan += stats.nan;
        self.estimates += stats.beam_estimates + stats.estimates + stats.shadow_estimates;
    }
}

/// Frames rendered and written. Another back end that takes over goes on where one failed.
struct SweepJob<'a> {
    frames: &'a JoinedFrames,
    settings: &'a RenderSettings,
    /// One for each frame.
    targets: Vec<Target>,
    /// What their files hold.
    forms: Vec<Form>,
    next: usize,
    counted: Counted,
}

impl Work for SweepJob<'_> {
    type Output = Outcome;

    fn run<B: Backend>(
        &mut self,
        backend: &B,
        _: &mut Kept<B>,
        observer: &mut dyn Observer,
    ) -> Result<Outcome, BackendError> {
        let mut renderer = FrameRenderer::new(backend, self.frames, self.settings);
        let count = self.targets.len() as f64;
        while self.next < self.targets.len() {
            let start = Instant::now();
            let mut frame = renderer.frame(self.next)?;
            self.counted.times[0] += start.elapsed();
            let done = self.next as f64;
            let target = &self.targets[self.next];
            let file = match PictureFile::new(target, self.forms[self.next].clone()) {
                Ok(file) => file,
                Err(error) => return Ok(Err(not_written(target, &error))),
            };
            let mut tell = |share| observer.progress(Stage::Rendering, (done + share) / count);
            let written = render_file(&mut frame, file, &mut tell);
            if let Err(error) = written? {
                return Ok(Err(not_written(target, &error)));
            }
            self.counted.add(&frame.stats);
            self.next += 1;
        }
        observer.progress(Stage::Rendering, 1.0);
        self.counted.compiled = renderer.compiled();
        self.counted.compiling = backend.compiling();
        Ok(Ok(()))
    }
}

/// The statistics of all frames.
struct Report<'a> {
    backend: String,
    composing: Duration,
    skipped: usize,
    joined: &'a JoinedFrames,
    counted: &'a Counted,
}

impl Report<'_> {
    /// Kernels that a frame's structure changes, and how many of each there are.
    fn changing(&self) -> Vec<(&'static str, usize)> {
        self.joined.families().filter(|(_, count)| *count > 1).collect()
    }

    fn json(&self) -> serde_json::Value {
        let counted = self.counted;
        let changing: serde_json::Map<_, _> = self.changing().into_iter().map(|(k, n)| (k.into(), n.into())).collect();
        json!({
            "version": 1,
            "backend": self.backend,
            "frames": counted.rendered,
            "skipped": self.skipped,
            "kernels_compiled": counted.compiled,
            "structures": changing,
            "rays": counted.rays,
            "unfinished": counted.unfinished,
            "nan": counted.nan,
            "estimates": counted.estimates,
            "compose_seconds": self.composing.as_secs_f64(),
            "compile_seconds": counted.times[0].as_secs_f64(),
            "render_seconds": counted.times[1].as_secs_f64(),
        })
    }

    fn table(&self) -> String {
        let counted = self.counted;
        let mut text = format!("{:<20} {}\n", "back end", self.backend);
        let mut row = |name: &str, value: String| text.push_str(&format!("{name:<20} {value}\n"));
        row("frames", format!("{} rendered, {} kept", counted.rendered, self.skipped));
        let changing: Vec<String> = self.changing().iter().map(|(name, n)| format!("{n} of {name}")).collect();
        let why = match changing.is_empty() {
            true => "every frame has the same".to_string(),
            false => format!("the structure changes: {}", changing.join(", ")),
        };
        row("kernels compiled", format!("{} for all frames; {why}", counted.compiled));
        if let Some(compiling) = counted.compiling {
            row("compiling", super::stats::compiling(&compiling));
        }
        row("estimates per ray", format!("{:.1}", counted.estimates as f64 / counted.rays.max(1) as f64));
        row("unfinished rays", counted.unfinished.to_string());
        row("NaN rays", counted.nan.to_string());
        row("compose time", format!("{:.3} s", self.composing.as_secs_f64()));
        row("compile time", format!("{:.3} s", counted.times[0].as_secs_f64()));
        row("render time", format!("{:.3} s", counted.times[1].as_secs_f64()));
        text
    }
}

/// Renders a frame into its file; gives the time that the file took, or why it could not be written.
fn render_file<B: Backend>(
    renderer: &mut Renderer<B>,
    mut file: PictureFile,
    progress: &mut (dyn FnMut(f64) + Send),
) -> Result<std::io::Result<Duration>, BackendError> {
    // A file that cannot be written on stops the render, and then says why.
    let rows = 0..renderer.size().height;
    renderer.render_layers(rows, file.wanted(), &mut |rows| file.push(&rows).is_ok(), &mut |share| {
        progress(share);
        true
    })?;
    Ok(file.finish(None))
}

#[cfg(test)]
mod tests {
    use bulbfold::compose::{Plan, Reach};
    use bulbfold::engine::Estimates;
    use bulbfold::graph::{DifferenceStep, EstimateSettings};

    use super::{Plans, SweepArgs};

    /// A plan that its fudge tells from others.
    fn plan(fudge: f64) -> Plan {
        let (choices, warnings) = (Vec::new(), Vec::new());
        let difference_step = DifferenceStep::default();
        Plan {
            choices,
            bounding_radius: 1.0,
            reach: Reach::Stated,
            members: 0.0,
            fudge,
            least_step: 1.0,
            most_step: f64::INFINITY,
            stop_at: None,
            difference_step,
            warnings,
        }
    }

    #[test]
    fn views_of_one_set_measure_it_once() {
        for (moved, expected) in [
            (&["turn=0..90", "fov=40..50", "camera=1,2,3..3,2,1", "target=0,0,0..1,0,0", "up=0,0,1..0,1,0"][..], 1),
            (&["power=5..6"], 4),
            (&["turn=0..90", "power=5..6"], 4),
        ] {
            let ranges = moved.iter().map(|text| text.parse().expect("a range")).collect();
            let sweep = SweepArgs { ranges, ..Default::default() };
            let (mut plans, mut measured) = (Plans::of(&sweep, &Estimates::Shared(EstimateSettings::default())), 0);
            for _ in 0..4 {
                let plan = plans.next(|| {
                    measured += 1;
                    Ok(plan(f64::from(measured)))
                });
                assert!(plan.is_ok_and(|plan| plan.fudge == f64::from(measured)), "{moved:?}");
            }
            assert_eq!(measured, expected, "{moved:?}");
        }
    }
}

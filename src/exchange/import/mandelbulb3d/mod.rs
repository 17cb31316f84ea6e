//! Mandelbulb3D's parameters: text blocks (`Mandelbulb3Dv18{...}`), also inside other text, and its `.m3p` files.
//!
//! Read are the hybrid of the program's own formulas, iterations, bailout, Julia constant and camera, whose places in the record
//! are published in the program's source. Light, colour and everything else is not read, which one line says. What the shape
//! depends on and is not carried over is listed.

mod code;
mod formulas;

use self::code::{ADDON, FORMULAS, HEADER, Record};
use self::formulas::{Formula, KNOWN};
use super::place::norm;
use super::sequence::schedule;
use super::text::{GraphText, as_name, sequence};
use super::value::{written, written_vector};
use super::{Imported, Lost, LostKind};
use crate::diag::{Diagnostic, Diagnostics, SourceId, Sources, Span};
use crate::graph::Camera;

/// Newest version of the record that is known.
const NEWEST: i32 = 44;

/// Width of the picture's plane, in formula units, at a zoom of 1.
const PICTURE_WIDTH: f64 = 2.1345;

/// Iterations of a hybrid that are looked at to find its period.
const LOOKED_AT: usize = 1000;

/// Whether a text holds parameters of Mandelbulb3D.
pub fn is_in(text: &str) -> bool {
    code::block(text).is_some()
}

/// Makes a graph file of the parameters in `id`, whose file is called `name` and has these bytes. Returns nothing when `d` has
/// errors.
pub fn import(sources: &Sources, (id, name): (SourceId, &str), bytes: &[u8], d: &mut Diagnostics) -> Option<Imported> {
    let text = sources.text(id);
    let (record, title, span) = match code::block(text) {
        Some(block) => {
            let span = Span::new(id, block.start, block.letters_at);
            (decoded(&block, id, span, d)?, block.title, span)
        }
        None => (Record(bytes.to_vec()), None, sources.span_at(id, 1, 1)),
    };
    let mut reading = Reading { record, lost: Vec::new(), d, span };
    reading.check()?;
    let mut graph = reading.graph()?;
    let shown = title.filter(|title| !title.is_empty()).unwrap_or(name);
    graph.summary = format!("{}, with the parameters of {shown}.", graph.summary);
    graph.source = format!("{shown}, parameters of Mandelbulb3D");
    graph.comment = vec![format!("Imported from {name} (Mandelbulb3D).")];
    let what = "lights, colours, fog, shadows, depth of field and picture size".to_string();
    let why = "parameters of Mandelbulb3D's looks are not read".to_string();
    reading.lost.push(Lost { kind: LostKind::Look, what, why });
    let lost = std::mem::take(&mut reading.lost);
    (!d.has_errors()).then(|| Imported { text: graph.write(), lost, notes: Vec::new() })
}

/// The record of a text block.
fn decoded(block: &code::Block, id: SourceId, span: Span, d: &mut Diagnostics) -> Option<Record> {
    if block.version < 16.0 {
        let message = format!("these parameters of Mandelbulb3D are of version {}, before 16", block.version);
        d.push(
            Diagnostic::error(message)
                .label(span, "their record is another one")
                .help("open them in Mandelbulb3D 1.8 or later and copy the parameters again"),
        );
        return None;
    }
    match code::bytes(block.letters) {
        Err(at) => {
            let length = block.letters[at..].chars().next().map_or(1, char::len_utf8);
            let place = Span::new(id, block.letters_at + at, block.letters_at + at + length);
            d.push(
                Diagnostic::error("the block of Mandelbulb3D's parameters holds a sign that its code does not have")
                    .label(place, "the code has letters, digits, `.` and `/`")
                    .help("copy the block again, from `Mandelbulb3Dv` to `}`"),
            );
            None
        }
        Ok(bytes) if bytes.len() < HEADER => {
            let message = format!(
                "the block of Mandelbulb3D's parameters is cut off: {} of {HEADER} bytes are there",
                bytes.len()
            );
            d.push(
                Diagnostic::error(message)
                    .label(span, "begins here")
                    .help("copy the whole block again, from `Mandelbulb3Dv` to `}`: it has 15 lines or more"),
            );
            None
        }
        Ok(bytes) => Some(Record(bytes)),
    }
}

struct Reading<'a> {
    record: Record,
    lost: Vec<Lost>,
    d: &'a mut Diagnostics,
    span: Span,
}

impl Reading<'_> {
    fn fail<T>(&mut self, message: impl Into<String>, label: &str, help: impl Into<String>) -> Option<T> {
        self.d.push(Diagnostic::error(message).label(self.span, label).help(help));
        None
    }

    fn lose(&mut self, kind: LostKind, what: impl Into<String>, why: impl Into<String>) {
        self.lost.push(Lost { kind, what: what.into(), why: why.into() });
    }

    /// Whether the bytes are a record at all.
    fn check(&mut self) -> Option<()> {
        let version = self.record.whole(0);
        let sizes = [self.record.whole(4), self.record.whole(8)];
        let is_sized = sizes.iter().all(|size| (1..32768).contains(size));
        if self.record.0.len() < HEADER || !is_sized || !(1..=99).contains(&version) {
            let message = "these are no parameters of Mandelbulb3D that can be read";
            let help = "copy them as text in Mandelbulb3D and save that: `Mandelbulb3Dv18{` ... `}`";
            return self.fail(message, "version and picture size are missing at their place", help);
        }
        if version < 20 {
            let message = format!("these parameters of Mandelbulb3D have a record of version {version}, before 20");
            let help = "open them in Mandelbulb3D 1.8 or later and save them again";
            return self.fail(message, "the record is another one", help);
        }
        if version > NEWEST {
            let why = format!("newer than {NEWEST}, the newest that this reader knows");
            self.lose(LostKind::Unknown, format!("record of version {version}"), why);
        }
        Some(())
    }

    fn graph(&mut self) -> Option<GraphText> {
        let formulas = self.formulas()?;
        let mut graph = GraphText::default();
        let mut names = Vec::new();
        let mut unknown = Vec::new();
        for formula in &formulas {
            let name = format!("{}_{}", as_name(&formula.name), formula.place);
            match formula.steps() {
                Some((steps, caveat)) => {
                    graph.nodes.push((name.clone(), sequence(&steps)));
                    if let Some(caveat) = caveat {
                        self.lose(LostKind::Shape, formula.shown(), caveat);
                    }
                }
                None => unknown.push(formula.name.clone()),
            }
            if formula.iterations < 0 {
                let why = "iterations that do not count there count here";
                self.lose(LostKind::Shape, formula.shown(), why);
            }
            names.push(name);
        }
        if !unknown.is_empty() {
            let holds: Vec<String> = formulas.iter().map(Formula::shown).collect();
            let message = format!("Mandelbulb3D's formula {} has no counterpart here", unknown.join(" and "));
            let camera = self.camera().map_or(String::new(), |camera| {
                format!(
                    "; camera at {} looking at {}",
                    written_vector(&camera.position),
                    written_vector(&camera.target)
                )
            });
            let help = format!("formulas that have one: {KNOWN}; others can be written as steps, see docs/formulas.md");
            let label = format!("the hybrid is: {}{camera}", holds.join("; "));
            return self.fail(message, &label, help);
        }
        let node = schedule(&names, &self.turns(&formulas));
        graph.output = match node.strip_prefix('"').and_then(|rest| rest.strip_suffix('"')) {
            Some(wire) if !wire.contains('"') => wire.to_string(),
            _ => {
                graph.nodes.push(("loop".into(), node));
                "loop".into()
            }
        };
        self.settings(&mut graph);
        graph.camera = self.camera();
        if graph.camera.is_none() {
            self.lose(LostKind::Look, "camera", "its numbers make no view");
        }
        let shown: Vec<&str> = formulas.iter().map(|formula| formula.name.as_str()).collect();
        graph.summary = shown.join(" and ");
        Some(graph)
    }

    /// Formulas that run, in order. Hybrids that do not take turns are errors.
    fn formulas(&mut self) -> Option<Vec<Formula>> {
        let kind = self.record.byte(HEADER + 1) & 3;
        if !(16..=99).contains(&self.record.byte(HEADER)) {
            let help = "copy the whole block again, or save the parameters again in Mandelbulb3D";
            return self.fail("these parameters of Mandelbulb3D hold no formulas", "of this record", help);
        }
        if kind != 0 {
            let what = if kind == 1 { "an interpolation of two formulas" } else { "a combination of two distances" };
            let message = format!("Mandelbulb3D's hybrid is {what}, which is not imported");
            let help = "alternating hybrids are; set the hybrid's mode to alternate, or write Blend or Union by hand";
            return self.fail(message, "of these parameters", help);
        }
        let formulas: Vec<Formula> = (0..FORMULAS).filter_map(|i| Formula::read(&self.record, i)).collect();
        if formulas.is_empty() {
            return self.fail(
                "the hybrid of these parameters runs no formula",
                "of Mandelbulb3D",
                "give one iterations",
            );
        }
        Some(formulas)
    }

    /// Indices of the formulas that run at iterations 0, 1, 2 ...
    fn turns(&mut self, formulas: &[Formula]) -> Vec<usize> {
        // Older records keep the place to repeat from where newer ones keep a light.
        let is_old = self.record.whole(0) < 42;
        let repeat = if is_old { self.record.byte(343).min(5) } else { self.record.byte(HEADER + 5) >> 4 };
        let from = formulas.iter().rposition(|formula| formula.place <= usize::from(repeat) + 1).unwrap_or(0);
        let mut turns = Vec::new();
        let mut at = 0;
        while turns.len() < LOOKED_AT {
            let count = formulas[at].iterations.unsigned_abs().min(LOOKED_AT as u32);
            turns.extend(std::iter::repeat_n(at, count as usize));
            at = if at + 1 < formulas.len() { at + 1 } else { from };
        }
        turns.truncate(LOOKED_AT);
        turns
    }

    fn settings(&mut self, graph: &mut GraphText) {
        let julia = self.record.vector(191);
        let is_julia = self.record.byte(190) != 0 && julia.iter().all(|part| part.is_finite());
        graph.settings.push(match is_julia {
            true => format!("constant: Julia({})", written_vector(&julia.map(|part| part.clamp(-1e6, 1e6)))),
            false => "constant: Mandelbrot".into(),
        });
        let bailout = self.record.number(92);
        let bailout = if bailout.is_finite() { bailout.clamp(1e-3, 1e6) } else { 16.0 };
        graph.settings.push(format!("escape_radius: {}", written(bailout)));
        graph.settings.push(format!("max_iterations: {}", self.record.whole(12).clamp(1, 10_000)));
        let cut = self.record.byte(176) & 7;
        if cut != 0 {
            self.lose(LostKind::Shape, "cutting planes", "they are not carried over");
        }
        if self.record.byte(HEADER + 2) & 6 != 0 {
            self.lose(LostKind::Shape, "inside rendering", "the set is drawn from outside");
        }
        if self.record.byte(148) & 3 != 0 {
            self.lose(LostKind::Shape, "camera optic", "planar and panoramic views are drawn through a flat lens");
        }
        if self.record.0.len() > HEADER + ADDON + 3 {
            let what = format!("{} bytes behind the formulas", self.record.0.len() - HEADER - ADDON);
            self.lose(LostKind::Unknown, what, "");
        }
    }

    /// The camera: rows of the matrix point right, down and ahead; rays start on a plane, where a pixel has the step's width.
    fn camera(&self) -> Option<Camera> {
        let record = &self.record;
        let rows: [[f64; 3]; 3] = match record.whole(0) > 43 && record.byte(18) & 1 != 0 {
            true => turn_of([record.number(246), record.number(254), record.number(262), record.number(270)]),
            false => std::array::from_fn(|row| record.vector(246 + 24 * row)),
        };
        let unit = |v: [f64; 3]| v.map(|part| part / norm(v));
        let [_, down, ahead] = rows.map(unit);
        let (middle, start) = (record.vector(36), record.number(20));
        // The program computes the step anew from the zoom (CalcStepWidth).
        let step = PICTURE_WIDTH / (record.number(84) * f64::from(record.whole(4)));
        let fov = record.number(108).clamp(1.0, 170.0).to_radians();
        let half = 0.5 * f64::from(record.whole(8)) * step;
        // The plane lies before the eye by as much as makes the rays through its edge meet.
        let back = half / (0.5 * fov).tan();
        let along = start - middle[2] - back;
        let position: [f64; 3] = std::array::from_fn(|i| middle[i] + along * ahead[i]);
        let distance = if along < -1e-12 { -along } else { 1.0 };
        let target = std::array::from_fn(|i| position[i] + distance * ahead[i]);
        let camera = Camera::new(position, target, down.map(|part| -part), fov);
        let parts = [camera.position, camera.target, camera.up].concat();
        (step > 0.0 && fov.is_finite() && parts.iter().all(|part| part.is_finite() && part.abs() < 1e6))
            .then_some(camera)
    }
}

/// Rows of the turn that a quaternion `(x, y, z, w)` makes.
fn turn_of([x, y, z, w]: [f64; 4]) -> [[f64; 3]; 3] {
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)],
        [2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)],
        [2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

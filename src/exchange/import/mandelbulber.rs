//! Mandelbulber 2's settings files (`.fract`).

use super::ask::Ask;
use super::looks::{about, shortened};
use super::migrate::migrate;
use super::objects::has_primitives;
use super::sequence::{Mode, Slot};
use super::settings::{Entry, Section, Settings};
use super::table::{Row, Table};
use super::text::{GraphText, as_name};
use super::tree::{self, Node};
use super::value::written;
use super::{Imported, Lost, LostKind, view};
use crate::diag::{Diagnostic, Diagnostics, SourceId, Sources};

/// Makes a graph file of the settings in `id`, whose file is called `name`. Returns nothing when `d` has errors.
pub fn import(sources: &Sources, id: SourceId, name: &str, d: &mut Diagnostics) -> Option<Imported> {
    let mut settings = Settings::read(sources, id, d)?;
    migrate(&mut settings, d);
    let tree = tree::read(&mut settings, d);
    if d.has_errors() {
        return None;
    }
    let table = Table::mandelbulber();
    let main = settings.section("main_parameters");
    let mut reading = Reading { main, settings: &settings, tree, lost: Vec::new(), d };
    let graph = reading.graph(&table, name)?;
    let mut lost = std::mem::take(&mut reading.lost);
    lost.extend(reading.left_in_main());
    lost.extend(settings.others.iter().filter(|section| *section != "description").map(|section| Lost {
        kind: LostKind::Look,
        what: format!("[{section}]"),
        why: "animations are not read".into(),
    }));
    (!d.has_errors()).then(|| Imported { text: graph.write(), lost, notes: Vec::new() })
}

/// A file while it is being read.
pub(super) struct Reading<'a> {
    /// The main section.
    pub main: Section,
    settings: &'a Settings,
    /// The tree of objects of a new file.
    pub tree: Option<Node>,
    /// What was not carried over.
    pub lost: Vec<Lost>,
    /// Errors.
    pub d: &'a mut Diagnostics,
}

impl Reading<'_> {
    fn graph(&mut self, table: &Table, name: &str) -> Option<GraphText> {
        let mode = self.mode();
        let is_mirrored = self.switch("legacy_coordinate_system");
        let slots = self.slots(table, mode)?;
        let mut graph = GraphText::default();
        for slot in &slots {
            let of = slot.row.name.as_str();
            let params = slot.expanded.params.iter();
            graph.params.extend(params.map(|(name, value)| (name.clone(), *value, format!("{of}: {}", spoken(name)))));
            graph.nodes.push((slot.name.clone(), slot.node()));
        }
        let estimate = self.estimate(&slots, mode);
        let (node, has_no_end) = self.field(&slots, (mode, &estimate), is_mirrored, &mut graph);
        graph.output = match node.strip_prefix('"').and_then(|rest| rest.strip_suffix('"')) {
            Some(wire) if !wire.contains('"') => wire.to_string(),
            _ => {
                graph.nodes.push(("scene".into(), node));
                "scene".into()
            }
        };
        let far = self.main.number("view_distance_max", 50.0, self.d).clamp(1.0, 1e5);
        // What orbits end at goes on without end: cells of a group, or copies of a fold's.
        if has_no_end || slots.iter().any(|slot| slot.expanded.end.is_some()) {
            graph.settings.push(format!("bounding_radius: {}", written(far)));
        } else if let Some(radius) = self.reach(&slots, mode) {
            graph.settings.push(format!("bounding_radius: {}", written(radius)));
        }
        graph.settings.push(format!("estimate: ({estimate})"));
        let version = &self.settings.version;
        let camera = view::camera(&self.main, (version, is_mirrored), &mut self.lost, self.d);
        graph.look = view::look(&self.main, (version, &camera, is_mirrored), &mut self.lost, self.d);
        graph.camera = Some(camera);
        let formulas: Vec<&str> = slots.iter().map(|slot| slot.row.name.as_str()).collect();
        let version = if version.text.is_empty() { "2" } else { &version.text };
        graph.summary = format!("{}, with the settings of {name}.", formulas.join(" and "));
        graph.source = format!("{name}, settings of Mandelbulber {version}");
        graph.comment = vec![format!("Imported from {name} (Mandelbulber {version}).")];
        let main = self.main.clone();
        self.scripts(&main);
        Some(graph)
    }

    /// How the formulas work together.
    fn mode(&mut self) -> Mode {
        let switches = (self.switch("hybrid_fractal_enable"), self.switch("boolean_operators"));
        match (&self.tree, switches) {
            (Some(Node::Formula(_)), _) => Mode::Single,
            (Some(Node::Hybrid(..)), _) => Mode::Hybrid,
            (Some(_), _) | (_, (_, true)) => Mode::Boolean,
            (_, (true, _)) => Mode::Hybrid,
            _ => Mode::Single,
        }
    }

    /// Lists values of a section that scripts give frame by frame.
    fn scripts(&mut self, section: &Section) {
        let lost = |entry: &Entry| Lost {
            kind: LostKind::Shape,
            what: shortened(&format!("{} {};{}", entry.name, entry.value, entry.script)),
            why: format!("scripts are not run; the value is {}", entry.value),
        };
        self.lost.extend(section.scripted().map(lost));
    }

    fn switch(&mut self, name: &str) -> bool {
        self.main.switch(name, false, self.d)
    }

    /// The slots that are used. An unknown formula is an error.
    fn slots<'t>(&mut self, table: &'t Table, mode: Mode) -> Option<Vec<Slot<'t>>> {
        let mut slots: Vec<Slot> = Vec::new();
        let mut rows: Vec<(usize, &Row)> = Vec::new();
        let of_tree = self.tree.as_ref().map(Node::formulas);
        let is_tree = of_tree.is_some();
        let numbers = of_tree.unwrap_or_else(|| (1..=if mode == Mode::Single { 1 } else { 9 }).collect());
        for number in numbers {
            let enabled = self.main.switch(&format!("fractal_enable_{number}"), true, self.d);
            let default = if number == 1 || is_tree { 2.0 } else { 0.0 };
            let name = format!("formula_{number}");
            let id = self.main.number(&name, default, self.d);
            if id == 0.0 || (mode != Mode::Single && !enabled && !is_tree) {
                continue;
            }
            match table.by_id(id as u32) {
                Some(row) => rows.push((number, row)),
                None => self.unknown(table, &name, id),
            }
        }
        let draws_primitives = is_tree && mode == Mode::Boolean;
        if rows.is_empty() && !draws_primitives && !self.d.has_errors() {
            self.d.push(Diagnostic::error("the settings use no formula").help("set `formula_1` to one"));
        }
        if self.d.has_errors() {
            return None;
        }
        for (number, row) in &rows {
            let suffix = if rows.len() > 1 { format!("_{number}") } else { String::new() };
            let section = self.settings.section(&format!("fractal_{number}"));
            let expanded = table.expand(row, &suffix, &section, self.d);
            let caveats = expanded.caveats.iter();
            self.lost.extend(caveats.map(|caveat| Lost {
                kind: LostKind::Shape,
                what: format!("{} (slot {number})", row.name),
                why: caveat.clone(),
            }));
            self.scripts(&section);
            self.left_in_slot(*number, row, &section);
            let own = is_tree || mode == Mode::Boolean;
            let mut slot = Slot::new((*number, row), expanded, (&self.main, mode, own), &mut self.lost, self.d);
            if is_tree {
                slot.place = slots.len() + 1;
            }
            slot.name = format!("{}{suffix}", as_name(&row.name));
            slots.push(slot);
        }
        for section in &self.settings.sections {
            let number = section.name.strip_prefix("fractal_").and_then(|number| number.parse::<usize>().ok());
            let is_used = number.is_none_or(|number| rows.iter().any(|(used, _)| *used == number));
            if !is_used && !section.entries.is_empty() {
                let what = format!("[{}]", section.name);
                let why = format!("{} settings of a slot that is not used", section.entries.len());
                self.lost.push(Lost { kind: LostKind::Unread, what, why });
            }
        }
        Some(slots)
    }

    fn unknown(&mut self, table: &Table, name: &str, id: f64) {
        let mut diagnostic = Diagnostic::error(format!("Mandelbulber's formula number {id} has no counterpart here"));
        if let Some(entry) = self.main.raw(name) {
            diagnostic = diagnostic.label(entry.span, "this formula");
        }
        let known: Vec<String> = table.formulas.iter().map(|row| format!("{} {}", row.id, row.name)).collect();
        self.d.push(diagnostic.help(format!("those that have one: {}", known.join(", "))));
    }

    /// Escape radius of a formula whose own is `default`.
    pub(super) fn bailout(&mut self, default: f64) -> f64 {
        let given = self.main.number("bailout", 100.0, self.d);
        if self.main.switch("use_default_bailout", true, self.d) { default } else { given.clamp(1e-3, 1e6) }
    }

    /// The fields of the estimate: rays stop where it is below a pixel, as the program's do, and it is the running
    /// derivative's, as there, where all steps have a rule for that and there is no hybrid, for which it takes differences.
    pub(super) fn estimate<'s>(&mut self, slots: impl IntoIterator<Item = &'s Slot<'s>>, mode: Mode) -> String {
        let detail = self.main.number("detail_level", 1.0, self.d).max(1e-2);
        let mut fields = format!("stop_at: {}", written((1.0 / detail).clamp(1e-3, 100.0)));
        if mode != Mode::Hybrid && slots.into_iter().all(|slot| !slot.row.differences) {
            fields.insert_str(0, "method: \"scalar\", ");
        }
        let factor = self.main.number("DE_factor", 1.0, self.d).clamp(1e-3, 1.0);
        if factor < 1.0 {
            fields.push_str(&format!(", fudge: {}", written(factor)));
        }
        fields
    }

    /// Radius of a ball around everything, where the formulas are known to hold it. Measuring would not see hairs that are
    /// thinner than any number, which rays that stop at an estimate show.
    fn reach(&mut self, slots: &[Slot], mode: Mode) -> Option<f64> {
        let places =
            ["fractal_position", "fractal_rotation", "formula_position_", "formula_rotation_", "formula_scale_"];
        let others = self.main.entries.iter().any(|entry| {
            places.iter().any(|place| entry.name.starts_with(place))
                && (self.tree.is_some() || entry.name.starts_with("fractal"))
        });
        let is_alone = mode != Mode::Boolean && !others && !has_primitives(&self.main);
        let of = |slot: &Slot| slot.expanded.reach.filter(|_| slot.constant == "Mandelbrot" && is_alone);
        slots.iter().map(of).try_fold(0.0, |most: f64, radius| Some(most.max(radius?)))
    }

    /// Lines of a used slot that its row has not asked for.
    fn left_in_slot(&mut self, number: usize, row: &Row, section: &Section) {
        for entry in section.unasked() {
            let kind = if row.ignores(&entry.name) { LostKind::Shape } else { LostKind::Unread };
            let what = format!("{} {}", entry.name, entry.value);
            let why = if kind == LostKind::Shape { format!("of {} (slot {number})", row.name) } else { String::new() };
            self.lost.push(Lost { kind, what, why });
        }
    }

    /// Lines of the main section that nothing has asked for.
    fn left_in_main(&self) -> Vec<Lost> {
        let lost = |entry: &Entry| Lost {
            kind: about(&entry.name),
            what: shortened(&format!("{} {}", entry.name, entry.value)),
            why: if entry.broken.is_some() { "the line cannot be read".into() } else { String::new() },
        };
        self.main.unasked().map(lost).collect()
    }
}

/// A parameter's name as words, without the number of its slot.
fn spoken(name: &str) -> String {
    name.trim_end_matches(|c: char| c.is_ascii_digit()).trim_end_matches('_').replace('_', " ")
}

//! Mandelbulber 2's settings files (`.fract`).

use super::ask::Ask;
use super::objects::{has_primitives, joined, limited, placed, with_primitives};
use super::sequence::{Mode, Slot, schedule, turns};
use super::settings::{Section, Settings, version};
use super::table::{Row, Table};
use super::text::{GraphText, as_name};
use super::value::written;
use super::{Imported, Lost, LostKind, view};
use crate::diag::{Diagnostic, Diagnostics, SourceId, Sources};

/// Settings of the main section that the shape depends on, or beginnings of their names.
const SHAPE: &[&str] = &[
    "repeat",
    "box_folding",
    "spherical_folding",
    "fractal_",
    "formula_",
    "julia",
    "limit",
    "iteration_threshold_mode",
    "constant_DE_threshold",
    "DE_thresh",
    "delta_DE",
    "linear_DE",
    "interior_mode",
    "minN",
    "initial_waxis",
    "perspective_type",
    "sweet_spot",
    "primitive_",
    "all_primitives",
    "check_for_bailout",
    "dont_add_c",
    "view_distance_min",
    "boolean_",
];

/// Beginnings of such names that are about looks all the same.
const NOT_SHAPE: &[&str] = &["formula_material_id", "julia_preview"];

/// Parts of the names of primitives' settings that are about looks.
const PRIMITIVE_LOOK: &[&str] = &["_color", "_reflection", "_material_id", "_texture"];

/// Makes a graph file of the settings in `id`, whose file is called `name`. Returns nothing when `d` has errors.
pub fn import(sources: &Sources, id: SourceId, name: &str, d: &mut Diagnostics) -> Option<Imported> {
    let settings = Settings::read(sources, id, d)?;
    let table = Table::mandelbulber();
    let mut reading = Reading { main: settings.section("main_parameters"), settings: &settings, lost: Vec::new(), d };
    let graph = reading.graph(&table, name, version(sources.text(id)))?;
    let mut lost = std::mem::take(&mut reading.lost);
    lost.extend(reading.left_in_main());
    lost.extend(settings.others.iter().filter(|section| *section != "description").map(|section| Lost {
        kind: LostKind::Look,
        what: format!("[{section}]"),
        why: "animations are not read".into(),
    }));
    (!d.has_errors()).then(|| Imported { text: graph.write(), lost })
}

/// A file while it is being read.
struct Reading<'a> {
    main: Section,
    settings: &'a Settings,
    lost: Vec<Lost>,
    d: &'a mut Diagnostics,
}

impl Reading<'_> {
    fn graph(&mut self, table: &Table, name: &str, version: &str) -> Option<GraphText> {
        let mode = match (self.switch("hybrid_fractal_enable"), self.switch("boolean_operators")) {
            (_, true) => Mode::Boolean,
            (true, _) => Mode::Hybrid,
            _ => Mode::Single,
        };
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
        if has_no_end {
            graph.settings.push(format!("bounding_radius: {}", written(far)));
        } else if let Some(radius) = self.reach(&slots, mode) {
            graph.settings.push(format!("bounding_radius: {}", written(radius)));
        }
        graph.settings.push(format!("estimate: ({estimate})"));
        let camera = view::camera(&self.main, is_mirrored, self.d);
        graph.look = view::look(&self.main, &camera, is_mirrored, self.d);
        graph.camera = Some(camera);
        let formulas: Vec<&str> = slots.iter().map(|slot| slot.row.name.as_str()).collect();
        graph.summary = format!("{}, with the settings of {name}.", formulas.join(" and "));
        graph.source = format!("{name}, settings of Mandelbulber {version}");
        graph.comment = vec![format!("Imported from {name} (Mandelbulber {version}).")];
        Some(graph)
    }

    fn switch(&mut self, name: &str) -> bool {
        self.main.switch(name, false, self.d)
    }

    /// The slots that are used. An unknown formula is an error.
    fn slots<'t>(&mut self, table: &'t Table, mode: Mode) -> Option<Vec<Slot<'t>>> {
        let mut slots: Vec<Slot> = Vec::new();
        let mut rows: Vec<(usize, &Row)> = Vec::new();
        for number in 1..=if mode == Mode::Single { 1 } else { 9 } {
            let enabled = self.main.switch(&format!("fractal_enable_{number}"), true, self.d);
            let default = if number == 1 { 2.0 } else { 0.0 };
            let name = format!("formula_{number}");
            let id = self.main.number(&name, default, self.d);
            if id == 0.0 || (mode != Mode::Single && !enabled) {
                continue;
            }
            match table.by_id(id as u32) {
                Some(row) => rows.push((number, row)),
                None => self.unknown(table, &name, id),
            }
        }
        if rows.is_empty() && !self.d.has_errors() {
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
            self.left_in_slot(*number, row, &section);
            let mut slot = Slot::new((*number, row), expanded, (&self.main, mode), &mut self.lost, self.d);
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

    /// The node of everything that is drawn, and whether it has no end. What orbits share goes to the file's settings.
    fn field(
        &mut self,
        slots: &[Slot],
        (mode, estimate): (Mode, &str),
        is_mirrored: bool,
        graph: &mut GraphText,
    ) -> (String, bool) {
        let pre = is_mirrored
            .then(|| "pre: [linear(matrix: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])]".to_string());
        graph.settings.extend(pre.clone());
        let limit = self.main.number("N", 250.0, self.d).clamp(1.0, 10_000.0);
        graph.settings.push(format!("max_iterations: {limit}"));
        let node = match mode {
            Mode::Boolean => {
                let nodes: Vec<(usize, String)> = slots
                    .iter()
                    .map(|slot| (slot.number, self.object(slot, (limit, estimate), pre.as_deref(), is_mirrored)))
                    .collect();
                joined(&nodes, &self.main, self.d)
            }
            _ => {
                let radius = slots.iter().map(|slot| slot.expanded.bailout).fold(0.0, f64::max);
                let radius = self.bailout(radius);
                graph.settings.push(format!("escape_radius: {}", written(radius)));
                self.loop_of(slots, limit as u32, graph)
            }
        };
        let position = self.main.vector("fractal_position", [0.0; 3], self.d);
        let degrees = self.main.vector("fractal_rotation", [0.0; 3], self.d);
        let node = placed(&node, position, degrees, 1.0, is_mirrored);
        let (node, has_no_end) = with_primitives(node, &self.main, is_mirrored, &mut self.lost, self.d);
        (limited(node, &self.main, is_mirrored, self.d), has_no_end)
    }

    /// The loop of one formula or of several in turn.
    fn loop_of(&mut self, slots: &[Slot], limit: u32, graph: &mut GraphText) -> String {
        let common = &slots[0].constant;
        graph.settings.push(format!("constant: {common}"));
        let mut names = Vec::new();
        for slot in slots {
            names.push(slot.name.clone());
            if slot.constant != *common {
                let name = format!("{}_item", slot.name);
                graph.nodes.push((name.clone(), format!("Item(of: \"{}\", constant: {})", slot.name, slot.constant)));
                names.pop();
                names.push(name);
            }
        }
        let repeat_from = self.main.number("repeat_from", 1.0, self.d).clamp(1.0, 9.0) as usize;
        let node = match slots.len() {
            1 => format!("\"{}\"", names[0]),
            _ => schedule(&names, &turns(slots, repeat_from, limit)),
        };
        match node.starts_with('"') {
            true => node,
            false => {
                graph.nodes.push(("loop".into(), node));
                "\"loop\"".into()
            }
        }
    }

    /// A formula that is an object of its own.
    fn object(&mut self, slot: &Slot, (limit, estimate): (f64, &str), pre: Option<&str>, is_mirrored: bool) -> String {
        let of = |name: &str| format!("{name}_{}", slot.number);
        let radius = self.bailout(slot.expanded.bailout);
        let pre = pre.map(|pre| format!(", {pre}")).unwrap_or_default();
        let orbit = format!(
            "Orbit(of: \"{}\", constant: {}, max_iterations: {limit}, escape_radius: {}, estimate: ({estimate}){pre})",
            slot.name,
            slot.constant,
            written(radius)
        );
        let position = self.main.vector(&of("formula_position"), [0.0; 3], self.d);
        let degrees = self.main.vector(&of("formula_rotation"), [0.0; 3], self.d);
        let scale = self.main.number(&of("formula_scale"), 1.0, self.d);
        let scale = if scale > 0.0 { scale } else { 1.0 };
        placed(&orbit, position, degrees, scale, is_mirrored)
    }

    fn bailout(&mut self, default: f64) -> f64 {
        let given = self.main.number("bailout", 100.0, self.d);
        if self.main.switch("use_default_bailout", true, self.d) { default } else { given.clamp(1e-3, 1e6) }
    }

    /// The fields of the estimate: rays stop where it is below a pixel, as the program's do, and it is the running
    /// derivative's, as there, where all steps have a rule for that and there is no hybrid, for which it takes differences.
    fn estimate(&mut self, slots: &[Slot], mode: Mode) -> String {
        let detail = self.main.number("detail_level", 1.0, self.d).max(1e-2);
        let mut fields = format!("stop_at: {}", written((1.0 / detail).clamp(1e-3, 100.0)));
        if mode != Mode::Hybrid && slots.iter().all(|slot| !slot.row.differences) {
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
        let others = ["fractal_position", "fractal_rotation"].iter().any(|name| self.main.has(name));
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
        let kind = |name: &str| {
            let begins = |list: &[&str]| list.iter().any(|beginning| name.starts_with(beginning));
            let is_look = begins(NOT_SHAPE) || PRIMITIVE_LOOK.iter().any(|part| name.contains(part));
            if begins(SHAPE) && !is_look { LostKind::Shape } else { LostKind::Look }
        };
        let what = |name: &str, value: &str| match value.char_indices().nth(60) {
            Some((end, _)) => format!("{name} {}...", &value[..end]),
            None => format!("{name} {value}"),
        };
        let lost = |entry: &super::settings::Entry| Lost {
            kind: kind(&entry.name),
            what: what(&entry.name, &entry.value),
            why: String::new(),
        };
        self.main.unasked().map(lost).collect()
    }
}

/// A parameter's name as words, without the number of its slot.
fn spoken(name: &str) -> String {
    name.trim_end_matches(|c: char| c.is_ascii_digit()).trim_end_matches('_').replace('_', " ")
}

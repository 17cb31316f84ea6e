//! Mandelbulber's formulas, alone, in turn or as objects of a scene, as nodes of a graph.

use super::ask::Ask;
use super::levels;
use super::mandelbulber::Reading;
use super::objects::{join, joined, limited, placed, primitive, with_primitives};
use super::sequence::{Mode, Slot, schedule, turns};
use super::text::GraphText;
use super::tree::{Join, Node};
use super::value::written;

/// What all orbits of a file share.
struct Common {
    estimate: String,
    /// The mirror in which old pictures stand, as a setting of an orbit.
    pre: Option<String>,
    is_mirrored: bool,
}

impl Common {
    /// The settings of an orbit except its iterations.
    fn fields(&self, slot: &Slot, estimate: &str, radius: f64) -> String {
        let pre = self.pre.as_ref().map(|pre| format!(", {pre}")).unwrap_or_default();
        // A threshold is one of rays: it stands beside the output alone.
        let fields = estimate.split(", ").filter(|field| !field.starts_with("stop_at"));
        let estimate = fields.collect::<Vec<_>>().join(", ");
        format!("constant: {}, escape_radius: {}, estimate: ({estimate}){pre}", slot.constant, written(radius))
    }
}

impl Reading<'_> {
    /// The node of everything that is drawn, and whether it has no end. What orbits share goes to the file's settings.
    pub(super) fn field(
        &mut self,
        slots: &[Slot],
        (mode, estimate): (Mode, &str),
        is_mirrored: bool,
        graph: &mut GraphText,
    ) -> (String, bool) {
        let pre = levels::pre(slots, mode == Mode::Single, is_mirrored, &mut self.lost);
        graph.settings.extend(pre.clone());
        let limit = slots.iter().map(|slot| self.limit(slot)).fold(1.0, f64::max);
        graph.settings.push(format!("max_iterations: {limit}"));
        let common = Common { estimate: estimate.to_string(), pre, is_mirrored };
        let tree = self.tree.clone();
        let mut has_no_end = false;
        let node = match (mode, &tree) {
            (Mode::Boolean, Some(tree)) => {
                let (node, is_endless) = self.objects(tree, slots, &common, graph);
                has_no_end = is_endless;
                node.unwrap_or_else(|| "Sphere(radius: 0.0)".into())
            }
            (Mode::Boolean, None) => {
                let nodes: Vec<(usize, String)> =
                    slots.iter().map(|slot| (slot.number, self.object(slot, &common))).collect();
                joined(&nodes, &self.main, self.d)
            }
            _ => {
                let radius = slots.iter().map(|slot| slot.expanded.bailout).fold(0.0, f64::max);
                let radius = self.bailout(radius);
                graph.settings.push(format!("escape_radius: {}", written(radius)));
                let slots: Vec<&Slot> = slots.iter().collect();
                graph.settings.push(format!("constant: {}", slots[0].constant));
                let turns = self.turns(&slots, limit as u32);
                let node = self.loop_of(&slots, &turns, "loop", graph);
                let fields = common.fields(slots[0], &common.estimate, radius);
                let node = levels::node(&slots, &turns, (&node, &fields), &mut self.lost).unwrap_or_else(|| {
                    let end = slots.iter().find_map(|slot| slot.expanded.end.as_ref());
                    graph.settings.extend(end.map(|end| format!("end: {end}")));
                    node
                });
                match &tree {
                    Some(Node::Hybrid(_, prefix)) => self.placed_as(&node, prefix, "", is_mirrored),
                    Some(_) => self.placed_as(&node, "formula", &format!("_{}", slots[0].number), is_mirrored),
                    None => node,
                }
            }
        };
        let node = self.placed_as(&node, "fractal", "", is_mirrored);
        if tree.is_some() {
            return (limited(node, &self.main, is_mirrored, self.d), has_no_end);
        }
        let (node, has_no_end) = with_primitives(node, &self.main, is_mirrored, &mut self.lost, self.d);
        (limited(node, &self.main, is_mirrored, self.d), has_no_end)
    }

    /// Iteration limit of a formula.
    fn limit(&mut self, slot: &Slot) -> f64 {
        let common = self.main.number("N", 250.0, self.d);
        self.main.number(&format!("formula_maxiter_{}", slot.number), common, self.d).round().clamp(1.0, 10_000.0)
    }

    /// The slots that run at iterations 0, 1, 2 ...
    fn turns(&mut self, slots: &[&Slot], limit: u32) -> Vec<usize> {
        let repeat_from = self.main.number("repeat_from", 1.0, self.d).clamp(1.0, 9.0) as usize;
        match slots.len() {
            1 => vec![0; limit as usize],
            _ => turns(slots, repeat_from, limit),
        }
    }

    /// The loop of one formula or of several in turn, as the name of a node. Formulas with a constant that is not the first
    /// one's say so.
    fn loop_of(&mut self, slots: &[&Slot], turns: &[usize], name: &str, graph: &mut GraphText) -> String {
        let common = &slots[0].constant;
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
        let node = match slots.len() {
            1 => format!("\"{}\"", names[0]),
            _ => schedule(&names, turns),
        };
        match node.starts_with('"') {
            true => node,
            false => {
                graph.nodes.push((name.to_string(), node));
                format!("\"{name}\"")
            }
        }
    }

    /// A node where settings such as `formula_position_2` put it.
    fn placed_as(&mut self, node: &str, prefix: &str, suffix: &str, is_mirrored: bool) -> String {
        let of = |name: &str| format!("{prefix}_{name}{suffix}");
        let position = self.main.vector(&of("position"), [0.0; 3], self.d);
        let degrees = self.main.vector(&of("rotation"), [0.0; 3], self.d);
        let scale = if prefix == "fractal" { 1.0 } else { self.main.number(&of("scale"), 1.0, self.d) };
        let scale = if scale > 0.0 { scale } else { 1.0 };
        placed(node, position, degrees, scale, is_mirrored)
    }

    /// A formula that is an object of its own.
    fn object(&mut self, slot: &Slot, common: &Common) -> String {
        let limit = self.limit(slot);
        let turns = vec![0; limit as usize];
        let orbit = self.orbit(&format!("\"{}\"", slot.name), &[slot], &turns, common);
        self.placed_as(&orbit, "formula", &format!("_{}", slot.number), common.is_mirrored)
    }

    fn orbit(&mut self, of: &str, slots: &[&Slot], turns: &[usize], common: &Common) -> String {
        let radius = slots.iter().map(|slot| slot.expanded.bailout).fold(0.0, f64::max);
        let radius = self.bailout(radius);
        let estimate = match slots.len() {
            1 => common.estimate.clone(),
            _ => self.estimate(slots.iter().copied(), Mode::Hybrid),
        };
        let fields = common.fields(slots[0], &estimate, radius);
        levels::node(slots, turns, (of, &fields), &mut self.lost).unwrap_or_else(|| {
            let end = slots.iter().find_map(|slot| slot.expanded.end.as_ref());
            let end = end.map(|end| format!(", end: {end}")).unwrap_or_default();
            format!("Orbit(of: {of}, max_iterations: {}, {fields}{end})", turns.len())
        })
    }

    /// An object of the tree with all below it, and whether it has no end; no node where nothing of it has a counterpart.
    fn objects(
        &mut self,
        tree: &Node,
        slots: &[Slot],
        common: &Common,
        graph: &mut GraphText,
    ) -> (Option<String>, bool) {
        let slot = |number: &usize| slots.iter().find(|slot| slot.number == *number);
        match tree {
            Node::Formula(number) => (slot(number).map(|slot| self.object(slot, common)), false),
            Node::Hybrid(numbers, prefix) => {
                let members: Vec<&Slot> = numbers.iter().filter_map(slot).collect();
                if members.is_empty() {
                    return (None, false);
                }
                let limit = members.iter().map(|slot| self.limit(slot)).fold(1.0, f64::max);
                let turns = self.turns(&members, limit as u32);
                let node = self.loop_of(&members, &turns, &format!("loop_{prefix}"), graph);
                let orbit = self.orbit(&node, &members, &turns, common);
                (Some(self.placed_as(&orbit, prefix, "", common.is_mirrored)), false)
            }
            Node::Primitive(name, prefix) => {
                if !self.main.switch(&format!("{name}_enabled"), true, self.d) {
                    return (None, false);
                }
                let Some((shape, is_endless)) = primitive(name, &self.main, common.is_mirrored, &mut self.lost, self.d)
                else {
                    return (None, false);
                };
                (Some(self.placed_as(&shape, prefix, "", common.is_mirrored)), is_endless)
            }
            Node::Join(operator, children, prefix) => {
                let code = match operator {
                    Join::And => 0.0,
                    Join::Or => 1.0,
                    Join::Without => 2.0,
                };
                let (mut node, mut has_no_end) = (None::<String>, false);
                for child in children {
                    let (next, is_endless) = self.objects(child, slots, common, graph);
                    has_no_end |= is_endless;
                    node = match (node, next) {
                        (Some(node), Some(next)) => Some(join(&node, &next, code)),
                        (node, next) => node.or(next),
                    };
                }
                (node.map(|node| self.placed_as(&node, prefix, "", common.is_mirrored)), has_no_end)
            }
        }
    }
}

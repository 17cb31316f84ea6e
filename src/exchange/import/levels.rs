//! Mandelbulber's dIFS formulas: shapes that are looked up along the orbit, joined to their union.

use super::sequence::Slot;
use super::table::ExpandedLevel;
use super::{Lost, LostKind};

/// More separate stretches of levels than this would make rays crawl.
const MOST_RUNS: usize = 12;

/// The node of all shapes that the slots look up in their turns; none if no slot has one. `turns` says which slot runs at
/// each iteration, `of` is the map's wire, `fields` are what the orbits have in common.
pub fn node(slots: &[&Slot], turns: &[usize], (of, fields): (&str, &str), lost: &mut Vec<Lost>) -> Option<String> {
    let mut nodes = Vec::new();
    for (index, slot) in slots.iter().enumerate() {
        for level in &slot.expanded.levels {
            nodes.extend(of_slot(index, level, turns, (of, fields), slot, lost));
        }
    }
    match nodes.len() {
        0 => None,
        1 => nodes.pop(),
        _ => Some(format!("Union([{}])", nodes.join(", "))),
    }
}

/// One shape of one slot: a node for each stretch of iterations in a row.
fn of_slot(
    index: usize,
    level: &ExpandedLevel,
    turns: &[usize],
    (of, fields): (&str, &str),
    slot: &Slot,
    lost: &mut Vec<Lost>,
) -> Vec<String> {
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for (i, turn) in turns.iter().enumerate() {
        if *turn != index || (i as f64) < level.range.0 || i as f64 >= level.range.1 {
            continue;
        }
        match runs.last_mut() {
            Some((_, end)) if *end == i => *end += 1,
            _ => runs.push((i, i + 1)),
        }
    }
    if runs.len() > MOST_RUNS {
        let what = format!("{} (slot {})", slot.row.name, slot.number);
        let why = format!("its shape is looked up in its first {MOST_RUNS} turns of {}", runs.len());
        lost.push(Lost { kind: LostKind::Shape, what, why });
        runs.truncate(MOST_RUNS);
    }
    let behind = usize::from(level.behind);
    let node = |(from, to): &(usize, usize)| {
        let shape = &level.shape;
        format!("Levels(of: {of}, shape: {shape}, from: {}, to: {}, {fields})", from + behind, to + behind)
    };
    runs.iter().map(node).collect()
}

/// What is done to the start point, as a setting of an orbit: a mirror, and what a formula that is `alone` does to it.
pub fn pre(slots: &[Slot], alone: bool, is_mirrored: bool, lost: &mut Vec<Lost>) -> Option<String> {
    let mirror = "linear(matrix: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])";
    let mut maps: Vec<&str> = if is_mirrored { vec![mirror] } else { Vec::new() };
    for slot in slots.iter().filter(|slot| !slot.expanded.pre.is_empty()) {
        if alone {
            maps.extend(slot.expanded.pre.iter().map(String::as_str));
        } else {
            let what = format!("{} (slot {})", slot.row.name, slot.number);
            let why = "its change of the start point is left out beside other formulas".to_string();
            lost.push(Lost { kind: LostKind::Shape, what, why });
        }
    }
    (!maps.is_empty()).then(|| format!("pre: [{}]", maps.join(", ")))
}

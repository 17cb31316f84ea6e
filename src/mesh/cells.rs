//! Triangles of a cell by the signs of its eight corners: marching cubes, with tables that are made and not written down.
//!
//! A vertex lies on each edge of a cell whose ends differ. On each face of the cell the vertices are joined by lines that leave the
//! inside on their left as seen from outside of the cell; where a face has four, lines go so that the two inner corners are joined.
//! That is decided by the face's corners alone, so cells on both sides of a face agree. The lines of the six faces form closed polygons. Each
//! is cut into triangles by diagonals that lie on no face, so that no other cell has the same one: every edge of a mesh is in exactly
//! two triangles, and around every vertex there is one ring of them.
//!
//! After W. Lorensen and H. Cline, 1987; the rule for faces of four vertices after C. Montani, R. Scateni and R. Scopigno, 1994.

use std::sync::LazyLock;

/// An edge of a cell: the corner it begins at (x in bit 0, y in bit 1, z in bit 2), and its axis.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct CellEdge {
    /// The lower corner.
    pub corner: u8,
    /// The axis along which it leads up.
    pub axis: u8,
}

/// Triangles of each case; bit `c` of a case says that corner `c` is inside. Seen from outside of the body their corners go round
/// against the clock.
pub(super) static TRIANGLES: LazyLock<Vec<Vec<[CellEdge; 3]>>> = LazyLock::new(|| (0..=255).map(triangles).collect());

/// The corners of a face, against the clock as seen from outside of the cell.
fn face(axis: usize, up: bool) -> [u8; 4] {
    let (u, v) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
    let base = u8::from(up) << axis;
    let mut corners = [base, base | u, base | u | v, base | v];
    if !up {
        corners.reverse();
    }
    corners
}

fn faces() -> impl Iterator<Item = [u8; 4]> {
    (0..3).flat_map(|axis| [face(axis, false), face(axis, true)])
}

/// The edge between two neighbouring corners.
fn edge(a: u8, b: u8) -> CellEdge {
    CellEdge { corner: a & b, axis: (a ^ b).trailing_zeros() as u8 }
}

/// The lines of a case on all faces, from vertex to vertex.
fn lines(case: u8) -> Vec<(CellEdge, CellEdge)> {
    let is_inside = |corner: u8| case >> corner & 1 == 1;
    let mut lines = Vec::new();
    for corners in faces() {
        let at = |k: usize| corners[k % 4];
        let enters = (0..4).filter(|&k| !is_inside(at(k)) && is_inside(at(k + 1)));
        for k in enters {
            // The nearest way out, going back: past the corners that are outside.
            let Some(back) = (1..4).map(|d| k + 4 - d).find(|&j| is_inside(at(j)) && !is_inside(at(j + 1))) else {
                continue;
            };
            lines.push((edge(at(k), at(k + 1)), edge(at(back), at(back + 1))));
        }
    }
    lines
}

/// Whether two edges lie on a face of the cell.
fn share_face(a: CellEdge, b: CellEdge) -> bool {
    let is_on =
        |e: CellEdge, corners: &[u8; 4]| corners.contains(&e.corner) && corners.contains(&(e.corner | 1 << e.axis));
    faces().any(|corners| is_on(a, &corners) && is_on(b, &corners))
}

fn triangles(case: u8) -> Vec<[CellEdge; 3]> {
    let mut lines = lines(case);
    let mut all = Vec::new();
    while let Some((first, mut last)) = lines.pop() {
        let mut polygon = vec![first];
        while last != first {
            polygon.push(last);
            let Some(next) = lines.iter().position(|line| line.0 == last) else { break };
            last = lines.swap_remove(next).1;
        }
        cut(&polygon, &mut all);
    }
    all
}

/// Cuts a polygon into triangles by diagonals that lie on no face; there is always a way.
fn cut(polygon: &[CellEdge], all: &mut Vec<[CellEdge; 3]>) -> bool {
    let Some((&last, inner)) = polygon.split_last().filter(|_| polygon.len() > 2) else { return true };
    let first = inner[0];
    for k in 1..inner.len() {
        let is_free = |a: CellEdge, b: CellEdge, is_side: bool| is_side || !share_face(a, b);
        let before = all.len();
        if is_free(first, inner[k], k == 1) && is_free(inner[k], last, k + 1 == inner.len()) {
            all.push([first, inner[k], last]);
            if cut(&polygon[..=k], all) && cut(&polygon[k..], all) {
                return true;
            }
            all.truncate(before);
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::{CellEdge, TRIANGLES, share_face};

    fn number(edge: CellEdge) -> u8 {
        edge.corner | edge.axis << 3
    }

    /// In every case the triangles use each vertex, leave open only lines on faces, and no diagonal lies on a face.
    #[test]
    fn triangles_are_closed_but_on_faces() {
        assert!(TRIANGLES[0].is_empty() && TRIANGLES[255].is_empty());
        assert_eq!(TRIANGLES.iter().map(Vec::len).max(), Some(5));
        for (case, triangles) in TRIANGLES.iter().enumerate() {
            let mut sides: BTreeMap<(u8, u8), i32> = BTreeMap::new();
            for [a, b, c] in triangles {
                for (from, to) in [(a, b), (b, c), (c, a)] {
                    let (from_number, to_number) = (number(*from), number(*to));
                    let key = (from_number.min(to_number), from_number.max(to_number));
                    let turn = if from_number < to_number { 1 } else { -1 };
                    let count = sides.entry(key).or_default();
                    *count += turn;
                    assert!(*count == turn || (*count == 0 && !share_face(*from, *to)), "case {case}");
                }
            }
            let cut = |corner: u8, axis: u8| (case >> corner ^ case >> (corner | 1 << axis)) & 1 == 1;
            let edges = (0..8u8).flat_map(|corner| (0..3u8).map(move |axis| (corner, axis)));
            let crossed = edges.filter(|&(corner, axis)| corner >> axis & 1 == 0 && cut(corner, axis)).count();
            let used: std::collections::BTreeSet<u8> = triangles.iter().flatten().map(|edge| number(*edge)).collect();
            assert_eq!(used.len(), crossed, "case {case}");
        }
    }

    #[test]
    fn a_corner_that_is_inside_is_seen_against_the_clock() {
        let place = |edge: CellEdge| {
            [0, 1, 2].map(|k| f64::from(edge.corner >> k & 1) + if edge.axis == k { 0.5 } else { 0.0 })
        };
        let [a, b, c] = TRIANGLES[1][0].map(place).map(glam::DVec3::from);
        assert!((b - a).cross(c - a).dot(glam::DVec3::ONE) > 0.0);
    }
}

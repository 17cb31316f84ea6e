//! Turning and mirroring: how Mandelbulber places things, as our transforms do.

/// Rows of a matrix.
pub type Matrix = [[f64; 3]; 3];

/// Turns about the fixed axes x, y and z, in that order, in degrees.
pub fn turn(degrees: [f64; 3]) -> Matrix {
    let [(sx, cx), (sy, cy), (sz, cz)] = degrees.map(|angle| angle.to_radians().sin_cos());
    [
        [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
        [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
        [-sy, cy * sx, cy * cx],
    ]
}

/// The inverse of a turn.
pub fn transposed(m: Matrix) -> Matrix {
    std::array::from_fn(|row| std::array::from_fn(|column| m[column][row]))
}

/// A turn as seen in the mirror z = 0.
pub fn mirrored(m: Matrix) -> Matrix {
    let sign = |i: usize| if i == 2 { -1.0 } else { 1.0 };
    std::array::from_fn(|row| std::array::from_fn(|column| m[row][column] * sign(row) * sign(column)))
}

/// The unit axis and the angle, in degrees, of a turn; without a turn the z axis and 0.
pub fn axis_angle(m: Matrix) -> ([f64; 3], f64) {
    let twice_sine = [m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]];
    let length = norm(twice_sine);
    let angle = length.atan2(m[0][0] + m[1][1] + m[2][2] - 1.0);
    if length > 1e-9 {
        return (twice_sine.map(|part| part / length), angle.to_degrees());
    }
    if angle < 1.0 {
        return ([0.0, 0.0, 1.0], 0.0);
    }
    // Half a turn: M = 2 a a^T - 1, so the longest row of M + 1 lies along the axis.
    let rows: Matrix = std::array::from_fn(|i| std::array::from_fn(|j| m[i][j] + if i == j { 1.0 } else { 0.0 }));
    let axis = rows.into_iter().max_by(|a, b| norm(*a).total_cmp(&norm(*b))).unwrap_or([0.0, 0.0, 1.0]);
    (axis.map(|part| part / norm(axis)), 180.0)
}

/// Length of a vector.
pub fn norm(v: [f64; 3]) -> f64 {
    dot(v, v).sqrt()
}

/// Scalar product.
pub fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| a[i] * b[i]).sum()
}

/// Vector product.
pub fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::{Matrix, axis_angle, mirrored, transposed, turn};
    use crate::compose::placement::rotation;

    fn differs(a: Matrix, b: Matrix) -> f64 {
        (0..9).map(|i| (a[i / 3][i % 3] - b[i / 3][i % 3]).abs()).fold(0.0, f64::max)
    }

    /// Axis and angle make the same matrix again, through the composer's own formula.
    #[test]
    fn every_turn_has_an_axis() {
        for degrees in [
            [0.0; 3],
            [10.0, 0.0, 0.0],
            [30.0, -70.0, 200.0],
            [180.0, 0.0, 0.0],
            [180.0, 0.0, 90.0],
            [0.0, 180.0, 45.0],
        ] {
            let matrix = turn(degrees);
            let (axis, angle) = axis_angle(matrix);
            assert!(differs(rotation(axis, angle.to_radians()), matrix) < 1e-9, "{degrees:?}");
            let (axis, angle) = axis_angle(transposed(matrix));
            assert!(differs(rotation(axis, -angle.to_radians()), matrix) < 1e-9, "{degrees:?}");
        }
    }

    #[test]
    fn a_mirrored_turn_turns_the_mirror_image() {
        // About z a turn looks the same in the mirror z = 0, about x it is the other way round.
        assert!(differs(mirrored(turn([0.0, 0.0, 40.0])), turn([0.0, 0.0, 40.0])) < 1e-12);
        assert!(differs(mirrored(turn([40.0, 0.0, 0.0])), turn([-40.0, 0.0, 0.0])) < 1e-12);
    }
}

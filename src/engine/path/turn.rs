//! Turns from view to view: spherical and quadrangle interpolation (K. Shoemake, "Quaternion calculus and fast animation", 1987).

use glam::{DQuat, DVec3};

/// Turns of a camera.
pub struct Turns {
    turns: Vec<DQuat>,
    /// What bends the way at each turn.
    bends: Vec<DQuat>,
}

impl Turns {
    /// The turns of views, the short way from each to the next.
    pub fn through(views: impl Iterator<Item = DQuat>, repeats: bool) -> Turns {
        let mut turns: Vec<DQuat> = Vec::new();
        for turn in views {
            // Both signs are one turn; the nearer one goes the short way.
            let turn = if turns.last().is_some_and(|before| before.dot(turn) < 0.0) { -turn } else { turn };
            turns.push(turn);
        }
        let last = turns.len() - 1;
        let near = |i: isize| match i {
            0.. if i as usize <= last => turns[i as usize],
            _ if repeats && i < 0 => turns[last - 1],
            _ if repeats => turns[1],
            ..0 => turns[0],
            _ => turns[last],
        };
        let bend = |i: usize| {
            let own = turns[i];
            let way = |other: DQuat| logarithm(own.conjugate() * if own.dot(other) < 0.0 { -other } else { other });
            own * exponential((way(near(i as isize + 1)) + way(near(i as isize - 1))) * -0.25)
        };
        let bends = (0..turns.len()).map(bend).collect();
        Turns { turns, bends }
    }

    /// The angle of a segment's turn, in radians.
    pub fn angle(&self, segment: usize) -> f64 {
        self.turns[segment].angle_between(self.turns[segment + 1])
    }

    /// The turn at a share of a segment.
    pub fn at(&self, segment: usize, share: f64) -> DQuat {
        let ends = slerp(self.turns[segment], self.turns[segment + 1], share);
        let bends = slerp(self.bends[segment], self.bends[segment + 1], share);
        slerp(ends, bends, 2.0 * share * (1.0 - share)).normalize()
    }
}

/// Interpolation that does not change signs.
fn slerp(from: DQuat, to: DQuat, share: f64) -> DQuat {
    let cos = from.dot(to).clamp(-1.0, 1.0);
    if cos > 1.0 - 1e-12 {
        return (from * (1.0 - share) + to * share).normalize();
    }
    let angle = cos.acos();
    (from * ((1.0 - share) * angle).sin() + to * (share * angle).sin()) * (1.0 / angle.sin())
}

/// Axis times half of the angle.
fn logarithm(turn: DQuat) -> DVec3 {
    let axis = turn.xyz();
    let length = axis.length();
    if length < 1e-15 { DVec3::ZERO } else { axis * (length.atan2(turn.w) / length) }
}

fn exponential(half: DVec3) -> DQuat {
    let angle = half.length();
    if angle < 1e-15 {
        return DQuat::IDENTITY;
    }
    let axis = half * (angle.sin() / angle);
    DQuat::from_xyzw(axis.x, axis.y, axis.z, angle.cos())
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::Turns;

    #[test]
    fn turns_about_one_axis_stay_about_it_and_are_even() {
        let turn = |degrees: f64| DQuat::from_axis_angle(DVec3::Z, degrees.to_radians());
        let turns = Turns::through([0.0, 30.0, 60.0, 90.0].map(turn).into_iter(), false);
        for (segment, share, degrees) in [(0, 0.0, 0.0), (1, 0.5, 45.0), (1, 0.25, 37.5), (2, 1.0, 90.0)] {
            let off = turns.at(segment, share).angle_between(turn(degrees)).to_degrees();
            assert!(off < 0.01, "{segment} {share}: {off}");
        }
    }

    #[test]
    fn the_short_way_is_taken() {
        let turn = |degrees: f64| DQuat::from_axis_angle(DVec3::Z, degrees.to_radians());
        let turns = Turns::through([170.0, 190.0].map(turn).into_iter(), false);
        assert!((turns.angle(0).to_degrees() - 20.0).abs() < 1e-6);
        assert!(turns.at(0, 0.5).angle_between(turn(180.0)).to_degrees() < 0.01);
    }
}

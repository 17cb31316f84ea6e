//! Whether stops on rays without a truth are early: by the members of the set around them.

use super::{Ray, Truths, point};

/// A stop in front of the truth by more than this share of the bounding radius is early.
pub(super) const EARLY: f64 = 0.005;
/// In views so close that this many footprints are less than that, they decide.
pub(super) const EARLY_FOOTPRINTS: f64 = 4.0;
/// Points around an early stop that are asked whether something thin is there after all, and how far around, in pixel radii.
pub(super) const NEAR_STOP: usize = 33;
pub(super) const NEAR_STOP_REACH: f64 = 0.25;
/// Points behind a stop that are asked for a member, over a stretch of four footprints at most: a 16th of a footprint apart.
const BEHIND: usize = 64;

impl Truths {
    /// Which of these stops have a member of the set within an eighth of a footprint.
    pub fn are_members_near(&self, places: &[(Ray, f64)]) -> Vec<bool> {
        let offset = |k: usize| 2.0 * k as f64 / (NEAR_STOP - 1) as f64 - 1.0;
        let pixel = self.scale.pixel;
        self.have_members(places, NEAR_STOP, |k, t| t + NEAR_STOP_REACH * pixel.radius(t) * offset(k))
    }

    /// Which of these stops are early: no member of the set is at them, within an eighth of a footprint of them, or so near behind
    /// them that the stop is right. `members` says which of them are members.
    pub fn are_early(&self, places: &[(Ray, f64)], members: &[bool]) -> Vec<bool> {
        let mut early: Vec<bool> = members.iter().map(|is_member| !is_member).collect();
        let far = |t: f64| (EARLY * self.scale.bounding_radius).min(EARLY_FOOTPRINTS * self.scale.footprint(t));
        let behind = |k: usize, t: f64| t + far(t) * (k + 1) as f64 / BEHIND as f64;
        strike(&mut early, places, |stops| self.are_members_near(stops));
        strike(&mut early, places, |stops| self.have_members(stops, BEHIND, behind));
        early
    }

    /// For each place whether a member is at any of `count` depths of its ray.
    fn have_members(&self, places: &[(Ray, f64)], count: usize, depth: impl Fn(usize, f64) -> f64) -> Vec<bool> {
        let depths: Vec<f64> = places.iter().flat_map(|(_, t)| (0..count).map(|k| depth(k, *t))).collect();
        let rays = places.iter().flat_map(|(ray, _)| std::iter::repeat_n(*ray, count));
        let points: Vec<[f64; 3]> = rays.zip(&depths).map(|(ray, t)| point(ray, *t)).collect();
        let eps: Vec<f64> = depths.iter().map(|t| self.scale.pixel.radius(*t)).collect();
        self.members().inside(&points, &eps).chunks(count).map(|inside| inside.contains(&true)).collect()
    }
}

/// Takes back that stops are early where they are found to be right.
fn strike(early: &mut [bool], places: &[(Ray, f64)], are_right: impl Fn(&[(Ray, f64)]) -> Vec<bool>) {
    let open: Vec<usize> = (0..places.len()).filter(|&i| early[i]).collect();
    let stops: Vec<(Ray, f64)> = open.iter().map(|&i| places[i]).collect();
    for (&i, is_right) in open.iter().zip(are_right(&stops)) {
        early[i] = !is_right;
    }
}

// All orbits at a point, joined. Twin: `estimate` in src/kernel/cpu/estimate.rs.

struct Estimate {
    result: $COMBINE_out,
    /// Iterations of all orbits.
    iterations: f32,
}

fn estimate(p: vec3<f32>, d: vec3<f32>, h: f32, hit_eps: f32) -> Estimate {
    $ORBITS
    return Estimate($COMBINE($RESULTS), $ITERATIONS);
}

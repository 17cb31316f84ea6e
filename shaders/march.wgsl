// Rays marched in slices: each dispatch advances the rays of a list by at most `call.slice` steps and lists those that
// still run. The state of a ray is its output columns. Twin: `run_march` in src/kernel/cpu.rs.

struct Running {
    count: atomic<u32>,
    /// Estimates made by one invocation of $SAMPLED.
    work: atomic<u32>,
    rays: array<u32>,
}

@group(0) @binding(3) var<storage, read> listed: array<u32>;
@group(0) @binding(4) var<storage, read_write> running: Running;

fn keep_running(i: u32) {
    running.rays[atomicAdd(&running.count, 1u)] = i;
}

fn read_state(column: u32, i: u32) -> f32 {
    return outputs[column * call.n + i];
}

/// By its bits: compilers may assume that no value is NaN.
fn is_nan(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7fffffffu) > 0x7f800000u;
}

/// Puts all rays at their near end. A ray whose range is empty has missed before it starts.
@compute @workgroup_size($WORKGROUP)
fn start(@builtin(global_invocation_id) id: vec3<u32>) {
    let i = element(id);
    if i >= call.end {
        return;
    }
    let t_near = load($T_NEARu, i);
    let runs = t_near < load($T_FARu, i);
    let status = select($MISSED, 0.0, runs);
    $START
    if runs {
        keep_running(i);
    }
}

/// Advances each listed ray by up to `call.slice` steps.
@compute @workgroup_size($WORKGROUP)
fn march(@builtin(global_invocation_id) id: vec3<u32>) {
    let k = element(id);
    if k >= call.end {
        return;
    }
    let i = listed[k + 2u];
    $RAY
    var state = $ADVANCE_out($STATE);
    var steps = 0u;
    var iterations = 0.0;
    var nans = 0u;
    while steps < call.slice && state.status == 0.0 {
        let at = $LOCATE($LOCATE_ARGUMENTS);
        let estimated = estimate(at.p, at.d, at.h, at.hit_eps);
        state = $ADVANCE($ADVANCE_ARGUMENTS);
        steps++;
        iterations += estimated.iterations;
        nans += select(0u, 1u, is_nan(estimated.result.de));
    }
    $STORES
    store($STEPSu, i, read_state($STEPSu, i) + f32(steps));
    store($STEPSu + 1u, i, read_state($STEPSu + 1u, i) + iterations);
    store($STEPSu + 2u, i, read_state($STEPSu + 2u, i) + f32(nans));
    if k % $SAMPLEDu == 0u {
        atomicAdd(&running.work, steps);
    }
    if state.status == 0.0 {
        keep_running(i);
    }
}

// Rays marched in slices: each dispatch advances all rays, or those of a list, by at most `call.slice` steps and lists those
// that still run. The state of a ray is its output columns. Twin: `run_march` in src/kernel/cpu.rs.

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

/// Advances each ray by up to `call.slice` steps, at first from its near end. A ray whose range is empty has missed before it
/// starts.
@compute @workgroup_size($WORKGROUP)
fn march(@builtin(global_invocation_id) id: vec3<u32>) {
    let k = element(id);
    if k >= call.end {
        return;
    }
    var i = k;
    if call.starts == 0u {
        // How long the list is the host need not know.
        if k >= listed[0] {
            return;
        }
        i = listed[k + 2u];
    }
    $RAY
    var state = $ADVANCE_out($START);
    var before = 0u;
    var iterations = 0.0;
    var nans = 0.0;
    if call.starts == 0u {
        state = $ADVANCE_out($STATE);
        before = u32(read_state($STEPSu, i));
        iterations = read_state($STEPSu + 1u, i);
        nans = read_state($STEPSu + 2u, i);
    }
    let end = min(before + call.slice, call.most);
    var steps = before;
    while steps < end && state.status == 0.0 {
        let at = $LOCATE($LOCATE_ARGUMENTS);
        let estimated = estimate(at.p, at.d, at.h, at.hit_eps);
        state = $ADVANCE($ADVANCE_ARGUMENTS);
        steps++;
        iterations += estimated.iterations;
        nans += select(0.0, 1.0, is_nan(estimated.result.de));
    }
    $STORES
    store($STEPSu, i, f32(steps));
    store($STEPSu + 1u, i, iterations);
    store($STEPSu + 2u, i, nans);
    if k % $SAMPLEDu == 0u {
        atomicAdd(&running.work, steps - before);
    }
    if state.status == 0.0 && steps < call.most {
        keep_running(i);
    }
}

// Rays marched in slices: each dispatch advances all rays, or those of a list, by at most `call.slice` steps and lists those
// that still run. The state of a ray is its output columns. Twin: `run_march` in src/kernel/cpu/march.rs.

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

/// Where a card of a pack lies after it was dealt out to $HANDS hands, one card each in turn, and these were put on each other.
fn dealt(card: u32, cards: u32) -> u32 {
    let least = cards / $HANDSu;
    let longer = cards % $HANDSu;
    // The first hands have a card more.
    let is_longer = card < longer * (least + 1u);
    let size = select(least, least + 1u, is_longer);
    let place = select(card - longer * (least + 1u), card, is_longer);
    let hand = place / max(size, 1u);
    return (place - hand * size) * $HANDSu + hand + select(longer, 0u, is_longer);
}

/// Which of so many rays an invocation takes: neighbours stay together in stacks of $STACK, and stacks are dealt out. Software drivers
/// give each of their threads one run of workgroups and wait for the last one, and parts of a picture are not equally expensive.
fn taken(place: u32, rays: u32) -> u32 {
    let stacks = rays / $STACKu;
    let stack = place / $STACKu;
    return select(place, dealt(stack, stacks) * $STACKu + place % $STACKu, stack < stacks);
}

/// Advances each ray by up to `call.slice` steps, at first from its near end. A ray whose range is empty has missed before it
/// starts.
@compute @workgroup_size($WORKGROUP)
fn march(@builtin(global_invocation_id) id: vec3<u32>) {
    var end_of_rays = call.end;
    if call.starts == 0u {
        // How long the list is the host need not know.
        end_of_rays = min(end_of_rays, listed[0]);
    }
    let place = element(id);
    if place >= end_of_rays {
        return;
    }
    var i = call.first + taken(place - call.first, end_of_rays - call.first);
    if call.starts == 0u {
        i = listed[i + 2u];
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
    if place % $SAMPLEDu == 0u {
        atomicAdd(&running.work, steps - before);
    }
    if state.status == 0.0 && steps < call.most {
        keep_running(i);
    }
}

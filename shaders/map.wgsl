// A straight-line function of each element. Twin: `run_map` in src/kernel/cpu/estimate.rs.

@compute @workgroup_size($WORKGROUP)
fn map(@builtin(global_invocation_id) id: vec3<u32>) {
    let i = element(id);
    if i >= call.end {
        return;
    }
    let result = $FUNCTION($LOADS);
    $STORES
}

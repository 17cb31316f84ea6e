// An estimate at each element. Twin: `run_estimates` in src/kernel/cpu/estimate.rs.

@compute @workgroup_size($WORKGROUP)
fn estimates(@builtin(global_invocation_id) id: vec3<u32>) {
    let i = element(id);
    if i >= call.end {
        return;
    }
    if !(load($HIT_EPSu, i) >= 0.0) {
        for (var column = 0u; column < $COLUMNSu; column++) {
            store(column, i, 0.0);
        }
        return;
    }
    let result = estimate($LOADS).result;
    $STORES
}

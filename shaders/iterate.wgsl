// The orbit $ORBIT. Twin: `iterate` in src/kernel/cpu/estimate.rs.

struct $ORBIT_end {
    state: $STATE,
    inside: bool,
    /// Iterations done.
    n: u32,
}

/// Iterates until the orbit has escaped or `max_iterations` are done. One way out: where lanes run in step, returning from
/// within a loop costs a mask in each iteration.
fn iterate_$ORBIT(start: $START) -> $ORBIT_end {
    var state = $STATE($FIRST);
    var n = 0u;
    while n < $MAX_ITERATIONSu {
        $ITERATION
        n++;
        if state.escaped {
            break;
        }
    }
    return $ORBIT_end(state, !state.escaped, n);
}

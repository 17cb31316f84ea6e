// The orbit $ORBIT. Twin: `iterate` in src/kernel/cpu.rs.

struct $ORBIT_end {
    state: $STATE,
    inside: bool,
    /// Iterations done.
    n: u32,
}

/// Iterates until the orbit has escaped or `max_iterations` are done.
fn iterate_$ORBIT(start: $START) -> $ORBIT_end {
    var state = $STATE($FIRST);
    for (var n = 0u; n < $MAX_ITERATIONSu; n++) {
        $ITERATION
        if state.escaped {
            return $ORBIT_end(state, false, n + 1u);
        }
    }
    return $ORBIT_end(state, true, $MAX_ITERATIONSu);
}

// What every kernel starts with: its buffers, and access to columns. Column j of element i lies at j * n + i.

struct Call {
    /// Elements in a column.
    n: u32,
    /// First element (of a march: first entry of the list of running rays) of this dispatch.
    first: u32,
    /// The one after its last.
    end: u32,
    /// Invocations in one row of the dispatch.
    row: u32,
    /// Most march steps of this dispatch.
    slice: u32,
    /// Most march steps of a ray.
    most: u32,
    /// 1 where rays start: all elements, in order.
    starts: u32,
}

@group(0) @binding(0) var<uniform> call: Call;
@group(0) @binding(1) var<storage, read> inputs: array<f32>;
@group(0) @binding(2) var<storage, read_write> outputs: array<f32>;

fn load(column: u32, i: u32) -> f32 {
    return inputs[column * call.n + i];
}

fn store(column: u32, i: u32, value: f32) {
    outputs[column * call.n + i] = value;
}

/// Number of this invocation's element.
fn element(id: vec3<u32>) -> u32 {
    return call.first + id.y * call.row + id.x;
}

//! Exported WGSL on the GPU back end.

use bulbfold::check::Formula;
use bulbfold::graph::Method;

use crate::support::{bulbfold, folder, stderr, stdout};

/// The function that a file exports gives the library's own estimates: it is run as WGSL on the GPU back end.
#[test]
fn exported_distances_are_our_own() {
    let folder = folder();
    for (fractal, method) in [("mandelbulb", Method::Scalar), ("mandelbox", Method::Scalar), ("menger", Method::Scalar)]
    {
        let output =
            bulbfold(folder.path(), ["export", fractal, "--to", "wgsl", "--de", method.name(), "--fudge", "1"]);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        let formula = Formula::builtin(fractal).unwrap();
        let radius = formula.graph().bounding_radius.unwrap_or(1.2);
        let points: Vec<[f64; 3]> =
            (0..60).map(|i| [7, 11, 17].map(|k| (f64::from((i * k) % 61) / 30.5 - 1.0) * 0.6 * radius)).collect();
        let Some(found) = gpu::run(&stdout(&output), &points) else { return };
        for (p, found) in points.iter().zip(found) {
            let expected = if formula.inside(*p) { 0.0 } else { formula.estimate(*p, method) };
            assert!(
                (found - expected).abs() < 2e-4 + 0.02 * expected.abs(),
                "{fractal} at {p:?}: {found}, not {expected}"
            );
        }
    }
}

/// A compute shader around a function `distance_estimate`, on any adapter.
mod gpu {
    use wgpu::util::{BufferInitDescriptor, DeviceExt};

    const MAIN: &str = "
@group(0) @binding(0) var<storage, read> points: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> distances: array<f32>;
@compute @workgroup_size(1)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    distances[id.x] = distance_estimate(points[id.x].xyz);
}
";

    /// Distances at points; nothing where there is no adapter and none is required.
    pub fn run(functions: &str, points: &[[f64; 3]]) -> Option<Vec<f64>> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
        let Some(adapter) = adapters.first() else {
            assert!(std::env::var_os("BULBFOLD_REQUIRE_GPU").is_none(), "there is no GPU adapter");
            eprintln!("skipped: there is no GPU adapter");
            return None;
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default())).unwrap();
        let source = wgpu::ShaderSource::Wgsl((functions.to_string() + MAIN).into());
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: None,
            module: &module,
            entry_point: Some("main"),
            compilation_options: Default::default(),
            cache: None,
        });
        let bytes: Vec<u8> =
            points.iter().flat_map(|p| [p[0], p[1], p[2], 0.0]).flat_map(|x| (x as f32).to_le_bytes()).collect();
        let usage = wgpu::BufferUsages::STORAGE;
        let input = device.create_buffer_init(&BufferInitDescriptor { label: None, contents: &bytes, usage });
        let size = points.len() as u64 * 4;
        let buffer = |usage| {
            device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
        };
        let output = buffer(wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
        let staging = buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
        let entries = [&input, &output].map(|buffer| buffer.as_entire_binding());
        let entries: Vec<_> =
            (0u32..).zip(entries).map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect();
        let layout = pipeline.get_bind_group_layout(0);
        let group =
            device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout: &layout, entries: &entries });
        let mut encoder = device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.dispatch_workgroups(points.len() as u32, 1, 1);
        }
        encoder.copy_buffer_to_buffer(&output, 0, &staging, 0, size);
        queue.submit([encoder.finish()]);
        staging.map_async(wgpu::MapMode::Read, .., |result| result.unwrap());
        device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
        let view = staging.get_mapped_range(..).unwrap();
        Some(view.chunks(4).map(|word| f64::from(f32::from_le_bytes([word[0], word[1], word[2], word[3]]))).collect())
    }
}

//! Generated kernels against WGSL written by hand: the same march with the same estimates on the same rays and device.
//!
//! `cargo bench --bench wgsl_by_hand -- [ROUNDS] [WIDTHxHEIGHT]` alternates both and prints times, their ratio and how far the
//! results agree. A fast device needs a larger size than the 640x480 rays that are the default.

use std::sync::Arc;
use std::time::Instant;

use bulbfold::compose::Composer;
use bulbfold::diag::Diagnostics;
use bulbfold::expr::Arena;
use bulbfold::formula::library::Library;
use bulbfold::graph::{EstimateSettings, LEAST_STEP, Method};
use bulbfold::kernel::Backend;
use bulbfold::kernel::gpu::{AdapterWanted, Gpu, GpuColumns, GpuKernel};
use bulbfold::load::load;
use bulbfold::render::{Pipeline, RenderSettings, Role, compose_pipeline};
use bulbfold::shade::Size;

const SIZE: Size = Size { width: 640, height: 480 };
const ROUNDS: usize = 7;
/// Workgroups of a dispatch by hand, which has one dimension.
const MOST_WORKGROUPS: u64 = 65535;
const MOST_RAYS: u64 = MOST_WORKGROUPS * 64;
const FRACTALS: [(&str, &str); 2] =
    [("mandelbulb", include_str!("mandelbulb.wgsl")), ("mandelbox", include_str!("mandelbox.wgsl"))];

fn main() {
    let (rounds, size) = match wanted() {
        Ok(wanted) => wanted,
        Err(message) => {
            eprintln!("{message}");
            std::process::exit(2);
        }
    };
    let gpu = match Gpu::new(AdapterWanted::Any) {
        Ok(gpu) => gpu,
        Err(error) => return eprintln!("skipped: {error}"),
    };
    println!("{}, {} x {} rays, {rounds} rounds", gpu.adapter().name, size.width, size.height);
    for (name, wgsl) in FRACTALS {
        let arena = Arc::new(Arena::default());
        let pipeline = pipeline(&arena, name, size);
        let pixels: Vec<(u32, u32)> = bulbfold::film::tiles(size).iter().flat_map(|tile| tile.pixels()).collect();
        let column = |f: fn(&(u32, u32)) -> u32| pixels.iter().map(|p| f64::from(f(p)) + 0.5).collect::<Vec<f64>>();
        let camera = gpu.prepare(&arena, pipeline.kernel(Role::Camera)).expect("kernels compile");
        let pixels = gpu.upload(&[column(|p| p.0), column(|p| p.1)]).expect("columns fit");
        let rays = gpu.run(&camera, &[&pixels]).expect("kernels run");
        let generated = gpu.prepare(&arena, pipeline.kernel(Role::March)).expect("kernels compile");
        let columns = gpu.download(&rays).expect("rays download");
        let by_hand = ByHand::new(wgsl, &columns, pipeline.pixel.pixel_radius, 64);
        compare(name, rounds, &gpu, &generated, &rays, &by_hand);
        let rays = u64::from(size.width) * u64::from(size.height);
        for workgroup in [16, 32, 64, 128, 256].into_iter().filter(|&w| rays.div_ceil(u64::from(w)) <= MOST_WORKGROUPS)
        {
            let by_hand = ByHand::new(wgsl, &columns, pipeline.pixel.pixel_radius, workgroup);
            let least = (0..=rounds).map(|_| milliseconds(|| by_hand.run())).fold(f64::INFINITY, f64::min);
            println!("{:<12} by hand in workgroups of {workgroup}: {least:.1} ms", "");
        }
    }
}

/// Rounds and size from the command line, which cargo adds a flag to.
fn wanted() -> Result<(usize, Size), String> {
    let (mut rounds, mut size) = (ROUNDS, SIZE);
    for word in std::env::args().skip(1).filter(|word| word != "--bench") {
        match (word.parse(), word.split_once('x').map(|(width, height)| (width.parse(), height.parse()))) {
            (Ok(wanted), _) if wanted > 0 => rounds = wanted,
            (_, Some((Ok(width), Ok(height)))) if (1..=MOST_RAYS).contains(&(u64::from(width) * u64::from(height))) => {
                size = Size { width, height };
            }
            _ => {
                return Err(format!(
                    "`{word}` is neither a number of rounds nor a size of up to {MOST_RAYS} rays: write `7 2048x1536`"
                ));
            }
        }
    }
    Ok((rounds, size))
}

fn pipeline(arena: &Arc<Arena>, name: &str, size: Size) -> Pipeline {
    let mut library = Library::builtin();
    let loaded = load(&mut library, name, &[], &mut Diagnostics::default()).expect("built-in fractals load");
    let estimate = EstimateSettings {
        method: Some(Method::Scalar),
        fudge: Some(1.0),
        least_step: Some(LEAST_STEP),
        ..EstimateSettings::default()
    };
    // Steps no longer than the estimate, orbits to their end: what the shaders by hand do.
    let settings = RenderSettings { size, estimate, plain: true, ..RenderSettings::default() };
    let composer = Composer { arena, library: &library, graph: &loaded.graph };
    compose_pipeline(&composer, &settings).expect("built-in fractals compose")
}

/// Alternates both.
fn compare(name: &str, rounds: usize, gpu: &Gpu, generated: &GpuKernel, rays: &GpuColumns, by_hand: &ByHand) {
    let mut times = [const { Vec::new() }; 3];
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    for _ in 0..=rounds {
        let mut hits = None;
        times[0].push(milliseconds(|| {
            hits = gpu.run(generated, &[rays]).and_then(|hits| gpu.finish().map(|()| hits)).ok()
        }));
        times[1].push(milliseconds(|| by_hand.run()));
        let hits = hits.expect("kernels run");
        times[2].push(milliseconds(|| ours = gpu.download(&hits).expect("hits download")));
        theirs = by_hand.hits();
    }
    let dispatches = gpu.dispatches();
    // The first round learns how much a dispatch may hold.
    times.iter_mut().for_each(|times| {
        times.remove(0);
        times.sort_by(f64::total_cmp);
    });
    let [least, median] = [0, rounds / 2].map(|at| [times[0][at], times[1][at]]);
    println!(
        "{name:<12} generated {:.1} ms (median {:.1}), by hand {:.1} ms (median {:.1})",
        least[0], median[0], least[1], median[1]
    );
    println!("{:<12} download of all columns: {:.1} ms", "", times[2][0]);
    println!(
        "{:<12} {} dispatches so far, the longest {:.1} ms",
        "",
        dispatches.count,
        dispatches.longest.as_secs_f64() * 1e3
    );
    println!("{:<12} generated / by hand: {:.3} (of medians {:.3})", "", least[0] / least[1], median[0] / median[1]);
    let rays = ours[0].len();
    let ends = (0..rays).filter(|&i| ours[5][i] == theirs[5][i]).count();
    let close = (0..rays).filter(|&i| (ours[0][i] - theirs[0][i]).abs() <= 1e-3 * ours[0][i].abs()).count();
    let estimates = [&ours, &theirs].map(|columns| columns[6].iter().sum::<f64>() / rays as f64);
    let share = |n: usize| 100.0 * n as f64 / rays as f64;
    println!(
        "{:<12} same end {:.2} %, same depth {:.2} %, estimates a ray {:.2} and {:.2}",
        "",
        share(ends),
        share(close),
        estimates[0],
        estimates[1]
    );
}

fn milliseconds(work: impl FnOnce()) -> f64 {
    let start = Instant::now();
    work();
    start.elapsed().as_secs_f64() * 1e3
}

/// A pipeline of WGSL written by hand, on a device of its own.
struct ByHand {
    device: wgpu::Device,
    queue: wgpu::Queue,
    pipeline: wgpu::ComputePipeline,
    group: wgpu::BindGroup,
    hits: wgpu::Buffer,
    rays: u32,
    workgroup: u32,
}

impl ByHand {
    fn new(estimate: &str, rays: &[Vec<f64>], pixel_radius: f64, workgroup: u32) -> ByHand {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            ..Default::default()
        }))
        .expect("there is an adapter");
        let request = wgpu::DeviceDescriptor { required_limits: adapter.limits(), ..Default::default() };
        let (device, queue) = pollster::block_on(adapter.request_device(&request)).expect("the adapter opens");
        let march = include_str!("march.wgsl").replace("size(64)", &format!("size({workgroup})"));
        let text = format!("{march}\n{estimate}");
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: None,
            source: wgpu::ShaderSource::Wgsl(text.into()),
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: None,
            module: &module,
            entry_point: Some("march"),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants: &[("pixel_radius", pixel_radius)],
                ..Default::default()
            },
            cache: None,
        });
        let numbers: Vec<f32> = rays.iter().flatten().map(|&x| x as f32).collect();
        let count = rays[0].len();
        let buffer = |size: usize| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: None,
                size: size as u64,
                usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            })
        };
        let (rays, hits) = (buffer(numbers.len() * 4), buffer(count * 9 * 4));
        queue.write_buffer(&rays, 0, bytemuck::cast_slice(&numbers));
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: rays.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: hits.as_entire_binding() },
            ],
        });
        ByHand { device, queue, pipeline, group, hits, rays: count as u32, workgroup }
    }

    fn wait(&self) {
        self.device.poll(wgpu::PollType::wait_indefinitely()).expect("the device works");
    }

    fn run(&self) {
        let mut encoder = self.device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &self.group, &[]);
            pass.dispatch_workgroups(self.rays.div_ceil(self.workgroup), 1, 1);
        }
        self.queue.submit([encoder.finish()]);
        self.wait();
    }

    fn hits(&self) -> Vec<Vec<f64>> {
        let bytes = u64::from(self.rays) * 9 * 4;
        let staging = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: bytes,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(&self.hits, 0, &staging, 0, bytes);
        self.queue.submit([encoder.finish()]);
        staging.map_async(wgpu::MapMode::Read, .., |_| ());
        self.wait();
        let view = staging.get_mapped_range(..).expect("the buffer is mapped");
        let numbers: &[f32] = bytemuck::cast_slice(&view);
        numbers.chunks_exact(self.rays as usize).map(|c| c.iter().map(|&x| f64::from(x)).collect()).collect()
    }
}

//! A formula's distance estimate in the languages of other programs.
//!
//! In comes a composed fractal with its plan; out comes a file ([`Exported`]) around one function, `distance_estimate`, from
//! a point in world units to a length that a ray may advance. It is written as WGSL first and goes from there through naga's
//! validator and writers, so that all languages say the same. Parameters are the numbers that the graph has at the time.

mod shadertoy;

use naga::back::{glsl, hlsl, msl, spv};

use crate::compose::{Composer, Plan, Purpose, compose_estimator};
use crate::diag::Diagnostic;
use crate::graph::{Camera, Method, TRAPS};
use crate::kernel::wgsl;
use crate::math::Precision;

/// A language, or the form that a program wants.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Target {
    /// WGSL: functions to put into a shader.
    Wgsl,
    /// GLSL ES 3.00, as WebGL 2 takes it: functions to put into a shader.
    Glsl,
    /// A whole picture for shadertoy.com.
    Shadertoy,
    /// A whole shader for Fragmentarium.
    Fragmentarium,
    /// HLSL: functions to put into a shader.
    Hlsl,
    /// The Metal shading language: functions to put into a shader.
    Msl,
    /// SPIR-V: a fragment shader from a point (location 0) to its distance (location 0).
    Spirv,
}

impl Target {
    /// All targets, in the order of listings.
    pub const ALL: [Target; 7] = [
        Target::Wgsl,
        Target::Glsl,
        Target::Shadertoy,
        Target::Fragmentarium,
        Target::Hlsl,
        Target::Msl,
        Target::Spirv,
    ];

    /// The name in flags.
    pub const fn name(self) -> &'static str {
        match self {
            Target::Wgsl => "wgsl",
            Target::Glsl => "glsl",
            Target::Shadertoy => "shadertoy",
            Target::Fragmentarium => "fragmentarium",
            Target::Hlsl => "hlsl",
            Target::Msl => "msl",
            Target::Spirv => "spirv",
        }
    }

    /// How the result is used, in one sentence.
    pub const fn usage(self) -> &'static str {
        match self {
            Target::Wgsl | Target::Glsl | Target::Hlsl | Target::Msl => {
                "Put this text into a shader and call distance_estimate(p) for points in world units."
            }
            Target::Shadertoy => "Paste this text into a new shader on shadertoy.com.",
            Target::Fragmentarium => "Open this file in Fragmentarium; it needs OpenGL 3.3.",
            Target::Spirv => "A fragment shader: the point is input location 0, the distance output location 0.",
        }
    }
}

/// The content of a file.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Exported {
    /// A text.
    Text(String),
    /// Words of SPIR-V.
    Words(Vec<u32>),
}

/// Why a formula could not be exported.
#[derive(Clone, Debug)]
pub enum ExportError {
    /// A step's script failed.
    Formula(Diagnostic),
    /// The method needs more than a point: the ray, or how far the last proof reached.
    NeedsRay(Method),
    /// A writer or the validator refused what we wrote: our bug. The text names the place.
    Writer(String),
}

/// Writes the estimate of a plan for a target.
pub fn export(composer: &Composer, plan: &Plan, camera: &Camera, target: Target) -> Result<Exported, ExportError> {
    let follows_rays =
        |method: &Method| method.is_certified() || matches!(method, Method::Directional | Method::DeltaRay);
    if let Some(method) = plan.choices.iter().map(|choice| choice.method).find(follows_rays) {
        return Err(ExportError::NeedsRay(method));
    }
    let estimator = compose_estimator(composer, &plan.choices, Purpose::Estimate).map_err(ExportError::Formula)?;
    let mut source = wgsl::write_estimate(composer.arena, &estimator);
    source.push_str(&distance(plan));
    let header = header(composer, plan, target);
    if matches!(target, Target::Wgsl | Target::Hlsl | Target::Msl) {
        let (module, info) = validated(&source)?;
        return Ok(Exported::Text(format!("{header}{}", functions(target, source, &module, &info)?)));
    }
    source.push_str("\n@fragment\nfn main(@location(0) point: vec3<f32>) -> @location(0) f32 {\n    return distance_estimate(point);\n}\n");
    let (module, info) = validated(&source)?;
    if target == Target::Spirv {
        let options = spv::Options { flags: spv::WriterFlags::empty(), ..spv::Options::default() };
        return spv::write_vec(&module, &info, &options, None).map(Exported::Words).map_err(writer);
    }
    let version = match target {
        Target::Fragmentarium => glsl::Version::Desktop(330),
        _ => glsl::Version::Embedded { version: 300, is_webgl: true },
    };
    let body = bare_glsl(&written_glsl(&module, &info, version)?);
    Ok(Exported::Text(match target {
        Target::Shadertoy => {
            format!("{header}{body}{}", shadertoy::picture(camera, &composer.graph.scene, plan.bounding_radius))
        }
        Target::Fragmentarium => fragmentarium(&header, &body, composer, camera),
        _ => format!("{header}{body}"),
    }))
}

/// The text of functions in a language that has modules without entry points.
fn functions(
    target: Target,
    source: String,
    module: &naga::Module,
    info: &naga::valid::ModuleInfo,
) -> Result<String, ExportError> {
    match target {
        Target::Hlsl => {
            let mut text = String::new();
            let (options, pipeline) = (hlsl::Options::default(), hlsl::PipelineOptions::default());
            hlsl::Writer::new(&mut text, &options, &pipeline).write(module, info, None).map_err(writer)?;
            Ok(text)
        }
        Target::Msl => {
            let (options, pipeline) = (msl::Options::default(), msl::PipelineOptions::default());
            msl::write_string(module, info, &options, &pipeline).map(|(text, _)| text).map_err(writer)
        }
        _ => Ok(source),
    }
}

fn validated(source: &str) -> Result<(naga::Module, naga::valid::ModuleInfo), ExportError> {
    wgsl::validate(source).map_err(|error| ExportError::Writer(error.to_string()))
}

fn writer(error: impl std::fmt::Display) -> ExportError {
    ExportError::Writer(error.to_string())
}

/// The function that everything is about. Beyond the bounding sphere, where no estimate is right, it is the way to that.
fn distance(plan: &Plan) -> String {
    let radius = plan.bounding_radius;
    format!(
        "
/// How far a ray may go from `p` (world units) without passing the set; 0 inside.
fn distance_estimate(p: vec3<f32>) -> f32 {{
    let r = length(p);
    if r > {far:?} {{
        return r - {radius:?};
    }}
    let d = select(vec3<f32>(1.0, 0.0, 0.0), p / -max(r, 1e-30), r > 0.0);
    let estimated = estimate(p, d, {step:?} * max(r, 1.0), 0.0).result;
    return select(estimated.de * {fudge:?}, 0.0, estimated.inside);
}}
",
        far = radius as f32 * 1.1,
        radius = radius as f32,
        step = Precision::F32.min_difference() as f32 * 10.0,
        fudge = plan.fudge as f32,
    )
}

/// Comment lines: what it is, parameters, estimate, source and use.
fn header(composer: &Composer, plan: &Plan, target: Target) -> String {
    let graph = composer.graph;
    let mut lines = vec![format!("{}: {}", graph.name, graph.summary)];
    if !graph.source.is_empty() {
        lines.push(format!("Formula: {}", graph.source));
    }
    if !graph.params.is_empty() {
        let values: Vec<String> =
            graph.params.iter().map(|param| format!("{} = {}", param.name, param.value)).collect();
        lines.push(format!("Parameters, as constants: {}", values.join(", ")));
    }
    let methods: Vec<&str> = plan.choices.iter().map(|choice| choice.method.name()).collect();
    lines.push(format!("Estimate: {}; step multiplier {}", methods.join(", "), plan.fudge));
    lines.push(format!("Everything lies within {} of the origin. {}", plan.bounding_radius, target.usage()));
    if target == Target::Shadertoy && (graph.scene.look.traps != TRAPS || graph.scene.look.is_painted()) {
        lines.push("The picture has one colour: those of parts and of traps are not written.".to_string());
    }
    lines.push(format!("Written by bulbfold {}.", env!("CARGO_PKG_VERSION")));
    let plain =
        |line: &String| line.chars().map(|c| if c.is_control() || c == '\\' { ' ' } else { c }).collect::<String>();
    lines.iter().map(|line| format!("// {}\n", plain(line))).collect::<String>() + "\n"
}

fn written_glsl(
    module: &naga::Module,
    info: &naga::valid::ModuleInfo,
    version: glsl::Version,
) -> Result<String, ExportError> {
    let options = glsl::Options { version, writer_flags: glsl::WriterFlags::empty(), ..glsl::Options::default() };
    let pipeline = glsl::PipelineOptions {
        shader_stage: naga::ShaderStage::Fragment,
        entry_point: "main".into(),
        multiview: None,
    };
    let mut text = String::new();
    let policies = naga::proc::BoundsCheckPolicies::default();
    glsl::Writer::new(&mut text, module, info, &options, &pipeline, policies)
        .and_then(|mut writer| writer.write())
        .map_err(writer)?;
    Ok(text)
}

/// The functions of a fragment shader without its version, precisions, inputs, outputs and `main`.
fn bare_glsl(text: &str) -> String {
    let end = text.find("void main()").unwrap_or(text.len());
    let is_frame = |line: &&str| {
        let line = line.trim_start();
        ["#version", "#extension", "precision ", "layout(", "smooth in ", "in vec3 "]
            .iter()
            .any(|begin| line.starts_with(begin))
    };
    let lines: Vec<&str> = text[..end].lines().filter(|line| !is_frame(line)).collect();
    lines.join("\n").trim().to_string() + "\n"
}

/// A shader for Fragmentarium's ray tracer, with a preset of the camera.
fn fragmentarium(header: &str, body: &str, composer: &Composer, camera: &Camera) -> String {
    let camera = &camera.flat();
    let vector = |v: [f64; 3]| format!("{},{},{}", v[0], v[1], v[2]);
    let distance = camera.position.iter().map(|x| x * x).sum::<f64>().sqrt();
    format!(
        "#version 330 compatibility\n{header}#info {}\n#include \"DE-Raytracer.frag\"\n#group {}\n\n{body}
float DE(vec3 p) {{
    return distance_estimate(p);
}}

#preset Default
FOV = {}
Eye = {}
Target = {}
Up = {}
MaxDistance = {}
#endpreset
",
        composer.graph.summary.replace(['\n', '\r'], " "),
        composer.graph.name,
        (camera.fov / 2.0).tan(),
        vector(camera.position),
        vector(camera.target),
        vector(camera.up),
        distance * 4.0 + 10.0,
    )
}

//! Fragmentarium's shaders (`.frag`).
//!
//! The formula itself is GLSL that anybody may have changed, so it is not read but recognised: by the file's name, by the
//! names of included files, or by uniforms that stand together in one formula only ([`Table::fragmentarium`]). Values come
//! from a preset, else from the sliders' defaults. `FOV` is the tangent of half the angle from bottom to top, times 1: with
//! 0.4 the picture's height at distance 1 is 0.8.

use super::ask::Ask;
use super::shader::Shader;
use super::table::{Adds, Row, Table};
use super::text::{GraphText, as_name, sequence};
use super::value::{written, written_vector};
use super::{Imported, Lost, LostKind};
use crate::diag::{Diagnostic, Diagnostics, SourceId, Sources};
use crate::graph::Camera;

/// Uniforms of the ray tracers: light, colour and quality.
const TRACER: &[&str] = &[
    "FocalPlane",
    "Aperture",
    "Gamma",
    "ToneMapping",
    "Exposure",
    "Brightness",
    "Contrast",
    "Saturation",
    "GaussianWeight",
    "AntiAliasScale",
    "AntiAlias",
    "Detail",
    "DetailAO",
    "FudgeFactor",
    "MaxRaySteps",
    "MaxDistance",
    "BoundingSphere",
    "Dither",
    "NormalBackStep",
    "AO",
    "Specular",
    "SpecularExp",
    "SpecularMax",
    "SpotLight",
    "SpotLightDir",
    "CamLight",
    "CamLightMin",
    "Glow",
    "GlowMax",
    "Fog",
    "HardShadow",
    "ShadowSoft",
    "Reflection",
    "DebugSun",
    "BaseColor",
    "OrbitStrength",
    "X",
    "Y",
    "Z",
    "R",
    "BackgroundColor",
    "GradientBackground",
    "CycleColors",
    "Cycles",
    "EnableFloor",
    "FloorNormal",
    "FloorHeight",
    "FloorColor",
    "EquiRectangular",
    "AutoFocus",
    "ColorIterations",
    "Vignette",
    "Bloom",
    "BloomIntensity",
    "BloomPow",
    "BloomTaps",
    "BloomStrong",
    "DepthToAlpha",
    "ShowDepth",
    "Samples",
    "Stratify",
    "DirectionalLight",
    "ShadowOnly",
];

/// Makes a graph file of the shader in `id`, whose file is called `name`. Returns nothing when `d` has errors.
pub fn import(
    sources: &Sources,
    id: SourceId,
    name: &str,
    preset: Option<&str>,
    d: &mut Diagnostics,
) -> Option<Imported> {
    let mut shader = Shader::read(sources, id, d);
    if shader.uniforms.is_empty() && shader.includes.is_empty() && !d.has_errors() {
        let message = "this is not a shader of Fragmentarium: it has neither includes nor uniforms with sliders";
        d.push(
            Diagnostic::error(message)
                .label(sources.span_at(id, 1, 1), "expected lines such as `uniform float Scale; slider[0,2,4]`")
                .help("plain GLSL cannot be imported; write the formula as a step, see docs/formulas.md"),
        );
    }
    let table = Table::fragmentarium();
    let row = recognised(&table, &shader, name);
    if row.is_none() && !d.has_errors() {
        let known: Vec<&str> = table.formulas.iter().map(|row| row.name.as_str()).collect();
        d.push(
            Diagnostic::error("the formula of this shader is not among those that are known here")
                .label(sources.span_at(id, 1, 1), "neither its name nor its uniforms are those of a known formula")
                .help(format!("known formulas: {}", known.join(", ")))
                .help("a file is recognised by its name, such as Mandelbulb.frag, or by its uniforms"),
        );
    }
    shader.choose(preset, d);
    let graph = graph(&table, row?, &shader, name, d);
    let lost = shader.unasked().into_iter().map(lost).collect();
    (!d.has_errors()).then(|| Imported { text: graph.write(), lost })
}

/// The row of a file: by its name, the names of what it includes, or the uniforms of a row, all of them.
fn recognised<'t>(table: &'t Table, shader: &Shader, name: &str) -> Option<&'t Row> {
    let stem = |name: &str| as_name(name.rsplit('/').next().unwrap_or(name).trim_end_matches(".frag"));
    let names: Vec<String> =
        std::iter::once(name.to_lowercase()).chain(shader.includes.iter().cloned()).map(|n| stem(&n)).collect();
    let has = |uniform: &String| shader.uniforms.iter().any(|given| given.name == *uniform);
    let by_name = table.formulas.iter().find(|row| row.files.iter().any(|file| names.contains(file)));
    by_name.or_else(|| table.formulas.iter().find(|row| !row.uniforms.is_empty() && row.uniforms.iter().all(has)))
}

fn graph(table: &Table, row: &Row, shader: &Shader, name: &str, d: &mut Diagnostics) -> GraphText {
    let expanded = table.expand(row, "", shader, d);
    let node = as_name(&row.name);
    let mut graph = GraphText {
        comment: vec![format!("Imported from {name} (Fragmentarium).")],
        summary: format!("{}, with the values of {name}.", row.name),
        source: format!("{name}, a shader of Fragmentarium"),
        output: node.clone(),
        ..GraphText::default()
    };
    let help = |param: &str| format!("{}: {}", row.name, param.replace('_', " "));
    graph.params.extend(expanded.params.iter().map(|(param, value)| (param.clone(), *value, help(param))));
    graph.nodes.push((node, sequence(&expanded.steps)));
    graph.settings.push(format!("constant: {}", constant(row, shader, d)));
    graph.settings.push(format!("escape_radius: {}", written(expanded.bailout.clamp(1e-3, 1e6))));
    let iterations = expanded.iterations.unwrap_or(12.0).round().clamp(1.0, 10_000.0);
    graph.settings.push(format!("max_iterations: {iterations}"));
    if !row.estimate.is_empty() {
        graph.settings.push(format!("estimate: ({})", row.estimate));
    }
    graph.camera = camera(shader, d);
    graph
}

fn constant(row: &Row, shader: &Shader, d: &mut Diagnostics) -> String {
    match row.constant {
        Adds::Nothing => "Off".into(),
        Adds::Always => "Mandelbrot".into(),
        Adds::Point => {
            // A four-component constant is that of a quaternion, whose w the slice cannot hold.
            let julia = shader.vector("JuliaC", [0.0; 3], d);
            match shader.switch("Julia", false, d) {
                true => format!("Julia({})", written_vector(&julia)),
                false => "Mandelbrot".into(),
            }
        }
    }
}

/// The camera of the preset; none where it has no eye.
fn camera(shader: &Shader, d: &mut Diagnostics) -> Option<Camera> {
    let fov = shader.number("FOV", 0.4, d);
    let position = shader.vector("Eye", [0.0, 0.0, -5.0], d);
    let target = shader.vector("Target", [0.0; 3], d);
    let up = shader.vector("Up", [0.0, 1.0, 0.0], d);
    shader.given("Eye").map(|_| Camera { position, target, up, fov: 2.0 * fov.atan() })
}

fn lost(given: &super::shader::Given) -> Lost {
    let is_tracer = TRACER.contains(&given.name.as_str());
    let kind = if is_tracer { LostKind::Look } else { LostKind::Shape };
    Lost { kind, what: format!("{} = {}", given.name, given.text), why: String::new() }
}

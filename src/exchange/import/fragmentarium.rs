//! Fragmentarium's shaders (`.frag`).
//!
//! The formula is GLSL that anybody may have changed, so names say nothing: the code is run at some points and compared with
//! the formulas of [`Table::fragmentarium`] (`evidence`). What is none of them is refused, unless the user says what it
//! is. Values come from a preset, else from the sliders' defaults. `FOV` is the tangent of half the angle from bottom to top,
//! times 1: with 0.4 the picture's height at distance 1 is 0.8.

use super::ask::Ask;
use super::evidence::{self, Measure};
use super::glsl::{self, Machine};
use super::shader::{Given, Shader};
use super::table::{Adds, Row, Table};
use super::text::{GraphText, as_name, sequence};
use super::value::{Value, written, written_vector};
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

/// The user's options for a shader.
#[derive(Clone, Copy, Default, Debug)]
pub struct Request<'a> {
    /// Name of the preset whose values are taken.
    pub preset: Option<&'a str>,
    /// Name of the formula that the shader is taken for, whatever its code says.
    pub taken_for: Option<&'a str>,
}

/// Makes a graph file of the shader in `id`, whose file is called `name`; `measure` computes our side of the comparison. Returns
/// nothing when `d` has errors.
pub fn import(
    sources: &Sources,
    (id, name): (SourceId, &str),
    request: Request,
    measure: Measure,
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
    shader.choose(request.preset, d);
    if d.has_errors() {
        return None;
    }
    let table = Table::fragmentarium();
    let (row, is_turned, note) = match request.taken_for {
        Some(wanted) => (named(&table, wanted, d)?, false, not_read(wanted)),
        None => recognised(&table, &shader, (sources, id, name), measure, d)?,
    };
    let asked = Asked { shader: &shader, is_turned };
    let mut graph = graph(&table, row, &asked, name, d);
    graph.comment.push(note.clone());
    graph.camera = camera(&shader, d);
    let is_proven = request.taken_for.is_none();
    let mut lost: Vec<Lost> = shader.unasked().into_iter().map(|given| lost(given, is_proven)).collect();
    lost.extend(shader.animations.iter().map(|line| Lost {
        kind: LostKind::Look,
        what: line.clone(),
        why: "an easing curve: animations are not carried over".into(),
    }));
    (!d.has_errors()).then(|| Imported { text: graph.write(), lost, notes: vec![note] })
}

fn not_read(name: &str) -> String {
    format!("warning: taken for {name} only because of --as; the code of the shader was not read")
}

/// The row that the user names.
fn named<'t>(table: &'t Table, wanted: &str, d: &mut Diagnostics) -> Option<&'t Row> {
    let name = as_name(wanted);
    let found = table.formulas.iter().find(|row| as_name(&row.name) == name || row.files.contains(&name));
    if found.is_none() {
        let known: Vec<String> = table.formulas.iter().map(|row| as_name(&row.name)).collect();
        let diagnostic =
            Diagnostic::error(format!("`--as {wanted}` names no formula of Fragmentarium that is known here"));
        let diagnostic = diagnostic.did_you_mean(&name, known.iter().map(String::as_str));
        d.push(diagnostic.help(format!("known formulas: {}", known.join(", "))));
    }
    found
}

/// The row whose map is the shader's, whether its angles turn the other way, and a line that says so.
fn recognised<'t>(
    table: &'t Table,
    shader: &Shader,
    (sources, id, name): (&Sources, SourceId, &str),
    measure: Measure,
    d: &mut Diagnostics,
) -> Option<(&'t Row, bool, String)> {
    let points = evidence::points();
    let code = sources.text(id);
    let runs = glsl::tokens(code).and_then(|tokens| glsl::parse(&tokens)).and_then(|program| {
        if !program.functions.contains_key("DE") {
            return Err(
                "there is no function `float DE(vec3)`, so it draws no distance estimate of a solid".to_string()
            );
        }
        evidence::run(&mut Machine::new(&program, &uniforms(shader))?, &points)
    });
    let place = code.lines().position(|line| line.contains("DE(")).map_or(1, |row| row + 1);
    let label = |diagnostic: Diagnostic, text: String| diagnostic.label(sources.span_at(id, place, 1), text);
    let runs = match runs {
        Ok(runs) => runs,
        Err(why) => {
            let message = "the code of this shader cannot be run here, so it is not known which formula it draws";
            d.push(how_to_go_on(table, label(Diagnostic::error(message), why)));
            let is_default = |given: &&Given| shader.peek(&given.name).is_some_and(|found| found.span == given.span);
            let broken = shader.uniforms.iter().filter(is_default).filter_map(|given| given.broken.as_deref());
            d.extend(broken.cloned());
            return None;
        }
    };
    let mut nearest = String::new();
    for row in &table.formulas {
        for is_turned in [false, true] {
            let asked = Asked { shader, is_turned };
            let mut ignored = Diagnostics::default();
            let text = graph(table, row, &asked, name, &mut ignored).write();
            let has_angles = row.settings().iter().any(|setting| is_angle(setting));
            if ignored.has_errors() || (is_turned && !has_angles) {
                continue;
            }
            let compared = measure(&text, &points).and_then(|ours| evidence::compare(&runs, &ours, &points));
            match compared {
                Ok(matches) => {
                    let note = format!("recognised as {}: {matches} places of orbits are the same", row.name);
                    return Some((row, is_turned, note));
                }
                Err(why) if why.starts_with("the orbits") => nearest = format!("of {}: {why}", row.name),
                Err(_) => {}
            }
        }
    }
    let message = "the formula of this shader is none that is known here: its code computes something else";
    let why = if nearest.is_empty() { "run and compared, orbit by orbit".to_string() } else { nearest };
    d.push(how_to_go_on(table, label(Diagnostic::error(message), why)));
    None
}

fn how_to_go_on(table: &Table, diagnostic: Diagnostic) -> Diagnostic {
    let known: Vec<String> = table.formulas.iter().map(|row| as_name(&row.name)).collect();
    diagnostic
        .help(format!("known formulas: {}", known.join(", ")))
        .help("`--as NAME` takes the preset's values for one of them without reading the code")
        .help("to draw the shader's own formula, write it as a step: see docs/formulas.md")
}

/// Types, names and values of all uniforms that have one.
fn uniforms(shader: &Shader) -> Vec<(String, String, glsl::Value)> {
    let value = |(name, kind): &(String, String)| {
        let given = shader.peek(name).filter(|given| given.broken.is_none())?;
        let parts: Option<Vec<f64>> = given.text.split([',', ' ']).filter(|part| !part.is_empty()).map(part).collect();
        let value = glsl::Value::construct(kind, &[glsl::Value::Vector(parts?)]).ok()?;
        Some((kind.clone(), name.clone(), value))
    };
    shader.types.iter().filter_map(value).collect()
}

fn part(text: &str) -> Option<f64> {
    match text {
        "true" => Some(1.0),
        "false" => Some(0.0),
        _ => super::value::number(text),
    }
}

/// A shader's values, with its angles the other way round where `z * turn` stands for `turn * z`.
struct Asked<'a> {
    shader: &'a Shader,
    is_turned: bool,
}

fn is_angle(name: &str) -> bool {
    name.contains("Angle")
}

impl Ask for Asked<'_> {
    fn ask(&self, name: &str, default: &Value, d: &mut Diagnostics) -> Value {
        match self.shader.ask(name, default, d) {
            Value::Number(angle) if self.is_turned && is_angle(name) => Value::Number(-angle),
            value => value,
        }
    }
}

fn graph(table: &Table, row: &Row, shader: &Asked, name: &str, d: &mut Diagnostics) -> GraphText {
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
    graph.settings.push(format!("constant: {}", constant(row, shader.shader, d)));
    graph.settings.push(format!("escape_radius: {}", written(expanded.bailout.clamp(1e-3, 1e6))));
    let iterations = expanded.iterations.unwrap_or(12.0).round().clamp(1.0, 10_000.0);
    graph.settings.push(format!("max_iterations: {iterations}"));
    if !row.estimate.is_empty() {
        graph.settings.push(format!("estimate: ({})", row.estimate));
    }
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

/// The camera of the preset; none if it has no eye.
fn camera(shader: &Shader, d: &mut Diagnostics) -> Option<Camera> {
    let fov = shader.number("FOV", 0.4, d);
    let position = shader.vector("Eye", [0.0, 0.0, -5.0], d);
    let target = shader.vector("Target", [0.0; 3], d);
    let up = shader.vector("Up", [0.0, 1.0, 0.0], d);
    shader.given("Eye").map(|_| Camera::new(position, target, up, 2.0 * fov.atan()))
}

/// What becomes of a value that nothing reads: where the map has been compared, it bears on nothing but looks.
fn lost(given: &Given, is_proven: bool) -> Lost {
    let is_look = is_proven || TRACER.contains(&given.name.as_str());
    let kind = if is_look { LostKind::Look } else { LostKind::Shape };
    Lost { kind, what: format!("{} = {}", given.name, given.text), why: String::new() }
}

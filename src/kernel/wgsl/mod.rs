//! WGSL: one complete module for each kernel.
//!
//! In come a [`Kernel`] and its arena; out comes the text of a module ([`write()`]): a struct and a function for each
//! [`Function`], then the fixed loops from `shaders/`, whose open slots (`$NAME`) are filled. Nothing here fails; the
//! text of any kernel passes [`validate`], which back ends call before a driver sees it. Temporaries are named after the
//! operation and its surroundings, so a small change of a formula is a small change of the text.
//!
//! ```
//! use bulbfold::expr::{Arena, Function, Port, Type};
//! use bulbfold::kernel::{Kernel, wgsl};
//! let arena = Arena::default();
//! let mut double = Function::new("double", vec![Port::new("z", Type::V3)]);
//! double.output("z", arena.input(0, Type::V3) * 2.0);
//! let text = wgsl::write(&arena, &Kernel::Map(double));
//! assert!(text.contains("fn double(z: vec3<f32>) -> double_out"));
//! wgsl::validate(&text).unwrap();
//! ```

mod function;
mod number;
#[cfg(test)]
pub(crate) mod tests;

use std::fmt::Write as _;

use function::{Helpers, members, write_function, write_struct};
use number::{identifier, scalar, suffix};

use super::records::{MarchState, Query, Ray, UNKNOWN};
use super::{BackendError, Estimator, Kernel, March, Orbit, Status};
use crate::expr::{Arena, Function, Port, Type};
use crate::graph::Schedule;

/// Invocations in a workgroup.
pub const WORKGROUP: u32 = 64;
/// One invocation of so many counts its estimates, which the others are taken to make too: counting costs time.
pub const SAMPLED: u32 = 16;
/// Rays of a march that stay neighbours (eight workgroups: what is read together stays together), and the hands that such
/// stacks are dealt out to.
const STACK: u32 = 8 * WORKGROUP;
const HANDS: u32 = 29;
/// Binding of a kernel's uniforms.
pub const UNIFORMS: u32 = 5;
/// Binding of the numbers that a kernel looks up.
pub const TABLES: u32 = 6;

/// The module of a kernel. Its entry point is [`entry_point`]; columns are bound as `shaders/prelude.wgsl` says.
pub fn write(arena: &Arena, kernel: &Kernel) -> String {
    let mut writer = Module { arena, body: String::new(), helpers: Helpers::new() };
    match kernel {
        Kernel::Map(function) => writer.map(function),
        Kernel::Estimate(estimator) => writer.estimates(estimator),
        Kernel::March(march) => writer.march(march),
    }
    let mut text = include_str!("../../../shaders/prelude.wgsl").to_string();
    text.push('\n');
    write_uniforms(&mut text, kernel.uniforms(arena));
    write_tables(&mut text, arena, &kernel.tables(arena));
    write_helpers(&mut text, &writer.helpers);
    text.push_str(&writer.body);
    text
}

/// The function `estimate` of an estimator and all that it calls, without buffers and entry points.
pub fn write_estimate(arena: &Arena, estimator: &Estimator) -> String {
    let mut writer = Module { arena, body: String::new(), helpers: Helpers::new() };
    writer.estimate(estimator);
    let mut text = String::new();
    write_helpers(&mut text, &writer.helpers);
    text.push_str(&writer.body);
    text
}

/// Name of a kernel's entry point.
pub fn entry_point(kernel: &Kernel) -> &'static str {
    match kernel {
        Kernel::Map(_) => "map",
        Kernel::Estimate(_) => "estimates",
        Kernel::March(_) => "march",
    }
}

/// Parses and validates a module. The error is [`BackendError::InvalidWgsl`] and shows the place.
pub fn validate(wgsl: &str) -> Result<(naga::Module, naga::valid::ModuleInfo), BackendError> {
    let module = naga::front::wgsl::parse_str(wgsl)
        .map_err(|error| BackendError::InvalidWgsl(error.emit_to_string_with_path(wgsl, "kernel.wgsl")))?;
    let mut validator =
        naga::valid::Validator::new(naga::valid::ValidationFlags::all(), naga::valid::Capabilities::empty());
    let info = validator
        .validate(&module)
        .map_err(|error| BackendError::InvalidWgsl(error.emit_to_string_with_path(wgsl, "kernel.wgsl")))?;
    Ok((module, info))
}

/// Replaces every `$NAME` of a template; more than one line of a value keeps the slot's indentation.
fn fill(template: &str, slots: &[(&str, String)]) -> String {
    let mut text = String::with_capacity(template.len() * 2);
    let mut rest = template;
    while let Some(at) = rest.find('$') {
        text.push_str(&rest[..at]);
        rest = &rest[at + 1..];
        let end = rest.find(|c: char| !c.is_ascii_uppercase() && c != '_').unwrap_or(rest.len());
        let name = rest[..end].trim_end_matches('_');
        let value = slots.iter().find(|(slot, _)| *slot == name).map_or("", |(_, value)| value);
        let line = &text[text.rfind('\n').map_or(0, |i| i + 1)..];
        let indent = " ".repeat(line.len() - line.trim_start().len());
        text.push_str(&value.replace('\n', &format!("\n{indent}")));
        rest = &rest[name.len()..];
    }
    text.push_str(rest);
    text
}

/// Writes the list of the kernel's uniforms, where it has any.
fn write_uniforms(text: &mut String, count: usize) {
    if count > 0 {
        let ports: Vec<Port> = (0..count).map(|number| Port::new(format!("u{number}"), Type::F)).collect();
        write_struct(text, "Uniforms", &ports);
        let _ = writeln!(text, "@group(0) @binding({UNIFORMS}) var<uniform> uniforms: Uniforms;\n");
    }
}

/// Writes the buffer of the kernel's tables and where each begins in it, where it has any.
fn write_tables(text: &mut String, arena: &Arena, numbers: &[u16]) {
    let mut first = 0;
    for number in numbers {
        let _ = writeln!(text, "const table_{number}: u32 = {first}u;");
        first += arena.table(*number).numbers().len();
    }
    if first > 0 {
        let _ = writeln!(text, "@group(0) @binding({TABLES}) var<storage, read> tables: array<f32>;\n");
    }
}

/// Writes the helpers that are used, and those that they use.
fn write_helpers(text: &mut String, used: &Helpers) {
    let template = include_str!("../../../shaders/operators.wgsl");
    let blocks: Vec<(&str, &str)> = template
        .split("\n\n")
        .filter_map(|block| {
            let name = block.split_once("fn bf_")?.1.split_once("_$T")?.0;
            Some((name, block.trim_end()))
        })
        .collect();
    let mut wanted = used.clone();
    // Helpers call those above them only, so one pass from the last to the first finds all.
    for (name, block) in blocks.iter().rev() {
        for width in [1, 3, 4] {
            if wanted.contains(&(name.to_string(), width)) {
                let called = blocks.iter().filter(|(other, _)| block.contains(&format!("bf_{other}_$T(")));
                wanted.extend(called.map(|(other, _)| (other.to_string(), width)));
            }
        }
    }
    for (name, block) in blocks {
        for ty in [Type::F, Type::V3, Type::V4] {
            if wanted.contains(&(name.to_string(), ty.width)) {
                // A helper's name holds a short form of the type, everything else the type itself.
                let named = block.replace("_$T(", &format!("_{}(", suffix(ty)));
                text.push_str(&fill(&named, &[("T", ty.wgsl().to_string())]));
                text.push_str("\n\n");
            }
        }
    }
}

struct Module<'a> {
    arena: &'a Arena,
    body: String,
    helpers: Helpers,
}

impl Module<'_> {
    /// Writes a function and the struct `<name>_out` of its results; returns its name.
    fn function(&mut self, function: &Function) -> String {
        let name = identifier(&function.name);
        let result = format!("{name}_out");
        write_struct(&mut self.body, &result, &function.output_ports());
        write_function(&mut self.body, self.arena, function, &result, &mut self.helpers);
        name
    }

    fn template(&mut self, template: &str, slots: &[(&str, String)]) {
        let mut slots = slots.to_vec();
        slots.push(("WORKGROUP", WORKGROUP.to_string()));
        slots.push(("SAMPLED", SAMPLED.to_string()));
        slots.push(("STACK", STACK.to_string()));
        slots.push(("HANDS", HANDS.to_string()));
        self.body.push_str(&fill(template, &slots));
        self.body.push('\n');
    }

    fn map(&mut self, function: &Function) {
        let name = self.function(function);
        self.template(
            include_str!("../../../shaders/map.wgsl"),
            &[
                ("FUNCTION", name),
                ("LOADS", loads("load", &function.inputs).join(", ")),
                ("STORES", stores("result", &function.output_ports())),
            ],
        );
    }

    fn estimates(&mut self, estimator: &Estimator) {
        self.estimate(estimator);
        let outputs = estimator.combine.output_ports();
        self.template(
            include_str!("../../../shaders/estimates.wgsl"),
            &[
                ("HIT_EPS", Query::COLUMNS.hit_eps.to_string()),
                ("LOADS", loads("load", &Query::ports()).join(", ")),
                ("COLUMNS", Port::scalars(&outputs).to_string()),
                ("STORES", stores("result", &outputs)),
            ],
        );
    }

    /// Writes `estimate` and all that it calls.
    fn estimate(&mut self, estimator: &Estimator) {
        let point = "p, d, h, hit_eps";
        let mut orbits = Vec::new();
        let mut results = vec![point.to_string()];
        let mut iterations = Vec::new();
        for orbit in &estimator.orbits {
            let (name, finish) = self.orbit(orbit);
            let start = format!("{name}_start");
            let end = format!("{name}_end");
            orbits.push(format!("let {start} = {}({point});", identifier(&orbit.init.name)));
            orbits.push(format!("let {end} = iterate_{name}({start});"));
            let mut arguments = prefixed(&format!("{end}.state"), &orbit.state);
            arguments.extend(frozen_of(&start, orbit));
            arguments.push(format!("f32({end}.n)"));
            orbits.push(format!("let {name} = {finish}({});", arguments.join(", ")));
            results.extend(prefixed(&name, &orbit.finish.output_ports()));
            results.push(format!("{end}.inside"));
            results.push(format!("f32({end}.n)"));
            iterations.push(format!("f32({end}.n)"));
        }
        let combine = self.function(&estimator.combine);
        let iterations = if iterations.is_empty() { "0.0".to_string() } else { iterations.join(" + ") };
        self.template(
            include_str!("../../../shaders/estimate.wgsl"),
            &[
                ("ORBITS", orbits.join("\n")),
                ("COMBINE", combine),
                ("RESULTS", results.join(", ")),
                ("ITERATIONS", iterations),
            ],
        );
    }

    /// Writes an orbit's functions and loop; returns its name and that of its `finish`.
    fn orbit(&mut self, orbit: &Orbit) -> (String, String) {
        let name = identifier(&orbit.name);
        let init = self.function(&orbit.init);
        let state = format!("{name}_state");
        let mut ports = orbit.state.clone();
        ports.push(Port::new("escaped", Type::B));
        write_struct(&mut self.body, &state, &ports);
        for item in &orbit.items {
            write_function(&mut self.body, self.arena, item, &state, &mut self.helpers);
        }
        let finish = self.function(&orbit.finish);
        let started = members(&orbit.init.output_ports());
        let mut first: Vec<String> =
            started[..orbit.state.len()].iter().map(|member| format!("start.{member}")).collect();
        first.push("false".into());
        self.template(
            include_str!("../../../shaders/iterate.wgsl"),
            &[
                ("ORBIT", name.clone()),
                ("STATE", state),
                ("START", format!("{init}_out")),
                ("FIRST", first.join(", ")),
                ("MAX_ITERATIONS", orbit.max_iterations.to_string()),
                ("ITERATION", iteration(orbit)),
            ],
        );
        (name, finish)
    }

    fn march(&mut self, march: &March) {
        self.estimate(&march.estimator);
        let locate = self.function(&march.locate);
        let advance = self.function(&march.advance);
        let state = MarchState::ports();
        let mut ray = Vec::new();
        let mut arguments = Vec::new();
        for (load, port) in loads("load", &Ray::ports()).iter().zip(Ray::ports()) {
            ray.push(format!("let ray_{} = {load};", identifier(&port.name)));
            arguments.push(format!("ray_{}", identifier(&port.name)));
        }
        arguments.extend(prefixed("state", &state));
        let locate_arguments = arguments.join(", ");
        let estimated = members(&march.estimator.combine.output_ports());
        arguments.extend(estimated[..2].iter().map(|member| format!("estimated.result.{member}")));
        // t and its front start at the near end; nothing else is known. A ray whose range is empty is over.
        let [missed, running, unknown] = [Status::Miss.code(), Status::RUNNING, UNKNOWN].map(scalar);
        let start = MarchState {
            t: "ray_t_near".to_string(),
            t_front: "ray_t_near".to_string(),
            t_outside: unknown.clone(),
            t_inside: unknown.clone(),
            last_de: unknown,
            status: format!("select({missed}, {running}, ray_t_near < ray_t_far)"),
        };
        self.template(
            include_str!("../../../shaders/march.wgsl"),
            &[
                ("START", start.values().join(", ")),
                ("RAY", ray.join("\n")),
                ("ADVANCE", advance),
                ("STATE", loads("read_state", &state).join(", ")),
                ("LOCATE", locate),
                ("LOCATE_ARGUMENTS", locate_arguments),
                ("ADVANCE_ARGUMENTS", arguments.join(", ")),
                ("STORES", stores("state", &state)),
                ("STEPS", MarchState::WIDTH.to_string()),
            ],
        );
    }
}

/// One iteration: a call of the only item, or a switch over the schedule.
fn iteration(orbit: &Orbit) -> String {
    let mut arguments = prefixed("state", &orbit.state);
    arguments.extend(frozen_of("start", orbit));
    arguments.push("f32(n)".into());
    let arguments = arguments.join(", ");
    let call = |item: usize| format!("state = {}({arguments});", identifier(&orbit.items[item].name));
    if orbit.items.len() == 1 {
        return call(0);
    }
    let Schedule { prefix, cycle } = &orbit.schedule;
    let mut text = match prefix.len() {
        0 => format!("switch n % {}u {{\n", cycle.len()),
        from => format!("switch select(n, {from}u + (n - {from}u) % {}u, n >= {from}u) {{\n", cycle.len()),
    };
    // One case an item: the places in prefix and cycle where it stands.
    let places: Vec<usize> = prefix.iter().chain(cycle).copied().collect();
    for item in 1..orbit.items.len() {
        let at: Vec<String> = (0..places.len()).filter(|&i| places[i] == item).map(|i| format!("{i}u")).collect();
        if !at.is_empty() {
            let _ = writeln!(text, "    case {}: {{ {} }}", at.join(", "), call(item));
        }
    }
    let _ = write!(text, "    default: {{ {} }}\n}}", call(0));
    text
}

/// Members of a struct value.
fn prefixed(value: &str, ports: &[Port]) -> Vec<String> {
    members(ports).iter().map(|member| format!("{value}.{member}")).collect()
}

/// The frozen values of an orbit, which are the last outputs of its `init`.
fn frozen_of(start: &str, orbit: &Orbit) -> Vec<String> {
    prefixed(start, &orbit.init.output_ports()).split_off(orbit.state.len())
}

/// Ports read from columns by the function `load`, in order.
fn loads(load: &str, ports: &[Port]) -> Vec<String> {
    let mut column = 0;
    ports
        .iter()
        .map(|port| {
            let parts: Vec<String> = (0..port.ty.width)
                .map(|_| {
                    column += 1;
                    let value = format!("{load}({}u, i)", column - 1);
                    if port.ty.is_bool { format!("{value} > 0.5") } else { value }
                })
                .collect();
            if port.ty.width == 1 { parts[0].clone() } else { format!("{}({})", port.ty.wgsl(), parts.join(", ")) }
        })
        .collect()
}

/// Members of a struct value written to columns, in order.
fn stores(value: &str, ports: &[Port]) -> String {
    let mut lines = Vec::new();
    for (port, member) in ports.iter().zip(prefixed(value, ports)) {
        for i in 0..usize::from(port.ty.width) {
            let part =
                if port.ty.width == 1 { member.clone() } else { format!("{member}.{}", ["x", "y", "z", "w"][i]) };
            let number = if port.ty.is_bool { format!("f32({part})") } else { part };
            lines.push(format!("store({}u, i, {number});", lines.len()));
        }
    }
    lines.join("\n")
}

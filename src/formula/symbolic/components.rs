//! Components of vectors and their combinations: `z.x`, `z.xzy`, `z.xy`.

use std::rc::Rc;

use rhai::{Dynamic, Engine, NativeCallContext};

use super::{Fallible, Part, Symbol, Tracer, to_dynamic, to_part};

/// Names of components, in order.
const LETTERS: &str = "xyzw";

/// The components that a property names, where all its letters are some.
pub(in crate::formula) fn swizzle(name: &str) -> Option<Vec<u8>> {
    let letters = name.chars().map(|letter| LETTERS.find(letter).map(|i| i as u8)).collect::<Option<Vec<u8>>>()?;
    (1..=4).contains(&letters.len()).then_some(letters)
}

pub(super) fn register(engine: &mut Engine, tracer: &Rc<Tracer>) {
    for name in ["x", "y", "z", "w", "xyz"] {
        let get = tracer.clone();
        engine.register_get(name, move |context: NativeCallContext, v: &mut Symbol| read(&get, &context, v, name));
        let set = tracer.clone();
        engine.register_set(name, move |context: NativeCallContext, v: &mut Symbol, value: Dynamic| {
            write(&set, &context, v, name, &value)
        });
    }
    // All other properties come here.
    let get = tracer.clone();
    engine.register_indexer_get(move |context: NativeCallContext, v: &mut Symbol, name: &str| {
        read(&get, &context, v, name)
    });
    let set = tracer.clone();
    engine.register_indexer_set(move |context: NativeCallContext, v: &mut Symbol, name: &str, value: Dynamic| {
        write(&set, &context, v, name, &value)
    });
}

fn read(tracer: &Tracer, context: &NativeCallContext, v: &Symbol, name: &str) -> Fallible<Dynamic> {
    let arena = tracer.mark(context)?;
    let letters = letters(v, name)?;
    if letters == [0, 1, 2] && !v.is_pair {
        return Ok(to_dynamic(&arena, v.expr().xyz()));
    }
    let parts: Vec<_> = letters.into_iter().map(|i| v.expr().component(i)).collect();
    Ok(Part::of(&parts).to_dynamic(&arena))
}

fn write(tracer: &Tracer, context: &NativeCallContext, v: &mut Symbol, name: &str, value: &Dynamic) -> Fallible<()> {
    let arena = tracer.mark(context)?;
    let letters = letters(v, name)?;
    let value = to_part(&arena, value)?;
    if value.width() as usize != letters.len() || value.expr.ty().is_bool {
        let expected = if letters.len() == 1 { "a number".into() } else { format!("a vec{}", letters.len()) };
        return Err(format!("`{name}` needs {expected}, found a {}", value.type_name()).into());
    }
    if letters.iter().enumerate().any(|(i, letter)| letters[..i].contains(letter)) {
        return Err(format!("`{name}` names a component twice, so it cannot be set").into());
    }
    let mut parts = Part { expr: v.expr(), is_pair: v.is_pair }.components();
    for (letter, part) in letters.into_iter().zip(value.components()) {
        parts[letter as usize] = part;
    }
    let id = Part::of(&parts).expr.id;
    v.id = id;
    Ok(())
}

/// The components of a value that a property names.
fn letters(v: &Symbol, name: &str) -> Fallible<Vec<u8>> {
    let part = Part { expr: v.expr(), is_pair: v.is_pair };
    let width = if part.width() > 1 { part.width() } else { 0 };
    let found = swizzle(name).filter(|letters| letters.iter().all(|letter| *letter < width));
    found.ok_or_else(|| {
        let ty = part.type_name();
        match width {
            0 => format!("a {ty} has no component `{name}`: it is no vector").into(),
            _ => {
                let all: Vec<String> = LETTERS.chars().take(width as usize).map(|letter| letter.to_string()).collect();
                format!("a {ty} has no component `{name}`: it has {}, and combinations of them", all.join(", ")).into()
            }
        }
    })
}

//! Components of vectors and their combinations: `z.x`, `z.xzy`, `z.xy`.

use rhai::{Dynamic, Engine, NativeCallContext};

use super::{Fallible, Part, Symbol, mark, to_dynamic, to_part};

/// Names of components, in order.
const LETTERS: &str = "xyzw";

/// The components that a property names, where all its letters are some.
pub(in crate::formula) fn swizzle(name: &str) -> Option<Vec<u8>> {
    let letters = name.chars().map(|letter| LETTERS.find(letter).map(|i| i as u8)).collect::<Option<Vec<u8>>>()?;
    (1..=4).contains(&letters.len()).then_some(letters)
}

pub(super) fn register(engine: &mut Engine) {
    for name in ["x", "y", "z", "w", "xyz"] {
        engine.register_get(name, move |context: NativeCallContext, v: &mut Symbol| read(&context, v, name));
        engine.register_set(name, move |context: NativeCallContext, v: &mut Symbol, value: Dynamic| {
            write(&context, v, name, &value)
        });
    }
    // All other properties come here.
    engine.register_indexer_get(|context: NativeCallContext, v: &mut Symbol, name: &str| read(&context, v, name));
    engine.register_indexer_set(|context: NativeCallContext, v: &mut Symbol, name: &str, value: Dynamic| {
        write(&context, v, name, &value)
    });
}

fn read(context: &NativeCallContext, v: &Symbol, name: &str) -> Fallible<Dynamic> {
    let arena = mark(context)?;
    let part = v.part(&arena)?;
    let letters = letters(part, name)?;
    if letters == [0, 1, 2] && !part.is_pair {
        return Ok(to_dynamic(part.expr.xyz()));
    }
    let parts: Vec<_> = letters.into_iter().map(|i| part.expr.component(i)).collect();
    Ok(Part::of(&parts).to_dynamic())
}

fn write(context: &NativeCallContext, v: &mut Symbol, name: &str, value: &Dynamic) -> Fallible<()> {
    let arena = mark(context)?;
    let part = v.part(&arena)?;
    let letters = letters(part, name)?;
    let value = to_part(&arena, value)?;
    if value.width() as usize != letters.len() || value.expr.ty().is_bool {
        let expected = if letters.len() == 1 { "a number".into() } else { format!("a vec{}", letters.len()) };
        return Err(format!("`{name}` needs {expected}, found a {}", value.type_name()).into());
    }
    if letters.iter().enumerate().any(|(i, letter)| letters[..i].contains(letter)) {
        return Err(format!("`{name}` names a component twice, so it cannot be set").into());
    }
    let mut parts = part.components();
    for (letter, part) in letters.into_iter().zip(value.components()) {
        parts[letter as usize] = part;
    }
    v.id = Part::of(&parts).expr.id;
    Ok(())
}

/// The components of a value that a property names.
fn letters(part: Part<'_>, name: &str) -> Fallible<Vec<u8>> {
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

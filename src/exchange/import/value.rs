//! Values of settings: truth, numbers, and lists of numbers.

use rhai::Dynamic;

/// A value of a setting or uniform.
#[derive(Clone, PartialEq, Debug)]
pub enum Value {
    /// A switch.
    Bool(bool),
    /// A number.
    Number(f64),
    /// Two to four numbers.
    Vector(Vec<f64>),
    /// One word of a list, or its place in that list.
    Word(String),
}

impl Value {
    /// Reads `text` as the kind of value that `like` is: numbers with decimal points or commas, `true`, `false`, 0 and 1,
    /// or as many numbers as `like` has. The error says what was expected.
    pub fn read_like(text: &str, like: &Value) -> Result<Value, String> {
        match like {
            Value::Bool(_) => match text {
                "true" | "1" => Ok(Value::Bool(true)),
                "false" | "0" => Ok(Value::Bool(false)),
                _ => Err("true or false".into()),
            },
            Value::Number(_) => number(text).map(Value::Number).ok_or_else(|| "a number".into()),
            Value::Vector(parts) => {
                let found: Option<Vec<f64>> = text.split_whitespace().map(number).collect();
                match found {
                    Some(found) if found.len() == parts.len() => Ok(Value::Vector(found)),
                    _ => Err(format!("{} numbers", parts.len())),
                }
            }
            Value::Word(_) => Ok(Value::Word(text.to_string())),
        }
    }

    /// Reads a text whose form says what it is, as tables write defaults: words stand in single quotes.
    pub fn read(text: &str) -> Option<Value> {
        let numbers: Option<Vec<f64>> = text.split_whitespace().map(number).collect();
        match (text, numbers) {
            ("true", _) => Some(Value::Bool(true)),
            ("false", _) => Some(Value::Bool(false)),
            (_, Some(numbers)) if numbers.len() == 1 => Some(Value::Number(numbers[0])),
            (_, Some(numbers)) if (2..=4).contains(&numbers.len()) => Some(Value::Vector(numbers)),
            (text, _) => {
                let word = text.strip_prefix('\'').and_then(|rest| rest.strip_suffix('\''))?;
                Some(Value::Word(word.to_string()))
            }
        }
    }

    /// The value as a variable of expressions: vectors have the parts `x`, `y`, `z` and `w`.
    pub fn dynamic(&self) -> Dynamic {
        match self {
            Value::Bool(value) => (*value).into(),
            Value::Number(value) => (*value).into(),
            Value::Vector(parts) => {
                let mut map = rhai::Map::new();
                for (name, part) in ["x", "y", "z", "w"].iter().zip(parts) {
                    map.insert((*name).into(), (*part).into());
                }
                map.into()
            }
            Value::Word(word) => word.clone().into(),
        }
    }
}

/// A finite number with a decimal point or comma.
pub fn number(text: &str) -> Option<f64> {
    text.replace(',', ".").parse().ok().filter(|number: &f64| number.is_finite())
}

/// A number as graph files write it.
pub fn written(number: f64) -> String {
    format!("{:?}", number + 0.0)
}

/// Numbers in brackets, as graph files write vectors.
pub fn written_vector(parts: &[f64]) -> String {
    let parts: Vec<String> = parts.iter().map(|part| written(*part)).collect();
    format!("({})", parts.join(", "))
}

/// The result of an expression as graph files write it; nothing for values that they cannot hold.
pub fn written_dynamic(value: &Dynamic) -> Option<String> {
    if let Some(map) = value.read_lock::<rhai::Map>() {
        let parts: Option<Vec<f64>> =
            ["x", "y", "z", "w"].iter().filter_map(|part| map.get(*part)).map(|part| part.as_float().ok()).collect();
        return parts.map(|parts| written_vector(&parts));
    }
    if let Ok(number) = value.as_float() {
        return number.is_finite().then(|| written(number));
    }
    if let Ok(number) = value.as_int() {
        return Some(number.to_string());
    }
    if let Ok(truth) = value.as_bool() {
        return Some(truth.to_string());
    }
    value.clone().into_string().ok()
}

#[cfg(test)]
mod tests {
    use super::{Value, written};

    #[test]
    fn points_and_commas_are_the_same() {
        let like = Value::Vector(vec![0.0; 3]);
        let expected = Ok(Value::Vector(vec![-0.75, 1e-3, 2.0]));
        assert_eq!(Value::read_like("-0.75 1e-3 2", &like), expected);
        assert_eq!(Value::read_like("-0,75 1e-3 2", &like), expected);
        assert_eq!(Value::read_like("1 2", &like), Err("3 numbers".into()));
        assert_eq!(Value::read_like("nan", &Value::Number(0.0)), Err("a number".into()));
        assert_eq!(Value::read_like("1", &Value::Bool(false)), Ok(Value::Bool(true)));
    }

    #[test]
    fn the_form_of_a_default_says_what_it_is() {
        assert_eq!(Value::read("0 0 1"), Some(Value::Vector(vec![0.0, 0.0, 1.0])));
        assert_eq!(Value::read("true"), Some(Value::Bool(true)));
        assert_eq!(Value::read("9"), Some(Value::Number(9.0)));
        assert_eq!(Value::read("none"), None);
        assert_eq!(Value::read("'none'"), Some(Value::Word("none".into())));
        assert_eq!(Value::read_like("type3", &Value::Word("type1".into())), Ok(Value::Word("type3".into())));
        assert_eq!(written(-0.0), "0.0");
    }
}

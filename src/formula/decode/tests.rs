//! Reads texts, decodes them, and compares the messages as people see them.

use super::*;
use crate::diag::Sources;
use crate::formula::ron::{Limits, read_ron};
use crate::formula::value::Name;

/// Reads `text`, hands its value to `decode`, and gives back its result and all messages.
fn decode<T>(text: &str, decode: impl FnOnce(&Value, &mut Diagnostics) -> T) -> (T, String) {
    let mut sources = Sources::default();
    let id = sources.add("a.ron", text);
    let mut diagnostics = Diagnostics::default();
    let value = read_ron(&sources, id, &Limits::default(), &mut diagnostics);
    let value = value.unwrap_or(Value::new(Span::NONE, ValueKind::Invalid));
    let out = decode(&value, &mut diagnostics);
    (out, diagnostics.render(&sources, false))
}

/// Titles of the messages.
fn titles(messages: &str) -> Vec<&str> {
    messages.lines().filter(|line| line.starts_with("error: ")).map(|line| &line[7..]).collect()
}

/// Title of the one message of reading `text` as a `T`.
fn refusal<T: FromValue>(text: &str) -> String {
    let (read, messages) = decode(text, |v, d| T::from_value(v, d).is_some());
    assert!(!read, "{text}");
    titles(&messages).join("; ")
}

#[test]
fn values_become_types() {
    assert_eq!(decode("-1.5", f64::from_value).0, Some(-1.5));
    assert_eq!(decode("Some(1.5)", f64::from_value).0, Some(1.5));
    assert_eq!(decode("true", bool::from_value).0, Some(true));
    assert_eq!(decode("\"a\"", String::from_value).0, Some("a".into()));
    assert_eq!(decode("4294967295", u32::from_value).0, Some(u32::MAX));
    assert_eq!(decode("7.0", usize::from_value).0, Some(7));
    assert_eq!(decode("(1, 2)", <[f64; 2]>::from_value).0, Some([1.0, 2.0]));
    assert_eq!(decode("[1, 2, 3]", <[f64; 3]>::from_value).0, Some([1.0, 2.0, 3.0]));
    assert_eq!(decode("(1, 2, 3, 4)", <[f64; 4]>::from_value).0, Some([1.0, 2.0, 3.0, 4.0]));
    assert_eq!(decode("[1, 2]", Vec::<u32>::from_value).0, Some(vec![1, 2]));
    assert_eq!(decode("[]", Vec::<String>::from_value).0, Some(vec![]));
    assert_eq!(decode("A", Value::from_value).0.map(|v| v.describe()), Some("`A`".into()));
}

#[test]
fn wrong_types_say_what_was_expected_and_found() {
    assert_eq!(refusal::<f64>("\"1\""), "expected a number, found a string");
    assert_eq!(refusal::<bool>("1"), "expected `true` or `false`, found a number");
    assert_eq!(refusal::<String>("Step(a: 1)"), "expected a string, found `Step(...)`");
    assert_eq!(refusal::<u32>("-1"), "expected a whole number from 0 to 4294967295, found -1");
    assert_eq!(refusal::<u32>("4294967296"), "expected a whole number from 0 to 4294967295, found 4294967296");
    assert_eq!(refusal::<usize>("1.5"), "expected a whole number from 0 up, found 1.5");
    assert_eq!(refusal::<usize>("1e300"), "expected a whole number from 0 up, found 1e300");
    assert_eq!(refusal::<u32>("()"), "expected a whole number from 0 to 4294967295, found `()`");
    assert_eq!(refusal::<[f64; 3]>("(1, 2)"), "expected three numbers such as (1, 2, 3), found a tuple of 2 items");
    assert_eq!(refusal::<[f64; 3]>("5"), "expected three numbers such as (1, 2, 3), found a number");
    let both = "expected a number, found a boolean; expected a number, found a map";
    assert_eq!(refusal::<Vec<f64>>("[true, 1, {}]"), both);
    assert_eq!(refusal::<[f64; 3]>("(true, 1, {})"), both);
}

#[test]
fn what_was_reported_as_unreadable_is_not_reported_again() {
    assert_eq!(refusal::<f64>("1e999"), "the number `1e999` is too large");
    assert_eq!(
        refusal::<Vec<f64>>("[NaN, =]"),
        "numbers must be finite, but this is `NaN`; expected a value, found `=`"
    );
    assert_eq!(refusal::<Value>("inf"), "numbers must be finite, but this is `inf`");
}

#[test]
fn scripts_may_hold_numbers_that_are_not_finite() {
    let mut diagnostics = Diagnostics::default();
    for number in [f64::NAN, f64::NEG_INFINITY] {
        let value = Value::new(Span::NONE, ValueKind::Number(number));
        assert_eq!(f64::from_value(&value, &mut diagnostics), None);
        assert_eq!(u32::from_value(&value, &mut diagnostics), None);
    }
    let messages = diagnostics.render(&Sources::default(), false);
    assert_eq!(titles(&messages)[0], "expected a finite number, found NaN");
    assert_eq!(titles(&messages)[3], "expected a whole number from 0 to 4294967295, found infinity");
}

#[test]
fn all_errors_of_a_struct_come_at_once() {
    let text = "Fold(\n    limti: 1,\n    scale: \"2\",\n    offset: (1, 2),\n    zzz: 1,\n)";
    let (read, messages) = decode(text, |value, d| {
        let mut fields = Fields::new(value, "a fold", d)?;
        assert_eq!(fields.name().map(|name| name.text.as_str()), Some("Fold"));
        assert_eq!(fields.span(), value.span);
        let limit: Option<f64> = fields.required("limit", d);
        let scale: f64 = fields.or("scale", 3.0, d);
        let offset: Option<[f64; 3]> = fields.optional("offset", d);
        let absent: Option<bool> = fields.optional("flip", d);
        fields.finish(d);
        Some((limit, scale, offset, absent))
    });
    assert_eq!(read, Some((None, 3.0, None, None)));
    let expected = "\
error: a fold needs the field `limit`
 --> a.ron:1:1
  |
1 | Fold(
  | ^^^^^ `limit` is missing here
  |
  = help: add `limit: ...`, a number

error: expected a number, found a string
 --> a.ron:3:12
  |
3 |     scale: \"2\",
  |            ^^^ expected a number
  |
  = help: numbers stand without quotes

error: expected three numbers such as (1, 2, 3), found a tuple of 2 items
 --> a.ron:4:13
  |
4 |     offset: (1, 2),
  |             ^^^^^^ expected three numbers such as (1, 2, 3)

error: a fold has no field `limti`
 --> a.ron:2:5
  |
2 |     limti: 1,
  |     ^^^^^ unknown field
  |
  = help: did you mean `limit`?

error: a fold has no field `zzz`
 --> a.ron:5:5
  |
5 |     zzz: 1,
  |     ^^^ unknown field
  |
  = help: the fields of a fold are `limit`, `scale`, `offset` and `flip`
";
    assert_eq!(messages, expected);
}

#[test]
fn maps_and_empty_brackets_have_fields_too() {
    let get = |text: &str| {
        decode(text, |value, d| {
            let mut fields = Fields::new(value, "a fold", d)?;
            let limit = fields.or("limit", 1.0, d);
            fields.finish(d);
            Some(limit)
        })
    };
    assert_eq!(get("{ \"limit\": 2 }"), (Some(2.0), String::new()));
    assert_eq!(get("{ limit: 2 }"), (Some(2.0), String::new()));
    assert_eq!(get("(limit: None)"), (Some(1.0), String::new()));
    assert_eq!(get("()"), (Some(1.0), String::new()));
    assert_eq!(get("Fold()"), (Some(1.0), String::new()));
    assert_eq!(titles(&get("{ 1: 2 }").1), ["expected a name, found a number"]);
    let expected = "expected a fold, that is, fields such as `(name: value)`, found a list";
    assert_eq!((get("[1]").0, titles(&get("[1]").1)), (None, vec![expected]));
    assert!(get("(other: 1)").1.ends_with("= help: the only field of a fold is `limit`\n"));
}

#[test]
fn the_rest_is_everything_not_asked_for() {
    let ((), messages) = decode("(a: 1, b: 2, c: 3)", |value, d| {
        let mut fields = Fields::new(value, "a step", d).expect("a struct");
        assert!(fields.optional_value("b").is_some() && fields.optional_value("x").is_none());
        let names = |list: Vec<(Name, &Value)>| list.into_iter().map(|(n, _)| n.text).collect::<Vec<_>>();
        assert_eq!(names(fields.rest()), ["a", "c"]);
        assert!(fields.rest().is_empty());
        fields.finish(d);
    });
    assert_eq!(messages, "");
}

#[test]
fn tables_have_names_in_order() {
    let names = |text: &str| {
        decode(text, |value, d| {
            let list = entries(value, "a palette", d);
            list.into_iter().map(|(name, value)| (name.text, value.describe())).collect::<Vec<_>>()
        })
    };
    let pair = |name: &str, what: &str| (name.to_owned(), what.to_owned());
    let both = vec![pair("b", "a number"), pair("a", "a string")];
    assert_eq!(names("{\"b\": 1, \"a\": \"x\"}"), (both.clone(), String::new()));
    assert_eq!(names("(b: 1, a: \"x\")"), (both, String::new()));
    let (list, messages) = names("{\"b\": 1, b: 2, true: 3}");
    assert_eq!(list, [pair("b", "a number")]);
    assert_eq!(titles(&messages), ["`b` is given twice", "expected a name, found a boolean"]);
    let expected = "expected a palette, that is, names and values such as `(name: value)`, found a number";
    assert_eq!(titles(&names("1").1), [expected]);
}

#[test]
fn ranges_are_told_as_people_write_them() {
    let mut diagnostics = Diagnostics::default();
    let mut check = |value, min, max| {
        let before = diagnostics.len();
        let is_good = check_range(value, min, max, "`power`", Span::NONE, &mut diagnostics);
        assert_eq!(is_good, diagnostics.len() == before);
        diagnostics.iter().skip(before).map(|d| d.message.clone()).collect::<String>()
    };
    assert_eq!(check(2.0, 2.0, 16.0), "");
    assert_eq!(check(20.0, 2.0, 16.0), "`power` must be from 2 to 16, but is 20");
    assert_eq!(check(-1e-9, 0.0, f64::INFINITY), "`power` must be at least 0, but is -1e-9");
    assert_eq!(check(1e20, f64::NEG_INFINITY, 0.5), "`power` must be at most 0.5, but is 1e20");
    assert_eq!(check(f64::NAN, 0.0, 1.0), "`power` must be from 0 to 1, but is NaN");
    assert_eq!(check(f64::NAN, f64::NEG_INFINITY, f64::INFINITY), "`power` must be a number, but is NaN");
}

//! What is read, compared with the `ron` crate; what is refused, with the messages as people see them.

use super::*;
use crate::formula::value::ValueKind;

/// Reads a text; its value and all messages.
fn read_within(text: &str, limits: &Limits) -> (Option<Value>, String) {
    let mut sources = Sources::default();
    let id = sources.add("a.ron", text);
    let mut diagnostics = Diagnostics::default();
    let value = read_ron(&sources, id, limits, &mut diagnostics);
    (value, diagnostics.render(&sources, false))
}

/// Reads a text within the usual limits.
fn read(text: &str) -> (Option<Value>, String) {
    read_within(text, &Limits::default())
}

/// Titles of a text's messages.
fn titles(text: &str) -> Vec<String> {
    let (_, messages) = read(text);
    let titles = messages
        .lines()
        .filter_map(|line| line.strip_prefix("error: "));
    titles.map(str::to_owned).collect()
}

/// A value in one fixed spelling, without places.
fn spell(value: &Value) -> String {
    report::key_text(value)
}

/// A value of the `ron` crate in the same spelling; it knows no names and no difference of struct, map,
/// tuple and list.
fn spell_theirs(value: &::ron::Value) -> String {
    let list = |items: &[::ron::Value]| {
        items
            .iter()
            .map(spell_theirs)
            .collect::<Vec<_>>()
            .join(", ")
    };
    match value {
        ::ron::Value::Unit => "()".into(),
        ::ron::Value::Bool(bool) => bool.to_string(),
        ::ron::Value::Char(c) => format!("{:?}", c.to_string()),
        ::ron::Value::String(text) => format!("{text:?}"),
        ::ron::Value::Number(number) => (number.into_f64() + 0.0).to_string(),
        ::ron::Value::Option(None) => "None".into(),
        ::ron::Value::Option(Some(value)) => spell_theirs(value),
        ::ron::Value::Seq(items) => format!("[{}]", list(items)),
        ::ron::Value::Map(map) => {
            let pairs = map
                .iter()
                .map(|(k, v)| format!("{}: {}", spell_theirs(k), spell_theirs(v)));
            format!("{{{}}}", pairs.collect::<Vec<_>>().join(", "))
        }
        ::ron::Value::Bytes(_) => "bytes".into(),
    }
}

/// Our value with the differences removed that the `ron` crate's value does not show.
fn flat(mut value: Value) -> Value {
    let span = value.span;
    value.kind = match value.kind {
        ValueKind::List(items) | ValueKind::Tuple { items, .. } => {
            ValueKind::List(items.into_iter().map(flat).collect())
        }
        ValueKind::Struct { fields, .. } => ValueKind::Map(
            fields
                .into_iter()
                .map(|(n, v)| (Value::new(span, ValueKind::Str(n.text)), flat(v)))
                .collect(),
        ),
        ValueKind::Map(entries) => ValueKind::Map(
            entries
                .into_iter()
                .map(|(k, v)| (flat(k), flat(v)))
                .collect(),
        ),
        other => other,
    };
    value
}

/// A text with most of what RON has.
const SAMPLE: &str = r##"#![enable(implicit_some)]
/* outer /* inner */ still */
Fractal(
    name: "Mandelbox \u{e9}\n", // the classic
    raw: r#"a "quoted" b"#,
    scale: -1.5e0, hex: 0xFF, size: 1_000, letter: 'x', unit: (),
    steps: [
        BoxFold(limit: 1.0, value: 2.0,),
        Scale(2.0, (0.5, .25, 1.)),
        Mandelbrot,
    ],
    table: { "a": [1, 2], "b": Some(true) },
    r#odd-name: None,
)
"##;

#[test]
fn agrees_with_the_ron_crate() {
    let texts = [
        "1",
        "-1.5e-3",
        "0x1F",
        "0b101",
        "0o17",
        "1_000_000",
        "+2.5",
        "1.0f32",
        "0.1f32",
        "7u8",
        ".5",
        "5.",
        "18446744073709551616",
        "true",
        "()",
        "\"a\\tb\\u{1F600}\\x41\\xc3\\xa9\"",
        "r\"\\n\"",
        "r##\"a\"#\"##",
        "'\\''",
        "'é'",
        "\"a\\\n     b\"",
        "[]",
        "[1, 2,]",
        "(1, \"a\", (2, 3))",
        "{\"a\": 1, \"b\": [true]}",
        "{}",
        "{1: 2, (3, 4): 5}",
        "(a: 1, b: (c: 2.5))",
        "( /* x /* y */ */ a: 1, // z\n)",
        "None",
        "Some(1)",
        "Some((1, 2))",
        "#![enable(unwrap_newtypes)]\n#![type = \"x\"]\n[1]",
        "(r#a-b: 1)",
        "\u{2028}[\u{b}1\u{c}]\u{85}",
        "Name(1, 2)",
        "Name(a: 1)",
    ];
    for text in texts {
        let (value, messages) = read(text);
        assert_eq!(messages, "", "{text}");
        let ours = spell(&flat(value.expect("a value")));
        match ::ron::from_str::<::ron::Value>(text) {
            Ok(theirs) => assert_eq!(ours, spell_theirs(&theirs), "{text}"),
            Err(error) => panic!("the ron crate refuses {text}: {error}"),
        }
    }
}

#[test]
fn refuses_what_the_ron_crate_refuses() {
    let texts = [
        "",
        "(",
        "[1 2]",
        "(a 1)",
        "(a: 1 b: 2)",
        "{1}",
        "[1,,2]",
        "[,]",
        "\"a",
        "r#\"a\"",
        "/* a",
        "1 2",
        "0x",
        "1._5",
        "\"\\q\"",
        "\"\\u{d800}\"",
        "'ab'",
        "''",
        "(a: 1, 2)",
        "(1, a: 2)",
        "#[x]\n1",
        "#![enable(nonsense)]\n1",
        "]",
        "{1: 2 3: 4}",
        "300u8",
        "[1)",
        "/ 1",
        "@",
        "1.5u8",
        "(a:: 1)",
        "12abc",
    ];
    for text in texts {
        assert!(
            ::ron::from_str::<::ron::Value>(text).is_err(),
            "the ron crate takes {text}"
        );
        assert!(!read(text).1.is_empty(), "{text}");
    }
}

#[test]
fn the_sample_reads_with_names_and_places() {
    let (value, messages) = read(SAMPLE);
    assert_eq!(messages, "");
    let value = value.expect("a value");
    let expected = "Fractal(name: \"Mandelbox é\\n\", raw: \"a \\\"quoted\\\" b\", scale: -1.5, hex: 255, \
        size: 1000, letter: \"x\", unit: (), steps: [BoxFold(limit: 1, value: 2), Scale(2, (0.5, 0.25, 1)), \
        Mandelbrot], table: {\"a\": [1, 2], \"b\": true}, odd-name: None)";
    assert_eq!(spell(&value), expected);
    let text = |span: Span| &SAMPLE[span.start as usize..span.end as usize];
    assert!(text(value.span).starts_with("Fractal(") && text(value.span).ends_with("None,\n)"));
    let ValueKind::Struct { fields, .. } = &value.kind else {
        panic!("not a struct");
    };
    assert_eq!(
        (text(fields[2].0.span), text(fields[2].1.span)),
        ("scale", "-1.5e0")
    );
    assert_eq!(text(fields[1].1.span), "r#\"a \"quoted\" b\"#");
    let ValueKind::List(steps) = &fields[7].1.kind else {
        panic!("not a list");
    };
    assert_eq!(text(steps[0].span), "BoxFold(limit: 1.0, value: 2.0,)");
    assert_eq!(text(steps[2].span), "Mandelbrot");
}

#[test]
fn all_errors_of_a_file_come_at_once() {
    let text = "(\n    a: [1, 2),\n    b: 1e999,\n    c = 3,\n    a: NaN,\n    d: {1: 2, 1: 3},\n    e: @,\n    f: 1 g: \"\\q\",\n";
    let (value, messages) = read(text);
    assert_eq!(value, None);
    let titles = titles(text);
    let expected = [
        "expected `,` or `]`, found `)`",
        "the number `1e999` is too large",
        "expected `:` and a value, found `=`",
        "numbers must be finite, but this is `NaN`",
        "field `a` is given twice",
        "key 1 is given twice",
        "expected a value, found `@`",
        "expected `,` or `)`, found `g`",
        "a string or character is misspelled",
        "expected a field or `)`, found end of file",
    ];
    assert_eq!(titles, expected, "{messages}");
}

#[test]
fn a_forgotten_bracket_is_found_at_the_next_field() {
    let text = "(\n    a: [1, 2,\n    b: 1e999,\n    c: x=3,\n    b: 2,\n";
    let expected = "\
error: expected `]`, found `b`
 --> a.ron:3:5
  |
2 |     a: [1, 2,
  |        - this `[` is not closed
3 |     b: 1e999,
  |     ^ expected `]`

error: the number `1e999` is too large
 --> a.ron:3:8
  |
3 |     b: 1e999,
  |        ^^^^^ cannot be stored

error: expected `,` or `)`, found `=`
 --> a.ron:4:9
  |
4 |     c: x=3,
  |         ^ expected `,` or `)`
  |
  = help: write `name: value`, with a colon

error: field `b` is given twice
 --> a.ron:5:5
  |
3 |     b: 1e999,
  |     - first given here
4 |     c: x=3,
5 |     b: 2,
  |     ^ given again here

error: expected a field or `)`, found end of file
 --> a.ron:6:1
  |
1 | (
  | - this `(` is not closed
...
6 |
  | ^ expected a field or `)`
";
    assert_eq!(read(text).1, expected);
}

/// The file is also the list of messages. To renew it, copy what the failing test prints, and read it.
#[test]
fn every_message_of_the_reader() {
    let texts = [
        "",
        "[1, 2",
        "(a: 1))",
        "(a: 1, 2)",
        "(1, a: 2)",
        "(a: )",
        "a: 1",
        "[1 2]",
        "[,]",
        "{1, 2: 3}",
        "[1;]",
        "(a-b: 1)",
        "[1._5]",
        "b\"x\"",
        "\"abc",
        "r##\"abc\"#",
        "'ab'",
        "'",
        "/* /* */",
        "#[x]",
        "#![enable(implicit_sum)] 1",
        "\"\\x4\"",
        "[# a\n]",
        "(a: -inf)",
        "{\"a\": 1, \"a\": 2}",
        "(a: [1}, b: 2)",
        "Fold{a: 1}",
        "[Fold{a: 1}, 2 3]",
        "{(1]: 2}",
    ];
    let all: String = texts
        .iter()
        .map(|text| format!("---- {text}\n{}\n", read(text).1))
        .collect();
    assert_eq!(all, include_str!("messages.txt"), "{all}");
}

#[test]
fn limits_are_errors() {
    let limits = Limits {
        bytes: 100,
        depth: 3,
        values: 5,
    };
    let title = |text: &str| {
        let (value, messages) = read_within(text, &limits);
        (
            value.is_some(),
            messages.lines().next().unwrap_or_default().to_owned(),
        )
    };
    assert_eq!(title("[1, 2, 3, 4]"), (true, String::new()));
    assert_eq!(
        title("[1, 2, 3, 4, 5]"),
        (false, "error: the file has more than 5 values".into())
    );
    assert_eq!(title("[[[]]]"), (true, String::new()));
    assert_eq!(
        title("[[[[]]]]"),
        (false, "error: brackets are nested more than 3 deep".into())
    );
    assert_eq!(
        title(&" ".repeat(101)),
        (
            false,
            "error: the file has 101 bytes, but at most 100 are allowed".into()
        )
    );
    let deep = Limits {
        depth: usize::MAX,
        ..Limits::default()
    };
    assert!(
        read_within(&"[".repeat(100_000), &deep)
            .1
            .starts_with("error: brackets are nested more than 256 deep")
    );
}

#[test]
fn hostile_texts_end_soon() {
    let million = 1 << 18;
    let fill = |piece: &str| piece.repeat(million / piece.len());
    let pieces = [
        "(", "[", "{", ")", "]", ",", ":", "\"", "'", "/*", "//", "//\n", "r#", "#", "a", "a:",
        "a(", "-", "1", "1,", "@", "@,", "\\", "é", "\u{0}", "\n", " ", "r#\"", "b\"", "\"\\q",
        "/", "[]", "()", "{}", "\"\",", "1:1,", "a:1,", "'\\",
    ];
    for piece in pieces {
        for start in ["", "[", "(", "(a: ", "{", "[\"", "{1: ["] {
            let mut text = start.to_owned() + fill(piece).as_str();
            while text.len() >= million {
                text.pop();
            }
            let limits = Limits::default();
            let mut sources = Sources::default();
            let id = sources.add("a", text);
            read_ron(&sources, id, &limits, &mut Diagnostics::default());
        }
    }
}

#[test]
fn no_mutation_of_the_sample_panics() {
    let mut state = 7_u64;
    let mut random = move |below: usize| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    for round in 0..10_000 {
        let mut bytes = SAMPLE.as_bytes().to_vec();
        for _ in 0..=random(4) {
            let at = random(bytes.len());
            match random(4) {
                0 => bytes.truncate(at.max(1)),
                1 => drop(bytes.remove(at)),
                2 => bytes[at] = b"()[]{},:\"'\\#/*rb0-.e_ \n@"[random(24)],
                _ => bytes[at] ^= 1 << random(8),
            }
            if bytes.is_empty() {
                bytes.push(b'(');
            }
        }
        let text = String::from_utf8_lossy(&bytes).into_owned();
        let mut sources = Sources::default();
        let id = sources.add("a", text.as_str());
        let mut diagnostics = Diagnostics::default();
        let value = read_ron(&sources, id, &Limits::default(), &mut diagnostics);
        assert!(value.is_some() || diagnostics.has_errors(), "{text}");
        if round % 10 == 0 {
            diagnostics.render(&sources, false);
        }
        if !diagnostics.has_errors() && random(8) == 0 {
            assert!(::ron::from_str::<::ron::Value>(&text).is_ok(), "{text}");
        }
    }
}

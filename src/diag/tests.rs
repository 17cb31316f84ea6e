//! Every kind of message drawn, and awkward places and texts.

use super::{Diagnostic, Diagnostics, SourceId, Sources, Span};

/// Draws one message about one text without colour.
fn drawn(text: &str, make: impl FnOnce(SourceId, &Sources) -> Diagnostic) -> String {
    let mut sources = Sources::default();
    let id = sources.add("box.ron", text);
    let mut diagnostics = Diagnostics::default();
    diagnostics.push(make(id, &sources));
    diagnostics.render(&sources, false)
}

#[test]
fn a_message_shows_title_place_line_label_and_help() {
    let text = "(\n    steps: [\n        BoxFold(limti: 1.0),\n    ],\n)\n";
    let out = drawn(text, |id, sources| {
        Diagnostic::error("unknown field `limti`")
            .label(sources.span_at(id, 3, 17), "not a field of `BoxFold`")
            .label(sources.span_at(id, 3, 9), "this step")
            .did_you_mean("limti", ["limit", "value"])
            .help("`bulbfold explain BoxFold` lists the fields")
    });
    let expected = "\
error: unknown field `limti`
 --> box.ron:3:17
  |
3 |         BoxFold(limti: 1.0),
  |         ------- ^^^^^ not a field of `BoxFold`
  |         |
  |         this step
  |
  = help: did you mean `limit`?
  = help: `bulbfold explain BoxFold` lists the fields
";
    assert_eq!(out, expected);
}

#[test]
fn a_message_without_a_place_is_title_and_help() {
    let out = drawn("", |_, _| {
        Diagnostic::warning("no GPU was found").label(Span::NONE, "nowhere").help("the CPU renders instead")
    });
    assert_eq!(out, "warning: no GPU was found\n  = help: the CPU renders instead\n");
    assert_eq!(Diagnostics::default().render(&Sources::default(), false), "");
}

#[test]
fn labels_in_two_files_and_far_apart_get_a_picture_each() {
    let mut sources = Sources::default();
    let a = sources.add("a.ron", format!("first{}last", "\n".repeat(999)));
    let b = sources.add("b.rhai", "let x = 1;");
    let mut diagnostics = Diagnostics::default();
    diagnostics.push(
        Diagnostic::error("`x` is given three times")
            .label(sources.span_at(b, 1, 5), "here")
            .label(sources.span_at(a, 1, 1), "and here")
            .label(sources.span_at(a, 1000, 1), "and here"),
    );
    let expected = "\
error: `x` is given three times
    --> b.rhai:1:5
     |
   1 | let x = 1;
     |     ^ here
     |
    ::: a.ron:1:1
     |
   1 | first
     | ----- and here
     |
    ::: a.ron:1000:1
     |
1000 | last
     | ---- and here
";
    assert_eq!(diagnostics.render(&sources, false), expected);
}

#[test]
fn a_span_of_many_lines_is_drawn_on_its_first() {
    let out = drawn("(\r\n    a: (\r\n        b: 1,\r\n    ),\r\n)", |id, _| {
        Diagnostic::error("too deep").label(Span::new(id, 7, 30), "this")
    });
    let expected = "\
error: too deep
 --> box.ron:2:5
  |
2 |     a: (
  |     ^^^^ this
";
    assert_eq!(out, expected);
}

#[test]
fn long_lines_are_cut_around_each_label_and_keep_their_columns() {
    let text = format!("[{}9.5{}]", "1,".repeat(50_000), ",2".repeat(50_000));
    let out = drawn(&text, |id, sources| {
        Diagnostic::error("too large")
            .label(sources.span_at(id, 1, 100_002), "must be below 9")
            .label(sources.span_at(id, 1, 1), "in this list")
    });
    let expected = "\
error: too large
 --> box.ron:1:100002
  |
1 | ...1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,9.5,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,2,...
  |                                            ^^^ must be below 9
  |
 ::: box.ron:1:1
  |
1 | [1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1...
  | - in this list
";
    assert_eq!(out, expected);
}

#[test]
fn ends_of_files_and_lines_are_places_too() {
    let at =
        |text: &str, start: usize| drawn(text, |id, _| Diagnostic::error("e").label(Span::new(id, start, start), "x"));
    assert_eq!(at("", 0), "error: e\n --> box.ron:1:1\n  |\n1 |\n  | ^ x\n");
    assert_eq!(at("ab\n", 3), "error: e\n --> box.ron:2:1\n  |\n2 |\n  | ^ x\n");
    assert_eq!(at("ab\ncd", 2), "error: e\n --> box.ron:1:3\n  |\n1 | ab\n  |   ^ x\n");
    assert_eq!(at("ab", 900), "error: e\n --> box.ron:1:3\n  |\n1 | ab\n  |   ^ x\n");
}

#[test]
fn control_characters_are_shown_and_never_sent() {
    let text = "a\u{1b}[31m\tb\u{9b}\u{202e}\0c\u{200d}\u{301}d";
    let mut sources = Sources::default();
    let id = sources.add("a\u{1b}\n.ron", text);
    let mut diagnostics = Diagnostics::default();
    let label = format!("label {text}");
    diagnostics.push(Diagnostic::error(text).label(sources.whole(id), label).help(text));
    let plain = diagnostics.render(&sources, false);
    assert!(!plain.chars().any(|c| c.is_control() && c != '\n'), "{plain:?}");
    let colored = diagnostics.render(&sources, true);
    assert!(colored.contains("\u{1b}[") && !colored.contains("\u{9b}"), "{colored:?}");
}

#[test]
fn at_most_twenty_are_shown_and_errors_go_first() {
    let mut diagnostics = Diagnostics::default();
    for number in 0..30 {
        diagnostics.push(Diagnostic::warning(format!("w{number}")));
    }
    diagnostics.extend([Diagnostic::error("the error")]);
    let out = diagnostics.render(&Sources::default(), false);
    assert!(out.starts_with("error: the error\n\nwarning: w0\n\n"), "{out}");
    assert!(out.ends_with("warning: w18\n\n... and 11 more\n"), "{out}");
    assert_eq!((diagnostics.len(), diagnostics.error_count()), (31, 1));
    assert!(diagnostics.has_errors() && !diagnostics.is_empty());
}

#[test]
fn places_count_characters_and_tokens() {
    let mut sources = Sources::default();
    let id = sources.add("x", "é = \"a\\\" b\" + 12.5;\r\nfn gö_1() <= 'c'\n\n");
    let text = |line, column| {
        let span = sources.span_at(id, line, column);
        &sources.text(id)[span.start as usize..span.end as usize]
    };
    assert_eq!((text(1, 1), text(1, 3), text(1, 5)), ("é", "=", "\"a\\\" b\""));
    assert_eq!((text(1, 15), text(1, 19), text(1, 20)), ("12.5", ";", "\r"));
    assert_eq!((text(2, 4), text(2, 11), text(2, 14)), ("gö_1", "<=", "'c'"));
    assert_eq!((text(3, 1), text(4, 7), text(0, 0)), ("\n", "", "é"));
    assert_eq!(sources.line_col(sources.span_at(id, 2, 11)), Some((2, 11)));
    assert_eq!(sources.line_col(Span::NONE), None);
    assert!(Sources::default().span_at(id, 1, 1).is_none());
    assert_eq!((Sources::default().name(id), Sources::default().text(id)), ("", ""));
}

#[test]
fn spans_join() {
    let mut sources = Sources::default();
    let (a, b) = (sources.add("a", "abcdef"), sources.add("b", "abcdef"));
    assert_eq!(Span::new(a, 4, 5).to(Span::new(a, 1, 2)), Span::new(a, 1, 5));
    assert_eq!(Span::new(a, 4, 5).to(Span::new(b, 1, 2)), Span::new(a, 4, 5));
    assert_eq!(Span::NONE.to(Span::new(b, 1, 2)), Span::new(b, 1, 2));
    assert_eq!(Span::new(b, 1, 2).to(Span::NONE), Span::new(b, 1, 2));
    assert_eq!(sources.whole(a), Span::new(a, 0, 6));
}

#[test]
fn no_span_of_no_text_panics() {
    let pieces = [
        "a",
        "é",
        "\n",
        "\r\n",
        "\r",
        "\t",
        "\u{1b}",
        "漢",
        "\u{200d}",
        "👩‍🚀",
        " ",
        "\u{301}",
        "                              ",
    ];
    let mut state = 1_u64;
    let mut random = move |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    for round in 0..3000 {
        let count = if round % 100 == 0 { 3000 } else { random(60) };
        let text: String = (0..count).map(|_| pieces[random(pieces.len())]).collect();
        let mut sources = Sources::default();
        let id = sources.add("x", text.as_str());
        let mut diagnostic = Diagnostic::error("m");
        for _ in 0..random(4) {
            let (start, end) = (random(text.len() + 3), random(text.len() + 3));
            diagnostic = diagnostic.label(Span { source: id, start: start as u32, end: end as u32 }, "l");
        }
        let mut diagnostics = Diagnostics::default();
        diagnostics.push(diagnostic);
        assert!(diagnostics.render(&sources, round % 2 == 0).contains('m'));
        sources.span_at(id, random(9), random(99));
    }
}

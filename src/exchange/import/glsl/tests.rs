use super::{Machine, Value, parse, tokens};

/// The value and the last vector of a function `DE` at a point.
fn run(text: &str, point: [f64; 3]) -> Result<(f64, [f64; 3]), String> {
    let program = parse(&tokens(text)?)?;
    let uniforms = [("int".into(), "N".into(), Value::Int(3)), ("float".into(), "S".into(), Value::Float(2.0))];
    let (value, trace) = Machine::new(&program, &uniforms)?.run("DE", point)?;
    Ok((value, trace.last().copied().unwrap_or_default()))
}

#[test]
fn statements_do_what_glsl_says() {
    let cases = [
        ("return p.x + p.yz.y * 2.0;", 7.0),
        ("float a = 0.0; for (int i = 0; i < N; i++) { if (i == 1) continue; a += float(i); } return a;", 2.0),
        ("int i = 0; while (true) { i++; if (i > 4) break; } return float(i);", 5.0),
        ("int i = 0; do { i += 2; } while (i < 5); return float(i);", 6.0),
        ("vec4 v = vec4(p, 1.0); v.zx *= 2.0; v *= S; return v.x * 1000.0 + v.z;", 4012.0),
        ("p.yx = p.xy; return p.x * 10.0 + p.y;", 21.0),
        ("mat3 m = mat3(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0); return (m * p).x + (p * m).x;", 44.0),
        ("return true && !false ? max(p.x, max(p.y, p.z)) : -1.0;", 3.0),
        ("vec3 q = abs(p - vec3(2.0)) - 1.5; return dot(q, vec3(1.0, 10.0, 100.0));", -65.5),
        ("return mod(-1.0, 3.0) + clamp(5.0, 0.0, 1.0) + mix(1.0, 3.0, 0.25) + floor(-0.5);", 3.5),
        ("float a[2]; return 0.0;", f64::NAN),
        ("return float(7 / 2) + float(7 % 4) + length(vec2(3.0, 4.0));", 11.0),
        ("{ float x = 5.0; } float x = 1.0; return x;", 1.0),
    ];
    for (body, expected) in cases {
        let found = run(&format!("float DE(vec3 p) {{ {body} }}"), [1.0, 2.0, 3.0]);
        match expected.is_nan() {
            true => assert!(found.is_err(), "{body}"),
            false => assert!((found.clone().unwrap().0 - expected).abs() < 1e-12, "{body}: {found:?}"),
        }
    }
}

#[test]
fn functions_give_back_what_they_change() {
    let text = "#define TWICE 2.0\n#ifdef NOTHING\nthis is no code\n#endif\n/* a comment */ uniform float S; slider[0,1,\\]\n\
        mat3 turn;\nvoid init() { turn = rotationMatrix3(vec3(0.0, 0.0, 1.0), 90.0); }\n\
        void grow(inout vec3 z, float by, out float told) { z *= by; told = by; }\n\
        float DE(vec3 pos) { vec3 z = pos; float t; grow(z, TWICE, t); z *= turn; return t; }\n\
        vec3 broken( { }\n#preset Default\nS = 1\n#endpreset\n";
    let (value, last) = run(text, [1.0, 0.0, 0.5]).unwrap();
    assert_eq!(value, 2.0);
    // A quarter turn about z.
    assert!((last[0]).abs() < 1e-12 && (last[1] - 2.0).abs() < 1e-12 && last[2] == 1.0, "{last:?}");
}

#[test]
fn what_is_not_known_is_an_error() {
    for (body, words) in [
        ("return noise(p);", "`noise`"),
        ("return time;", "`time`"),
        ("while (true) { }", "too long"),
        ("return DE(p);", "too often"),
        ("return p.q.x;", "no part"),
        ("return p;", "a vector"),
    ] {
        let error = run(&format!("float DE(vec3 p) {{ {body} return 0.0; }}"), [0.0; 3]).unwrap_err();
        assert!(error.contains(words), "{body}: {error}");
    }
    let error = parse(&tokens("float DE(vec3 p) {\n return 1.0 +;\n}").unwrap()).map(|program| program.functions.len());
    assert_eq!(error, Ok(0));
}

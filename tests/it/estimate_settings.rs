//! What files and flags may say about estimates, and what becomes of it.

use bulbfold::check::{Backends, Formula, Target, truth};
use bulbfold::compose::{Purpose, compose_estimator};
use bulbfold::graph::{DeForm, Difference, DifferenceStep, EstimateSettings, Method, StopAt};
use bulbfold::kernel::Kernel;
use bulbfold::march::{MarchSettings, compose_march};
use bulbfold::math::Precision;

use crate::support::formula;

/// The step of finite differences that a march takes: the share or length asked for, above the precision's least one.
#[test]
fn marches_take_the_step_that_is_asked_for() {
    let text =
        r#"(nodes: { "square": quaternion_square() }, bounding_radius: 2, estimate: (method: delta, step: STEP))"#;
    let (precision, last_de, p) = (Precision::F32, 0.5, [3.0, 0.0, 0.0]);
    for (step, parsed, wanted) in [
        ("Share(0.1)", DifferenceStep::Share(0.1), 0.05),
        ("Share(1e-6)", DifferenceStep::Share(1e-6), 3e-5),
        ("0.002", DifferenceStep::Fixed(0.002), 0.002),
        ("1e-9", DifferenceStep::Fixed(1e-9), 3e-5),
    ] {
        let formula = formula(&text.replace("STEP", step));
        let plan = formula.plan();
        assert_eq!((plan.choices[0].method, plan.difference_step), (Method::Delta, parsed));
        let subject = formula.subject();
        let estimator = compose_estimator(&subject.composer(), &plan.choices, Purpose::March);
        let settings = MarchSettings { precision, difference_step: parsed, ..MarchSettings::default() };
        let march = compose_march(subject.arena, estimator.unwrap_or_else(|e| panic!("{}", e.message)), &settings);
        let names: Vec<String> = march.locate.output_ports().into_iter().map(|port| port.name).collect();
        assert_eq!(names, ["p", "d", "h", "hit_eps"]);
        // Ray from p along y, at t = 0; last_de is the state's fifth number.
        let ray = [p[0], p[1], p[2], 0.0, 1.0, 0.0, 0.0, 9.0, 0.0, 0.0, -1.0, -1.0, last_de, 0.0];
        let columns: Vec<Vec<f64>> = ray.iter().map(|x| vec![*x]).collect();
        let out =
            Backends::cpu_only().run(Target::CPU_F64, subject.arena, &Kernel::Map(march.locate), &columns).unwrap();
        // These differences are along the axes: nothing reads the ray's direction.
        assert_eq!([out[3][0], out[4][0], out[5][0]], [0.0; 3]);
        assert!((out[6][0] - wanted).abs() < 1e-15, "{step}: {}", out[6][0]);
    }
}

#[test]
fn methods_that_do_not_apply_say_why() {
    let bulb = r#"(nodes: { "bulb": bulb_power() }, bounding_radius: 2, estimate: (method: METHOD))"#;
    let boxed = r#"(nodes: { "fold": box_fold(), "grow": scale(scale: 2), "box": Sequence(["fold", "grow"]) },
        output: "box", bounding_radius: 14, estimate: (method: METHOD))"#;
    for (text, method, why) in [
        (bulb, "own", "an iterated map has no distance of its own"),
        (boxed, "own", "only primitives have"),
        (boxed, "potential", "r grows by a factor"),
        (boxed, "sinh", "there is no potential"),
    ] {
        let formula = formula(&text.replace("METHOD", method));
        let plan = formula.plan();
        assert!(plan.warnings.len() == 1 && plan.warnings[0].contains(why), "{:?}", plan.warnings);
        assert_ne!(plan.choices[0].method.name(), method);
    }
    let formula = formula(&bulb.replace("METHOD", "sinh, form: linear"));
    assert!(formula.plan().warnings[0].contains("logarithmic by itself"), "{:?}", formula.plan().warnings);
    assert_eq!(formula.plan().choices[0].form, DeForm::Logarithmic);
}

#[test]
fn every_method_and_form_is_a_field() {
    for method in Method::ALL {
        for form in DeForm::ALL {
            let text = format!(
                r#"(nodes: {{ "bulb": bulb_power() }}, bounding_radius: 2, max_iterations: 3,
                    estimate: (method: "{}", form: "{}", axis: (0, 3, 4), difference: ln_r))"#,
                method.name(),
                form.name()
            );
            let formula = formula(&text);
            let choice = &formula.plan().choices[0];
            let wanted = if method == Method::Own { Method::Gradient } else { method };
            let by_escape = method.is_potential() || method.is_certified() && form.is_shape();
            let wanted_form = if by_escape { DeForm::Logarithmic } else { form };
            assert_eq!((choice.method, choice.form), (wanted, wanted_form), "{text}");
            assert_eq!((choice.axis, choice.difference), ([0.0, 0.6, 0.8], Some(Difference::LnR)));
        }
    }
    let text = r#"(nodes: { "bulb": bulb_power() }, bounding_radius: 2, estimate: (method: auto, form: auto))"#;
    assert_eq!(formula(text).plan().choices[0].method, Method::Gradient);
    for wrong in ["method: gradiant", "form: round", "difference: s", "step: 0", "step: Share(2)", "axis: (0, 0, 0)"] {
        let text = format!(r#"(nodes: {{ "bulb": bulb_power() }}, estimate: ({wrong}))"#);
        assert!(Formula::from_ron(&text).is_err(), "{wrong}");
    }
}

/// A primitive's own distance is its estimate, and any other method is refused.
#[test]
fn primitives_have_their_own_distance() {
    let formula = formula(r#"(nodes: { "ball": Sphere(radius: 0.75) })"#);
    assert_eq!(formula.plan().applicable(), [Method::Own]);
    assert_eq!(formula.estimate([0.0, 2.0, 0.0], Method::Own), 1.25);
    let subject = formula.subject();
    let wanted = EstimateSettings { method: Some(Method::Scalar), ..Default::default() };
    let plan = bulbfold::compose::choose(&subject.composer(), &wanted).unwrap_or_else(|e| panic!("{}", e.message));
    assert!(plan.warnings[0].contains("primitives are not iterated"), "{:?}", plan.warnings);
}

/// The set of z^8 is the unit ball, and half of r ln r its estimate: known where it falls below a threshold.
#[test]
fn rays_stop_in_front_where_that_is_asked_for() {
    let ball = r#"(nodes: { "bulb": bulb_power(power: 8) }, constant: Julia((0, 0, 0)), escape_radius: 10,
        max_iterations: 30, bounding_radius: 2, estimate: (method: METHOD, form: logarithmic STOP))"#;
    let pixel_radius = 1e-3;
    let backends = Backends::new();
    for method in ["scalar", "gradient", "delta"] {
        for (stop, pixels) in [("", 0.0), (", stop_at: 1", 1.0), (", stop_at: 5", 5.0)] {
            let formula = formula(&ball.replace("METHOD", method).replace("STOP", stop));
            let (plan, subject) = (formula.plan(), formula.subject());
            assert_eq!(plan.stop_at, (pixels > 0.0).then_some(StopAt::Pixels(pixels)));
            let rays = [([0.0, -3.0, 0.3], [0.0, 1.0, 0.0]), ([1.5, 2.0, -1.0], [-0.557086, -0.742781, 0.371391])];
            for target in backends.targets() {
                let settings = MarchSettings::of_plan(plan, pixel_radius, target.precision());
                let march = truth::candidate(&subject.composer(), &plan.choices, &settings).expect("it composes");
                let columns = truth::ray_columns(&rays, plan.bounding_radius);
                let out = backends.run(target, subject.arena, &march, &columns).expect("it runs");
                for ((origin, direction), end) in rays.iter().zip(truth::ends(&out, rays.len())) {
                    let t = end.depth().unwrap_or_else(|| panic!("{method} {stop}: no hit"));
                    let r = [0, 1, 2].map(|k| origin[k] + direction[k] * t).iter().map(|x| x * x).sum::<f64>().sqrt();
                    let (estimate, threshold) = (r * r.ln() / 2.0, pixels * 2.0 * pixel_radius * t);
                    let told = format!("{method}{stop} on {}: r = {r}, threshold {threshold}", target.name());
                    match pixels {
                        0.0 => assert!((r - 1.0).abs() < pixel_radius * t, "{told}"),
                        _ => assert!(r > 1.0 && estimate < 1.01 * threshold && estimate > 0.2 * threshold, "{told}"),
                    }
                }
            }
        }
    }
}

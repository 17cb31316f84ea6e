//! Estimates at critical points and next to nothing beside them: outside of the set they are numbers above 0, by every method.

use bulbfold::check::{Backends, Formula, Random, Target};
use bulbfold::compose::field_orbits;
use bulbfold::formula::embedded::FRACTALS;
use bulbfold::graph::{DeForm, Method};

/// Folds, poles and critical points have coordinates of 0; the others are in no special place.
fn points() -> Vec<[f64; 3]> {
    let near = [0.0, 1e-30, -1e-160];
    let values = [0.0, 1e-30, -1e-160, 0.7, -1.3];
    let mut points: Vec<[f64; 3]> = Vec::new();
    for x in near {
        for y in values {
            for z in values {
                points.extend([[x, y, z], [y, x, z], [y, z, x]]);
            }
        }
    }
    let mut random = Random::new(31);
    points.extend((0..20).map(|_| random.in_ball(3.0)));
    points
}

fn has_end_shape(formula: &Formula) -> bool {
    field_orbits(&formula.subject().composer()).iter().any(|orbit| orbit.settings.shape.is_some())
}

/// Whether an orbit ends in a slab: its distance from there is below 0 within, and 0 where the orbit leaves later.
fn ends_in_slab(formula: &Formula) -> bool {
    formula.plan().choices.iter().any(|choice| choice.form == DeForm::Plane)
}

/// What is wrong with a fractal's estimates, a line for each of these methods and back ends.
fn wrong(
    name: &str,
    formula: &Formula,
    (backends, targets): (&Backends, &[Target]),
    methods: &[Method],
) -> Vec<String> {
    let (subject, points) = (formula.subject(), points());
    let mut wrong = Vec::new();
    for &method in methods {
        let Some(choices) = subject.choices(Some(method)) else { continue };
        let kernel = subject.estimator(&choices).expect("built-in fractals compose");
        // A proof of 0 says that nothing is proven. An orbit that leaves may do so within the end's shape: at its wall, as it seems.
        let may_be_zero = method.is_certified() || has_end_shape(formula) || ends_in_slab(formula);
        // A shifted point may lie at a pole of the scator's product: what is infinite is told as no number.
        let may_be_nan = name == "scator_set" && method == Method::Delta;
        for target in targets {
            let found = subject.estimates(backends, *target, &kernel, &points).expect("kernels run");
            // At a pole a slab's gradient is no number in single precision, and where the slab is cut the cut's own distance is left.
            let may_be_cut = ends_in_slab(formula);
            let bad =
                |de: f64| (de.is_nan() && !may_be_nan) || (de < 0.0 && !may_be_cut) || (de == 0.0 && !may_be_zero);
            let mut bad = points.iter().zip(&found).filter(|(_, (de, inside))| !inside && bad(*de));
            if let Some((p, (de, _))) = bad.next() {
                let more = bad.count();
                wrong.push(format!("{name}, {}, {}: {de} at {p:?}, and {more} more", method.name(), target.name()));
            }
        }
    }
    wrong
}

#[test]
fn estimates_are_numbers_above_zero_outside() {
    let backends = Backends::cpu_only();
    let mut all = Vec::new();
    for (name, _) in FRACTALS {
        let formula = Formula::builtin(name).expect("built-in fractals load");
        all.extend(wrong(name, &formula, (&backends, &[Target::CPU_F64, Target::CPU_F32]), &Method::ALL));
    }
    assert!(all.is_empty(), "{}", all.join("\n"));
}

/// The same on a GPU, of formulas with folds, poles, whole and broken powers, four components, an end shape and a slab.
#[test]
fn estimates_are_numbers_above_zero_outside_on_a_gpu() {
    let backends = Backends::new();
    if let Some(why) = backends.why_no_gpu() {
        assert!(std::env::var_os("BULBFOLD_REQUIRE_GPU").is_none(), "{why}");
        return;
    }
    let mut all = Vec::new();
    for name in
        ["mandelbulb", "mandelbox", "quaternion_julia", "mandelbulb_fractional", "riemann_sphere", "scator_solid"]
    {
        let formula = Formula::builtin(name).expect("built-in fractals load");
        let chosen = formula.subject().method().expect("an orbit has a method");
        all.extend(wrong(name, &formula, (&backends, &[Target::Gpu]), &[chosen, Method::Delta]));
    }
    assert!(all.is_empty(), "{}", all.join("\n"));
}

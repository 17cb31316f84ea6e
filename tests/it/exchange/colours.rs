//! Gradients and palettes of Mandelbulber's files.

use bulbfold::colour::hex;
use bulbfold::graph::{By, Look, Spread};

use crate::exchange::{import, imported};
use crate::support::stderr;

fn look(version: &str, settings: &str) -> Look {
    let text = format!(
        "# Mandelbulber settings file\n# version {version}\n# only modified parameters\n[main_parameters]\nformula_1 2;\n{settings}\n[fractal_1]\n"
    );
    imported("scene.fract", &text, &[]).graph().scene.look.clone()
}

/// Colours at the stops, and how the gradient is placed.
fn layer(look: &Look) -> (Vec<(String, f64)>, Spread) {
    let [layer] = &look.paint.layers[..] else { panic!("{} layers", look.paint.layers.len()) };
    assert!(layer.by == By::Trap(0) && layer.gradient.is_cyclic());
    let stops = layer.gradient.stops().iter().map(|stop| (hex(stop.colour), stop.at));
    (stops.collect(), layer.spread.clone())
}

#[test]
fn gradients_come_with_their_places_speed_and_offset() {
    let (stops, spread) = layer(&look(
        "2.32",
        "mat1_is_defined true;\nmat1_surface_color_gradient 0 9e8e5d 1999 4f2744 7999 fcbe3d;\nmat1_coloring_speed 2;\nmat1_coloring_palette_offset 0.25;",
    ));
    let expected = [("#9e8e5d", 0.0), ("#4f2744", 0.1999), ("#fcbe3d", 0.7999)];
    assert!(stops.iter().zip(expected).all(|(a, b)| a.0 == b.0 && (a.1 - b.1).abs() < 1e-6) && stops.len() == 3);
    let Spread::Cyclic(period, begin) = spread else { panic!("{spread:?}") };
    assert!((period - 0.256).abs() < 1e-9 && (begin - 0.25).abs() < 1e-9, "{period} {begin}");
}

#[test]
fn palettes_of_old_files_are_evenly_spaced() {
    for name in ["mat1_surface_color_palette", "surface_color_palette"] {
        let (stops, _) = layer(&look("2.10", &format!("{name} fd6029 698403 fff59b f5bd22;")));
        assert_eq!(stops.len(), 4, "{name}: {stops:?}");
        assert_eq!((stops[1].0.as_str(), stops[1].1), ("#698403", 0.25), "{name}");
    }
}

#[test]
fn surfaces_without_a_gradient_have_one_colour() {
    for (version, switch) in [("2.32", "mat1_use_colors_from_palette false;"), ("2.03", "fractal_color false;")] {
        let look = look(version, &format!("{switch}\nmat1_surface_color ffff 0000 0000;"));
        assert!(look.paint.layers.is_empty() && look.paint.palette == [[1.0, 0.0, 0.0]; 5], "{:?}", look.paint);
    }
}

#[test]
fn gradients_that_cannot_be_read_are_errors_with_their_place() {
    let text = "# Mandelbulber settings file\n# version 2.32\n[main_parameters]\nformula_1 2;\nmat1_surface_color_gradient 0 zz 10;\n";
    let (_, output) = import("scene.fract", text, &[]);
    let said = stderr(&output);
    assert!(output.status.code() == Some(2) && said.contains("scene.fract:5") && said.contains("places and"), "{said}");
}

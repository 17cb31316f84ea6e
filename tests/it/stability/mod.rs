//! Awkward inputs, each with its right answer, on every method, precision and back end.
//!
//! A row is a test of the same name in one of the modules below; its two sentences are in [`ROWS`], which
//! `docs/stability.md` is made from (`BULBFOLD_BLESS=1 cargo test --test it stability::page` renews it).

mod folds;
mod forms;
mod pictures;
mod powers;
mod suite;

macro_rules! rows {
    ($($module:ident::$name:ident: $happens:literal, $must:literal;)*) => {
        /// Name, what happens, what must happen.
        const ROWS: &[(&str, &str, &str)] = &[$((stringify!($name), $happens, $must)),*];

        $(#[test]
        fn $name() {
            $module::$name();
        })*
    };
}

rows! {
    powers::origin_of_bulbs:
        "At r = 0 angles and unit vectors have no direction: 0/0.",
        "The origin stays where it is: inside, with an estimate of 0, for every power, fractional ones too, and convention.";
    powers::start_of_julia_sets:
        "In Julia mode an orbit that starts at r = 0 goes on from c with a derivative of exactly 0.",
        "The state after one iteration is c. A slope of 0 tells nothing: exact methods say 0 and the march walks.";
    powers::poles_of_bulbs:
        "On the polar axis of acos, asin and y the azimuth is not defined: 0/0 in forms without trigonometry.",
        "The orbit is that of a real number, a^n + a (asin: the azimuth counts as 0); estimates are those of that orbit.";
    powers::fractional_powers:
        "Fractional powers have a seam along the azimuth of 180 degrees and at the poles.",
        "With c = 0 the set is the unit ball for every power, r ln r / 2 the estimate, on the seam and the poles too.";
    powers::powers_below_one:
        "|n| < 1 contracts: orbits go to r = 1 and nothing escapes.",
        "All points below the bailout are inside, with estimates of 0.";
    powers::negative_powers:
        "r^-n has a pole at 0 and takes far points near to it, so that escape is not divergence.",
        "With c = 0 all points beside the unit sphere escape; estimates are numbers from 0 up, or counted where single precision ends.";
    powers::power_overflow:
        "With a bailout of 1e3 and power 8, r^8 is 1e24, whose square is no number in single precision.",
        "The estimate is r ln r / 2, the same as with a bailout of 10.";
    powers::hopeless_overflow:
        "With a bailout of 1e6 and power 8, r^8 itself overflows in single precision.",
        "Not a number, and counted as such, or the right answer; never infinity, never a number that is wrong.";
    powers::max_iterations_0_and_1:
        "With no iteration nothing can escape; with one, only what the first map throws out.",
        "All is inside; then all with |p^8 + p| up to the bailout, and the estimate follows from dr = 8 r^7 + 1.";
    forms::large_bailout:
        "A linear orbit that is stopped at r = 1e6 overflows r squared only in what is made of it later.",
        "Pure scaling by 100 gives the distance to the origin.";
    forms::jacobian_squares:
        "Starting at 1e-18 from the attractor, the components of J are 1e24: their squares overflow.",
        "Pure scaling gives the distance to the origin, 1e-18.";
    forms::running_derivative:
        "Inside orbits go on to the iteration limit: 3^200 overflows dr and J in single precision.",
        "Inside is inside: the estimate is 0, whatever dr is.";
    forms::underflow:
        "Near a superattracting point r^8 underflows to 0, and dr with it; r = 1e-30 squares to 0.",
        "Inside, with an estimate of 0.";
    forms::small_bailout:
        "A bailout below the attractor's radius throws members out, and r - R is negative where they leave.",
        "Estimates are 0 there, never negative: the march walks instead of stepping backwards.";
    forms::iteration_shells:
        "Neighbouring points escape after different numbers of iterations, where finite differences would jump.",
        "Differences are taken at one count: pure scaling gives the distance just inside and outside each shell.";
    forms::tiny_differences:
        "A step of differences below the spacing of numbers near p is no step: the slope would be 0.",
        "A march never takes such a step: a ball 100 away from the origin is hit where it is.";
    forms::far_field:
        "Far away r ln r / 2 is more than the distance: at r = 100 it is 230.",
        "Rays start at the bounding sphere and meet the ball at the exact depth.";
    forms::grazing_rays:
        "Rays that just touch or just miss step in front of the surface for long.",
        "Those within the radius hit at the exact depth, those beyond miss.";
    folds::fold_planes:
        "On the plane of a fold the derivative has two values.",
        "The estimate on the plane is one of both sides', or between them.";
    folds::sphere_fold_radii:
        "At the two radii of a sphere fold the factor has a kink.",
        "The estimate at the radius is one of both sides', or between them.";
    folds::equal_coordinates:
        "Where coordinates are equal, sorting folds choose twice, and a derivative could count one coordinate twice or never.",
        "On the diagonals of the Menger sponge and the tetrahedron the estimate is the exact distance to the corner.";
    folds::fold_value_not_twice_the_limit:
        "A fold limit - value other than 2 limit jumps at the limit: no reflection.",
        "The jump is on the side that the step says, membership is that of the map, and no estimate is negative or NaN.";
    folds::conditional_translation:
        "The Menger sponge by conditional translation, 'if z < -1 then z += 2', jumps, and with a turn the jump shows.",
        "Without a turn it is the same set as by folds; with one, estimates stay numbers from 0 up.";
    folds::mandelbox_scales_near_one:
        "Scales within -1 ... 1 contract, and those just outside take thousands of iterations to escape.",
        "For scales inside nothing below the bailout escapes; near +-1 everything stays a number, and extents stay finite.";
    pictures::camera_inside_the_set:
        "Every ray starts inside: there is no surface in front.",
        "Every pixel is a hit at depth 0 after one estimate, with a finite colour.";
    pictures::camera_inside_the_bounding_sphere:
        "The bounding sphere's near side is behind the camera.",
        "Rays start at the camera, and depths are exact.";
    pictures::camera_on_the_surface:
        "The first estimate is 0 or a rounding error, and so is the hit threshold.",
        "Rays into the ball hit within a millionth, rays away from it miss, and no pixel is NaN.";
    pictures::zoom:
        "At 1e-5, 1e-9 and 1e-13 of the object in front of its surface, pixels are as small as that.",
        "In double precision the depth is right to 3 % down to 1e-13; in single precision all pixels are finite and hit.";
    pictures::nan_is_counted:
        "A step that gives NaN for some points.",
        "NaN counts as escaped, rays that met one are counted, no pixel is NaN, and the set behind is where it is.";
    pictures::infinity_is_counted:
        "A step that overflows for some points.",
        "Infinity counts as escaped, rays that met one are counted, no pixel is NaN, and the set behind is where it is.";
}

/// The page that the rows make.
fn page() -> String {
    let mut page = String::from(
        "# Where estimates fail, and what happens then\n\n\
        Each row is a test of that name, run with every method that applies, on the CPU in f64 and f32 and on the GPU where\n\
        there is one: `cargo test --release --test it stability::`. This page is made from the tests.\n\n\
        | row | what happens | what must happen |\n|---|---|---|\n",
    );
    for (name, happens, must) in ROWS {
        page.push_str(&format!("| `{name}` | {happens} | {must} |\n"));
    }
    page
}

#[test]
fn page_is_in_step() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/stability.md");
    if std::env::var("BULBFOLD_BLESS").is_ok_and(|v| v == "1") {
        std::fs::write(path, page()).unwrap();
    }
    let written = std::fs::read_to_string(path).unwrap_or_default();
    assert!(
        written == page(),
        "docs/stability.md is out of step: BULBFOLD_BLESS=1 cargo test --test it stability::page"
    );
}

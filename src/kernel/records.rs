//! What kernels read and write: each record is declared once, with typed, documented fields.
//!
//! All fields of a record hold the same type `T`: expressions where a function is composed, `usize` in `COLUMNS` (the
//! numbers of columns; a vector's is that of its first component), slices or numbers where results are read. Ports, inputs
//! of functions, outputs and columns follow from the declaration, in its order.
//!
//! ```
//! use bulbfold::kernel::records::{Marched, Ray};
//!
//! assert_eq!((Ray::COLUMNS.direction, Ray::COLUMNS.t_near, Ray::WIDTH), (3, 6, 8));
//! let columns: Vec<Vec<f64>> = (0..Marched::WIDTH).map(|column| vec![column as f64; 2]).collect();
//! assert_eq!(Marched::of(&columns).status[1], Marched::COLUMNS.status as f64);
//! ```

use super::Status;
use crate::expr::{Arena, Expr, Function, Inputs, Port, Type};

/// Declares a record.
macro_rules! record {
    ($(#[$doc:meta])* pub struct $name:ident { $($(#[$field_doc:meta])* $field:ident: $ty:ident,)+ }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Debug)]
        pub struct $name<T> {
            $($(#[$field_doc])* pub $field: T,)+
        }

        impl $name<usize> {
            /// The number of each field's first column.
            pub const COLUMNS: $name<usize> = {
                let next = 0;
                $(let ($field, next) = (next, next + Type::$ty.width as usize);)+
                let _ = next;
                $name { $($field,)+ }
            };
            /// Columns of all fields together.
            pub const WIDTH: usize = 0 $(+ Type::$ty.width as usize)+;
        }

        impl $name<Port> {
            /// The ports of all fields, in order.
            pub fn ports() -> Vec<Port> {
                vec![$(Port::new(stringify!($field), Type::$ty),)+]
            }
        }

        impl<'g> $name<Expr<'g>> {
            /// Takes the fields as the next inputs of a function.
            pub fn read(inputs: &mut Inputs<'g>) -> Self {
                $name::read_as("", inputs)
            }

            /// The same with something before the names of the ports.
            pub fn read_as(prefix: &str, inputs: &mut Inputs<'g>) -> Self {
                $name { $($field: inputs.take(format!("{prefix}{}", stringify!($field)), Type::$ty),)+ }
            }

            /// The fields as the first inputs of a function.
            pub fn first(arena: &'g Arena) -> Self {
                $name::read(&mut Inputs::new(arena))
            }

            /// Gives the fields as the next outputs of a function.
            pub fn write(self, function: &mut Function) {
                $(function.output(stringify!($field), self.$field);)+
            }
        }

        impl<T> $name<T> {
            /// The record with something made of each value, in order.
            pub fn map<U>(self, mut of: impl FnMut(T) -> U) -> $name<U> {
                $name { $($field: of(self.$field),)+ }
            }

            /// The values in order.
            pub fn values(self) -> Vec<T> {
                vec![$(self.$field,)+]
            }
        }
    };
}

/// Declares a record that begins with what changes along a march.
macro_rules! march_record {
    ($(#[$doc:meta])* pub struct $name:ident { $($more:tt)* }) => {
        record! {
            $(#[$doc])*
            pub struct $name {
                /// Where the march is on its ray; the depth of the hit where it has hit. In beams, the beam's radius there.
                t: F,
                /// Where the estimate fell below the hit threshold before the ray came here: surfaces are looked at there.
                t_front: F,
                /// The last point that is known to be outside; [`UNKNOWN`] before there is one, for rays that begin inside.
                t_outside: F,
                /// The nearest point that is known to be inside; [`UNKNOWN`] before there is one.
                t_inside: F,
                /// The last estimate, with 0 for one that was not a number; [`UNKNOWN`] before there is one. Marches of
                /// proofs keep here how far the next proof is to reach, negative once something unproven was crossed.
                last_de: F,
                /// [`Status::RUNNING`] while the march goes on, then the code of a [`Status`].
                status: F,
                $($more)*
            }
        }
    };
}

record! {
    /// A place in the picture, in pixels from its upper left corner: `x` to the right, `y` down, centres at halves.
    pub struct Pixel {
        /// Columns to the right.
        x: F,
        /// Rows down.
        y: F,
    }
}

record! {
    /// A place in the picture whose ray begins where a beam ended.
    pub struct Begin {
        /// As in [`Pixel`].
        x: F,
        /// As in [`Pixel`].
        y: F,
        /// Depth at which the ray begins, at the earliest.
        start: F,
    }
}

record! {
    /// A cone around the ray through a place in the picture.
    pub struct Beam {
        /// As in [`Pixel`].
        x: F,
        /// As in [`Pixel`].
        y: F,
        /// The most that a unit direction of the cone differs from the central one, in length.
        spread: F,
        /// Depth at which the cone begins.
        start: F,
    }
}

record! {
    /// A ray, in world units, and the range of its parameter `t`. Where `t_far` is not above `t_near` the range is empty: the
    /// ray misses without an estimate.
    pub struct Ray {
        /// Where `t` is 0.
        origin: V3,
        /// What `t` is multiplied by: a unit vector, except in beams.
        direction: V3,
        /// Where the march begins; not below 0.
        t_near: F,
        /// Where it ends in a miss; [`Ray::NOWHERE`] makes the range empty.
        t_far: F,
    }
}

impl Ray<f64> {
    /// A `t_far` that makes the range empty wherever it begins.
    pub const NOWHERE: f64 = -1.0;

    /// The point at `t` of ray `i` of columns of rays.
    pub fn point(columns: &[Vec<f64>], i: usize, t: f64) -> [f64; 3] {
        let Ray { origin, direction, .. } = Ray::COLUMNS;
        [0, 1, 2].map(|k| columns[origin + k][i] + columns[direction + k][i] * t)
    }

    /// Columns of rays.
    pub fn columns(rays: impl IntoIterator<Item = ([f64; 3], [f64; 3], [f64; 2])>) -> Vec<Vec<f64>> {
        let mut columns = vec![Vec::new(); Ray::WIDTH];
        for (origin, direction, range) in rays {
            let values = origin.into_iter().chain(direction).chain(range);
            columns.iter_mut().zip(values).for_each(|(column, value)| column.push(value));
        }
        columns
    }
}

march_record! {
    /// What changes along a march: a ray's state.
    pub struct MarchState {}
}

march_record! {
    /// What a march gives: the last state of each ray, and counts. Of marches towards a light only the status and the counts
    /// mean anything.
    pub struct Marched {
        /// Estimates made.
        steps: F,
        /// Iterations of all of them.
        iterations: F,
        /// Estimates that were not a number.
        nan: F,
    }
}

impl<'g> MarchState<Expr<'g>> {
    /// This state, or another one where a condition holds.
    pub fn or(self, condition: Expr<'g>, other: MarchState<Expr<'g>>) -> MarchState<Expr<'g>> {
        let mut others = other.values().into_iter();
        self.map(|own| others.next().map_or(own, |other| condition.select(other, own)))
    }
}

/// What a march's state holds of depths and estimates before they are known. What is known is not negative, except the
/// `last_de` of a march of proofs.
pub const UNKNOWN: f64 = -1.0;

/// Whether a value of a march's state is known.
pub fn is_known(value: Expr<'_>) -> Expr<'_> {
    value.lift(0.0).le(value)
}

/// Whether a value of a march's state is [`UNKNOWN`].
pub fn is_unknown(value: Expr<'_>) -> Expr<'_> {
    value.lt(value.lift(0.0))
}

record! {
    /// What an estimator is asked, in world units.
    pub struct Query {
        /// Where.
        p: V3,
        /// Unit direction of the ray that asks.
        d: V3,
        /// Step of finite differences; for proofs, how far the proof is to reach.
        h: F,
        /// Hit threshold, which is how thick a shell counts; [`Query::NOT_WANTED`] for elements that may give anything.
        hit_eps: F,
    }
}

impl Query<f64> {
    /// The `hit_eps` of elements whose answer is not wanted: nothing is iterated for them.
    pub const NOT_WANTED: f64 = -1.0;
}

record! {
    /// What an estimator answers first.
    pub struct Answer {
        /// Distance estimate in world units. 0 or what is not a number says that nothing is known; of points inside it means
        /// nothing.
        de: F,
        /// Whether the point belongs to the set.
        inside: B,
    }
}

record! {
    /// What is known of a surface where it is looked at.
    pub struct Surface {
        /// Unit gradient of the distance: out of the surface, where it is anything.
        gradient: V3,
        /// Least distances of the orbit from the traps.
        trap: V4,
    }
}

record! {
    /// What a surface is made of. Names and meanings are those of glTF 2.0 (`KHR_materials_*`) and OpenPBR 1.1.
    pub struct Matter {
        /// Base colour, linear: the albedo of what is no metal, the reflectance along the normal of what is.
        base: V3,
        /// From 0 (dielectric) to 1 (metal).
        metallic: F,
        /// From 0 (mirror) to 1 (matte); its square is the width of the microfacets' distribution.
        roughness: F,
        /// Weight of the dielectric reflection, from 0 to 1.
        specular: F,
        /// Share of the light that enters and is not scattered back, from 0 to 1.
        transmission: F,
        /// Distance over which light inside takes on the base colour, in world units; 0 where it does so at the surface.
        transmission_depth: F,
        /// Index of refraction, at least 1.
        ior: F,
        /// Weight of a clear coat, from 0 to 1.
        coat: F,
        /// Roughness of the coat, from 0 to 1.
        coat_roughness: F,
        /// Radiance that it emits, linear, at least 0.
        emission: V3,
    }
}

record! {
    /// A path of light, followed from the camera.
    pub struct Path {
        /// What of the light at the path's next point reaches the camera: linear, by colour.
        throughput: V3,
        /// Density, by solid angle, of the direction that the path took last; [`UNKNOWN`] on its way from the camera, 0 once it has ended.
        density: F,
        /// Surfaces that it has met.
        bounces: F,
        /// Light that it has found so far, linear.
        radiance: V3,
        /// 1 where it goes on inside what light goes through, else 0.
        inside: F,
    }
}

record! {
    /// What a pixel shows by way of mirrors.
    pub struct Mirrored {
        /// What of the light of the surface that the next ray meets reaches the camera, linear, by colour; 0 where the ray is not wanted.
        throughput: V3,
        /// Radiance of the surroundings that is shown already in place of that light.
        counted: V3,
        /// Light that is shown so far, linear.
        radiance: V3,
    }
}

record! {
    /// Random numbers that pick a point of the lens's opening, each from 0 to 1.
    pub struct LensPoint {
        /// Picks how far it is from the middle.
        u: F,
        /// Picks on which side it is.
        v: F,
    }
}

record! {
    /// Random numbers of a point of a path, each from 0 to 1.
    pub struct Random {
        /// Picks a light.
        light: F,
        /// Pick a direction towards it.
        light_u: F,
        /// See `light_u`.
        light_v: F,
        /// Picks what scatters the path.
        lobe: F,
        /// Pick the direction of the path.
        u: F,
        /// See `u`.
        v: F,
        /// Ends the path.
        survival: F,
    }
}

record! {
    /// A linear colour.
    pub struct Colour {
        /// Red, green and blue from 0 to 1.
        colour: V3,
    }
}

impl<'a> Marched<&'a [f64]> {
    /// The fields of a march's columns. Panics where columns are missing.
    pub fn of(columns: &'a [Vec<f64>]) -> Marched<&'a [f64]> {
        Marched::COLUMNS.map(|column| &columns[column][..])
    }

    /// What the march gave for ray `i`.
    pub fn ray(&self, i: usize) -> Marched<f64> {
        self.map(|column| column[i])
    }

    /// What the march gave for each ray.
    pub fn rays(self) -> impl Iterator<Item = Marched<f64>> + 'a {
        (0..self.t.len()).map(move |i| self.ray(i))
    }
}

impl Marched<f64> {
    /// How the march ended.
    pub fn end(&self) -> Status {
        Status::from_code(self.status)
    }

    /// The depth of the hit, where there is one.
    pub fn depth(&self) -> Option<f64> {
        (self.end() == Status::Hit).then_some(self.t)
    }

    /// Whether no point of the ray is known to be outside: it begins inside, or was never marched.
    pub fn begins_inside(&self) -> bool {
        self.t_outside < 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::{MarchState, Marched, Query, Ray, Surface};
    use crate::expr::{Arena, Function, Inputs, Port, Type};

    #[test]
    fn ports_inputs_and_columns_follow_from_the_declaration() {
        assert_eq!((Ray::WIDTH, Query::WIDTH, Surface::WIDTH), (8, 8, 7));
        assert_eq!((Query::COLUMNS.hit_eps, Surface::COLUMNS.trap), (7, 3));
        assert_eq!(Marched::ports()[..MarchState::WIDTH], MarchState::ports());
        let arena = Arena::default();
        let mut inputs = Inputs::new(&arena);
        let (_, surface) = (Ray::read(&mut inputs), Surface::read_as("other_", &mut inputs));
        assert_eq!(surface.trap.id, arena.input(5, Type::V4).id);
        let mut function = inputs.function("both");
        assert_eq!(function.inputs[5], Port::new("other_trap", Type::V4));
        assert_eq!(Port::scalars(&function.inputs), Ray::WIDTH + Surface::WIDTH);
        surface.write(&mut function);
        assert_eq!(function.output_ports(), Surface::ports());
        assert_eq!(Function::new("", Ray::ports()).inputs.len(), 4);
    }
}

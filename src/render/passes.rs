//! A picture as a list of passes: kernels, what each of them reads and what it writes.
//!
//! Nothing here knows a picture. A [`Chain`] is the passes that lead from what is given to what is wanted, made ready on a
//! back end: a whole picture, or the first few passes of one for those who ask where its rays end. A light is two more
//! passes.

use std::time::{Duration, Instant};

use crate::expr::Arena;
use crate::kernel::records::{Marched, Ray};
use crate::kernel::{Backend, BackendError, Kernel, Status};

/// What a pass is for: its name, and the handle by which its kernel is found.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum Role {
    /// Places in the picture to rays.
    Camera,
    /// Tiles to beams.
    Beam,
    /// Beams to their ends.
    BeamMarch,
    /// Places in the picture, and where beams ended, to rays.
    Begin,
    /// Places in the picture where nothing is to colours.
    Background,
    /// Rays to their ends.
    March,
    /// Ends to what is asked of surfaces.
    SurfacePoint,
    /// Answers of surfaces.
    Surface,
    /// Surfaces to rays towards a light, by its number.
    ShadowRay(u8),
    /// Rays towards a light to their ends.
    ShadowMarch(u8),
    /// Surfaces to rays along their normals.
    CornerRay,
    /// Rays along normals to how open their places are.
    CornerMarch,
    /// Rays to how closely they pass.
    PassingMarch,
    /// Rays through the middle of a lens to rays through its opening.
    Blur,
    /// What is seen directly to what is shown before the first mirror.
    MirrorStart,
    /// Surfaces to the rays that they mirror.
    MirrorRay,
    /// What such a ray meets to what is shown with it.
    MirrorStep,
    /// What is shown to colours.
    MirrorEnd,
    /// Rays of paths to those inside what light goes through.
    InnerRay,
    /// Those to where they leave it.
    InnerMarch,
    /// Both ends of rays to the one that counts.
    JoinEnds,
    /// Points of paths to rays towards the lights that are picked there.
    LightRay,
    /// Those rays to their ends.
    LightMarch,
    /// Points of paths to the rays on which they go on.
    BounceRay,
    /// Points of paths to their next states.
    PathStep,
    /// All of it to colours.
    Colour,
    /// All of it to what is kept besides colours.
    Data,
    /// Colours to bytes.
    Encode,
}

impl Role {
    /// The name in listings.
    pub fn name(self) -> &'static str {
        match self {
            Role::Camera => "camera",
            Role::Beam => "beam",
            Role::BeamMarch => "beam_march",
            Role::Begin => "begin",
            Role::Background => "background",
            Role::March => "march",
            Role::SurfacePoint => "surface_point",
            Role::Surface => "surface",
            Role::ShadowRay(_) => "shadow_ray",
            Role::ShadowMarch(_) => "shadow_march",
            Role::CornerRay => "corner_ray",
            Role::CornerMarch => "corner_march",
            Role::PassingMarch => "passing_march",
            Role::Blur => "blur",
            Role::MirrorStart => "mirror_start",
            Role::MirrorRay => "mirror_ray",
            Role::MirrorStep => "mirror_step",
            Role::MirrorEnd => "mirror_end",
            Role::InnerRay => "inner_ray",
            Role::InnerMarch => "inner_march",
            Role::JoinEnds => "join_ends",
            Role::LightRay => "light_ray",
            Role::LightMarch => "light_march",
            Role::BounceRay => "bounce_ray",
            Role::PathStep => "path_step",
            Role::Colour => "colour",
            Role::Data => "data",
            Role::Encode => "encode",
        }
    }
}

/// What passes read and write: columns of one record, an element a ray, pixel or tile.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Slot {
    /// [`Pixel`](crate::kernel::records::Pixel)s.
    Points,
    /// The same with where beams ended: [`Begin`](crate::kernel::records::Begin)s.
    Begins,
    /// [`Beam`](crate::kernel::records::Beam)s, of tiles.
    Tiles,
    /// Beams as [`Ray`]s.
    Beams,
    /// What their march gave, [`Marched`].
    BeamEnds,
    /// [`Ray`]s.
    Rays,
    /// What their march gave, [`Marched`].
    Ends,
    /// [`Query`](crate::kernel::records::Query)s of surfaces.
    Queries,
    /// [`Surface`](crate::kernel::records::Surface)s.
    Surfaces,
    /// [`Ray`]s towards a light, by its number.
    ShadowRays(u8),
    /// What their march gave, [`Marched`].
    Shadows(u8),
    /// [`Ray`]s along normals.
    CornerRays,
    /// What their march gave, [`Marched`].
    Corners,
    /// What a march of the picture's rays gave that looks how closely they pass, [`Marched`].
    Passing,
    /// What is shown before a mirrored ray, [`Mirrored`](crate::kernel::records::Mirrored).
    Mirrors,
    /// The same after it.
    MirrorsAfter,
    /// [`LensPoint`](crate::kernel::records::LensPoint)s.
    LensPoints,
    /// [`Ray`]s through the opening of a lens.
    BlurredRays,
    /// [`Path`](crate::kernel::records::Path)s before a point.
    Paths,
    /// [`Ray`]s inside what light goes through.
    InnerRays,
    /// Where they leave it, [`Marched`].
    InnerEnds,
    /// The ends of rays on either side, [`Marched`].
    JoinedEnds,
    /// The [`Random`](crate::kernel::records::Random) numbers of a point.
    Randoms,
    /// [`Ray`]s towards the lights that are picked there.
    LightRays,
    /// What their march gave, [`Marched`].
    Lit,
    /// The [`Ray`]s on which paths go on, or that surfaces mirror.
    NextRays,
    /// [`Path`](crate::kernel::records::Path)s after a point.
    NextPaths,
    /// [`Colour`](crate::kernel::records::Colour)s.
    Colours,
    /// [`Colour`](crate::kernel::records::Colour)s of pixels where nothing is.
    Backgrounds,
    /// What is kept besides colours.
    Data,
    /// Encoded colours.
    Bytes,
}

impl Slot {
    /// Whether it holds the ends of further rays than the picture's own, whose estimates are counted with those of shadows.
    pub fn is_further_march(self) -> bool {
        matches!(self, Slot::Shadows(_) | Slot::Corners | Slot::Passing)
    }
}

/// A kernel (or what became of it), what it reads and what it writes.
#[derive(Clone, Debug)]
pub struct Pass<K> {
    /// What it is for.
    pub role: Role,
    /// Its inputs, in the order of the kernel's.
    pub reads: Vec<Slot>,
    /// Its output.
    pub writes: Slot,
    /// What runs.
    pub kernel: K,
}

/// Passes in the order in which they may run: each reads what is given, or what those before it wrote.
#[derive(Clone, Debug)]
pub struct Passes<K> {
    list: Vec<Pass<K>>,
}

impl<K> Default for Passes<K> {
    fn default() -> Self {
        Passes { list: Vec::new() }
    }
}

impl<K> Passes<K> {
    /// Adds a pass after the others.
    pub fn push(&mut self, role: Role, reads: impl Into<Vec<Slot>>, writes: Slot, kernel: K) {
        self.list.push(Pass { role, reads: reads.into(), writes, kernel });
    }

    /// All passes in order.
    pub fn iter(&self) -> impl Iterator<Item = &Pass<K>> {
        self.list.iter()
    }

    /// What runs in a role.
    pub fn get(&self, role: Role) -> Option<&K> {
        self.list.iter().find(|pass| pass.role == role).map(|pass| &pass.kernel)
    }

    /// Leaves passes out.
    pub fn retain(&mut self, keep: impl Fn(Role) -> bool) {
        self.list.retain(|pass| keep(pass.role));
    }

    /// The list without its kernels.
    pub fn plan(&self) -> Passes<()> {
        let pass =
            |pass: &Pass<K>| Pass { role: pass.role, reads: pass.reads.clone(), writes: pass.writes, kernel: () };
        Passes { list: self.list.iter().map(pass).collect() }
    }

    /// The passes, by number, that lead from what is given to what is wanted. What nothing leads to is left out.
    fn route(&self, given: &[Slot], wanted: &[Slot]) -> Vec<usize> {
        let mut route = Vec::new();
        for &slot in wanted {
            let mut longer = route.clone();
            if self.reach(slot, given, &mut longer) {
                route = longer;
            }
        }
        route.sort_unstable();
        route
    }

    /// Adds the passes that a slot needs; false where it cannot be written.
    fn reach(&self, slot: Slot, given: &[Slot], route: &mut Vec<usize>) -> bool {
        if given.contains(&slot) {
            return true;
        }
        self.list.iter().enumerate().filter(|(_, pass)| pass.writes == slot).any(|(number, pass)| {
            if route.contains(&number) {
                return true;
            }
            let mut longer = route.clone();
            let is_reached = pass.reads.iter().all(|&read| self.reach(read, given, &mut longer));
            if is_reached {
                *route = longer;
                route.push(number);
            }
            is_reached
        })
    }
}

/// One pass of a chain.
struct Step<B: Backend> {
    role: Role,
    kernel: B::Prepared,
    reads: Vec<Slot>,
    writes: Slot,
    /// What no later pass reads and nobody wants.
    done: Vec<Slot>,
}

/// Passes made ready on a back end that lead from some columns to others.
pub struct Chain<B: Backend> {
    steps: Vec<Step<B>>,
}

/// What passes wrote, by slot.
pub struct Written<C>(Vec<(Slot, C)>);

impl<C> Written<C> {
    /// Takes what was written to a slot out.
    pub fn take(&mut self, slot: Slot) -> Option<C> {
        let at = self.0.iter().position(|(written, _)| *written == slot)?;
        Some(self.0.remove(at).1)
    }

    /// What was written to the slots that are left, in the order of the passes.
    pub fn rest(self) -> Vec<C> {
        self.0.into_iter().map(|(_, columns)| columns).collect()
    }
}

impl<B: Backend> Chain<B> {
    /// The passes that lead from what is given to what is wanted; `prepare` makes the kernels of their roles ready. What
    /// nothing leads to is left out.
    pub fn new<K>(
        passes: &Passes<K>,
        given: &[Slot],
        wanted: &[Slot],
        mut prepare: impl FnMut(&Pass<K>) -> Result<B::Prepared, BackendError>,
    ) -> Result<Chain<B>, BackendError> {
        let route: Vec<&Pass<K>> = passes.route(given, wanted).into_iter().map(|number| &passes.list[number]).collect();
        let mut steps = Vec::new();
        for (number, pass) in route.iter().enumerate() {
            let is_read_later = |slot: &Slot| route[number + 1..].iter().any(|later| later.reads.contains(slot));
            let is_done = |slot: &Slot| !given.contains(slot) && !wanted.contains(slot) && !is_read_later(slot);
            let done = pass.reads.iter().copied().filter(is_done).collect();
            let (role, reads, writes) = (pass.role, pass.reads.clone(), pass.writes);
            steps.push(Step { role, kernel: prepare(pass)?, reads, writes, done });
        }
        Ok(Chain { steps })
    }

    /// The same, of kernels that are still to be compiled.
    pub fn compile(
        backend: &B,
        arena: &Arena,
        passes: &Passes<Kernel>,
        given: &[Slot],
        wanted: &[Slot],
    ) -> Result<Chain<B>, BackendError> {
        Chain::new(passes, given, wanted, |pass| backend.prepare(arena, &pass.kernel))
    }

    /// Runs the passes; `timed` is told how long each took. Gives what was written and is wanted.
    pub fn run(
        &self,
        backend: &B,
        given: &[(Slot, &B::Columns)],
        mut timed: impl FnMut(Role, Duration),
    ) -> Result<Written<B::Columns>, BackendError> {
        let mut written: Vec<(Slot, B::Columns)> = Vec::with_capacity(self.steps.len());
        for step in &self.steps {
            let start = Instant::now();
            let find = |read: &Slot| {
                let own = written.iter().find(|(slot, _)| slot == read).map(|(_, columns)| columns);
                own.or_else(|| given.iter().find(|(slot, _)| slot == read).map(|(_, columns)| *columns))
            };
            let inputs: Vec<&B::Columns> =
                step.reads.iter().map(|read| find(read).expect("a pass before it wrote what it reads")).collect();
            let columns = backend.run(&step.kernel, &inputs)?;
            written.push((step.writes, columns));
            written.retain(|(slot, _)| !step.done.contains(slot));
            timed(step.role, start.elapsed());
        }
        Ok(Written(written))
    }

    /// Runs the passes on columns of numbers, and gives what was written to the slot that is wanted.
    pub fn write(&self, backend: &B, slot: Slot, columns: &[impl AsRef<[f64]>], wanted: Slot) -> WrittenTo<B> {
        let given = backend.upload(columns)?;
        let mut written = self.run(backend, &[(slot, &given)], |_, _| {})?;
        Ok(written.take(wanted).expect("the chain leads there"))
    }
}

/// Columns that a chain wrote to the slot that was wanted.
type WrittenTo<B> = Result<<B as Backend>::Columns, BackendError>;

/// The first passes of a picture, up to where its rays end: for whoever asks about rays and not about colours.
pub struct Marches<B: Backend> {
    rays: Chain<B>,
    march: Chain<B>,
}

/// Where rays came from and how they ended.
pub struct Ends {
    /// Columns of [`Ray`].
    pub rays: Vec<Vec<f64>>,
    /// Columns of [`Marched`].
    pub ends: Vec<Vec<f64>>,
}

impl<B: Backend> Marches<B> {
    /// Compiles what leads from points of the picture to ends of rays.
    pub fn new(backend: &B, arena: &Arena, passes: &Passes<Kernel>) -> Result<Marches<B>, BackendError> {
        Ok(Marches {
            rays: Chain::compile(backend, arena, passes, &[Slot::Points], &[Slot::Rays])?,
            march: Chain::compile(backend, arena, passes, &[Slot::Rays], &[Slot::Ends])?,
        })
    }

    /// The rays through points of the picture, where the back end has them.
    pub fn rays(&self, backend: &B, points: &[Vec<f64>; 2]) -> Result<B::Columns, BackendError> {
        self.rays.write(backend, Slot::Points, points, Slot::Rays)
    }

    /// The ends of rays, where the back end has them.
    pub fn ends(&self, backend: &B, rays: &B::Columns) -> Result<B::Columns, BackendError> {
        march(backend, &self.march, rays)
    }

    /// Marches points of the picture.
    pub fn run(&self, backend: &B, points: &[Vec<f64>; 2]) -> Result<Ends, BackendError> {
        let rays = self.rays(backend, points)?;
        let ends = backend.download(&self.ends(backend, &rays)?)?;
        Ok(Ends { rays: backend.download(&rays)?, ends })
    }
}

/// The ends of rays by a chain that leads from [`Slot::Rays`] to [`Slot::Ends`].
pub(super) fn march<B: Backend>(backend: &B, chain: &Chain<B>, rays: &B::Columns) -> WrittenTo<B> {
    let mut written = chain.run(backend, &[(Slot::Rays, rays)], |_, _| {})?;
    Ok(written.take(Slot::Ends).expect("a march gives ends"))
}

/// The depths of hits among ends.
pub(super) fn depths<B: Backend>(backend: &B, ends: &B::Columns) -> Result<Vec<Option<f64>>, BackendError> {
    let Marched { t, status, .. } = Marched::COLUMNS;
    let columns = backend.download_only(ends, &[t, status])?;
    let depth = |(&t, &status): (&f64, &f64)| (Status::from_code(status) == Status::Hit).then_some(t);
    Ok(columns[0].iter().zip(&columns[1]).map(depth).collect())
}

impl Ends {
    /// How the rays ended.
    pub fn marched(&self) -> Marched<&[f64]> {
        Marched::of(&self.ends)
    }

    /// The depths and points of hits in front of the camera; nothing of other rays.
    pub fn hits(&self) -> impl Iterator<Item = Option<(f64, [f64; 3])>> + '_ {
        let hit = |(i, end): (usize, Marched<f64>)| {
            let t = end.depth().filter(|t| *t > 0.0)?;
            Some((t, Ray::point(&self.rays, i, t)))
        };
        self.marched().rays().enumerate().map(hit)
    }
}

/// Columns of the points in the middle of pixels.
pub fn centres(pixels: &[(u32, u32)]) -> [Vec<f64>; 2] {
    let of = |of: fn(&(u32, u32)) -> u32| pixels.iter().map(|pixel| f64::from(of(pixel)) + 0.5).collect();
    [of(|pixel| pixel.0), of(|pixel| pixel.1)]
}

/// Columns of points on an even grid over a picture, row by row.
pub fn grid(grid: crate::shade::Size, size: crate::shade::Size) -> [Vec<f64>; 2] {
    let place = |i: u32, of: u32, edge: u32| (f64::from(i) + 0.5) / f64::from(of) * f64::from(edge);
    let cells = || (0..grid.height).flat_map(|j| (0..grid.width).map(move |i| (i, j)));
    let x = cells().map(|(i, _)| place(i, grid.width, size.width)).collect();
    let y = cells().map(|(_, j)| place(j, grid.height, size.height)).collect();
    [x, y]
}

#[cfg(test)]
mod tests {
    use super::{Passes, Role, Slot};

    /// A picture with two lights and beams.
    fn passes() -> Passes<()> {
        let mut passes = Passes::default();
        passes.push(Role::Camera, [Slot::Points], Slot::Rays, ());
        passes.push(Role::Begin, [Slot::Begins], Slot::Rays, ());
        passes.push(Role::March, [Slot::Rays], Slot::Ends, ());
        for light in [0, 1] {
            passes.push(Role::ShadowRay(light), [Slot::Rays, Slot::Ends], Slot::ShadowRays(light), ());
            passes.push(Role::ShadowMarch(light), [Slot::ShadowRays(light)], Slot::Shadows(light), ());
        }
        let reads = [Slot::Rays, Slot::Ends, Slot::Shadows(0), Slot::Shadows(1)];
        passes.push(Role::Colour, reads, Slot::Colours, ());
        passes
    }

    #[test]
    fn what_is_given_and_wanted_says_which_passes_run() {
        let passes = passes();
        let route = |given: &[Slot], wanted: &[Slot]| -> Vec<Role> {
            passes.route(given, wanted).into_iter().map(|number| passes.list[number].role).collect()
        };
        assert_eq!(route(&[Slot::Points], &[Slot::Rays]), [Role::Camera]);
        assert_eq!(route(&[Slot::Points], &[Slot::Ends]), [Role::Camera, Role::March]);
        assert_eq!(route(&[Slot::Begins], &[Slot::Ends]), [Role::Begin, Role::March]);
        assert_eq!(route(&[Slot::Rays], &[Slot::Shadows(1)]), [Role::March, Role::ShadowRay(1), Role::ShadowMarch(1)]);
        assert_eq!(route(&[Slot::Rays, Slot::Ends], &[Slot::Colours]).len(), 5);
        assert_eq!(route(&[Slot::Tiles], &[Slot::BeamEnds, Slot::Tiles]), []);
    }
}

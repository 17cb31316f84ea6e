//! Bounds of expressions over balls, as expressions: what proofs about a whole region are made of.
//!
//! An [`Encloser`] is given nodes that range over a ball (or are known exactly) and says between which values any other
//! node lies, by interval evaluation with the rules of the operator table. Where a length or a plane's distance is
//! taken of a ball the ball itself is used, not the box around it, so that no factor sqrt(3) is lost. Bounds are not
//! rounded outwards: who needs that adds a margin.

use rustc_hash::FxHashMap;

use super::differentiate::reachable;
use super::ops::Operator;
use super::{Arena, Expr, NodeId, Op, Type};

/// Stands for "no bound" and stays finite in products with ordinary numbers in single precision.
pub const UNBOUNDED: f64 = 1e18;

/// Bounds of a number over a region; of a truth value, whether it surely (`lo`) and whether it possibly (`hi`) holds.
#[derive(Clone, Copy, Debug)]
pub struct Bounds<'g> {
    /// Not above any value.
    pub lo: Expr<'g>,
    /// Not below any value.
    pub hi: Expr<'g>,
}

impl<'g> Bounds<'g> {
    /// One value.
    pub fn exactly(x: Expr<'g>) -> Bounds<'g> {
        Bounds { lo: x, hi: x }
    }

    /// All values within `radius` of `centre`.
    pub fn around(centre: Expr<'g>, radius: Expr<'g>) -> Bounds<'g> {
        Bounds { lo: centre - radius, hi: centre + radius }
    }

    /// Nothing is known.
    pub fn unknown(arena: &'g Arena) -> Bounds<'g> {
        Bounds { lo: arena.f(-UNBOUNDED), hi: arena.f(UNBOUNDED) }
    }

    /// True if both bounds are one node.
    pub fn is_exact(self) -> bool {
        self.lo.id == self.hi.id
    }

    /// The middle.
    pub fn middle(self) -> Expr<'g> {
        if self.is_exact() { self.lo } else { (self.lo + self.hi) * 0.5 }
    }

    /// Half the distance of the bounds.
    pub fn half_width(self) -> Expr<'g> {
        if self.is_exact() { self.lo.lift(0.0) } else { (self.hi - self.lo) * 0.5 }
    }

    /// The largest absolute value.
    pub fn magnitude(self) -> Expr<'g> {
        if self.is_exact() { self.lo.abs() } else { self.hi.max(-self.lo) }
    }

    /// The bounds of an increasing function.
    pub(super) fn rising(self, f: impl Fn(Expr<'g>) -> Expr<'g>) -> Bounds<'g> {
        Bounds { lo: f(self.lo), hi: f(self.hi) }
    }

    /// The bounds of a decreasing function.
    pub(super) fn falling(self, f: impl Fn(Expr<'g>) -> Expr<'g>) -> Bounds<'g> {
        Bounds { lo: f(self.hi), hi: f(self.lo) }
    }

    /// The product; of middle and half width, since minima would lose what is not a number.
    pub(super) fn times(self, other: Bounds<'g>) -> Bounds<'g> {
        let (a, b) = (self.middle(), other.middle());
        let (ra, rb) = (self.half_width(), other.half_width());
        Bounds::around(a * b, a.abs() * rb + b.abs() * ra + ra * rb)
    }

    /// The square: never negative, unlike the product of two numbers with these bounds.
    pub(super) fn squared(self) -> Bounds<'g> {
        let least = self.lo.max(-self.hi).max(self.lo.lift(0.0));
        let most = self.magnitude();
        Bounds { lo: least * least, hi: most * most }
    }

    /// The reciprocal; unknown where 0 is between the bounds.
    pub(super) fn reciprocal(self) -> Bounds<'g> {
        let zero = self.lo.lift(0.0);
        let apart = zero.lt(self.lo).or(self.hi.lt(zero));
        Bounds { lo: apart.select(1.0 / self.hi, zero - UNBOUNDED), hi: apart.select(1.0 / self.lo, zero + UNBOUNDED) }
    }

    /// A sine or cosine, whose slope is at most 1, from the function itself.
    pub(super) fn wave(self, f: impl Fn(Expr<'g>) -> Expr<'g>) -> Bounds<'g> {
        let (middle, half) = (f(self.middle()), self.half_width());
        let one = middle.lift(1.0);
        Bounds { lo: (middle - half).max(-one), hi: (middle + half).min(one) }
    }

    /// The extremes of a function of two numbers that lie in the corners of their rectangle.
    pub(super) fn corners(self, other: Bounds<'g>, f: impl Fn(Expr<'g>, Expr<'g>) -> Expr<'g>) -> Bounds<'g> {
        let values = [f(self.lo, other.lo), f(self.lo, other.hi), f(self.hi, other.lo), f(self.hi, other.hi)];
        let [a, b, c, d] = values;
        Bounds { lo: a.min(b).min(c.min(d)), hi: a.max(b).max(c.max(d)) }
    }
}

/// A ball that a vector ranges over.
#[derive(Clone, Copy)]
struct Ball<'g> {
    centre: Expr<'g>,
    radius: Expr<'g>,
}

/// Bounds of nodes of one arena. Inputs that are given no ball count as known exactly.
pub struct Encloser<'g> {
    arena: &'g Arena,
    known: FxHashMap<NodeId, Vec<Bounds<'g>>>,
    balls: FxHashMap<NodeId, Ball<'g>>,
    jumps: Expr<'g>,
}

impl<'g> Encloser<'g> {
    /// Each node ranges over the ball of this radius around itself.
    pub fn new(arena: &'g Arena, balls: &[(Expr<'g>, Expr<'g>)]) -> Self {
        let mut encloser =
            Encloser { arena, known: FxHashMap::default(), balls: FxHashMap::default(), jumps: arena.bool(false) };
        for &(centre, radius) in balls {
            let bounds = centre.components().into_iter().map(|x| Bounds::around(x, radius)).collect();
            encloser.known.insert(centre.id, bounds);
            encloser.balls.insert(centre.id, Ball { centre, radius });
        }
        encloser
    }

    /// Bounds of all components.
    pub fn bounds(&mut self, root: Expr<'g>) -> Vec<Bounds<'g>> {
        for id in reachable(self.arena, &[root.id]) {
            if !self.known.contains_key(&id) {
                let bounds = self.step(self.arena.expr(id));
                self.known.insert(id, bounds);
            }
        }
        self.known[&root.id].clone()
    }

    /// True if a value that was asked for may jump inside the region: a comparison that is not decided chooses
    /// between two values, a rounding changes, an angle crosses its cut. Where this is false, every value asked for is
    /// continuous over the region.
    pub fn jumps(&self) -> Expr<'g> {
        self.jumps
    }

    fn step(&mut self, y: Expr<'g>) -> Vec<Bounds<'g>> {
        let node = y.node();
        let width = node.ty.width as usize;
        let args: Vec<Expr<'g>> = node.args().iter().map(|&a| self.arena.expr(a)).collect();
        let b: Vec<Vec<Bounds<'g>>> = node.args().iter().map(|a| self.known[a].clone()).collect();
        if b.iter().flatten().all(|b| b.is_exact()) {
            return y.components().into_iter().map(Bounds::exactly).collect();
        }
        match node.op {
            Op::Const(_) | Op::Input(_) | Op::Uniform(_) => y.components().into_iter().map(Bounds::exactly).collect(),
            Op::Compose => b.iter().map(|b| b[0]).collect(),
            Op::Splat => vec![b[0][0]; width],
            Op::Extract(i) => vec![b[0][i as usize]],
            Op::Dot => vec![self.dot(&args, &b)],
            Op::Lookup(number) => {
                let [lo, hi] = self.arena.table(number).ends().map(|end| self.arena.f(end));
                vec![Bounds { lo, hi }]
            }
            Op::Apply(operator) => {
                self.move_ball(operator, y, &args);
                (0..width)
                    .map(|i| {
                        let of: Vec<Bounds<'g>> = b.iter().map(|b| b[i]).collect();
                        self.note_jump(operator, &of);
                        match operator {
                            Operator::Mul if args[0].id == args[1].id => of[0].squared(),
                            _ => operator.enclose(&of),
                        }
                    })
                    .collect()
            }
        }
    }

    /// A scalar product: of a ball with itself, of a ball with a known vector, or of anything.
    fn dot(&self, args: &[Expr<'g>], b: &[Vec<Bounds<'g>>]) -> Bounds<'g> {
        let zero = self.arena.f(0.0);
        if args[0].id == args[1].id {
            if let Some(ball) = self.balls.get(&args[0].id) {
                let r = ball.centre.length();
                return Bounds { lo: (r - ball.radius).max(zero), hi: r + ball.radius }.squared();
            }
            let squares = b[0].iter().map(|b| b.squared());
            return squares
                .reduce(|a, b| Bounds { lo: a.lo + b.lo, hi: a.hi + b.hi })
                .expect("vectors have components");
        }
        for (ball, other) in [(0, 1), (1, 0)] {
            if let (Some(ball), true) = (self.balls.get(&args[ball].id), b[other].iter().all(|b| b.is_exact())) {
                return Bounds::around(ball.centre.dot(args[other]), ball.radius * args[other].length());
            }
        }
        let products = b[0].iter().zip(&b[1]).map(|(a, b)| a.times(*b));
        products.reduce(|a, b| Bounds { lo: a.lo + b.lo, hi: a.hi + b.hi }).expect("vectors have components")
    }

    /// Balls stay balls under mirrors, shifts and factors.
    fn move_ball(&mut self, operator: Operator, y: Expr<'g>, args: &[Expr<'g>]) {
        let ball = |i: usize| args.get(i).and_then(|a| self.balls.get(&a.id)).copied();
        let exact = |i: usize| self.known[&args[i].id].iter().all(|b| b.is_exact());
        let moved = match (operator, ball(0), ball(1)) {
            (Operator::Neg | Operator::Abs, Some(ball), _) => Some(ball.radius),
            (Operator::Add | Operator::Sub, Some(ball), None) if exact(1) => Some(ball.radius),
            (Operator::Add | Operator::Sub, None, Some(ball)) if exact(0) => Some(ball.radius),
            (Operator::Mul, Some(ball), None) if exact(1) => Some(ball.radius * largest(args[1])),
            (Operator::Mul, None, Some(ball)) if exact(0) => Some(ball.radius * largest(args[0])),
            _ => None,
        };
        if let Some(radius) = moved {
            self.balls.insert(y.id, Ball { centre: y, radius });
        }
    }

    fn note_jump(&mut self, operator: Operator, b: &[Bounds<'g>]) {
        let jump = match operator {
            Operator::Select => (!b[0].lo).and(b[0].hi),
            Operator::Floor | Operator::Sign => {
                let y = operator.enclose(b);
                !y.lo.equals(y.hi)
            }
            Operator::Mod => {
                let turns = b[0].times(b[1].reciprocal());
                !turns.lo.floor().equals(turns.hi.floor())
            }
            Operator::Atan2 => crosses_cut(b[0], b[1]),
            // Comparisons jump only in what is chosen by them.
            _ => return,
        };
        self.jumps = self.jumps.or(jump);
    }
}

/// The largest absolute component.
fn largest(v: Expr<'_>) -> Expr<'_> {
    v.components().into_iter().map(Expr::abs).reduce(|a, b| a.max(b)).expect("vectors have components")
}

/// True if the rectangle of y and x touches the half line from the origin to negative x.
pub(super) fn crosses_cut<'g>(y: Bounds<'g>, x: Bounds<'g>) -> Expr<'g> {
    let zero = y.lo.lift(0.0);
    y.lo.le(zero).and(zero.le(y.hi)).and(x.lo.le(zero))
}

/// The roots, with some nodes replaced. Everything is built again, so identities that now apply are used.
pub fn substitute<'g>(arena: &'g Arena, roots: &[Expr<'g>], places: &[(Expr<'g>, Expr<'g>)]) -> Vec<Expr<'g>> {
    let mut built: FxHashMap<NodeId, Expr<'g>> = places.iter().map(|(from, to)| (from.id, *to)).collect();
    let ids: Vec<NodeId> = roots.iter().map(|r| r.id).collect();
    for id in reachable(arena, &ids) {
        if built.contains_key(&id) {
            continue;
        }
        let node = arena.node(id);
        arena.set_span(node.span);
        let args: Vec<Expr<'g>> = node.args().iter().map(|a| built[a]).collect();
        let new = match node.op {
            Op::Const(_) | Op::Input(_) | Op::Uniform(_) => arena.expr(id),
            Op::Compose => arena.compose(&args),
            Op::Splat => args[0].widen(node.ty.width),
            Op::Extract(i) => args[0].component(i),
            Op::Dot => args[0].dot(args[1]),
            Op::Lookup(number) => arena.look_up(&arena.table(number).clone(), args[0]),
            Op::Apply(operator) => Expr::apply(operator, &args),
        };
        built.insert(id, new);
    }
    arena.set_span(crate::diag::Span::NONE);
    roots.iter().map(|r| built[&r.id]).collect()
}

/// Bounds of the derivatives of a vector function along each component of `x`: row by row, `J[i][j]` that of output `i`
/// by component `j`.
pub fn enclose_jacobian<'g>(
    encloser: &mut Encloser<'g>,
    arena: &'g Arena,
    y: Expr<'g>,
    x: Expr<'g>,
) -> Vec<Vec<Bounds<'g>>> {
    let width = x.ty().width as usize;
    let columns: Vec<Vec<Bounds<'g>>> = (0..width)
        .map(|j| {
            let mut axis = [0.0; 4];
            axis[j] = 1.0;
            let direction = arena.constant(Type::F.with_width(width as u8), axis);
            let tangent = super::Differentiator::new(arena, &[(x, direction)]).derivative(y);
            encloser.bounds(tangent)
        })
        .collect();
    (0..columns[0].len()).map(|i| columns.iter().map(|column| column[i]).collect()).collect()
}

/// A bound of the largest singular value of every matrix within the bounds: the root of the product of the largest sums
/// of rows and of columns.
pub fn norm_bound<'g>(rows: &[Vec<Bounds<'g>>]) -> Expr<'g> {
    let size = |i: usize, j: usize| rows[i][j].magnitude();
    let most = |sums: Vec<Expr<'g>>| sums.into_iter().reduce(|a, b| a.max(b)).expect("matrices have rows");
    let sum = |parts: Vec<Expr<'g>>| parts.into_iter().reduce(|a, b| a + b).expect("matrices have columns");
    let (height, width) = (rows.len(), rows[0].len());
    let by_rows = most((0..height).map(|i| sum((0..width).map(|j| size(i, j)).collect())).collect());
    let by_columns = most((0..width).map(|j| sum((0..height).map(|i| size(i, j)).collect())).collect());
    (by_rows * by_columns).sqrt()
}

//! Names that a script uses and does not define: found in its syntax tree, all of them, before anything runs.

use std::collections::{HashMap, HashSet};

use rhai::{AST, ASTNode, Expr, FnCallExpr, Position, Stmt, StmtBlock};

use crate::formula::symbolic::swizzle;

/// A name without a meaning.
#[derive(PartialEq, Eq, Debug)]
pub(super) struct Unknown {
    pub kind: UnknownKind,
    pub name: String,
    pub position: Position,
    /// Names that may have been meant.
    pub near: Vec<String>,
}

/// What the name stands for.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum UnknownKind {
    Function,
    Variable,
    /// A parameter of the step.
    Parameter,
    /// A component of a vector.
    Component,
}

/// What a variable holds, as far as its name tells.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Holds {
    Anything,
    /// A vector of the orbit.
    Vector,
    /// The parameters of the step.
    Parameters,
}

/// What is known outside of the script.
pub(super) struct Known<'a> {
    /// Names of functions.
    pub functions: &'a HashSet<String>,
    /// Names of values.
    pub values: &'a [&'a str],
    /// Names of the step's parameters, where the script is a step whose description could be read.
    pub params: Option<&'a [&'a str]>,
}

/// Functions of step files: which argument holds the parameters, and how many before it are vectors of the orbit.
const ENTRIES: [(&str, usize, usize, usize); 11] = [
    ("step", 3, 2, 2),
    ("step", 4, 2, 2),
    ("derivative", 3, 2, 1),
    ("derivative", 5, 2, 1),
    ("distance", 2, 1, 1),
    ("growth", 3, 2, 1),
    ("stretch", 3, 2, 1),
    ("bend", 4, 3, 2),
    ("tube", 5, 4, 2),
    ("chord", 5, 4, 2),
    ("material", 2, 1, 0),
];

/// Most names that are reported for one script.
const MOST: usize = 100;

/// Words of the script language that are called like functions.
const CALLED_WORDS: [&str; 10] =
    ["call", "curry", "is_shared", "is_def_var", "is_def_fn", "type_of", "print", "debug", "Fn", "throw"];

/// All names in a script that mean nothing, in the order of the text.
pub(super) fn unknown_names(ast: &AST, known: &Known) -> Vec<Unknown> {
    let bodies = Body::all(ast);
    let own = bodies.iter().map(|body| body.name.clone()).collect();
    let mut walk = Walk { known, own, scopes: vec![HashMap::new()], found: Vec::new() };
    let (mut inside, mut seen) = (None, 0);
    // The walk shows a script's own statements, then those of its functions; only the outermost are asked for.
    ast.walk(&mut |path: &[ASTNode]| {
        if let [ASTNode::Stmt(statement)] = path {
            seen += 1;
            let body = if seen > ast.statements().len() { innermost(&bodies, statement.position()) } else { None };
            if body != inside {
                inside = body;
                walk.scopes = vec![body.map_or_else(HashMap::new, |i| bodies[i].arguments.clone())];
            }
            walk.statement(statement);
        }
        true
    });
    walk.found.sort_by_key(|unknown| (unknown.position.line(), unknown.position.position()));
    walk.found.dedup_by(|a, b| a.position == b.position);
    walk.found
}

/// Place of the last statement of a function: what it returns, as a rule.
pub(super) fn last_statement(ast: &AST, function: &str) -> Option<Position> {
    let bodies = Body::all(ast);
    let (mut seen, mut last) = (0, None);
    ast.walk(&mut |path: &[ASTNode]| {
        if let [ASTNode::Stmt(statement)] = path {
            seen += 1;
            let body = innermost(&bodies, statement.position()).filter(|_| seen > ast.statements().len());
            if body.is_some_and(|i| bodies[i].name == function) {
                last = Some(match statement {
                    Stmt::Expr(expression) => expression.start_position(),
                    Stmt::Return(Some(expression), ..) => expression.start_position(),
                    other => other.position(),
                });
            }
        }
        true
    });
    last.filter(|position| !position.is_none())
}

/// Line and column.
type At = (usize, usize);

fn at(position: Position) -> Option<At> {
    Some((position.line()?, position.position().unwrap_or(0)))
}

/// A function of the script.
struct Body {
    name: String,
    from: At,
    to: At,
    arguments: HashMap<String, Holds>,
}

impl Body {
    fn all(ast: &AST) -> Vec<Body> {
        let list = ast.iter_functions().map(|f| (f.name.to_string(), f.params.len()));
        list.filter_map(|(name, arguments)| {
            let function = ast.shared_lib().get_script_fn(&name, arguments)?;
            let entry = ENTRIES.iter().find(|entry| entry.0 == name && entry.1 == arguments);
            let holds = |i: usize| match entry {
                Some((.., parameters, _)) if i == *parameters => Holds::Parameters,
                Some((.., vectors)) if i < *vectors => Holds::Vector,
                _ => Holds::Anything,
            };
            let arguments = function.params.iter().enumerate().map(|(i, name)| (name.to_string(), holds(i))).collect();
            let from = at(function.body.start_position())?;
            // A closure without braces is one statement, and its end is not known.
            let to = at(function.body.end_position()).unwrap_or(from);
            Some(Body { name, from, to, arguments })
        })
        .collect()
    }
}

/// The function that a place is in: closures stand inside of others.
fn innermost(bodies: &[Body], position: Position) -> Option<usize> {
    let place = at(position)?;
    let around = bodies.iter().enumerate().filter(|(_, body)| body.from <= place && place <= body.to);
    around.max_by_key(|(_, body)| body.from).map(|(i, _)| i)
}

struct Walk<'a> {
    known: &'a Known<'a>,
    /// Functions of the script.
    own: HashSet<String>,
    /// Variables of each block that is open.
    scopes: Vec<HashMap<String, Holds>>,
    found: Vec<Unknown>,
}

impl Walk<'_> {
    fn block(&mut self, block: &StmtBlock) {
        self.scopes.push(HashMap::new());
        block.statements().iter().for_each(|statement| self.statement(statement));
        self.scopes.pop();
    }

    fn declare(&mut self, name: &str) {
        if let Some(scope) = self.scopes.last_mut() {
            scope.insert(name.to_string(), Holds::Anything);
        }
    }

    fn holds(&self, name: &str) -> Option<Holds> {
        self.scopes.iter().rev().find_map(|scope| scope.get(name)).copied()
    }

    fn statement(&mut self, statement: &Stmt) {
        match statement {
            Stmt::If(parts, _) | Stmt::While(parts, _) | Stmt::Do(parts, ..) => {
                self.expression(&parts.expr);
                self.block(&parts.body);
                self.block(&parts.branch);
            }
            Stmt::For(parts, _) => {
                let (name, counter, flow) = &**parts;
                self.expression(&flow.expr);
                let counter = counter.iter().map(|counter| counter.name.to_string());
                let names = std::iter::once(name.name.to_string()).chain(counter);
                self.scopes.push(names.map(|name| (name, Holds::Anything)).collect());
                self.block(&flow.body);
                self.scopes.pop();
            }
            Stmt::Var(parts, ..) => {
                self.expression(&parts.1);
                self.declare(&parts.0.name);
            }
            Stmt::Assignment(parts) => {
                self.expression(&parts.1.lhs);
                self.expression(&parts.1.rhs);
            }
            Stmt::FnCall(call, position) => self.call(call, *position),
            Stmt::Block(block) => self.block(block),
            Stmt::TryCatch(parts, _) => {
                self.block(&parts.body);
                self.scopes.push(HashMap::new());
                if let Expr::Variable(name, ..) = &parts.expr {
                    self.declare(&name.1);
                }
                self.block(&parts.branch);
                self.scopes.pop();
            }
            Stmt::Expr(expression) => self.expression(expression),
            Stmt::BreakLoop(Some(expression), ..) | Stmt::Return(Some(expression), ..) => self.expression(expression),
            _ => {}
        }
    }

    fn expression(&mut self, expression: &Expr) {
        match expression {
            Expr::InterpolatedString(parts, _) | Expr::Array(parts, _) => {
                parts.iter().for_each(|part| self.expression(part));
            }
            Expr::Map(parts, _) => parts.0.iter().for_each(|(_, value)| self.expression(value)),
            Expr::Variable(name, _, position) if name.2.is_empty() => self.variable(&name.1, *position),
            Expr::MethodCall(call, position) | Expr::FnCall(call, position) => self.call(call, *position),
            Expr::Stmt(block) => self.block(block),
            Expr::Dot(sides, ..) => {
                self.property(&sides.lhs, &sides.rhs);
                self.expression(&sides.lhs);
                self.expression(&sides.rhs);
            }
            Expr::Index(sides, ..) => {
                self.expression(&sides.lhs);
                self.expression(&sides.rhs);
            }
            Expr::And(parts, _) | Expr::Or(parts, _) | Expr::Coalesce(parts, _) => {
                parts.iter().for_each(|part| self.expression(part));
            }
            _ => {}
        }
    }

    fn call(&mut self, call: &FnCallExpr, position: Position) {
        let name = call.name.as_str();
        let is_word = call.is_operator_call() || call.is_qualified() || CALLED_WORDS.contains(&name);
        // A closure in a variable is called by its name, too.
        let is_known = self.known.functions.contains(name) || self.own.contains(name) || self.holds(name).is_some();
        if !is_word && !is_known && self.found.len() < MOST {
            let mut near: Vec<String> = self.own.iter().filter(|name| !name.starts_with("anon$")).cloned().collect();
            near.sort_unstable();
            self.push(UnknownKind::Function, name, position, near);
        }
        call.args.iter().for_each(|argument| self.expression(argument));
    }

    fn variable(&mut self, name: &str, position: Position) {
        let is_known = self.holds(name).is_some() || self.known.values.contains(&name) || self.own.contains(name);
        if !is_known && self.found.len() < MOST {
            let mut near: Vec<String> = self.scopes.iter().flatten().map(|(name, _)| name.clone()).collect();
            near.sort_unstable();
            near.extend(self.known.values.iter().map(ToString::to_string));
            self.push(UnknownKind::Variable, name, position, near);
        }
    }

    /// A part of what a variable holds.
    fn property(&mut self, of: &Expr, property: &Expr) {
        let Expr::Variable(variable, ..) = of else { return };
        let (name, position) = match property {
            Expr::Property(name, position) => (&name.2, *position),
            Expr::Dot(sides, ..) | Expr::Index(sides, ..) => match &sides.lhs {
                Expr::Property(name, position) => (&name.2, *position),
                _ => return,
            },
            _ => return,
        };
        match (self.holds(&variable.1), self.known.params) {
            (Some(Holds::Parameters), Some(params)) if !params.contains(&name.as_str()) => {
                let near = params.iter().map(ToString::to_string).collect();
                self.push(UnknownKind::Parameter, name, position, near);
            }
            (Some(Holds::Vector), _) if swizzle(name).is_none() => {
                self.push(UnknownKind::Component, name, position, Vec::new());
            }
            _ => {}
        }
    }

    fn push(&mut self, kind: UnknownKind, name: &str, position: Position, near: Vec<String>) {
        self.found.push(Unknown { kind, name: name.to_string(), position, near });
    }
}

//! Where in a script's text the parts of its values were written.
//!
//! Values of the engine do not know where they come from, so the text's literals are kept as a tree beside them: a field of a
//! returned map is looked up in the literal that made it, through the variables in which it was kept.

use std::collections::HashMap;

use rhai::{AST, ASTNode, Expr, Position, Stmt};

use crate::diag::{SourceId, Sources, Span};

/// Where a script wrote what.
#[derive(Default)]
pub struct Places {
    /// What the script ends with.
    result: Written,
    /// What variables of the script were made of, the last time.
    variables: HashMap<String, Written>,
    /// Arguments of calls, by the place of the call.
    calls: HashMap<Position, Vec<Written>>,
    /// Fields by name, where it stands in the text once.
    fields: HashMap<String, Option<(Position, Position)>>,
}

/// What stands at a place of the text.
#[derive(Clone, Default)]
struct Written {
    at: Position,
    form: Form,
}

#[derive(Clone, Default)]
enum Form {
    /// Anything else.
    #[default]
    Other,
    /// `#{ name: value }`, with the places of the names.
    Fields(Vec<(String, Position, Written)>),
    /// `[value, value]`.
    Items(Vec<Written>),
    /// A variable.
    Variable(String),
}

/// A place in a script: of one of its values, or of what holds it where its own place is unknown.
#[derive(Clone)]
pub struct Place<'a> {
    places: &'a Places,
    written: Option<&'a Written>,
    /// Where the value starts.
    pub at: Position,
}

/// How many variables are followed from one to the next.
const MOST_STEPS: usize = 16;

impl Places {
    /// The places of a script.
    pub fn of(ast: &AST) -> Places {
        let mut places = Places::default();
        ast.walk(&mut |path: &[ASTNode]| {
            match path.last() {
                Some(ASTNode::Stmt(Stmt::Var(parts, ..))) => {
                    places.variables.insert(parts.0.name.to_string(), written(&parts.1));
                }
                Some(ASTNode::Stmt(Stmt::Assignment(parts))) => places.assignment(&parts.1.lhs, &parts.1.rhs),
                Some(ASTNode::Stmt(Stmt::FnCall(call, at)) | ASTNode::Expr(Expr::FnCall(call, at))) => {
                    places.calls.insert(*at, call.args.iter().map(written).collect());
                }
                Some(ASTNode::Expr(Expr::Map(parts, _))) => {
                    for (name, value) in &parts.0 {
                        places.field(&name.name, name.pos, value.start_position());
                    }
                }
                _ => {}
            }
            true
        });
        if let Some(last) = ast.statements().last() {
            places.result = match last {
                Stmt::Expr(expression) => written(expression),
                Stmt::Return(Some(expression), ..) => written(expression),
                other => Written { at: other.position(), form: Form::Other },
            };
        }
        places
    }

    fn assignment(&mut self, to: &Expr, value: &Expr) {
        match to {
            Expr::Variable(name, ..) => {
                self.variables.insert(name.1.to_string(), written(value));
            }
            Expr::Dot(sides, ..) => {
                if let Expr::Property(name, at) = &sides.rhs {
                    self.field(&name.2, *at, value.start_position());
                }
            }
            _ => {}
        }
    }

    fn field(&mut self, name: &str, at: Position, value: Position) {
        let place = (at, value);
        self.fields
            .entry(name.to_string())
            .and_modify(|known| *known = known.filter(|k| *k == place))
            .or_insert(Some(place));
    }

    /// Place of what the script ends with.
    pub fn result(&self) -> Place<'_> {
        self.place(&self.result)
    }

    /// Place of an argument of the call that stands there.
    pub fn argument(&self, call: Position, i: usize) -> Place<'_> {
        match self.calls.get(&call).and_then(|arguments| arguments.get(i)) {
            Some(written) => self.place(written),
            None => Place { places: self, written: None, at: call },
        }
    }

    fn place<'a>(&'a self, written: &'a Written) -> Place<'a> {
        let mut target = written;
        for _ in 0..MOST_STEPS {
            let Form::Variable(name) = &target.form else { break };
            let Some(next) = self.variables.get(name) else { break };
            target = next;
        }
        let at = if matches!(target.form, Form::Variable(_)) { written.at } else { target.at };
        Place { places: self, written: Some(target), at }
    }
}

impl<'a> Place<'a> {
    /// Place of a field's name, and of its value.
    pub fn field(&self, name: &str) -> (Position, Place<'a>) {
        if let Some(Written { form: Form::Fields(fields), .. }) = self.written
            && let Some((_, at, value)) = fields.iter().find(|(field, ..)| field == name)
        {
            return (*at, self.places.place(value));
        }
        let (at, value) = self.places.fields.get(name).copied().flatten().unwrap_or((self.at, self.at));
        (at, Place { places: self.places, written: None, at: value })
    }

    /// Place of an item of a list.
    pub fn item(&self, i: usize) -> Place<'a> {
        match self.written {
            Some(Written { form: Form::Items(items), .. }) if i < items.len() => self.places.place(&items[i]),
            _ => Place { written: None, ..self.clone() },
        }
    }
}

/// What stands for the place of a value in messages.
#[derive(Clone)]
pub enum Spot<'a> {
    /// One place for all of it.
    One(Span),
    /// Its own place in a script.
    Own {
        /// The place.
        place: Place<'a>,
        /// The texts.
        sources: &'a Sources,
        /// The script.
        text: SourceId,
    },
}

impl<'a> Spot<'a> {
    /// What is shown of the place.
    pub fn span(&self) -> Span {
        match self {
            Spot::One(span) => *span,
            Spot::Own { place, sources, text } => super::span_of(sources, *text, place.at),
        }
    }

    /// Place of a field's name, and of its value.
    pub fn field(&self, name: &str) -> (Span, Spot<'a>) {
        match self {
            Spot::One(span) => (*span, self.clone()),
            Spot::Own { place, sources, text } => {
                let (at, place) = place.field(name);
                (super::span_of(sources, *text, at), Spot::Own { place, sources, text: *text })
            }
        }
    }

    /// Place of an item of a list.
    pub fn item(&self, i: usize) -> Spot<'a> {
        match self {
            Spot::One(_) => self.clone(),
            Spot::Own { place, sources, text } => Spot::Own { place: place.item(i), sources, text: *text },
        }
    }
}

fn written(expression: &Expr) -> Written {
    let form = match expression {
        Expr::Map(parts, _) => Form::Fields(
            parts.0.iter().map(|(name, value)| (name.name.to_string(), name.pos, written(value))).collect(),
        ),
        Expr::Array(parts, _) => Form::Items(parts.iter().map(written).collect()),
        Expr::Variable(name, ..) => Form::Variable(name.1.to_string()),
        _ => Form::Other,
    };
    Written { at: expression.start_position(), form }
}

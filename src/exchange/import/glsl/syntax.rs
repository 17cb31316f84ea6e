//! GLSL as a tree: functions, statements and expressions of the part that distance estimates are written in.

use std::collections::HashMap;

use super::token::{Kind, OPERATORS, Token};
use super::value::size_of;

/// Deepest nesting of expressions and statements.
const MAX_DEPTH: usize = 80;

/// Most terms of a sum, a product, a list or a chain of parts.
const MAX_CHAIN: usize = 200;

/// An expression.
#[derive(Clone, PartialEq, Debug)]
pub enum Expr {
    /// A whole number.
    Int(i64),
    /// A number.
    Float(f64),
    /// A truth.
    Bool(bool),
    /// A variable.
    Name(String),
    /// `f(a, b)`, also of types.
    Call(String, Vec<Expr>),
    /// `v.xyz`.
    Part(Box<Expr>, String),
    /// `v[i]`.
    Index(Box<Expr>, Box<Expr>),
    /// `-a`, `!a`.
    Unary(&'static str, Box<Expr>),
    /// `a + b` and the like.
    Binary(&'static str, Box<Expr>, Box<Expr>),
    /// `a ? b : c`.
    Choice(Box<Expr>, Box<Expr>, Box<Expr>),
    /// `a = b`, `a += b`.
    Assign(&'static str, Box<Expr>, Box<Expr>),
    /// `++a`, `a++`: the sign of the step, and whether the value is that before it.
    Step(f64, bool, Box<Expr>),
}

/// A statement.
#[derive(Clone, PartialEq, Debug)]
pub enum Statement {
    /// `float a = 1.0, b;`
    Declare(String, Vec<(String, Option<Expr>)>),
    /// An expression for its effect.
    Do(Expr),
    /// `{ ... }`.
    Block(Vec<Statement>),
    /// `if`.
    If(Expr, Box<Statement>, Option<Box<Statement>>),
    /// `for` and `while`: start, condition, step, body.
    Loop(Option<Box<Statement>>, Option<Expr>, Option<Expr>, Box<Statement>),
    /// `do ... while`.
    DoWhile(Box<Statement>, Expr),
    /// `return`.
    Return(Option<Expr>),
    /// `break`.
    Break,
    /// `continue`.
    Continue,
}

/// A function.
#[derive(Clone, PartialEq, Debug)]
pub struct Function {
    /// Parameters: type, name, whether the caller gets their last values.
    pub parameters: Vec<(String, String, bool)>,
    /// Statements.
    pub body: Vec<Statement>,
}

/// A shader.
#[derive(Clone, Default, PartialEq, Debug)]
pub struct Program {
    /// Functions by name; of several with one name all, for other numbers of parameters.
    pub functions: HashMap<String, Vec<Function>>,
    /// Global variables in their order.
    pub globals: Vec<Statement>,
}

/// Reads words as a shader. The error names the line and what was expected. Functions that cannot be read are left out, and
/// so an error only where they are called.
pub fn parse(tokens: &[Token]) -> Result<Program, String> {
    let mut parser = Parser { tokens, at: 0, depth: 0 };
    let mut program = Program::default();
    while parser.at < tokens.len() {
        let start = parser.at;
        match parser.top_level(&mut program) {
            Ok(()) => {}
            Err(error) => {
                parser.at = start;
                if !parser.skip_function() {
                    return Err(error);
                }
            }
        }
    }
    Ok(program)
}

struct Parser<'t> {
    tokens: &'t [Token],
    at: usize,
    depth: usize,
}

type Parsed<T> = Result<T, String>;

impl Parser<'_> {
    fn peek(&self) -> Option<&Kind> {
        self.tokens.get(self.at).map(|token| &token.kind)
    }

    fn peek_name(&self, ahead: usize) -> Option<&str> {
        match self.tokens.get(self.at + ahead).map(|token| &token.kind) {
            Some(Kind::Name(name)) => Some(name),
            _ => None,
        }
    }

    fn is(&self, sign: &str) -> bool {
        matches!(self.peek(), Some(Kind::Sign(found)) if *found == sign)
    }

    fn take(&mut self, sign: &str) -> bool {
        let is = self.is(sign);
        self.at += usize::from(is);
        is
    }

    fn take_word(&mut self, word: &str) -> bool {
        let is = self.peek_name(0) == Some(word);
        self.at += usize::from(is);
        is
    }

    fn fail<T>(&self, expected: &str) -> Parsed<T> {
        let token = self.tokens.get(self.at).or(self.tokens.last());
        let line = token.map_or(0, |token| token.line);
        let found = match self.peek() {
            Some(Kind::Name(name)) => format!("`{name}`"),
            Some(Kind::Sign(sign)) => format!("`{sign}`"),
            Some(Kind::Int(number)) => format!("{number}"),
            Some(Kind::Float(number)) => format!("{number}"),
            None => "the end".into(),
        };
        Err(format!("line {line}: expected {expected}, found {found}"))
    }

    fn expect(&mut self, sign: &str) -> Parsed<()> {
        if self.take(sign) { Ok(()) } else { self.fail(&format!("`{sign}`")) }
    }

    fn name(&mut self) -> Parsed<String> {
        match self.peek() {
            Some(Kind::Name(name)) => {
                let name = name.clone();
                self.at += 1;
                Ok(name)
            }
            _ => self.fail("a name"),
        }
    }

    /// Says whether a chain may grow.
    fn grow(&self, terms: &mut usize) -> Parsed<()> {
        *terms += 1;
        if *terms > MAX_CHAIN { self.fail("an expression with fewer terms") } else { Ok(()) }
    }

    fn deeper<T>(&mut self, f: impl FnOnce(&mut Self) -> Parsed<T>) -> Parsed<T> {
        if self.depth >= MAX_DEPTH {
            return self.fail("code that is less deep");
        }
        self.depth += 1;
        let result = f(self);
        self.depth -= 1;
        result
    }

    /// Passes over a function or variable that could not be read; says whether there is one.
    fn skip_function(&mut self) -> bool {
        while self.at < self.tokens.len() && !self.is("{") && !self.is(";") {
            self.at += 1;
        }
        if !self.is("{") {
            return self.take(";");
        }
        let mut open = 0;
        while self.at < self.tokens.len() {
            open += i32::from(self.is("{")) - i32::from(self.is("}"));
            self.at += 1;
            if open == 0 {
                return true;
            }
        }
        false
    }

    fn top_level(&mut self, program: &mut Program) -> Parsed<()> {
        if self.take(";") {
            return Ok(());
        }
        let mut is_uniform = false;
        while let Some("uniform" | "const" | "varying" | "in" | "out" | "highp" | "mediump" | "lowp") =
            self.peek_name(0)
        {
            is_uniform |= matches!(self.peek_name(0), Some("uniform" | "varying"));
            self.at += 1;
        }
        if is_uniform {
            self.at -= 1;
        }
        // Values of uniforms come from sliders and presets.
        if is_uniform || self.peek_name(0) == Some("precision") {
            while self.at < self.tokens.len() && !self.take(";") {
                self.at += 1;
            }
            return Ok(());
        }
        let kind = self.name()?;
        let name = self.name()?;
        if !self.take("(") {
            self.at -= 1;
            let declaration = self.declaration(kind)?;
            program.globals.push(declaration);
            return Ok(());
        }
        let parameters = self.parameters()?;
        if self.take(";") {
            return Ok(());
        }
        self.expect("{")?;
        let body = self.block()?;
        program.functions.entry(name).or_default().push(Function { parameters, body });
        Ok(())
    }

    fn parameters(&mut self) -> Parsed<Vec<(String, String, bool)>> {
        let mut parameters = Vec::new();
        while !self.take(")") {
            let mut gives_back = false;
            while let Some("const" | "in" | "out" | "inout" | "highp" | "mediump" | "lowp") = self.peek_name(0) {
                gives_back |= matches!(self.peek_name(0), Some("out" | "inout"));
                self.at += 1;
            }
            let kind = self.name()?;
            if kind == "void" {
                continue;
            }
            parameters.push((kind, self.name()?, gives_back));
            if !self.take(",") && !self.is(")") {
                return self.fail("`,` or `)`");
            }
        }
        Ok(parameters)
    }

    /// Variables behind a type, to the semicolon.
    fn declaration(&mut self, kind: String) -> Parsed<Statement> {
        if size_of(&kind).is_none() {
            return self.fail("a type of numbers, vectors or matrices");
        }
        let mut variables = Vec::new();
        loop {
            let name = self.name()?;
            let value = if self.take("=") { Some(self.assignment()?) } else { None };
            variables.push((name, value));
            if !self.take(",") {
                break;
            }
        }
        self.expect(";")?;
        Ok(Statement::Declare(kind, variables))
    }

    fn block(&mut self) -> Parsed<Vec<Statement>> {
        let mut statements = Vec::new();
        while !self.take("}") {
            statements.push(self.statement()?);
        }
        Ok(statements)
    }

    fn statement(&mut self) -> Parsed<Statement> {
        self.deeper(Self::statement_inner)
    }

    fn statement_inner(&mut self) -> Parsed<Statement> {
        if self.take("{") {
            return self.block().map(Statement::Block);
        }
        if self.take(";") {
            return Ok(Statement::Block(Vec::new()));
        }
        if self.take_word("if") {
            self.expect("(")?;
            let condition = self.expression()?;
            self.expect(")")?;
            let then = Box::new(self.statement()?);
            let otherwise = if self.take_word("else") { Some(Box::new(self.statement()?)) } else { None };
            return Ok(Statement::If(condition, then, otherwise));
        }
        if self.take_word("for") {
            return self.for_loop();
        }
        if self.take_word("while") {
            self.expect("(")?;
            let condition = self.expression()?;
            self.expect(")")?;
            return Ok(Statement::Loop(None, Some(condition), None, Box::new(self.statement()?)));
        }
        if self.take_word("do") {
            let body = Box::new(self.statement()?);
            if !self.take_word("while") {
                return self.fail("`while`");
            }
            self.expect("(")?;
            let condition = self.expression()?;
            self.expect(")")?;
            self.expect(";")?;
            return Ok(Statement::DoWhile(body, condition));
        }
        let simple = match self.peek_name(0) {
            Some("return") => {
                self.at += 1;
                Statement::Return(if self.is(";") { None } else { Some(self.expression()?) })
            }
            Some("break") => {
                self.at += 1;
                Statement::Break
            }
            Some("continue") => {
                self.at += 1;
                Statement::Continue
            }
            _ => return self.declaration_or_expression(),
        };
        self.expect(";")?;
        Ok(simple)
    }

    fn declaration_or_expression(&mut self) -> Parsed<Statement> {
        while let Some("const" | "highp" | "mediump" | "lowp") = self.peek_name(0) {
            self.at += 1;
        }
        if let (Some(kind), Some(_)) = (self.peek_name(0), self.peek_name(1)) {
            let kind = kind.to_string();
            self.at += 1;
            return self.declaration(kind);
        }
        let value = self.expression()?;
        self.expect(";")?;
        Ok(Statement::Do(value))
    }

    fn for_loop(&mut self) -> Parsed<Statement> {
        self.expect("(")?;
        let start = if self.take(";") { None } else { Some(Box::new(self.declaration_or_expression()?)) };
        let condition = if self.is(";") { None } else { Some(self.expression()?) };
        self.expect(";")?;
        let step = if self.is(")") { None } else { Some(self.expression()?) };
        self.expect(")")?;
        Ok(Statement::Loop(start, condition, step, Box::new(self.statement()?)))
    }

    /// Expressions with commas between them; the value is the last one's.
    fn expression(&mut self) -> Parsed<Expr> {
        let (mut value, mut terms) = (self.assignment()?, 0);
        while self.take(",") {
            self.grow(&mut terms)?;
            value = Expr::Binary(",", Box::new(value), Box::new(self.assignment()?));
        }
        Ok(value)
    }

    fn assignment(&mut self) -> Parsed<Expr> {
        self.deeper(|parser| {
            let target = parser.choice()?;
            for sign in ["=", "+=", "-=", "*=", "/=", "%="] {
                if parser.take(sign) {
                    let value = parser.assignment()?;
                    return Ok(Expr::Assign(sign, Box::new(target), Box::new(value)));
                }
            }
            Ok(target)
        })
    }

    fn choice(&mut self) -> Parsed<Expr> {
        let condition = self.binary(0)?;
        if !self.take("?") {
            return Ok(condition);
        }
        let yes = self.assignment()?;
        self.expect(":")?;
        let no = self.assignment()?;
        Ok(Expr::Choice(Box::new(condition), Box::new(yes), Box::new(no)))
    }

    fn binary(&mut self, level: usize) -> Parsed<Expr> {
        let Some(signs) = OPERATORS.get(level) else { return self.unary() };
        let (mut value, mut terms) = (self.binary(level + 1)?, 0);
        'next: loop {
            for sign in *signs {
                if self.take(sign) {
                    self.grow(&mut terms)?;
                    let right = self.binary(level + 1)?;
                    value = Expr::Binary(sign, Box::new(value), Box::new(right));
                    continue 'next;
                }
            }
            return Ok(value);
        }
    }

    fn unary(&mut self) -> Parsed<Expr> {
        self.deeper(|parser| {
            for (sign, by) in [("++", 1.0), ("--", -1.0)] {
                if parser.take(sign) {
                    return Ok(Expr::Step(by, false, Box::new(parser.unary()?)));
                }
            }
            for sign in ["-", "!", "+"] {
                if parser.take(sign) {
                    let value = parser.unary()?;
                    return Ok(if sign == "+" { value } else { Expr::Unary(sign, Box::new(value)) });
                }
            }
            parser.postfix()
        })
    }

    fn postfix(&mut self) -> Parsed<Expr> {
        let (mut value, mut terms) = (self.primary()?, 0);
        loop {
            self.grow(&mut terms)?;
            value = if self.take(".") {
                Expr::Part(Box::new(value), self.name()?)
            } else if self.take("[") {
                let index = self.expression()?;
                self.expect("]")?;
                Expr::Index(Box::new(value), Box::new(index))
            } else if self.take("++") {
                Expr::Step(1.0, true, Box::new(value))
            } else if self.take("--") {
                Expr::Step(-1.0, true, Box::new(value))
            } else {
                return Ok(value);
            };
        }
    }

    fn primary(&mut self) -> Parsed<Expr> {
        let kind = self.peek().cloned();
        self.at += 1;
        match kind {
            Some(Kind::Int(number)) => Ok(Expr::Int(number)),
            Some(Kind::Float(number)) => Ok(Expr::Float(number)),
            Some(Kind::Sign("(")) => {
                let value = self.expression()?;
                self.expect(")")?;
                Ok(value)
            }
            Some(Kind::Name(name)) => match name.as_str() {
                "true" => Ok(Expr::Bool(true)),
                "false" => Ok(Expr::Bool(false)),
                _ if self.take("(") => self.arguments().map(|arguments| Expr::Call(name, arguments)),
                _ => Ok(Expr::Name(name)),
            },
            _ => {
                self.at -= 1;
                self.fail("a value")
            }
        }
    }

    fn arguments(&mut self) -> Parsed<Vec<Expr>> {
        let mut arguments = Vec::new();
        while !self.take(")") {
            arguments.push(self.assignment()?);
            if !self.take(",") && !self.is(")") {
                return self.fail("`,` or `)`");
            }
        }
        Ok(arguments)
    }
}

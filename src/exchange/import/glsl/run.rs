//! Runs a shader's functions at a point, and keeps every vector that a variable holds on the way.

use std::collections::HashMap;

use super::builtin;
use super::syntax::{Expr, Function, Program, Statement};
use super::value::{Failure, Value, arithmetic, each};

/// Most statements and expressions of one run.
const BUDGET: u32 = 100_000;

/// Most vectors that are kept.
const MAX_TRACE: usize = 4_000;

/// Deepest call.
const MAX_CALLS: usize = 12;

/// A shader with values for its uniforms.
pub struct Machine<'p> {
    program: &'p Program,
    globals: HashMap<String, (String, Value)>,
    /// Variables of the functions that run, each with its blocks.
    frames: Vec<Vec<HashMap<String, (String, Value)>>>,
    trace: Vec<[f64; 3]>,
    left: u32,
}

/// How a statement ends.
enum Flow {
    Next,
    Break,
    Continue,
    Return(Option<Value>),
}

type Outcome<T> = Result<T, Failure>;

impl<'p> Machine<'p> {
    /// Gives uniforms their values, then runs what global variables are made of, and `init` where there is one.
    pub fn new(program: &'p Program, uniforms: &[(String, String, Value)]) -> Outcome<Machine<'p>> {
        let far = Value::Vector(vec![1e4; 4]);
        let mut globals = HashMap::from([("orbitTrap".to_string(), ("vec4".to_string(), far))]);
        globals.extend(uniforms.iter().map(|(kind, name, value)| (name.clone(), (kind.clone(), value.clone()))));
        let mut machine = Machine { program, globals, frames: Vec::new(), trace: Vec::new(), left: BUDGET };
        for declaration in &program.globals {
            if let Statement::Declare(kind, variables) = declaration {
                for (name, value) in variables {
                    // What cannot be computed is an error only where it is read.
                    let value = match value {
                        Some(value) => machine.value(value).and_then(|value| value.into_kind(kind)),
                        None => Value::construct(kind, &[]),
                    };
                    if let Ok(value) = value {
                        machine.globals.insert(name.clone(), (kind.clone(), value));
                    }
                }
            }
        }
        if program.functions.contains_key("init") {
            machine.call("init", Vec::new())?;
        }
        Ok(machine)
    }

    /// The value of a function at a point, and every vector that a variable was given while it ran.
    pub fn run(&mut self, function: &str, point: [f64; 3]) -> Outcome<(f64, Vec<[f64; 3]>)> {
        let globals = self.globals.clone();
        self.trace.clear();
        self.frames.clear();
        self.left = BUDGET;
        let value = self.call(function, vec![Value::Vector(point.to_vec())]).map(|(value, _)| value);
        self.globals = globals;
        let value = value?.ok_or_else(|| format!("`{function}` gives no value"))?.number()?;
        Ok((value, std::mem::take(&mut self.trace)))
    }

    fn spend(&mut self) -> Outcome<()> {
        self.left = self.left.checked_sub(1).ok_or("the code runs for too long")?;
        Ok(())
    }

    /// Calls a function of the shader; gives its value and the last values of its parameters.
    fn call(&mut self, name: &str, arguments: Vec<Value>) -> Outcome<(Option<Value>, Vec<Value>)> {
        let program = self.program;
        let list = program.functions.get(name).map_or(&[][..], Vec::as_slice);
        let fits = |function: &&Function| {
            function.parameters.len() == arguments.len()
                && function
                    .parameters
                    .iter()
                    .zip(&arguments)
                    .all(|((kind, ..), value)| value.clone().into_kind(kind).is_ok())
        };
        let function = list.iter().find(fits).ok_or_else(|| format!("the function `{name}` is not in the file"))?;
        if self.frames.len() >= MAX_CALLS {
            return Err(format!("`{name}` calls itself too often"));
        }
        let mut variables = HashMap::new();
        for ((kind, parameter, _), value) in function.parameters.iter().zip(arguments) {
            variables.insert(parameter.clone(), (kind.clone(), value.into_kind(kind)?));
        }
        self.frames.push(vec![variables]);
        let flow = self.statements(&function.body);
        let frame = self.frames.pop().unwrap_or_default();
        let value = match flow? {
            Flow::Return(value) => value,
            _ => None,
        };
        let last = |parameter: &str| frame[0].get(parameter).map(|(_, value)| value.clone());
        let kept = function.parameters.iter().filter_map(|(_, parameter, _)| last(parameter)).collect();
        Ok((value, kept))
    }

    fn block(&mut self, statements: &[Statement]) -> Outcome<Flow> {
        if let Some(frame) = self.frames.last_mut() {
            frame.push(HashMap::new());
        }
        let flow = self.statements(statements);
        if let Some(frame) = self.frames.last_mut() {
            frame.pop();
        }
        flow
    }

    fn statements(&mut self, statements: &[Statement]) -> Outcome<Flow> {
        for statement in statements {
            match self.statement(statement)? {
                Flow::Next => {}
                flow => return Ok(flow),
            }
        }
        Ok(Flow::Next)
    }

    fn statement(&mut self, statement: &Statement) -> Outcome<Flow> {
        self.spend()?;
        match statement {
            Statement::Declare(kind, variables) => {
                for (name, value) in variables {
                    let value = match value {
                        Some(value) => self.value(value)?.into_kind(kind)?,
                        None => Value::construct(kind, &[])?,
                    };
                    self.keep(&value);
                    if let Some(block) = self.frames.last_mut().and_then(|frame| frame.last_mut()) {
                        block.insert(name.clone(), (kind.clone(), value));
                    }
                }
                Ok(Flow::Next)
            }
            Statement::Do(value) => self.value(value).map(|_| Flow::Next),
            Statement::Block(statements) => self.block(statements),
            Statement::If(condition, then, otherwise) => match (self.value(condition)?.truth()?, otherwise) {
                (true, _) => self.statement(then),
                (false, Some(otherwise)) => self.statement(otherwise),
                (false, None) => Ok(Flow::Next),
            },
            Statement::Loop(start, condition, step, body) => {
                if let Some(frame) = self.frames.last_mut() {
                    frame.push(HashMap::new());
                }
                let flow = self.repeat((start.as_deref(), condition.as_ref(), step.as_ref()), body);
                if let Some(frame) = self.frames.last_mut() {
                    frame.pop();
                }
                flow
            }
            Statement::DoWhile(body, condition) => loop {
                match self.statement(body)? {
                    Flow::Break => return Ok(Flow::Next),
                    Flow::Return(value) => return Ok(Flow::Return(value)),
                    Flow::Next | Flow::Continue => {}
                }
                if !self.value(condition)?.truth()? {
                    return Ok(Flow::Next);
                }
            },
            Statement::Return(value) => {
                let value = value.as_ref().map(|value| self.value(value)).transpose()?;
                Ok(Flow::Return(value))
            }
            Statement::Break => Ok(Flow::Break),
            Statement::Continue => Ok(Flow::Continue),
        }
    }

    fn repeat(
        &mut self,
        (start, condition, step): (Option<&Statement>, Option<&Expr>, Option<&Expr>),
        body: &Statement,
    ) -> Outcome<Flow> {
        if let Some(start) = start {
            self.statement(start)?;
        }
        loop {
            self.spend()?;
            if let Some(condition) = condition
                && !self.value(condition)?.truth()?
            {
                return Ok(Flow::Next);
            }
            match self.statement(body)? {
                Flow::Break => return Ok(Flow::Next),
                Flow::Return(value) => return Ok(Flow::Return(value)),
                Flow::Next | Flow::Continue => {}
            }
            if let Some(step) = step {
                self.value(step)?;
            }
        }
    }

    fn value(&mut self, expr: &Expr) -> Outcome<Value> {
        self.spend()?;
        match expr {
            Expr::Int(number) => Ok(Value::Int(*number)),
            Expr::Float(number) => Ok(Value::Float(*number)),
            Expr::Bool(truth) => Ok(Value::Bool(*truth)),
            Expr::Name(name) => {
                self.variable(name).cloned().ok_or_else(|| format!("the variable `{name}` has no value"))
            }
            Expr::Call(name, arguments) => self.call_of(name, arguments),
            Expr::Part(of, part) => {
                let parts = self.value(of)?.components();
                let picked: Outcome<Vec<f64>> = places(part)?
                    .into_iter()
                    .map(|i| parts.get(i).copied().ok_or_else(|| format!("there is no part `{part}`")))
                    .collect();
                picked.map(Value::of)
            }
            Expr::Index(of, index) => {
                let (of, index) = (self.value(of)?, self.value(index)?.number()?);
                let found = match &of {
                    Value::Matrix(columns) => columns.get(index as usize).map(|column| Value::Vector(column.clone())),
                    other => other.components().get(index as usize).map(|part| Value::Float(*part)),
                };
                found.filter(|_| index >= 0.0).ok_or_else(|| format!("there is no part number {index}"))
            }
            Expr::Unary(sign, of) => match (*sign, self.value(of)?) {
                ("!", value) => Ok(Value::Bool(!value.truth()?)),
                (_, Value::Int(number)) => Ok(Value::Int(-number)),
                (_, value) => arithmetic("*", &value, &Value::Float(-1.0)),
            },
            Expr::Binary(sign, a, b) => self.binary(sign, a, b),
            Expr::Choice(condition, yes, no) => match self.value(condition)?.truth()? {
                true => self.value(yes),
                false => self.value(no),
            },
            Expr::Assign(sign, target, value) => {
                let mut value = self.value(value)?;
                if *sign != "=" {
                    let before = self.value(target)?;
                    value = arithmetic(&sign[..1], &before, &value)?;
                }
                self.assign(target, value.clone())?;
                Ok(value)
            }
            Expr::Step(by, is_before, target) => {
                let before = self.value(target)?;
                let by = if matches!(before, Value::Int(_)) { Value::Int(*by as i64) } else { Value::Float(*by) };
                let after = arithmetic("+", &before, &by)?;
                self.assign(target, after.clone())?;
                Ok(if *is_before { before } else { after })
            }
        }
    }

    fn binary(&mut self, sign: &str, a: &Expr, b: &Expr) -> Outcome<Value> {
        let left = self.value(a)?;
        match sign {
            "&&" => return Ok(Value::Bool(left.truth()? && self.value(b)?.truth()?)),
            "||" => return Ok(Value::Bool(left.truth()? || self.value(b)?.truth()?)),
            "," => return self.value(b),
            _ => {}
        }
        let right = self.value(b)?;
        let is_equal = || left.components() == right.components();
        Ok(match sign {
            "==" => Value::Bool(is_equal()),
            "!=" => Value::Bool(!is_equal()),
            "^^" => Value::Bool(left.truth()? != right.truth()?),
            "<" => Value::Bool(left.number()? < right.number()?),
            ">" => Value::Bool(left.number()? > right.number()?),
            "<=" => Value::Bool(left.number()? <= right.number()?),
            ">=" => Value::Bool(left.number()? >= right.number()?),
            _ => arithmetic(sign, &left, &right)?,
        })
    }

    fn call_of(&mut self, name: &str, arguments: &[Expr]) -> Outcome<Value> {
        let values: Outcome<Vec<Value>> = arguments.iter().map(|argument| self.value(argument)).collect();
        let values = values?;
        if !self.program.functions.contains_key(name) {
            return builtin::call(name, &values);
        }
        let (value, last) = self.call(name, values)?;
        let functions = &self.program.functions[name];
        let function = functions.iter().find(|function| function.parameters.len() == arguments.len());
        let parameters = function.map_or(&[][..], |function| function.parameters.as_slice());
        for (((_, _, gives_back), target), value) in parameters.iter().zip(arguments).zip(last) {
            if *gives_back {
                self.assign(target, value)?;
            }
        }
        // A call of a function without a value stands alone, where nothing reads it.
        Ok(value.unwrap_or(Value::Bool(false)))
    }

    fn variable(&self, name: &str) -> Option<&Value> {
        let local = self.frames.last().and_then(|frame| frame.iter().rev().find_map(|block| block.get(name)));
        local.or_else(|| self.globals.get(name)).map(|(_, value)| value)
    }

    fn assign(&mut self, target: &Expr, value: Value) -> Outcome<()> {
        match target {
            Expr::Name(name) => {
                let local =
                    self.frames.last_mut().and_then(|frame| frame.iter_mut().rev().find_map(|b| b.get_mut(name)));
                let place = local.or_else(|| self.globals.get_mut(name));
                let (kind, place) = place.ok_or_else(|| format!("the variable `{name}` is not declared"))?;
                *place = value.into_kind(kind)?;
                let value = place.clone();
                self.keep(&value);
                Ok(())
            }
            Expr::Part(of, part) => {
                let whole = self.value(of)?;
                let Value::Vector(mut parts) = whole else { return Err(format!("`.{part}` needs a vector")) };
                let given = value.components();
                for (i, place) in places(part)?.into_iter().enumerate() {
                    let part = parts.get_mut(place).ok_or_else(|| format!("there is no part `{part}`"))?;
                    *part = *given.get(i).or(given.first()).ok_or("a value is missing")?;
                }
                self.assign(of, Value::Vector(parts))
            }
            Expr::Index(of, index) => {
                let index = self.value(index)?.number()? as usize;
                let whole = match (self.value(of)?, value) {
                    (Value::Matrix(mut columns), Value::Vector(column)) if index < columns.len() => {
                        columns[index] = column;
                        Value::Matrix(columns)
                    }
                    (Value::Vector(mut parts), value) if index < parts.len() => {
                        parts[index] = value.number()?;
                        Value::Vector(parts)
                    }
                    _ => return Err(format!("there is no part number {index}")),
                };
                self.assign(of, whole)
            }
            _ => Err("a value is given to something that is no variable".into()),
        }
    }

    /// Notes the first three components of a vector.
    fn keep(&mut self, value: &Value) {
        if let Value::Vector(parts) = value
            && let [x, y, z, ..] = parts[..]
            && self.trace.len() < MAX_TRACE
        {
            self.trace.push([x, y, z]);
        }
    }
}

/// Indices of the parts that a swizzle names.
fn places(part: &str) -> Outcome<Vec<usize>> {
    let sets = ["xyzw", "rgba", "stpq"];
    let set = sets.iter().find(|set| part.chars().all(|c| set.contains(c)));
    let set = set.filter(|_| (1..=4).contains(&part.len())).ok_or_else(|| format!("there is no part `{part}`"))?;
    Ok(part.chars().filter_map(|c| set.find(c)).collect())
}

/// Components of two values joined by a function.
pub fn joined(a: &Value, b: &Value, f: fn(f64, f64) -> f64) -> Outcome<Value> {
    let parts = each(a, b, |x, y| Ok(f(x, y)))?;
    let is_vector = matches!(a, Value::Vector(_)) || matches!(b, Value::Vector(_));
    Ok(if is_vector { Value::Vector(parts) } else { Value::of(parts) })
}

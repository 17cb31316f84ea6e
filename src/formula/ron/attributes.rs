//! Attributes at the start of a file. They are checked, and change nothing here.

use super::reader::{Outcome, Reader};
use super::scan;
use crate::diag::Diagnostic;

impl Reader<'_> {
    /// Reads `#![enable(...)]`, `#![type = "..."]` and `#![schema = "..."]`, which change nothing here.
    pub fn attributes(&mut self) -> Outcome<()> {
        while self.rest().starts_with('#') {
            let start = self.at;
            let is_read = self.attribute()?;
            if !is_read {
                let span = self.span_from(start).to(self.span(start, start + 1));
                let diagnostic = Diagnostic::error("this attribute is not one of RON's").label(span, "here");
                let diagnostic = diagnostic.help("write `#![enable(implicit_some)]`, or leave it out");
                let fail = self.report(diagnostic);
                return Err(fail);
            }
            self.skip_gap()?;
        }
        Ok(())
    }

    /// Reads one attribute; false if it is not spelled well.
    fn attribute(&mut self) -> Outcome<bool> {
        for wanted in ['#', '!', '['] {
            if !self.eat(wanted) {
                return Ok(false);
            }
            self.skip_gap()?;
        }
        let word = scan::run(self.rest(), scan::is_name_char);
        let name = &self.rest()[..word];
        self.at += word;
        self.skip_gap()?;
        let is_read = match name {
            "enable" => self.eat('(') && self.extensions()?,
            "type" | "schema" => self.eat('=') && self.attribute_text()?,
            _ => false,
        };
        self.skip_gap()?;
        Ok(is_read && self.eat(']'))
    }

    /// Reads the string of an attribute.
    fn attribute_text(&mut self) -> Outcome<bool> {
        self.skip_gap()?;
        if !scan::is_string_start(self.rest()) {
            return Ok(false);
        }
        self.string()?;
        Ok(true)
    }

    /// Reads names of RON extensions up to the `)`.
    fn extensions(&mut self) -> Outcome<bool> {
        const KNOWN: [&str; 4] =
            ["unwrap_newtypes", "implicit_some", "unwrap_variant_newtypes", "explicit_struct_names"];
        loop {
            self.skip_gap()?;
            if self.eat(')') {
                return Ok(true);
            }
            let len = scan::run(self.rest(), scan::is_name_char);
            let name = &self.rest()[..len];
            if len == 0 {
                return Ok(false);
            }
            self.at += len;
            if !KNOWN.contains(&name) {
                let diagnostic = Diagnostic::error(format!("unknown RON extension `{name}`"))
                    .label(self.span_from(self.at - len), "not one of RON's")
                    .did_you_mean(name, KNOWN);
                self.report_and_go_on(diagnostic)?;
            }
            self.skip_gap()?;
            if !self.eat(',') && !self.rest().starts_with(')') {
                return Ok(false);
            }
        }
    }
}

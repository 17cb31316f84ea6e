//! Reading how distances are estimated.

use super::Reader;
use crate::diag::Diagnostic;
use crate::formula::decode::Fields;
use crate::formula::value::{Value, ValueKind};
use crate::graph::settings::{
    CALIBRATED_ROWS, DeForm, Difference, DifferenceStep, EstimateSettings, MOST_STEPS, Method, Quality, StopAt,
};

impl Reader<'_> {
    pub(super) fn estimate(&mut self, value: &Value) -> Option<EstimateSettings> {
        let mut fields = Fields::new(value, "an estimate", self.d)?;
        let method = self.word_or_auto(&mut fields, "method", &Method::ALL.map(|m| (m.name(), m)));
        let form = self.word_or_auto(&mut fields, "form", &DeForm::ALL.map(|f| (f.name(), f)));
        let difference = self.word_or_auto(&mut fields, "difference", &Difference::ALL.map(|x| (x.name(), x)));
        let radius = fields.optional_value("radius").and_then(|v| self.number(v, 0.0, 1e6));
        let axis = fields.optional_value("axis").and_then(|v| self.direction(v));
        let fudge = fields.optional_value("fudge").and_then(|v| self.number(v, 1e-3, 1.0));
        let step = fields.optional_value("step").and_then(|v| self.difference_step(v));
        let least_step = fields.optional_value("least_step").and_then(|v| self.number(v, 1e-4, 1.0));
        let most_step = fields.optional_value("most_step").and_then(|v| self.number(v, MOST_STEPS[0], MOST_STEPS[1]));
        let late_ends = fields.optional("late_ends", self.d);
        let stop_at = fields.optional_value("stop_at").and_then(|v| self.stop_at(v));
        let quality = self.word_or_auto(&mut fields, "quality", &[("proof", Quality::Proof)]);
        let calibrated = fields.optional_value("calibrated").and_then(|v| self.calibrated(v));
        fields.finish(self.d);
        Some(EstimateSettings {
            method,
            form,
            radius,
            axis,
            fudge,
            difference,
            step,
            least_step,
            most_step,
            late_ends,
            stop_at,
            quality,
            calibrated,
        })
    }

    /// Pixels; or world units, as `World(0.01)` or, as on the command line, "0.01u".
    fn stop_at(&mut self, value: &Value) -> Option<StopAt> {
        let [least, most] = StopAt::WORLD;
        match &value.kind {
            ValueKind::Tuple { name: Some(name), items } if name.text == "World" && items.len() == 1 => {
                self.number(&items[0], least, most).map(StopAt::World)
            }
            // Other texts are expressions of parameters.
            ValueKind::Str(text) if text.trim().strip_suffix('u').is_some_and(|x| x.trim().parse::<f64>().is_ok()) => {
                match StopAt::parse(text) {
                    Ok(stop) => Some(stop),
                    Err(expected) => {
                        self.d.push(Diagnostic::error("`stop_at` is out of range").label(value.span, expected));
                        None
                    }
                }
            }
            _ => {
                let [least, most] = StopAt::PIXELS;
                self.number(value, least, most).map(StopAt::Pixels)
            }
        }
    }

    /// `true`, or the rows of the picture that was measured.
    fn calibrated(&mut self, value: &Value) -> Option<u32> {
        match value.kind {
            ValueKind::Bool(is_calibrated) => is_calibrated.then_some(CALIBRATED_ROWS),
            _ => self.number(value, 1.0, 1e5).map(|rows| rows as u32),
        }
    }

    /// A field that is one of several words, or `auto`, which is as if it were absent.
    fn word_or_auto<T: Copy>(
        &mut self,
        fields: &mut Fields,
        name: &'static str,
        words: &[(&'static str, T)],
    ) -> Option<T> {
        let mut words: Vec<(&str, Option<T>)> = words.iter().map(|(word, value)| (*word, Some(*value))).collect();
        words.push(("auto", None));
        self.word(fields.optional_value(name)?, name, &words).flatten()
    }

    /// A length in world units, or `Share(part of the estimate)`.
    fn difference_step(&mut self, value: &Value) -> Option<DifferenceStep> {
        match &value.kind {
            ValueKind::Tuple { name: Some(name), items } if name.text == "Share" && items.len() == 1 => {
                self.number(&items[0], 1e-9, 1.0).map(DifferenceStep::Share)
            }
            _ => self.number(value, 1e-15, 1e6).map(DifferenceStep::Fixed),
        }
    }
}

//! What a file cuts away of its output: `clip` keeps what lies in fields, `cut` takes what lies in them.
//!
//! Both become joins of the output with these fields, so that estimates, proofs, bounds and shadows know of them, and faces are closed.

use super::read::Reader;
use super::{Node, NodeKind, NodeRef};
use crate::diag::Span;
use crate::formula::decode::Fields;

impl Reader<'_> {
    /// The output, joined with the fields of `clip` and `cut`.
    pub(super) fn clipped(&mut self, output: Option<NodeRef>, fields: &mut Fields) -> Option<NodeRef> {
        let [clip, cut] = ["clip", "cut"].map(|name| fields.optional_value(name));
        let mut output = output;
        if let Some(value) = clip {
            let kept = self.wires(value);
            output = output.zip(kept).map(|(output, kept)| {
                let all = [output].into_iter().chain(kept).collect();
                self.added("clip", value.span, NodeKind::Intersection(all))
            });
        }
        if let Some(value) = cut {
            let taken = self.wires(value);
            output = output.zip(taken).map(|(output, taken)| {
                let b = match taken[..] {
                    [only] => only,
                    _ => self.added("cut/all", value.span, NodeKind::Union(taken)),
                };
                self.added("cut", value.span, NodeKind::Difference { a: output, b })
            });
        }
        output
    }

    /// Adds a node.
    pub(super) fn added(&mut self, name: &str, span: Span, kind: NodeKind) -> NodeRef {
        let number = self.nodes.len();
        self.nodes.push(Some(Node { name: format!("{name}/{number}"), span, kind }));
        NodeRef(number)
    }
}

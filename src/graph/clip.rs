//! What is cut away of an output: `clip` keeps what lies in fields, `cut` takes what lies in them, and a camera's `near` takes what is
//! too near.
//!
//! All become joins of the output with fields, so that estimates, proofs, bounds and shadows know of them, and faces are closed.

use super::read::Reader;
use super::scene::Camera;
use super::{Graph, Lens, Node, NodeKind, NodeRef, Primitive, SphereForm};
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

/// Name of the join that a camera's near plane makes; no node of a file can have it.
const NEAR: &str = "camera/near";

impl Graph {
    /// Takes away what is too near for the scene's camera, and gives back what was too near for another one.
    pub(super) fn cut_near(&mut self) {
        if self.node(self.output).name == NEAR {
            // The join and its field are the last nodes, and the join names what was drawn before first.
            self.output = self.node(self.output).kind.wires()[0];
            self.nodes.truncate(self.nodes.len() - 2);
        }
        let Some(camera) = self.scene.camera.filter(|camera| camera.near > 0.0) else { return };
        let (field, output) = (NodeRef(self.nodes.len()), self.output);
        let (near, join) = match camera.lens {
            Lens::Perspective { .. } | Lens::Orthographic { .. } => {
                (plane_before(&camera), NodeKind::Intersection(vec![output, field]))
            }
            _ => {
                let (centre, radius) = (camera.position, camera.near);
                let ball = Primitive::Sphere { centre, radius, form: SphereForm::Signed };
                (ball, NodeKind::Difference { a: output, b: field })
            }
        };
        let node = |name: &str, kind| Node { name: name.into(), span: Span::NONE, kind };
        self.nodes.push(node("camera/near/field", NodeKind::Primitive(near)));
        self.nodes.push(node(NEAR, join));
        self.output = NodeRef(self.nodes.len() - 1);
    }
}

/// The half space beyond a camera's near plane.
fn plane_before(camera: &Camera) -> Primitive {
    let away = [0, 1, 2].map(|i| camera.target[i] - camera.position[i]);
    let normal = away.map(|part| -part / camera.distance());
    let offset = (0..3).map(|i| normal[i] * camera.position[i]).sum::<f64>() - camera.near;
    Primitive::Plane { normal, offset }
}

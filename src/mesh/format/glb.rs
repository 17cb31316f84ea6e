//! glTF 2.0 in one binary file (Khronos, 2021): vertices side by side, then numbers of corners.

use std::io::{self, Write};

use serde_json::{Value, json};

use super::{Encoder, File, Head, commit, write_floats};
use crate::colour::linear;
use crate::mesh::surface::{Triangle, Vertex};

/// Bytes of a vertex: position, normal, colour of four numbers of 16 bits.
const STRIDE: u64 = 32;
/// Bytes of the file's head and of a chunk's.
const HEAD: usize = 12;
const CHUNK: usize = 8;
/// Bytes that are kept free for the description, which is known last.
const DESCRIPTION: usize = 1100;

pub(super) struct Glb {
    file: File,
    head: Head,
    low: [f32; 3],
    high: [f32; 3],
    /// Colours by their bytes.
    light: [u16; 256],
}

impl Glb {
    pub fn new(mut file: File, head: &Head) -> io::Result<Glb> {
        let binary = STRIDE * head.vertices + 12 * head.triangles;
        let all = (HEAD + CHUNK + DESCRIPTION + CHUNK) as u64 + binary;
        file.write_all(b"glTF")?;
        for number in [2, all as u32, DESCRIPTION as u32] {
            file.write_all(&number.to_le_bytes())?;
        }
        file.write_all(b"JSON")?;
        file.write_all(&[b' '; DESCRIPTION])?;
        file.write_all(&(binary as u32).to_le_bytes())?;
        file.write_all(b"BIN\0")?;
        let light = std::array::from_fn(|byte| (linear(byte as f64 / 255.0) * 65535.0).round() as u16);
        Ok(Glb { file, head: head.clone(), low: [f32::INFINITY; 3], high: [f32::NEG_INFINITY; 3], light })
    }

    fn description(&self) -> Value {
        let (count, corners) = (self.head.vertices, 3 * self.head.triangles);
        let scale = if self.head.is_mm { 0.001 } else { 1.0 };
        let half = std::f64::consts::FRAC_1_SQRT_2;
        json!({
            "asset": { "version": "2.0", "generator": "bulbfold" },
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            // Upwards is y there, and lengths are metres.
            "nodes": [{ "mesh": 0, "name": self.head.name, "rotation": [-half, 0, 0, half], "scale": [scale, scale, scale] }],
            "meshes": [{ "primitives": [{
                "attributes": { "POSITION": 0, "NORMAL": 1, "COLOR_0": 2 }, "indices": 3, "material": 0,
            }] }],
            "materials": [{ "pbrMetallicRoughness": { "metallicFactor": 0, "roughnessFactor": 0.8 } }],
            "buffers": [{ "byteLength": STRIDE * count + 4 * corners }],
            "bufferViews": [
                { "buffer": 0, "byteLength": STRIDE * count, "byteStride": STRIDE, "target": 34962 },
                { "buffer": 0, "byteOffset": STRIDE * count, "byteLength": 4 * corners, "target": 34963 },
            ],
            "accessors": [
                { "bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3", "min": self.low, "max": self.high },
                { "bufferView": 0, "byteOffset": 12, "componentType": 5126, "count": count, "type": "VEC3" },
                { "bufferView": 0, "byteOffset": 24, "componentType": 5123, "normalized": true, "count": count, "type": "VEC4" },
                { "bufferView": 1, "componentType": 5125, "count": corners, "type": "SCALAR" },
            ],
        })
    }
}

impl Encoder for Glb {
    fn vertices(&mut self, vertices: &[Vertex]) -> io::Result<()> {
        for vertex in vertices {
            for k in 0..3 {
                self.low[k] = self.low[k].min(vertex.position[k]);
                self.high[k] = self.high[k].max(vertex.position[k]);
            }
            write_floats(&mut self.file, &vertex.position)?;
            write_floats(&mut self.file, &vertex.normal)?;
            let [r, g, b] = vertex.colour.map(|byte| self.light[usize::from(byte)]);
            [r, g, b, u16::MAX].iter().try_for_each(|part| self.file.write_all(&part.to_le_bytes()))?;
        }
        Ok(())
    }

    fn triangles(&mut self, triangles: &[Triangle]) -> io::Result<()> {
        triangles.iter().flatten().try_for_each(|corner| self.file.write_all(&corner.to_le_bytes()))
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        let description = self.description().to_string();
        if description.len() > DESCRIPTION {
            return Err(io::Error::other("the name of the formula is too long for this file"));
        }
        self.file.flush()?;
        self.file.get_mut().overwrite((HEAD + CHUNK) as u64, description.as_bytes())?;
        commit(self.file)
    }
}

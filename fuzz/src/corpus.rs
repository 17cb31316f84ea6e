//! Inputs to start from: the built-in formulas and the files of `fuzz/seeds`.

use std::path::Path;

use bulbfold::check::Random;
use bulbfold::formula::embedded::{FRACTALS, SCRIPTS, STEPS};

/// Whole inputs of a target.
pub struct Corpus {
    /// At least one.
    inputs: Vec<Vec<u8>>,
    /// Inputs that take seconds each, by intention.
    heavy: Vec<Vec<u8>>,
}

/// The files of a folder of `fuzz/seeds`, by name.
fn files(folder: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("seeds").join(folder);
    let mut files: Vec<_> = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|file| file.path()).collect();
    files.sort();
    files.iter().filter_map(|file| std::fs::read(file).ok()).collect()
}

impl Corpus {
    /// The inputs of a target: what the program holds of its kind, and the files of `fuzz/seeds/KIND`, those of `fuzz/seeds/KIND_heavy` apart.
    pub fn load(target: &str) -> Corpus {
        let texts = |table: &[(&str, &str)]| table.iter().map(|(_, text)| text.as_bytes().to_vec()).collect::<Vec<_>>();
        let (folder, mut inputs) = match target {
            "ron" | "edit" | "writers" | "graphs" => ("ron", texts(FRACTALS)),
            "script" => ("script", texts(SCRIPTS)),
            "step" => ("step", texts(STEPS)),
            other => (other, Vec::new()),
        };
        let seeds = files(folder);
        // Built-in formulas are many and alike: seeds weigh as much as all of them together.
        for _ in 0..(inputs.len() / seeds.len().max(1)).max(1) {
            inputs.extend(seeds.iter().cloned());
        }
        if inputs.is_empty() {
            inputs.push(b"(".to_vec());
        }
        Corpus { inputs, heavy: files(&format!("{folder}_heavy")) }
    }

    /// One of the inputs.
    pub fn pick(&self, random: &mut Random) -> &[u8] {
        &self.inputs[random.below(self.inputs.len())]
    }

    /// One of the inputs that take seconds; any where there are none.
    pub fn pick_heavy(&self, random: &mut Random) -> &[u8] {
        if self.heavy.is_empty() { self.pick(random) } else { &self.heavy[random.below(self.heavy.len())] }
    }
}

//! Signed distances as OpenVDB, by Python's module.

use std::io::{self, Read, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;

use bulbfold::mesh::Grid;

use super::{Failure, Outcome, message};

/// Finds the module under both of its names.
const IMPORT: &str = "
try:
    import openvdb as vdb
except ImportError:
    import pyopenvdb as vdb
";
/// Reads the numbers from its input and writes the file to its output, which `vdb.write` cannot do itself.
const SCRIPT: &str = "
import os, sys, tempfile
import numpy
x, y, z = (int(number) for number in sys.argv[1:4])
cell, ox, oy, oz = (float(number) for number in sys.argv[4:8])
values = numpy.frombuffer(sys.stdin.buffer.read(), '<f4').reshape(z, y, x).transpose(2, 1, 0)
band = 3 * cell
grid = vdb.FloatGrid(band)
grid.copyFromArray(numpy.ascontiguousarray(numpy.clip(values, -band, band)))
grid.name = 'surface'
grid.gridClass = vdb.GridClass.LEVEL_SET
grid.transform = vdb.createLinearTransform(voxelSize=cell)
grid.transform.translate((ox, oy, oz))
grid['bulbfold'] = sys.argv[8]
with tempfile.TemporaryDirectory() as folder:
    path = os.path.join(folder, 'a.vdb')
    vdb.write(path, grids=[grid])
    with open(path, 'rb') as file:
        sys.stdout.buffer.write(file.read())
";

/// Refuses to start without the module.
pub fn check(python: &Path) -> Outcome {
    let tried = Command::new(python).arg("-c").arg(format!("{IMPORT}\nimport numpy")).stdin(Stdio::null()).output();
    match tried {
        Ok(output) if output.status.success() => Ok(()),
        Ok(output) => {
            let said = String::from_utf8_lossy(&output.stderr).lines().next_back().unwrap_or_default().to_string();
            Err(missing(&format!("{} has no openvdb with numpy: {said}", python.display())))
        }
        Err(error) => Err(missing(&format!("cannot start {}: {error}", python.display()))),
    }
}

fn missing(text: &str) -> Failure {
    let help = "install it (Debian: `apt install python3-openvdb`), name the Python that has it with `--python`, or write a .npy";
    Failure::Usage(message(text, help))
}

/// A Python that takes numbers and gives a file.
pub struct Pipe {
    child: Child,
    given: JoinHandle<io::Result<Vec<u8>>>,
}

impl Pipe {
    /// Starts it for the numbers of a grid.
    pub fn new(python: &Path, grid: &Grid, name: &str) -> io::Result<Pipe> {
        let mut command = Command::new(python);
        command.arg("-c").arg(format!("{IMPORT}{SCRIPT}")).args(grid.points.map(|count| count.to_string()));
        command.arg(grid.cell.to_string()).args(grid.origin.map(|x| x.to_string())).arg(name);
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
        let mut output = child.stdout.take().ok_or_else(|| io::Error::other("it has no output"))?;
        let given = std::thread::spawn(move || {
            let mut bytes = Vec::new();
            output.read_to_end(&mut bytes).map(|_| bytes)
        });
        Ok(Pipe { child, given })
    }

    /// The file, once all numbers are there.
    pub fn finish(mut self) -> io::Result<Vec<u8>> {
        drop(self.child.stdin.take());
        let status = self.child.wait()?;
        let bytes = self.given.join().map_err(|_| io::Error::other("another thread failed"))??;
        if status.success() { Ok(bytes) } else { Err(io::Error::other("Python failed; what it said is above")) }
    }
}

impl Write for Pipe {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.child.stdin.as_mut().ok_or_else(|| io::Error::other("it takes no more"))?.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

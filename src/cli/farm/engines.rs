//! The texts of a bundle that engines of farms read: each runs a command a part, and then the one that joins them.

use super::bundle::Manifest;

/// Tasks of a Slurm array at most: one less than Slurm's own limit where nobody has changed it.
const MOST_TASKS: u32 = 1000;

/// Names and texts of the files.
pub fn files(manifest: &Manifest) -> [(&'static str, String); 5] {
    [
        ("template.yaml", open_job_description(manifest)),
        ("slurm_submit.sh", slurm_submit(manifest)),
        ("slurm_part.sh", slurm_part(manifest)),
        ("slurm_join.sh", slurm_join(manifest)),
        ("Makefile", makefile(manifest)),
    ]
}

/// The name of a job as all engines take it.
fn job_name(manifest: &Manifest) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || "_-.".contains(c) { c } else { '_' };
    let name: String = manifest.name.chars().take(40).map(plain).collect();
    format!("bulbfold-{name}")
}

/// Frames as a range of Open Job Description: all that follow each other at the same distance.
fn frames(manifest: &Manifest) -> String {
    let numbers = &manifest.frames;
    let (first, last) = (numbers[0].number, numbers[numbers.len() - 1].number);
    match manifest.film.as_ref().map_or(1, |film| film.every) {
        _ if first == last => first.to_string(),
        1 => format!("{first}-{last}"),
        every => format!("{first}-{last}:{every}"),
    }
}

fn range(count: u32) -> String {
    if count == 1 { "1".into() } else { format!("1-{count}") }
}

/// A template of Open Job Description, version 2023-09.
fn open_job_description(manifest: &Manifest) -> String {
    format!(
        r#"# Checked and run with: openjd check template.yaml, openjd run template.yaml
specificationVersion: jobtemplate-2023-09
name: "{name}"
parameterDefinitions:
  - name: Job
    type: PATH
    objectType: DIRECTORY
    dataFlow: INOUT
    default: "."
    description: The folder of the job, in which this file lies.
  - name: Bulbfold
    type: STRING
    default: bulbfold
    description: The program, version {program}.
steps:
  - name: Parts
    description: Renders the parts of the picture.
    parameterSpace:
      taskParameterDefinitions:
        - name: Frame
          type: INT
          range: "{frames}"
        - name: Tile
          type: INT
          range: "{tiles}"
        - name: Samples
          type: INT
          range: "{samples}"
    script:
      actions:
        onRun:
          command: "{{{{Param.Bulbfold}}}}"
          args: [render, "{{{{Param.Job}}}}", --part, "{{{{Task.Param.Frame}}}},{{{{Task.Param.Tile}}}},{{{{Task.Param.Samples}}}}", --openjd]
          cancelation:
            mode: NOTIFY_THEN_TERMINATE
            notifyPeriodInSeconds: 5
  - name: Join
    description: Joins the parts.
    dependencies:
      - dependsOn: Parts
    script:
      actions:
        onRun:
          command: "{{{{Param.Bulbfold}}}}"
          args: [join, "{{{{Param.Job}}}}", --openjd]
"#,
        name = job_name(manifest),
        program = manifest.program,
        frames = frames(manifest),
        tiles = range(manifest.tiles),
        samples = range(manifest.samples_split),
    )
}

/// Hands the parts to Slurm as arrays, and the join behind them.
fn slurm_submit(manifest: &Manifest) -> String {
    format!(
        r#"#!/bin/sh
# Submits the parts as job arrays, and the join behind them. Arguments go to every sbatch; BULBFOLD names the program.
set -eu
cd "$(dirname "$0")"
first=0
after=
while [ "$first" -lt {parts} ]; do
    count=$(({parts} - first))
    [ "$count" -le {MOST_TASKS} ] || count={MOST_TASKS}
    id=$(sbatch --parsable --array="1-$count" --export="ALL,BULBFOLD_FIRST=$first" "$@" slurm_part.sh)
    after="$after:${{id%%;*}}"
    first=$((first + count))
done
sbatch --parsable --dependency="afterok$after" --kill-on-invalid-dep=yes "$@" slurm_join.sh
"#,
        parts = manifest.parts(),
    )
}

/// A task of an array. What was lost with a node is requeued, and goes on where it was.
fn slurm_part(manifest: &Manifest) -> String {
    format!(
        r#"#!/bin/sh
#SBATCH --job-name={name}
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --output=slurm_part_%A_%a.log
exec "${{BULBFOLD:-bulbfold}}" render . --part "$((BULBFOLD_FIRST + SLURM_ARRAY_TASK_ID))/{parts}"
"#,
        name = job_name(manifest),
        parts = manifest.parts(),
    )
}

fn slurm_join(manifest: &Manifest) -> String {
    format!(
        r#"#!/bin/sh
#SBATCH --job-name={name}-join
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --output=slurm_join_%j.log
exec "${{BULBFOLD:-bulbfold}}" join .
"#,
        name = job_name(manifest),
    )
}

/// Rules for as many workers as `make -j` has.
fn makefile(manifest: &Manifest) -> String {
    format!(
        "# All on this machine, with four workers: make -j4. More arguments of each: make ARGUMENTS='--threads 2'
BULBFOLD ?= bulbfold
ARGUMENTS ?=
parts := $(addprefix part-,$(shell seq 1 {parts}))

join: $(parts)
\t$(BULBFOLD) join .

$(parts): part-%:
\t$(BULBFOLD) render . --part $*/{parts} $(ARGUMENTS)

.PHONY: join $(parts)
",
        parts = manifest.parts(),
    )
}

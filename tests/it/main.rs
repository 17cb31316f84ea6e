//! Every test from outside the library in one program: one module a subject.

mod auto;
mod backends;
mod beams;
mod bench;
mod bounds;
mod calibrate_write;
mod cameras;
mod certified;
#[cfg(feature = "chart")]
mod chart;
mod check;
mod choice;
mod cli;
mod colours;
mod compiled;
mod cost;
mod critical;
mod diagnostics;
mod docs;
#[cfg(all(feature = "gpu", target_os = "linux"))]
mod driver;
mod end_shapes;
mod engine;
mod environment;
mod estimate_settings;
mod examples;
mod exchange;
#[cfg(feature = "chart")]
mod explore;
mod expressions;
mod farm;
mod film;
mod films;
mod find;
mod formats;
mod formulas;
mod framing;
#[cfg(feature = "chart")]
mod gallery;
mod habits;
mod high_precision;
#[cfg(unix)]
mod hostile;
mod language;
mod layering;
mod lights;
mod lost_device;
mod materials;
mod memory;
mod meshes;
mod methods;
mod moves;
mod mutations;
mod notation;
mod orbit_counts;
#[cfg(unix)]
mod output;
mod palettes;
mod paths;
mod pictures;
mod planes;
mod precision;
mod presets;
mod random_graphs;
mod reach;
mod recipes;
mod rows;
mod sampled;
mod scenes;
mod scripts;
mod shortcuts;
mod stability;
mod step_rules;
mod stop_at;
mod support;
mod sweep;
mod truth;
mod user_step;
#[cfg(feature = "chart")]
mod view;
mod watch;

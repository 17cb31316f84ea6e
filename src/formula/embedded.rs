//! The formula files that are part of the program; found by `build.rs`, not listed anywhere.

include!(concat!(env!("OUT_DIR"), "/embedded.rs"));

#![cfg_attr(fuzzing, no_main)]

bulbfold_fuzz::libfuzzer_target!("step");

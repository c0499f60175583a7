//! Runs one target of `strand::fuzzing`, which the environment variable `STRAND_FUZZ_TARGET` names.

#![no_main]

use std::sync::OnceLock;

static TARGET: OnceLock<String> = OnceLock::new();

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let target = TARGET.get_or_init(|| std::env::var("STRAND_FUZZ_TARGET").expect("the name of a target"));
    strand::fuzzing::run(target, data);
});

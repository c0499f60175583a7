//! Inputs that were found by fuzzing, and some at random.

use std::path::Path;

use super::{TARGETS, run};

const AT_RANDOM: u64 = 100; // inputs of each target
const LENGTH: u64 = 600; // bytes of an input at most

#[test]
fn found_inputs_have_sound_answers() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/fuzzing");
    for (name, _) in TARGETS {
        let files = std::fs::read_dir(folder.join(name)).expect("a folder for each target");
        let paths: Vec<_> = files.map(|file| file.unwrap().path()).collect();
        assert!(!paths.is_empty(), "{name}");
        for path in paths {
            println!("{}", path.display());
            run(name, &std::fs::read(path).unwrap());
        }
    }
}

#[test]
fn random_inputs_have_sound_answers() {
    let mut state = 1u64;
    let mut random = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    };
    for (name, _) in TARGETS {
        for _ in 0..AT_RANDOM {
            let data: Vec<u8> = (0..random() % LENGTH).map(|_| (random() >> 24) as u8).collect();
            println!("{name} {data:?}");
            run(name, &data);
        }
    }
}

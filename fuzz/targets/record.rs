//! The record of a run.

#![no_main]

use libfuzzer_sys::fuzz_target;
use pigtail_machines::record::Reader;

fuzz_target!(|data: &[u8]| {
    let path = std::env::temp_dir().join(format!("pigtail-fuzz-{}.record", std::process::id()));
    std::fs::write(&path, data).expect("a place for it");
    if let Ok(mut reader) = Reader::open(&path) {
        while let Ok(Some(_)) = reader.next_exchange() {}
    }
});

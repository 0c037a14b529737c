//! The record of a run. By the first byte either the bytes as they are, or a whole record of which they are
//! a block: compressed and with its checksum, so that they come as far as what reads blocks.

#![no_main]

use libfuzzer_sys::fuzz_target;
use pigtail_machines::record::Reader;

/// With what a record begins.
const MAGIC: &[u8] = b"PIGTAIL1";

fuzz_target!(|data: &[u8]| {
    let Some((how, rest)) = data.split_first() else {
        return;
    };
    let mut bytes = Vec::new();
    if how % 2 == 0 {
        bytes.extend(rest);
    } else {
        bytes.extend(MAGIC);
        for block in [&b"about"[..], rest] {
            let packed = zstd::encode_all(block, 1).expect("room");
            bytes.extend((packed.len() as u32).to_le_bytes());
            bytes.extend(packed);
        }
    }
    let path = std::env::temp_dir().join(format!("pigtail-fuzz-{}.record", std::process::id()));
    std::fs::write(&path, bytes).expect("a place for it");
    if let Ok(mut reader) = Reader::open(&path) {
        while let Ok(Some(_)) = reader.next_exchange() {}
    }
});

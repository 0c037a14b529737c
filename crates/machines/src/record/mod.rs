//! Every exchange of a run, on disk, and back from there.
//!
//! A record is `PIGTAIL1`, then blocks: the length of a zstd frame (4 bytes, little endian) and the
//! frame, which carries its own checksum. The first block holds what the caller wants to be kept with
//! the record; each other one holds a quarter of a second of exchanges and can be read by itself. A
//! process that is killed loses what has not left it: less than three blocks. A record that ends in the
//! middle of a block is read up to there.

mod format;
mod reader;
mod recorder;
mod replay;

pub use reader::{Reader, RecordError};
pub use recorder::{Closing, Recorder, Written};
pub use replay::Replay;

/// What every record begins with.
const MAGIC: &[u8; 8] = b"PIGTAIL1";
/// No block is larger than this before compression, bytes: what says so is damaged.
const LARGEST: usize = 1 << 26;

//! Reads a record back.

use super::format::{Block, Exchange};
use super::{LARGEST, MAGIC};
use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};

/// Why a record cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// It cannot be written.
    #[error("{path}: the record cannot be written: {error}", path = path.display())]
    Unwritable {
        /// The file.
        path: PathBuf,
        /// Why.
        error: io::Error,
    },
    /// It cannot be read.
    #[error("{path}: cannot be read: {error}", path = path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why.
        error: io::Error,
    },
    /// It is no record.
    #[error("{path}: is no record of a run; accepted is what a run wrote", path = path.display())]
    Foreign {
        /// The file.
        path: PathBuf,
    },
    /// Something in it was changed.
    #[error("{path}: block {block} is damaged; what is before it was read", path = path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The block, from 0, which is what was kept with the record.
        block: u64,
    },
}

/// A record that is being read, block by block.
#[derive(Debug)]
pub struct Reader {
    path: PathBuf,
    file: BufReader<File>,
    about: Vec<u8>,
    ready: VecDeque<Exchange>,
    blocks: u64,
    cut: bool,
}

impl Reader {
    /// Opens a record.
    ///
    /// # Errors
    ///
    /// When it cannot be read, or is none.
    pub fn open(path: &Path) -> Result<Self, RecordError> {
        let unreadable = |error| RecordError::Unreadable {
            path: path.to_owned(),
            error,
        };
        let mut file = BufReader::new(File::open(path).map_err(unreadable)?);
        let mut magic = [0; MAGIC.len()];
        let foreign = || RecordError::Foreign {
            path: path.to_owned(),
        };
        if fill(&mut file, &mut magic).map_err(unreadable)? < magic.len() || magic != *MAGIC {
            return Err(foreign());
        }
        let mut reader = Self {
            path: path.to_owned(),
            file,
            about: Vec::new(),
            ready: VecDeque::new(),
            blocks: 0,
            cut: false,
        };
        reader.about = reader.block()?.ok_or_else(foreign)?;
        Ok(reader)
    }

    /// What was kept with the record.
    pub fn about(&self) -> &[u8] {
        &self.about
    }

    /// Whether the record ended in the middle of a block, as one does whose process was killed. Known
    /// once it has been read to its end.
    pub fn is_cut(&self) -> bool {
        self.cut
    }

    /// The next exchange; `None` at the record's end.
    ///
    /// # Errors
    ///
    /// When the record cannot be read, or was changed.
    pub fn next_exchange(&mut self) -> Result<Option<Exchange>, RecordError> {
        while self.ready.is_empty() {
            let Some(bytes) = self.block()? else {
                return Ok(None);
            };
            let block = Block::decode(&bytes).map_err(|_| self.damaged(self.blocks - 1))?;
            self.ready.extend(block.exchanges());
        }
        Ok(self.ready.pop_front())
    }

    fn damaged(&self, block: u64) -> RecordError {
        RecordError::Damaged {
            path: self.path.clone(),
            block,
        }
    }

    /// The bytes of the next block; `None` at the end.
    fn block(&mut self) -> Result<Option<Vec<u8>>, RecordError> {
        let path = self.path.clone();
        let unreadable = |error| RecordError::Unreadable { path, error };
        let mut length = [0; 4];
        match fill(&mut self.file, &mut length) {
            Ok(4) => {}
            Ok(read) => {
                self.cut |= read > 0;
                return Ok(None);
            }
            Err(error) => return Err(unreadable(error)),
        }
        let length = u32::from_le_bytes(length) as usize;
        if length > LARGEST {
            return Err(self.damaged(self.blocks));
        }
        let mut frame = vec![0; length];
        match fill(&mut self.file, &mut frame) {
            Ok(read) if read == length => {}
            Ok(_) => {
                self.cut = true;
                return Ok(None);
            }
            Err(error) => return Err(unreadable(error)),
        }
        let mut raw = Vec::new();
        let whole = zstd::Decoder::new(&frame[..])
            .and_then(|decoder| decoder.take(LARGEST as u64 + 1).read_to_end(&mut raw));
        if whole.is_err() || raw.len() > LARGEST {
            return Err(self.damaged(self.blocks));
        }
        self.blocks += 1;
        Ok(Some(raw))
    }
}

/// Reads as much as there is, up to the buffer's length.
fn fill(file: &mut impl Read, buffer: &mut [u8]) -> io::Result<usize> {
    let mut read = 0;
    while read < buffer.len() {
        match file.read(&mut buffer[read..]) {
            Ok(0) => break,
            Ok(n) => read += n,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(read)
}

//! Writes every exchange of a machine to a file while it works.

use super::format::Block;
use super::{MAGIC, RecordError};
use pigtail_hal::{Command, Fault, Machine, Measurement, Rule, Spec};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

/// A block is full after so long, seconds of machine time.
const BLOCK: f64 = 0.25;
/// Compression: what does not cost the machine any time.
const LEVEL: i32 = -3;

/// A machine of which every exchange is recorded. What comes back, faults too, comes back unchanged;
/// when the record cannot be written any more, the machine stops: a run that nobody can account for is
/// no run.
#[derive(Debug)]
pub struct Recorder<M> {
    machine: M,
    block: Block,
    most: usize,
    time: f64,
    fault: Option<Fault>,
    writer: Option<Writer>,
    path: PathBuf,
}

/// The thread that writes.
#[derive(Debug)]
struct Writer {
    blocks: SyncSender<Block>,
    empty: Receiver<Block>,
    thread: JoinHandle<io::Result<Written>>,
    failed: Arc<Mutex<Option<String>>>,
}

/// A record on its way to the disk, when the machine is done.
#[derive(Debug)]
#[must_use = "only who waits is told what could not be written"]
pub struct Closing {
    /// Gone once it was waited for.
    thread: Option<JoinHandle<io::Result<Written>>>,
    path: PathBuf,
}

/// What was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Written {
    /// Length, bytes.
    pub bytes: u64,
    /// SHA-256 of all of it.
    pub sha256: [u8; 32],
}

impl<M> Recorder<M> {
    /// A machine of which nothing is recorded.
    pub fn idle(machine: M) -> Self {
        Self {
            machine,
            block: Block::default(),
            most: 0,
            time: 0.0,
            fault: None,
            writer: None,
            path: PathBuf::new(),
        }
    }

    /// The machine that is recorded.
    pub fn inner(&self) -> &M {
        &self.machine
    }
}

impl<M: Machine> Recorder<M> {
    /// Records a machine to a new file; `about` is kept with the record.
    ///
    /// # Errors
    ///
    /// When the file cannot be written.
    pub fn new(machine: M, path: &Path, about: &[u8]) -> Result<Self, RecordError> {
        let mut recorder = Self::idle(machine);
        recorder.begin(path, about)?;
        Ok(recorder)
    }

    /// Records what comes from now on to a new file; `about` is kept with the record.
    ///
    /// # Errors
    ///
    /// When the file cannot be written.
    pub fn begin(&mut self, path: &Path, about: &[u8]) -> Result<(), RecordError> {
        let failed = |error: io::Error| RecordError::Unwritable {
            path: path.to_owned(),
            error,
        };
        let mut file = Hashed {
            file: File::create_new(path).map_err(failed)?,
            hash: Sha256::new(),
            bytes: 0,
        };
        file.write_all(MAGIC).map_err(failed)?;
        write(&mut file, about).map_err(failed)?;
        self.most = (BLOCK * self.machine.spec().servo.rate).ceil() as usize;
        self.writer = Some(Writer::new(file));
        path.clone_into(&mut self.path);
        Ok(())
    }

    /// Ends the record and hands over what is left of it, which is written, and the record closed, while
    /// the caller does something else. The machine goes on, and nothing of it is recorded any more; `None`
    /// where nothing was.
    pub fn finish(&mut self) -> Option<Closing> {
        let block = std::mem::take(&mut self.block);
        Some(Closing {
            thread: Some(self.writer.take()?.close(block)),
            path: self.path.clone(),
        })
    }

    /// Hands the block over. Waits where the disk is slower than the machine.
    #[cold]
    fn hand_over(&mut self) {
        let Some(writer) = &self.writer else { return };
        // One that was written comes back: its memory is mapped already.
        let empty = writer.empty.try_recv().unwrap_or_default();
        let block = std::mem::replace(&mut self.block, empty);
        self.block.rows.reserve(self.most);
        let sent = writer.blocks.send(block);
        let failed = writer.failed.lock().unwrap_or_else(PoisonError::into_inner);
        if sent.is_ok() && failed.is_none() {
            return;
        }
        let why = failed
            .clone()
            .unwrap_or_else(|| "its thread has ended".to_owned());
        self.fault = Some(Fault {
            rule: Rule::RecordWritable,
            axis: self.path.display().to_string(),
            value: why,
            limit: "a disk with room".to_owned(),
            time: self.time,
        });
    }
}

impl Closing {
    /// The record's file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Waits until all of the record is on the disk.
    ///
    /// # Errors
    ///
    /// When it could not be written to its end.
    pub fn wait(mut self) -> Result<Written, RecordError> {
        let ended = self.thread.take().and_then(|thread| thread.join().ok());
        let failed = || io::Error::other("the thread that writes it has failed");
        ended
            .unwrap_or_else(|| Err(failed()))
            .map_err(|error| RecordError::Unwritable {
                path: std::mem::take(&mut self.path),
                error,
            })
    }
}

impl Drop for Closing {
    /// Whoever goes on without it, for an error of its own, leaves a record that is whole.
    fn drop(&mut self) {
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

impl Writer {
    fn new(mut file: Hashed) -> Self {
        // One block in the machine's hands, one on its way, one being written: no more is lost when
        // the process is killed.
        let (blocks, coming): (_, Receiver<Block>) = sync_channel(1);
        let (back, empty) = channel();
        let failed = Arc::new(Mutex::new(None));
        let said = Arc::clone(&failed);
        let thread = std::thread::spawn(move || {
            let mut bytes = Vec::new();
            for mut block in coming {
                block.encode(&mut bytes);
                if let Err(error) = write(&mut file, &bytes) {
                    *said.lock().unwrap_or_else(PoisonError::into_inner) = Some(error.to_string());
                    return Err(error);
                }
                block.clear();
                // The machine may have come to its end.
                let _ = back.send(block);
            }
            file.close()
        });
        Self {
            blocks,
            empty,
            thread,
            failed,
        }
    }

    fn close(self, last: Block) -> JoinHandle<io::Result<Written>> {
        if !last.rows.is_empty() {
            // Nobody there to take it is an error that the thread returns.
            let _ = self.blocks.send(last);
        }
        self.thread
    }
}

/// A file, and what is known of its content.
struct Hashed {
    file: File,
    hash: Sha256,
    bytes: u64,
}

impl Hashed {
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.file.write_all(bytes)?;
        self.hash.update(bytes);
        self.bytes += bytes.len() as u64;
        Ok(())
    }

    /// Sees all of it to the disk.
    fn close(self) -> io::Result<Written> {
        self.file.sync_all()?;
        Ok(Written {
            bytes: self.bytes,
            sha256: self.hash.finalize().into(),
        })
    }
}

/// A block in one piece, so that it is there or not.
fn write(file: &mut Hashed, raw: &[u8]) -> io::Result<()> {
    let mut out = vec![0; 4];
    let mut encoder = zstd::Encoder::new(&mut out, LEVEL)?;
    encoder.include_checksum(true)?;
    encoder.write_all(raw)?;
    encoder.finish()?;
    let length = u32::try_from(out.len() - 4).map_err(io::Error::other)?;
    out[..4].copy_from_slice(&length.to_le_bytes());
    file.write_all(&out)
}

impl<M: Machine> Machine for Recorder<M> {
    fn spec(&self) -> &Spec {
        self.machine.spec()
    }

    #[inline]
    fn exchange(&mut self, command: &Command) -> Result<Measurement, Fault> {
        if let Some(fault) = &self.fault {
            return Err(fault.clone());
        }
        if self.writer.is_none() {
            return self.machine.exchange(command);
        }
        let answer = self.machine.exchange(command);
        match &answer {
            Ok(measured) => {
                self.time = measured.time;
                self.block.push(command, measured);
                if self.block.rows.len() >= self.most {
                    self.hand_over();
                    if let Some(fault) = &self.fault {
                        self.machine.stop();
                        return Err(fault.clone());
                    }
                }
            }
            Err(fault) => {
                self.block.push_fault(command, self.time, fault);
                self.fault = Some(fault.clone());
            }
        }
        answer
    }

    fn stop(&mut self) {
        self.machine.stop();
    }

    fn clear(&mut self) -> Option<Fault> {
        self.machine.clear().inspect(|_| self.fault = None)
    }
}

impl<M> Drop for Recorder<M> {
    fn drop(&mut self) {
        if let Some(writer) = self.writer.take() {
            // There is nobody left to tell.
            let _ = writer.close(std::mem::take(&mut self.block)).join();
        }
    }
}

//! Writes every exchange of a machine to a file while it works.

use super::format::Block;
use super::{MAGIC, RecordError};
use pigtail_hal::{Command, Fault, Machine, Measurement, Spec};
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
    thread: JoinHandle<()>,
    failed: Arc<Mutex<Option<io::Error>>>,
}

impl<M: Machine> Recorder<M> {
    /// Records a machine to a new file; `about` is kept with the record.
    ///
    /// # Errors
    ///
    /// When the file cannot be written.
    pub fn new(machine: M, path: &Path, about: &[u8]) -> Result<Self, RecordError> {
        let failed = |error: io::Error| RecordError::Unwritable {
            path: path.to_owned(),
            error,
        };
        let mut file = File::create_new(path).map_err(failed)?;
        file.write_all(MAGIC).map_err(failed)?;
        write(&mut file, about).map_err(failed)?;
        let most = (BLOCK * machine.spec().servo.rate).ceil() as usize;
        Ok(Self {
            machine,
            block: Block::default(),
            most,
            time: 0.0,
            fault: None,
            writer: Some(Writer::new(file)),
            path: path.to_owned(),
        })
    }

    /// Writes what is left and closes the record.
    ///
    /// # Errors
    ///
    /// When it could not be written to its end.
    pub fn finish(mut self) -> Result<(), RecordError> {
        self.close().map_err(|error| RecordError::Unwritable {
            path: self.path.clone(),
            error,
        })
    }

    fn close(&mut self) -> io::Result<()> {
        let block = std::mem::take(&mut self.block);
        let Some(writer) = self.writer.take() else {
            return Ok(());
        };
        writer.close(block)
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
            .as_ref()
            .map_or_else(|| "its thread has ended".to_owned(), ToString::to_string);
        self.fault = Some(Fault {
            rule: "record can be written".into(),
            axis: self.path.display().to_string(),
            value: why,
            limit: "a disk with room".to_owned(),
            time: self.time,
        });
    }
}

impl Writer {
    fn new(mut file: File) -> Self {
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
                    *said.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
                    return;
                }
                block.clear();
                // The machine may have come to its end.
                let _ = back.send(block);
            }
            if let Err(error) = file.sync_all() {
                *said.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
            }
        });
        Self {
            blocks,
            empty,
            thread,
            failed,
        }
    }

    fn close(self, last: Block) -> io::Result<()> {
        // Nobody there to take it is an error that the thread has left behind.
        let _ = if last.rows.is_empty() {
            Ok(())
        } else {
            self.blocks.send(last)
        };
        drop(self.blocks);
        let ended = self.thread.join();
        let failed = self
            .failed
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take();
        match (failed, ended) {
            (Some(error), _) => Err(error),
            (None, Err(_)) => Err(io::Error::other("the thread that writes it has failed")),
            (None, Ok(())) => Ok(()),
        }
    }
}

/// A block in one piece, so that it is there or not.
fn write(file: &mut File, raw: &[u8]) -> io::Result<()> {
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

    fn exchange(&mut self, command: &Command) -> Result<Measurement, Fault> {
        if let Some(fault) = &self.fault {
            return Err(fault.clone());
        }
        match self.machine.exchange(command) {
            Ok(measured) => {
                self.time = measured.time;
                self.block.push(command, &measured);
                if self.block.rows.len() >= self.most {
                    self.hand_over();
                    if let Some(fault) = &self.fault {
                        self.machine.stop();
                        return Err(fault.clone());
                    }
                }
                Ok(measured)
            }
            Err(fault) => {
                self.block.push_fault(command, self.time, &fault);
                self.fault = Some(fault.clone());
                Err(fault)
            }
        }
    }

    fn stop(&mut self) {
        self.machine.stop();
    }
}

impl<M> Drop for Recorder<M> {
    fn drop(&mut self) {
        if let Some(writer) = self.writer.take() {
            // There is nobody left to tell.
            let _ = writer.close(std::mem::take(&mut self.block));
        }
    }
}

//! The files of a run's folder, and what they hash to.

use pigtail_hal::digest::hex;
use sha2::{Digest, Sha256};
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

/// What is locked in a run's folder while a process is at it.
pub const LOCK: &str = ".lock";

/// A file of a run.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct FileHash {
    /// Its place inside the run's folder, with slashes.
    pub path: String,
    /// Its length.
    pub bytes: u64,
    /// SHA-256 of its content, hexadecimal.
    pub sha256: String,
}

/// Every file below `folder`, by path, but for an empty lock; those that are `known` by whoever wrote
/// them are not read again. What is neither file nor folder counts as a file that cannot be read, for
/// nothing of ours makes such a thing.
///
/// # Errors
///
/// When one cannot be read.
pub fn hash_all(folder: &Path, known: &[FileHash]) -> io::Result<Vec<FileHash>> {
    list(folder)?
        .into_iter()
        .map(|path| {
            if let Some(file) = known.iter().find(|file| file.path == path) {
                return Ok(file.clone());
            }
            let (bytes, sha256) = hash(&folder.join(&path))?;
            Ok(FileHash {
                path,
                bytes,
                sha256,
            })
        })
        .collect()
}

/// The paths of every file below `folder`, sorted, with slashes.
pub(super) fn list(folder: &Path) -> io::Result<Vec<String>> {
    let mut paths = Vec::new();
    collect(folder, "", &mut paths)?;
    paths.sort();
    Ok(paths)
}

fn collect(folder: &Path, before: &str, paths: &mut Vec<String>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let path = format!("{before}{}", entry.file_name().to_string_lossy());
        if entry.file_type()?.is_dir() {
            collect(&entry.path(), &format!("{path}/"), paths)?;
        } else if path != LOCK || entry.metadata()?.len() > 0 {
            paths.push(path);
        }
    }
    Ok(())
}

/// Length and SHA-256 of a file.
pub(super) fn hash(path: &Path) -> io::Result<(u64, String)> {
    let mut file = File::open(path)?;
    let (mut hash, mut length) = (Sha256::new(), 0);
    let mut buffer = vec![0; 1 << 16];
    loop {
        match file.read(&mut buffer) {
            Ok(0) => return Ok((length, hex(&hash.finalize()))),
            Ok(read) => {
                hash.update(&buffer[..read]);
                length += read as u64;
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
}

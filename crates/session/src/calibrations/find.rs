//! A calibration as a person names it.

use super::{ABOUT, About, Belief, FILE, Versions, about_in, verified};
use pigtail_hal::Error;
use std::path::{Path, PathBuf};

/// A calibration that was named.
#[derive(Debug, Clone)]
pub struct Found {
    /// As it was named.
    pub named: String,
    /// Its file.
    pub file: PathBuf,
    /// Itself.
    pub belief: Belief,
    /// What is said of it, where it was kept by a run or is a version.
    pub about: Option<About>,
}

/// The calibration that is named by the number of a version of a rig, a run of the folder `runs`, or a path: a
/// `calibration.toml`, or a folder with one.
///
/// # Errors
///
/// When there is none, or it is not as it was written.
pub fn find(rig: &str, named: &str, runs: &Path) -> Result<Found, Error> {
    if let Ok(version) = named.parse::<u32>() {
        let versions = Versions::of(rig)?;
        let (about, belief) = versions.version(version)?;
        return Ok(Found {
            named: named.to_owned(),
            file: versions.folder(version).join(FILE),
            belief,
            about: Some(about),
        });
    }
    let places = [
        PathBuf::from(named),
        Path::new(named).join(FILE),
        runs.join(named).join(FILE),
    ];
    let Some(file) = places.into_iter().find(|path| path.is_file()) else {
        let message = format!(
            "is no calibration; accepted is the number of a version of the rig, a {FILE}, or a folder with one, such \
             as that of a run that found it"
        );
        return Err(Error::new(named, "", message));
    };
    let folder = file.parent().unwrap_or(Path::new(""));
    let kept = file.ends_with(FILE) && folder.join(ABOUT).is_file();
    let about = kept.then(|| about_in(folder)).transpose()?;
    let belief = match &about {
        Some(about) => verified(folder, about)?,
        None => Belief::read(&file)?,
    };
    Ok(Found {
        named: named.to_owned(),
        file,
        belief,
        about,
    })
}

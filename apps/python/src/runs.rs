//! What the store of runs says.

use crate::failure::Failure;
use crate::work::work;
use pigtail_hal::Error;
use pigtail_store::database::Database;
use pigtail_store::database::query::folders;
use pyo3::prelude::*;
use serde_json::json;
use std::path::{Path, PathBuf};

fn open(runs: &Path) -> Result<Option<Database>, Error> {
    // Asks for the folder first: that it is not there is an error.
    folders(runs)?;
    Database::open(runs)
}

/// The runs, the oldest first, as JSON.
#[pyfunction]
pub(crate) fn runs_list(py: Python<'_>, runs: PathBuf) -> PyResult<String> {
    work(py, None, |_| {
        let mut others = folders(&runs)?;
        let known = match Database::open(&runs)? {
            Some(database) => database.runs_listed()?,
            None => Vec::new(),
        };
        others.retain(|name| !known.iter().any(|run| run.run == *name));
        Ok(json!({ "runs": known, "not_in_store": others }).to_string())
    })
}

/// All that is known of a run, as JSON.
#[pyfunction]
pub(crate) fn runs_show(py: Python<'_>, runs: PathBuf, run: &str) -> PyResult<String> {
    work(py, None, |_| {
        let name = Path::new(run)
            .file_name()
            .unwrap_or_default()
            .to_string_lossy();
        let missing = || {
            let message =
                format!("there is no run {name}; accepted is a run that `Runs.list()` names");
            Error::new(runs.display().to_string(), "", message)
        };
        let database = open(&runs)?.ok_or_else(missing)?;
        let shown = database.shown(&name)?.ok_or_else(missing)?;
        let json = serde_json::to_string(&shown).map_err(anyhow::Error::from);
        json.map_err(Failure::from)
    })
}

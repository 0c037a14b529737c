//! `pigtail align` on a rig that is controlled by position.

use crate::common::Common;
use crate::phases::Watcher;
use crate::{Failure, running, stop};
use pigtail_evaluate::align::AlignmentDocument;
use pigtail_evaluate::bench::align;
use pigtail_evaluate::entry;
use pigtail_hal::Error;
use pigtail_report as report;
use pigtail_session::bench::BenchSetup;
use pigtail_session::calibrations::RunsOn;
use pigtail_session::fleet::NOMINAL;
use pigtail_session::rig::Named;
use pigtail_store::runs::Run;
use std::path::Path;

/// Refuses options that a rig which is controlled by position has no use for, if any of them is given.
pub(crate) fn refuse(options: &[(&str, bool)]) -> Result<(), Error> {
    match options.iter().find(|(_, given)| *given) {
        None => Ok(()),
        Some((option, _)) => Err(Error::new(
            *option,
            "",
            "is for a machine of volts, and this rig is controlled by position; accepted is to leave it out",
        )),
    }
}

/// Aligns a device, and keeps it as a run. Its document, as JSON too, and a line on what it ran on.
pub(crate) fn run(
    common: &Common,
    recipe: &str,
    calibration: Option<&Path>,
    seed: u64,
) -> Result<(AlignmentDocument, Vec<u8>, String), Failure> {
    refuse(&[("--fleet", common.fleet != NOMINAL)])?;
    let mut setup = BenchSetup::load_named(&Named {
        rig: &common.rig,
        recipe,
        calibration,
        ..Named::default()
    })?;
    let run = Run::begin(&common.runs, "align", seed, &setup.rig.hashes)?;
    setup.options.stop = stop::on_signal()?;
    run.devices(&entry::bench(&setup, seed))?;
    let mut watcher = Watcher::of(&run, setup.rig.spec.meter.range);
    let ended = align(&setup, seed, &mut watcher);
    watcher.progress.finish();
    let mut document = match ended {
        Ok(document) => document,
        Err(error) => {
            run.abandon();
            return Err(error.into());
        }
    };
    watcher.phases.all_entered()?;
    document.report = run.path("report.html").display().to_string();
    let rig = RunsOn::of_bench(&setup.rig);
    let line = format!("Ran on {rig}\n");
    let json = {
        let on = running::on_rig(rig, &document, None);
        run.write_json("summary.json", &on)?;
        serde_json::to_vec(&on).map_err(anyhow::Error::from)?
    };
    running::keep_samples(&run, &watcher.record)?;
    let page = report::bench_alignment(&setup.rig.hashes, &document, &watcher.record)?;
    run.write("report.html", page)?;
    run.aligned(&entry::aligned(&document))?;
    match &document.fault {
        Some(fault) => run.fault(fault)?,
        None => run.finish(&document.outcome())?,
    }
    Ok((document, json, line))
}

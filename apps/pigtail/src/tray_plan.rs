//! `pigtail plan --tray`.

use crate::common::Common;
use crate::{DONE, Failure, produce, running};
use pigtail_cycle::plan::{Plan, plan};
use pigtail_report as report;
use pigtail_session::produce::Loaded;
use pigtail_session::setup::Setup;
use serde::Serialize;

/// A plan, what it is of, and where its report is.
#[derive(Serialize)]
struct Reported<'p> {
    #[serde(flatten)]
    plan: &'p Plan,
    /// The tray's file, and its production recipes.
    tray: &'p str,
    recipes: Vec<&'p str>,
    devices: usize,
    /// Path of the report.
    report: String,
}

/// What a tray will take on a rig.
pub(crate) fn planned(loaded: &Loaded, setup: &Setup) -> Plan {
    let geometry = &setup.rig.calibration.geometry;
    plan(
        &loaded.tray,
        &loaded.productions,
        &setup.rig.recipe,
        &setup.rig.spec,
        [geometry.left.home, geometry.right.home],
    )
}

/// `pigtail plan --tray`.
pub(crate) fn run(common: &Common, tray: &str) -> Result<u8, Failure> {
    let (loaded, mut setup) = produce::load(common, tray)?;
    let planned = planned(&loaded, &setup);
    setup.rig.hashes.extend(loaded.hashes.iter().cloned());
    let run = running::begin(&mut setup, &common.runs, "plan", common.seed, false)?;
    let devices = loaded.tray.devices.len();
    let reported = Reported {
        plan: &planned,
        tray: &loaded.file,
        recipes: loaded.productions.keys().map(String::as_str).collect(),
        devices,
        report: run.path("report.html").display().to_string(),
    };
    let on = running::on(&setup, &reported, None);
    run.write_json("summary.json", &on)?;
    let words = words(&planned, devices);
    let title = format!("Plan of tray {}", loaded.file);
    run.write(
        "report.html",
        report::tray_plan(&title, &words[0], &planned)?,
    )?;
    run.finish(&format!("{:.1} devices an hour", planned.devices_per_hour))?;
    let mut text = Vec::new();
    if common.json {
        serde_json::to_writer(&mut text, &on).map_err(anyhow::Error::from)?;
        text.push(b'\n');
    } else {
        let mut rows = vec![vec!["on the critical path".to_owned(), "s".to_owned()]];
        rows.extend(
            planned
                .limits
                .iter()
                .map(|(what, s)| vec![what.clone(), format!("{s:.1}")]),
        );
        crate::common::write_table(&mut text, &rows).map_err(anyhow::Error::from)?;
        text.extend(format!("\n{}", words.join("\n")).bytes());
        text.extend(format!("\nReport: {}\n", reported.report).bytes());
        text.extend(running::line(&setup).bytes());
    }
    crate::print(&text)?;
    Ok(DONE)
}

/// What it comes to, and what idle time cannot be below.
fn words(planned: &Plan, devices: usize) -> [String; 4] {
    let sides = |[left, right]: [f64; 2]| format!("left {left:.1} %, right {right:.1} %");
    [
        format!(
            "{:.0} s for {devices} devices: {:.1} s a device, {:.1} devices an hour; idle: {}",
            planned.seconds,
            planned.seconds_per_device,
            planned.devices_per_hour,
            sides(planned.idle_percent)
        ),
        format!(
            "without work of its own, however that is overlapped, at least: {}",
            sides(planned.idle_or_waiting_at_least_percent)
        ),
        format!(
            "idle in whatever order, each holding still for the other as here, at least: {}",
            sides(planned.idle_at_least_percent)
        ),
        format!(
            "idle were everything but the other's cures done in no time, at least: {}",
            sides(planned.idle_by_cures_at_least_percent)
        ),
    ]
}

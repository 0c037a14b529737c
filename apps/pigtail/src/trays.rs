//! `pigtail produce --trays`.

use crate::common::Common;
use crate::journal::{Head, TrayJournal};
use crate::produce::Arguments;
use crate::{DONE, FAULT, Failure, NEGATIVE, campaign, running, stop};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use pigtail_evaluate::campaign::Commissioned;
use pigtail_evaluate::trays::{TrayDone, TraysDocument, summarize, trays};
use pigtail_report as report;
use pigtail_session::calibrations::{Part, RunsOn};
use pigtail_session::produce::Loaded;
use pigtail_session::setup::Setup;
use pigtail_store::runs::Run;
use pigtail_twin::Specimen;
use serde::Serialize;
use std::io::Write;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

/// What is kept: the sums, and every tray.
#[derive(Serialize)]
struct Kept<'k> {
    #[serde(flatten)]
    document: &'k TraysDocument,
    /// How many times faster than real time, on how many threads; not the same from run to run.
    times_real_time: f64,
    threads: usize,
    each: &'k [TrayDone],
}

/// An event of `--json`: a tray is done.
#[derive(Serialize)]
struct Done<'e> {
    event: &'static str,
    seed: u64,
    devices: usize,
    passed: usize,
    refused: Option<&'e str>,
}

/// Runs many trays with seeds from the one that is named on.
pub(crate) fn run(
    arguments: &Arguments,
    mut setup: Setup,
    loaded: &Loaded,
    asked: u64,
    head: &Head,
) -> Result<u8, Failure> {
    let common: &Common = &arguments.common;
    let before = match &arguments.resume {
        Some(named) => TrayJournal::resumed(named, &common.runs, head)?,
        None => Vec::new(),
    };
    let stop = stop::on_signal()?;
    let threads = arguments
        .threads
        .unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
    let seeds: Vec<u64> = (0..asked).map(|k| common.seed.wrapping_add(k)).collect();
    let machines = if arguments.commission {
        let mut of = seeds.iter().map(|seed| Specimen::from(*seed).machine());
        let of: Vec<u64> = of.by_ref().collect();
        Some(campaign::commission(
            &setup,
            &of,
            &common.runs,
            threads,
            &stop,
        )?)
    } else {
        running::warn(&setup, Part::ALIGNMENT);
        None
    };
    setup.rig.hashes.extend(loaded.hashes.iter().cloned());
    let run = Run::begin(&common.runs, "produce", common.seed, &setup.rig.hashes)?;
    let mut journal = TrayJournal::begin(&run, head, &before)?;
    match all(
        arguments,
        &setup,
        loaded,
        machines.as_ref(),
        (&seeds, before),
        threads,
        &stop,
        (&run, &mut journal),
    ) {
        Ok(code) => Ok(code),
        Err(why) => {
            // What was done is gone on from.
            if journal.is_empty() {
                run.abandon();
            }
            Err(why)
        }
    }
}

#[expect(
    clippy::too_many_arguments,
    reason = "what was asked for, and what runs it"
)]
fn all(
    arguments: &Arguments,
    setup: &Setup,
    loaded: &Loaded,
    machines: Option<&Commissioned>,
    (seeds, mut each): (&[u64], Vec<TrayDone>),
    threads: usize,
    stop: &AtomicBool,
    (run, journal): (&Run, &mut TrayJournal),
) -> Result<u8, Failure> {
    let common: &Common = &arguments.common;
    let wall = Instant::now();
    let bar = ProgressBar::with_draw_target(
        Some(seeds.len() as u64),
        ProgressDrawTarget::stderr_with_hz(10),
    );
    // The first tray takes seconds: that there is one is told before it ends.
    bar.enable_steady_tick(Duration::from_millis(100));
    let template = "{spinner} {pos}/{len} trays [{wide_bar}] {msg} {eta} left";
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style.progress_chars("=> "));
    }
    let counts = |tray: &TrayDone| {
        let of = tray.document.as_ref();
        of.map_or((0, 0), |d| {
            (d.devices, d.devices - d.rejected.values().sum::<usize>())
        })
    };
    // More than are asked for now are none the less done.
    let left = seeds.get(each.len()..).unwrap_or_default();
    let (mut devices, mut passed) = each
        .iter()
        .map(counts)
        .fold((0, 0), |sum, of| (sum.0 + of.0, sum.1 + of.1));
    bar.set_position(each.len() as u64);
    let mut written = Ok(());
    let watch = |tray: &TrayDone| {
        let of = counts(tray);
        (devices, passed) = (devices + of.0, passed + of.1);
        if written.is_ok() {
            written = journal.keep(tray);
        }
        bar.set_message(format!("{passed} of {devices} devices passed"));
        bar.inc(1);
        if common.json && written.is_ok() {
            let event = Done {
                event: "tray",
                seed: tray.seed,
                devices: of.0,
                passed: of.1,
                refused: tray.refused.as_deref(),
            };
            written = serde_json::to_string(&event)
                .map_err(anyhow::Error::from)
                .and_then(|line| Ok(writeln!(std::io::stdout(), "{line}")?));
        }
    };
    let done = trays(setup, loaded, machines, left, threads, stop, watch);
    bar.finish_and_clear();
    each.extend(done?);
    written?;
    let seed = common.seed;
    let document = summarize(
        setup,
        loaded,
        &each,
        seed,
        seeds.len(),
        arguments.commission,
    )?;
    let seconds = wall.elapsed().as_secs_f64();
    let kept = Kept {
        document: &document,
        times_real_time: (document.seconds / seconds).round(),
        threads,
        each: &each,
    };
    run.write_json("summary.json", &running::on(setup, &kept, None))?;
    let accepted = loaded
        .productions
        .values()
        .map(|p| p.verify.added_loss_db)
        .fold(0.0, f64::max);
    run.write("report.html", report::trays(&document, &each, accepted)?)?;
    run.finish(&format!(
        "{passed} of {devices} passed on {} trays",
        document.trays
    ))?;
    let mut text = Vec::new();
    if common.json {
        serde_json::to_writer(&mut text, &document).map_err(anyhow::Error::from)?;
        text.push(b'\n');
    } else {
        words(&mut text, &document, threads, seconds).map_err(anyhow::Error::from)?;
        let report = run.path("report.html");
        text.extend(format!("Report: {}\n", report.display()).bytes());
        let rig = RunsOn::of(&setup.rig);
        text.extend(running::ran_on(&rig, arguments.commission).bytes());
    }
    crate::print(&text)?;
    Ok(if document.stopped > 0 {
        FAULT
    } else if document.interrupted || !document.rejected.is_empty() {
        NEGATIVE
    } else {
        DONE
    })
}

fn words(
    out: &mut impl Write,
    d: &TraysDocument,
    threads: usize,
    seconds: f64,
) -> std::io::Result<()> {
    let or = |value: Option<f64>| value.map_or("-".to_owned(), |v| format!("{v:.3}"));
    let share =
        |[low, high]: [f64; 2]| format!("{} to {}", report::percent(low), report::percent(high));
    if d.interrupted {
        writeln!(out, "Stopped before all trays were done.")?;
    }
    if d.trays_refused > 0 {
        writeln!(
            out,
            "{} machines were refused when they were commissioned: no tray was run on them",
            d.trays_refused
        )?;
    }
    writeln!(
        out,
        "{} trays, {} devices, {} fibers, yield {} (95 %: {})",
        d.trays,
        d.devices,
        d.fibers,
        report::percent(d.passed),
        share(d.exact_95.passed)
    )?;
    for (cause, n) in &d.rejected {
        writeln!(out, "rejected for {cause}: {n}")?;
    }
    for (what, count, of, interval) in [
        (
            "fibers wrongly passed",
            d.wrongly_passed,
            d.fibers_passed,
            d.exact_95.wrongly_passed,
        ),
        (
            "trays that touched a chip",
            d.touched,
            d.trays,
            d.exact_95.touched,
        ),
        ("trays whose holders met", d.met, d.trays, d.exact_95.met),
    ] {
        writeln!(out, "{what}: {count} of {of} (95 %: {})", share(interval))?;
    }
    writeln!(
        out,
        "nearest to a chip {} um, holders to each other {} mm",
        or(d.smallest_gap_um),
        or(d.smallest_apart_mm)
    )?;
    writeln!(
        out,
        "{:.1} devices an hour, {} s a fiber (median)",
        d.devices_per_hour,
        or(d.seconds_per_fiber.p50)
    )?;
    writeln!(
        out,
        "idle: left {:.1} %, right {:.1} %; under the lamp: left {:.1} %, right {:.1} %",
        d.idle_percent.left, d.idle_percent.right, d.held_percent.left, d.held_percent.right
    )?;
    writeln!(
        out,
        "loss added by cure {} dB (median), {} dB (99 %); known to {} of the stated sigma",
        or(d.added_loss_db.p50),
        or(d.added_loss_db.p99),
        or(d.stated_sigma)
    )?;
    writeln!(
        out,
        "{:.0} s of machine time in {seconds:.1} s on {threads} threads",
        d.seconds
    )
}

/// A number of trays is bad input where it is none.
pub(crate) fn whole(text: &str) -> Result<u64, String> {
    /// More are a slip of the keyboard.
    const MOST: u64 = 1_000_000;
    let accepted = || format!("accepted is a whole number from 1 to {MOST}");
    let number: Result<u64, _> = text.parse();
    number
        .ok()
        .filter(|n| (1..=MOST).contains(n))
        .ok_or_else(accepted)
}

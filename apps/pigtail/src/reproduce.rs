//! `pigtail reproduce`.

use crate::common::Common;
use crate::running::{self, stopped};
use crate::{DONE, Failure, NEGATIVE};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use pigtail_hal::Error;
use pigtail_report as report;
use pigtail_reproduce::accounts::Accounts;
use pigtail_reproduce::claims::changes::Verdict;
use pigtail_reproduce::claims::{Group, Subject};
use pigtail_reproduce::specimens::{Specimens, SpecimensDocument};
use pigtail_reproduce::{Bench, ReproductionDocument, experiments, reproduce, select};
use pigtail_session::rig::DEFAULT_RECIPE_NAME;
use pigtail_store::runs::Run;
use std::fmt::Write as _;
use std::time::Duration;

/// Run the experiments of the thesis on the twin, each result beside the printed one
///
/// Every figure with data and every number in the text of *Coordinated Control of Two Macro/Micro
/// Manipulators for Fiber Pigtailling Automation*, through the same control code as a real run. The
/// seed draws device, fixture and noise. What the thesis simulated is simulated with its model, the rig's
/// plant; what it measured is measured on the machine, which departs from the model where the rig's
/// measured.toml says so: the one in the middle of its make, unless a specimen is asked for. How near a
/// result must come goes by the kind of its claim. A report goes into a folder below `runs`, with the thesis's slips
/// as a section of their own.
///
/// Claims are counted by what they rest on. Nothing was fitted to a prediction; for a calibrated claim a number of
/// plant, control or experiment was set, or may have been; a definition cannot fail. What was changed of a claim
/// after a result was seen is told with the results before and after.
///
/// The exit code is 1 where a claim does not hold for a reason that is not known. Those whose reason was
/// found stay in the list, and say it. What drawn machines (`--machines`) give does not change it.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pigtail reproduce                 everything, about a minute on two cores
  pigtail reproduce --quick         with fewer steps, devices and runs
  pigtail reproduce 2.8 4.20        some figures
  pigtail reproduce 3 --seed 7      a chapter, with another device
  pigtail reproduce 2 --specimen    a chapter, on a machine that the seed draws
  pigtail reproduce --machines 20 --quick
                                    and each claim on how many of 20 machines
  pigtail reproduce budget          the times of 3.4")]
pub(crate) struct Arguments {
    /// Chapters (2, 3, 4), figures (2.8), or `budget`; everything where none is named
    #[arg(value_name = "CHAPTER|FIGURE")]
    names: Vec<String>,
    #[command(flatten)]
    common: Common,
    /// Take fewer steps, devices and runs
    #[arg(long)]
    quick: bool,
    /// Let the seed draw the machine too, instead of the thesis's own
    #[arg(long)]
    specimen: bool,
    /// Run them on so many drawn machines too, and say of each claim on how many it holds
    #[arg(long, alias = "specimens", value_name = "M", conflicts_with = "specimen",
          value_parser = clap::value_parser!(u32).range(1..=1000))]
    machines: Option<u32>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<u8, Failure> {
    let common = &arguments.common;
    let selected = select(&arguments.names)?;
    let setup = common.setup(DEFAULT_RECIPE_NAME)?;
    if setup.fleet.is_some() {
        let message = "the thesis is reproduced on its own machine; accepted is nominal, and --machines for what \
                       else is drawn";
        return Err(Error::new("--fleet", "", message).into());
    }
    let drawn = arguments
        .machines
        .map(|n| Specimens::new(&setup, (common.seed, arguments.quick), n, &selected))
        .transpose()?;
    let bench = Bench::new(setup, common.seed, arguments.quick, arguments.specimen)?;
    let run = Run::begin(
        &common.runs,
        "reproduce",
        common.seed,
        &bench.machine.rig.hashes,
    )?;
    let steps = experiments()
        .filter(|e| e.figures.iter().any(|id| selected.contains(id)))
        .count();
    let steps = steps + drawn.as_ref().map_or(0, Specimens::experiments);
    let bar = ProgressBar::new(steps as u64);
    if let Ok(style) = ProgressStyle::with_template("reproduce [{bar:20}] {pos}/{len} {msg}") {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.enable_steady_tick(Duration::from_millis(200));
    let tell = |figures: &[&'static str]| {
        bar.set_message(figures.join(", "));
        bar.inc(1);
    };
    let made = reproduce(&bench, &selected, &tell).and_then(|mut made| {
        made.document.specimens = drawn.map(|drawn| drawn.run(&tell)).transpose()?;
        Ok(made)
    });
    bar.finish_and_clear();
    let made = made.map_err(|ended| stopped(&run, &bench.machine, ended))?;
    let on = running::on(&bench.machine, &made.document, None);
    run.write_json("summary.json", &on)?;
    run.write("report.html", report::thesis(&made)?)?;
    let report = run.path("report.html").display().to_string();
    run.finish(&format!(
        "{} of {} claims hold",
        made.document.held, made.document.of
    ))?;
    let text = running::told(common.json, &on, &bench.machine, || {
        format!("{}Report: {report}\n", account(&made.document))
    })?;
    crate::print(text.as_bytes())?;
    Ok(if made.document.is_as_known() {
        DONE
    } else {
        NEGATIVE
    })
}

/// What a person wants to know of it.
fn account(d: &ReproductionDocument) -> String {
    let mut text = String::new();
    for claim in &d.claims {
        let mark = match (claim.holds, claim.explained) {
            (true, _) => "holds",
            (false, true) => "FAILS, explained",
            (false, false) => "FAILS",
        };
        let ours = claim.ours.map_or_else(|| "-".to_owned(), |v| v.to_string());
        let changed = if claim.changes.is_empty() { "" } else { " *" };
        let _ = writeln!(
            text,
            "{:24} {:>9} {ours:>10} {:6} {:10} {mark}",
            format!("{}{changed}", claim.id),
            format!("{}{}", claim.tolerance_sign(), claim.thesis),
            claim.unit,
            claim.basis.name()
        );
    }
    for claim in d.claims.iter().filter(|c| !c.holds) {
        let _ = writeln!(text);
        let head = format!("{}: {} ({})", claim.id, claim.quantity, claim.tolerance);
        write_wrapped(&mut text, 0, &head);
        write_wrapped(&mut text, 2, &claim.note);
    }
    write_changes(&mut text, &d.accounts);
    if let Some(specimens) = &d.specimens {
        write_specimens(&mut text, specimens);
    }
    let _ = writeln!(text);
    write_accounts(&mut text, d);
    text
}

/// The claims counted by what they rest on.
fn write_accounts(text: &mut String, d: &ReproductionDocument) {
    for group in Group::ALL {
        let count = d.accounts.group(group);
        if count.of == 0 {
            continue;
        }
        let (many, meaning) = group.meaning();
        let _ = writeln!(
            text,
            "{} of {} {many} hold: {meaning}",
            count.hold, count.of
        );
        let part = match group {
            Group::Prediction => Some((
                d.accounts.predictions_unchanged,
                "of which nothing was changed after a result was seen",
            )),
            Group::Calibrated => Some((d.accounts.calibrated_in_doubt, "of which it is in doubt")),
            Group::Definition => None,
        };
        if let Some((count, what)) = part.filter(|(count, _)| count.of > 0) {
            let _ = writeln!(text, "  {} of {}, {what}", count.hold, count.of);
        }
    }
    let _ = writeln!(text, "{} of {} in all ({:.0} s)", d.held, d.of, d.seconds);
}

/// What was changed after a result was seen, with both results.
fn write_changes(text: &mut String, accounts: &Accounts) {
    if accounts.changed.of > 0 {
        let _ = writeln!(
            text,
            "\n* Changed after a result was seen (report and --json say what, and why):"
        );
    }
    let result = |result: Option<Verdict>| {
        result.map_or_else(
            || "no claim".to_owned(),
            |r| format!("{} {}", r.ours, if r.holds { "holds" } else { "FAILS" }),
        )
    };
    for change in &accounts.changed_after_result {
        let _ = writeln!(
            text,
            "{:17} {} {:7} {:9} {:>13} -> {}",
            change.claim,
            change.date,
            change.commit,
            change.what.name(),
            result(change.before),
            result(Some(change.after))
        );
    }
    for withdrawn in &accounts.withdrawn {
        let line = format!(
            "Withdrawn: {}, {} {}: {}. {}",
            withdrawn.claim, withdrawn.date, withdrawn.commit, withdrawn.was, withdrawn.why
        );
        write_wrapped(text, 0, &line);
    }
}

/// The claims on drawn machines.
fn write_specimens(text: &mut String, d: &SpecimensDocument) {
    let _ = writeln!(text, "\nOn {}:", machines(&d.seeds));
    let _ = writeln!(
        text,
        "{:23} {:10} {:>10} {:>10} {:>10} {:>10}",
        "", "", "hold on", "least", "median", "most"
    );
    let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| v.to_string());
    for claim in &d.claims {
        let Some(held) = claim.held else { continue };
        let _ = writeln!(
            text,
            "{:23} {:10} {:>10} {:>10} {:>10} {:>10}",
            claim.id,
            claim.basis.name(),
            format!("{held} of {}", claim.of),
            number(claim.least),
            number(claim.median),
            number(claim.most)
        );
    }
    for ended in &d.ended {
        let figures = ended.figures.join(", ");
        let line = format!(
            "seed {}, {figures}: {}; counts as not held",
            ended.seed, ended.how
        );
        write_wrapped(text, 2, &line);
    }
    for subject in [Subject::Model, Subject::Numbers] {
        let same = d
            .claims
            .iter()
            .filter(|c| c.not_drawn == subject.not_drawn());
        let same: Vec<&str> = same.map(|c| c.id).collect();
        if let Some(why) = subject.not_drawn().filter(|_| !same.is_empty()) {
            write_wrapped(text, 2, &format!("not drawn, {why}: {}", same.join(", ")));
        }
    }
    for group in Group::ALL {
        let tally = d.accounts.group(group);
        if tally.claims > 0 {
            let (many, _) = group.meaning();
            let _ = writeln!(
                text,
                "{} of {} {many} hold on every machine; {} of {} machine by machine",
                tally.on_all, tally.claims, tally.hold, tally.of
            );
        }
    }
}

/// How many machines, and of which seeds.
fn machines(seeds: &[u64]) -> String {
    match seeds {
        [one] => format!("one drawn machine (seed {one})"),
        [first, .., last] => format!("{} drawn machines (seeds {first} to {last})", seeds.len()),
        [] => "no machine".to_owned(),
    }
}

/// Writes a paragraph in lines of at most 80 characters.
fn write_wrapped(text: &mut String, indent: usize, paragraph: &str) {
    const WIDTH: usize = 80;
    let mut line = " ".repeat(indent);
    for word in paragraph.split_whitespace() {
        let blank = line.trim().is_empty();
        if !blank && line.chars().count() + 1 + word.chars().count() > WIDTH {
            let _ = writeln!(text, "{line}");
            line = " ".repeat(indent);
        } else if !blank {
            line.push(' ');
        }
        line.push_str(word);
    }
    let _ = writeln!(text, "{line}");
}

//! The report of a campaign.

use super::figure::{HALF, WHOLE};
use super::histogram::histogram;
use super::html::{configuration, figure, fixed, number, page, verdict};
use super::sureness::sureness;
use super::text::far;
use anyhow::Result;
use maud::{Markup, html};
use pigtail_control::job::PORTS;
use pigtail_evaluate::align::TOLERANCE_Z_UM;
use pigtail_evaluate::campaign::{CampaignDocument, Store};
use pigtail_numerics::statistics::Percentiles;
use pigtail_session::fleet::NOMINAL;
use pigtail_session::piezos::PiezoModel;
use pigtail_session::procedure::Procedure;
use pigtail_session::scenario::Scenario;
use std::fmt::Write as _;

/// Seeds shown of each cause.
const SEEDS: usize = 5;

/// The report of a campaign as one HTML text.
///
/// # Errors
///
/// When the rows cannot be read or a figure cannot be drawn.
pub fn campaign(store: &Store, document: &CampaignDocument) -> Result<String> {
    let title = format!(
        "{} devices, {} on {}, seed {}{}",
        document.devices,
        document.recipe,
        document.rig,
        document.seed,
        otherwise(document)
    );
    let body = html! {
        (summary(document))
        (measures(document))
        p.soft {
            (drawn_on(document)) ", drawn around " code { "plant.toml" }
            ". Times are machine time of every fiber that was attempted; offsets and losses are the truth \
             about every fiber that was attached, offsets in the table without sign. Percentiles are \
             values that really came: p99 is the least that 99 % do not exceed. Of fewer than 1000 fibers p99.9 would be \
             the greatest again, and is not shown."
        }
        (faults(document))
        (failures(document))
        (figures(store, document)?)
        (sureness(store, document)?)
        (phases(document))
        (configuration(
            &store.plan().configuration,
            html! { (document.version) ", rows of SHA-256 " code { (document.rows_sha256) } }
        ))
    };
    Ok(page(&title, &body))
}

/// A share in percent. Digits enough to tell it from 100 %, never rounded up to it.
pub fn percent(share: f64) -> String {
    if share == 0.0 || share == 1.0 {
        format!("{:.0} %", 100.0 * share)
    } else if share < 0.001 {
        format!("{:.4} %", 100.0 * share)
    } else {
        let text = format!("{:.2} %", 100.0 * share);
        if text == "100.00 %" {
            format!("{:.4} %", 100.0 * share)
        } else {
            text
        }
    }
}

fn share(part: u64, of: u64) -> String {
    percent(part as f64 / of.max(1) as f64)
}

/// What is not as it is if nothing is said.
fn otherwise(document: &CampaignDocument) -> String {
    let mut text = String::new();
    for (name, usual, is) in [
        ("fleet", NOMINAL, &document.fleet),
        ("scenario", Scenario::default().name(), &document.scenario),
        ("faults", "none", &document.faults),
    ] {
        if is != usual {
            let _ = write!(text, ", {name} {is}");
        }
    }
    if document.commissioned {
        text += ", each machine commissioned first";
    }
    if let Some(model) = document
        .piezo_model
        .filter(|model| *model != PiezoModel::default())
    {
        let _ = write!(text, " by piezo model {model}");
    }
    text
}

/// Which machines and devices there are.
fn drawn_on(document: &CampaignDocument) -> String {
    if document.devices_each <= 1 {
        return "Each device has its own machine, chip and fixture".to_owned();
    }
    let machines = document.machines;
    format!(
        "{machines} machines with up to {} devices each: a chip and a place in its fixture for every device",
        document.devices_each
    )
}

fn summary(document: &CampaignDocument) -> Markup {
    let sure = &document.confidence;
    let level = format!("{:.0} % confidence", 100.0 * sure.level);
    let between = |[low, high]: [f64; 2]| format!("{} to {}", percent(low), percent(high));
    let across = Procedure::tolerance_of(&document.procedure);
    html! {
        @if !document.complete {
            p.bad {
                "Interrupted: " (document.devices) " of " (document.devices_planned) " devices are done."
            }
        }
        p {
            span class=(verdict(document.aligned == document.fibers)) {
                (document.aligned) " of " (document.fibers) " fibers aligned"
            }
            " by the " (document.procedure) " procedure: " (share(document.aligned, document.fibers))
            " (" (level) ": " (between(sure.fibers_aligned)) "). All fibers of "
            (document.devices_aligned) " of " (document.devices) " devices: "
            (share(document.devices_aligned, document.devices))
            " (" (between(sure.devices_aligned)) ")."
        }
        p {
            span class=(verdict(document.wrong.count == 0)) {
                (document.wrong.count) " wrongly believed aligned"
            }
            ": control says so, and the fiber is farther than " (across) ", " (across) " or "
            (TOLERANCE_Z_UM) " um from where it should be (" (level) ": at most "
            (percent(sure.fibers_wrong[1])) "). "
            span class=(verdict(document.collided.count == 0)) {
                (document.collided.count) " devices were touched."
            }
        }
    }
}

/// A table of percentiles: a row a name, with its unit and digits behind the point.
fn percentiles(rows: &[(&str, &str, &Percentiles, usize)]) -> Markup {
    html! {
        div.scroll { table {
            tr {
                th {} th.text { "unit" }
                @for name in ["mean", "p50", "p90", "p99", "p99.9", "greatest"] {
                    th { (name) }
                }
            }
            @for (name, unit, of, digits) in rows {
                tr {
                    td { (name) }
                    td.text { (unit) }
                    @for value in [of.mean, of.p50, of.p90, of.p99, far(of), of.max] {
                        td { (number(value, *digits)) }
                    }
                }
            }
        } }
    }
}

fn measures(document: &CampaignDocument) -> Markup {
    let offset = &document.offset_um;
    percentiles(&[
        ("time a fiber", "s", &document.seconds_per_fiber, 2),
        ("offset in x", "um", &offset.x, 3),
        ("offset in y", "um", &offset.y, 3),
        ("offset in z", "um", &offset.z, 3),
        ("coupling loss", "dB", &document.coupling_loss_db, 3),
    ])
}

/// How devices ended on which something was broken on purpose.
fn faults(document: &CampaignDocument) -> Markup {
    if document.by_fault.is_empty() {
        return Markup::default();
    }
    html! {
        h2 { "What was broken" }
        p {
            "One thing broke on each device, at a time drawn from those of an alignment: one that breaks \
             when all is done is one of the aligned. Stopped: by the guard. Wrong: believed aligned. \
             Failed: the program itself."
        }
        div.scroll { table {
            tr {
                th { "broken" } th { "devices" } th { "stopped" } th { "given up" } th { "aligned" }
                th { "wrong" } th { "touched" } th { "failed" }
            }
            @for (name, of) in &document.by_fault {
                tr {
                    td { (name) }
                    @for count in [of.devices, of.tripped, of.given_up, of.aligned] {
                        td { (count) }
                    }
                    @for count in [of.false_aligned, of.collisions, of.broken] {
                        td class=(verdict(count == 0)) { (count) }
                    }
                }
            }
        } }
        div.scroll { table {
            tr { th { "rule that stopped the machine" } th { "devices" } }
            @for (rule, count) in &document.tripped {
                tr { td { (rule) } td { (count) } }
            }
        } }
    }
}

fn failures(document: &CampaignDocument) -> Markup {
    if document.failed.is_empty() {
        return Markup::default();
    }
    html! {
        h2 { "Not aligned" }
        div.scroll { table {
            tr { th { "cause" } th.text { "replay" } th { "fibers" } th { "share" } }
            @for (cause, count) in &document.failed {
                @let seeds = document.replay.get(cause).map_or(&[][..], Vec::as_slice);
                @let shown: Vec<_> = seeds.iter().take(SEEDS).map(u64::to_string).collect();
                tr {
                    td.bad { (cause) }
                    td.text {
                        code { (document.replay_command()) } " " (shown.join(", "))
                        @if (*count as usize) > shown.len() { " ..." }
                    }
                    td { (count) }
                    td { (share(*count, document.fibers)) }
                }
            }
        } }
    }
}

fn figures(store: &Store, document: &CampaignDocument) -> Result<Markup> {
    let rows = store.rows()?;
    // A figure of nothing shows nothing.
    let shown = |column: &str, width, axis: &str, marks: &[(&str, f64, bool)], caption: &str| {
        // A group of rows is in memory at a time.
        let read = |each: &mut dyn FnMut(usize, f64)| -> Result<()> {
            for group in rows.groups(&["port", column]) {
                let group = group?;
                for (port, value) in group.texts("port").iter().zip(group.numbers(column)) {
                    if let Some(value) = value {
                        each(usize::from(port.as_deref() != Some(PORTS[0])), value);
                    }
                }
            }
            Ok(())
        };
        let drawn = histogram(width, &["inputs", "outputs"], read, axis, marks)?;
        Ok::<_, anyhow::Error>(drawn.map_or_else(Markup::default, |drawn| figure(&drawn, caption)))
    };
    let named = |of: &Percentiles| -> Vec<(&str, f64, bool)> {
        // A percentile that so few values cannot tell from the greatest is not marked.
        [("p50", of.p50), ("p99", of.p99), ("p99.9", of.p999)]
            .into_iter()
            .filter(|(_, value)| *value < of.max)
            .filter_map(|(name, value)| Some((name, value?, false)))
            .collect()
    };
    let offset = |axis: &str, limit: f64, caption: &str| {
        shown(
            &format!("offset_{axis}_um"),
            HALF,
            &format!("offset in {axis}, um"),
            &[("tolerance", -limit, true), ("tolerance", limit, true)],
            &format!("{caption} Tolerance: {limit} um either way."),
        )
    };
    let across = Procedure::tolerance_of(&document.procedure);
    Ok(html! {
        h2 { "How often" }
        (shown(
            "seconds",
            WHOLE,
            "machine time of a fiber, s",
            &named(&document.seconds_per_fiber),
            "Machine time of each fiber, inputs and outputs apart. The height is logarithmic, so that one fiber \
             among thousands is seen."
        )?)
        div.pair {
            (offset(
                "x",
                across,
                "Offset across the chip, from the peak of the coupling at the fiber's gap."
            )?)
            (offset("y", across, "Offset up from the chip.")?)
            (offset("z", TOLERANCE_Z_UM, "Gap beyond the wanted one.")?)
            (shown(
                "coupling_loss_db",
                HALF,
                "coupling loss, dB",
                &named(&document.coupling_loss_db),
                "Loss at the interface of an attached fiber."
            )?)
        }
    })
}

fn phases(document: &CampaignDocument) -> Markup {
    let rows: Vec<_> = document
        .phases
        .iter()
        .map(|phase| (phase.name, "s", &phase.seconds, 2))
        .collect();
    let idle = &document.idle_seconds_per_device;
    html! {
        h2 { "Where the time goes" }
        (percentiles(&rows))
        @if let Some(arms) = &document.arms {
            p {
                "Of the time of a device the left manipulator stands still for " (fixed(arms.idle_percent.left, 1))
                " %, the right one for " (fixed(arms.idle_percent.right, 1)) " %; both move for "
                (fixed(arms.both_moving_percent, 1)) " %."
            }
            (percentiles(&[
                ("left stands still, a device", "s", &idle.left, 2),
                ("right stands still, a device", "s", &idle.right, 2),
            ]))
        }
    }
}

//! The report of a campaign.

use super::figure::{HALF, WHOLE};
use super::histogram::histogram;
use super::html::{escape, figure, page};
use anyhow::Result;
use pigtail_evaluate::align::TOLERANCE_Z_UM;
use pigtail_evaluate::campaign::{Document, Store};
use pigtail_numerics::statistics::Percentiles;
use pigtail_session::procedure::Procedure;
use std::fmt::Write as _;

/// Seeds shown of each cause.
const SEEDS: usize = 5;

/// The report of a campaign as one HTML text.
///
/// # Errors
///
/// When the rows cannot be read or a figure cannot be drawn.
pub fn campaign(store: &Store, document: &Document) -> Result<String> {
    let title = format!(
        "{} devices, {} on {}, seed {}",
        document.devices, document.recipe, document.rig, document.seed
    );
    let mut body = format!("<h1>{}</h1>\n", escape(&title));
    body.push_str(&verdict(document));
    body.push_str(&measures(document));
    body.push_str(
        "<p class=\"soft\">Each device has its own machine, chip and fixture, drawn around \
         <code>plant.toml</code>. Times are machine time of every fiber that was attempted; \
         offsets and losses are the truth about every fiber that was attached, offsets in the \
         table without sign. Percentiles are values that really came: p99 is the least that 99 % \
         do not exceed.</p>\n",
    );
    body.push_str(&faults(document));
    body.push_str(&failures(document));
    body.push_str(&figures(store, document)?);
    body.push_str(&phases(document));
    body.push_str("<details><summary>Configuration</summary>\n<table>\n");
    for (file, hash) in &store.plan().configuration {
        let _ = writeln!(
            body,
            "<tr><td>{}</td><td><code>{hash}</code></td></tr>",
            escape(file)
        );
    }
    let _ = writeln!(
        body,
        "</table>\n<p>pigtail {}, rows of SHA-256 <code>{}</code></p></details>",
        document.version, document.rows_sha256
    );
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

fn verdict(document: &Document) -> String {
    let class = |good: bool| if good { "good" } else { "bad" };
    let sure = &document.confidence;
    let between = |[low, high]: [f64; 2]| format!("{} to {}", percent(low), percent(high));
    let mut html = String::new();
    if !document.complete {
        let _ = writeln!(
            html,
            "<p class=\"bad\">Interrupted: {} of {} devices are done.</p>",
            document.devices, document.devices_planned
        );
    }
    let _ = writeln!(
        html,
        "<p><span class=\"{}\">{} of {} fibers aligned</span> by the {} procedure: {} \
         ({:.0} % confidence: {}). All fibers of {} of {} devices: {} ({}).</p>",
        class(document.aligned == document.fibers),
        document.aligned,
        document.fibers,
        document.procedure,
        share(document.aligned, document.fibers),
        100.0 * sure.level,
        between(sure.fibers_aligned),
        document.devices_aligned,
        document.devices,
        share(document.devices_aligned, document.devices),
        between(sure.devices_aligned),
    );
    let _ = writeln!(
        html,
        "<p><span class=\"{}\">{} wrongly believed aligned</span>: control says so, and the fiber is \
         farther than {}, {} or {} um from where it should be ({:.0} % confidence: at most {}). \
         <span class=\"{}\">{} devices were touched.</span></p>",
        class(document.wrong.count == 0),
        document.wrong.count,
        Procedure::tolerance_of(&document.procedure),
        Procedure::tolerance_of(&document.procedure),
        TOLERANCE_Z_UM,
        100.0 * sure.level,
        percent(sure.fibers_wrong[1]),
        class(document.collided.count == 0),
        document.collided.count
    );
    html
}

fn row(html: &mut String, name: &str, unit: &str, of: &Percentiles, digits: usize) {
    let _ = write!(html, "<tr><td>{name}</td><td>{unit}</td>");
    for value in [of.mean, of.p50, of.p90, of.p99, of.p999, of.max] {
        let text = value.map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"));
        let _ = write!(html, "<td>{text}</td>");
    }
    html.push_str("</tr>\n");
}

const HEADER: &str = "<div class=\"scroll\"><table>\n<tr><th></th><th>unit</th><th>mean</th><th>p50</th>\
                      <th>p90</th><th>p99</th><th>p99.9</th><th>greatest</th></tr>\n";

fn measures(document: &Document) -> String {
    let mut html = String::from(HEADER);
    let o = &document.offset_um;
    row(
        &mut html,
        "time a fiber",
        "s",
        &document.seconds_per_fiber,
        2,
    );
    for (name, of) in [
        ("offset in x", &o.x),
        ("offset in y", &o.y),
        ("offset in z", &o.z),
    ] {
        row(&mut html, name, "um", of, 3);
    }
    row(
        &mut html,
        "coupling loss",
        "dB",
        &document.coupling_loss_db,
        3,
    );
    html.push_str("</table></div>\n");
    html
}

/// How devices ended on which something was broken on purpose.
fn faults(document: &Document) -> String {
    if document.by_fault.is_empty() {
        return String::new();
    }
    let mut html = String::from(
        "<h2>What was broken</h2>\n<p>One thing broke on each device, at a time drawn from those of an \
         alignment: one that breaks when all is done is one of the aligned. Stopped: by the guard. \
         Wrong: believed aligned. Failed: the program itself.</p>\n<div class=\"scroll\"><table>\n\
         <tr><th>broken</th><th>devices</th><th>stopped</th><th>given up</th><th>aligned</th>\
         <th>wrong</th><th>touched</th><th>failed</th></tr>\n",
    );
    for (name, of) in &document.by_fault {
        let _ = write!(html, "<tr><td>{}</td>", escape(name));
        for count in [of.devices, of.tripped, of.given_up, of.aligned] {
            let _ = write!(html, "<td>{count}</td>");
        }
        for count in [of.false_aligned, of.collisions, of.broken] {
            let class = if count == 0 { "good" } else { "bad" };
            let _ = write!(html, "<td class=\"{class}\">{count}</td>");
        }
        html.push_str("</tr>\n");
    }
    html.push_str(
        "</table></div>\n<div class=\"scroll\"><table>\n<tr><th>rule that stopped the machine</th>\
         <th>devices</th></tr>\n",
    );
    for (rule, count) in &document.tripped {
        let _ = writeln!(html, "<tr><td>{}</td><td>{count}</td></tr>", escape(rule));
    }
    html.push_str("</table></div>\n");
    html
}

fn failures(document: &Document) -> String {
    if document.failed.is_empty() {
        return String::new();
    }
    let mut html = String::from(
        "<h2>Not aligned</h2>\n<div class=\"scroll\"><table>\n<tr><th>cause</th><th>replay</th>\
         <th>fibers</th><th>share</th></tr>\n",
    );
    for (cause, count) in &document.failed {
        let seeds = document.replay.get(cause).map_or(&[][..], Vec::as_slice);
        let shown: Vec<_> = seeds.iter().take(SEEDS).map(u64::to_string).collect();
        let more = if (*count as usize) > shown.len() {
            " ..."
        } else {
            ""
        };
        let _ = writeln!(
            html,
            "<tr><td class=\"bad\">{}</td><td><code>{}</code> {}{more}</td><td>{count}</td>\
             <td>{}</td></tr>",
            escape(cause),
            escape(&document.replay_command()),
            shown.join(", "),
            share(*count, document.fibers)
        );
    }
    html.push_str("</table></div>\n");
    html
}

fn figures(store: &Store, document: &Document) -> Result<String> {
    let rows = store.rows()?;
    let mut html = String::from("<h2>How often</h2>\n");
    // A figure of nothing shows nothing.
    let shown = |column: &str, width, axis: &str, marks: &[(&str, f64, bool)], caption: &str| {
        let values = rows.numbers(column)?;
        Ok::<_, anyhow::Error>(if values.is_empty() {
            String::new()
        } else {
            figure(&histogram(width, &values, axis, marks)?, caption)
        })
    };
    let named = |of: &Percentiles| -> Vec<(&str, f64, bool)> {
        [("p50", of.p50), ("p99", of.p99), ("p99.9", of.p999)]
            .into_iter()
            .filter_map(|(name, value)| Some((name, value?, false)))
            .collect()
    };
    html.push_str(&shown(
        "seconds",
        WHOLE,
        "machine time of a fiber, s",
        &named(&document.seconds_per_fiber),
        "Machine time of each fiber. The height is logarithmic, so that one fiber among thousands \
         is seen.",
    )?);
    html.push_str("<div class=\"pair\">\n");
    for (axis, limit, caption) in [
        (
            "x",
            Procedure::tolerance_of(&document.procedure),
            "Offset across the chip, from the peak of the coupling at the fiber's gap.",
        ),
        (
            "y",
            Procedure::tolerance_of(&document.procedure),
            "Offset up from the chip.",
        ),
        ("z", TOLERANCE_Z_UM, "Gap beyond the wanted one."),
    ] {
        html.push_str(&shown(
            &format!("offset_{axis}_um"),
            HALF,
            &format!("offset in {axis}, um"),
            &[("tolerance", -limit, true), ("tolerance", limit, true)],
            &format!("{caption} Tolerance: {limit} um either way."),
        )?);
    }
    html.push_str(&shown(
        "coupling_loss_db",
        HALF,
        "coupling loss, dB",
        &named(&document.coupling_loss_db),
        "Loss at the interface of an attached fiber.",
    )?);
    html.push_str("</div>\n");
    Ok(html)
}

fn phases(document: &Document) -> String {
    let mut html = format!("<h2>Where the time goes</h2>\n{HEADER}");
    for phase in &document.phases {
        row(&mut html, phase.name, "s", &phase.seconds, 2);
    }
    html.push_str("</table></div>\n");
    html
}

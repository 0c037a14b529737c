//! The report of one alignment.

use super::figure::{Axes, HALF, WHOLE, coloured, curves, envelope, over_time, range_of};
use super::html::{escape, figure, page};
use anyhow::Result;
use pigtail_control::kinematics::Kinematics;
use pigtail_control::procedure::PORTS;
use pigtail_control::station::Sample;
use pigtail_hal::{Channel, Side};
use pigtail_session::align::{Document, FiberRow};
use pigtail_session::record::{PhaseRecord, Record};
use pigtail_session::rig::Setup;
use std::fmt::Write as _;

/// Phases in which a fiber looks for light or follows it.
const SEARCHING: [&str; 6] = ["raster", "search", "climb", "centre", "approach", "final"];
/// Those of them in which nothing is followed yet.
const BLIND: [&str; 2] = ["raster", "search"];
/// Most points of a picture: more would make a page that scrolls badly and shows no more.
const POINTS: usize = 5000;

/// The report of an alignment as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn alignment(setup: &Setup, document: &Document, record: &Record) -> Result<String> {
    let mut body = String::new();
    let title = format!(
        "{} on {}, seed {}",
        document.recipe, document.rig, document.seed
    );
    let _ = writeln!(body, "<h1>{}</h1>", escape(&title));
    let _ = writeln!(body, "<p>{}</p>", verdict(document));
    body.push_str(&table(document));
    body.push_str(
        "<p class=\"soft\">Offsets are the truth, from the twin: x and y from the peak of the \
         coupling at the fiber's gap, z from the gap that was wanted. Control never sees them. \
         All pictures show what control saw: encoders, commanded micro displacement, \
         photodiodes.</p>\n",
    );
    for (index, fiber) in document.fibers.iter().enumerate() {
        body.push_str(&section(setup, record, index, fiber)?);
    }
    body.push_str("<details><summary>Configuration</summary>\n<table>\n");
    for (file, hash) in &setup.hashes {
        let _ = writeln!(
            body,
            "<tr><td>{}</td><td><code>{hash}</code></td></tr>",
            escape(file)
        );
    }
    let _ = writeln!(
        body,
        "</table>\n<p>pigtail {}</p></details>",
        document.version
    );
    Ok(page(&title, &body))
}

fn verdict(document: &Document) -> String {
    let good = |f: &&FiberRow| f.outcome == "aligned" && f.within_tolerance == Some(true);
    let aligned = document.fibers.iter().filter(good).count();
    let of = document.fibers.len();
    let class = if document.is_success() { "good" } else { "bad" };
    let mut text = format!(
        "<span class=\"{class}\">{aligned} of {of} fibers aligned</span>, {:.2} s of machine time \
         a fiber, by the {} procedure.",
        document.seconds_per_fiber, document.procedure
    );
    if document.collision {
        text.push_str(" <span class=\"bad\">A fiber hit the chip: nothing here counts.</span>");
    }
    if document
        .fibers
        .iter()
        .any(|f| f.within_tolerance == Some(false))
    {
        text.push_str(" <span class=\"bad\">One that control believes aligned is not.</span>");
    }
    text
}

fn table(document: &Document) -> String {
    let names = document.phase_names();
    let mut html =
        String::from("<div class=\"scroll\"><table>\n<tr><th>fiber</th><th>outcome</th>");
    for name in &names {
        let _ = write!(html, "<th>{name}<small>s</small></th>");
    }
    html.push_str(
        "<th>in all<small>s</small></th><th>x<small>um</small></th><th>y<small>um</small></th>\
         <th>z<small>um</small></th><th>loss<small>dB</small></th></tr>\n",
    );
    let number = |value: Option<f64>, digits: usize| {
        value.map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"))
    };
    for fiber in &document.fibers {
        let class = if fiber.outcome == "aligned" && fiber.within_tolerance == Some(true) {
            "good"
        } else {
            "bad"
        };
        let _ = write!(
            html,
            "<tr><td>{}</td><td class=\"{class}\">{}</td>",
            fiber.port,
            fiber.verdict()
        );
        for name in &names {
            let _ = write!(html, "<td>{}</td>", number(fiber.seconds_in(name), 2));
        }
        let o = fiber.offset_um;
        let _ = writeln!(
            html,
            "<td>{:.2}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
            fiber.seconds,
            number(o.map(|o| o.x), 3),
            number(o.map(|o| o.y), 3),
            number(o.map(|o| o.z), 2),
            number(fiber.coupling_loss_db, 2),
        );
    }
    html.push_str("</table></div>\n");
    html
}

/// One light sample of a fiber, as the pictures need it.
struct Seen {
    time: f64,
    phase: &'static str,
    /// The tip from the port by design, micrometres, as control believes.
    x: f64,
    y: f64,
    /// Along the approach, micrometres from where the run ended.
    z: f64,
    volts: f64,
}

fn seen(setup: &Setup, record: &Record, index: usize, port: &str) -> Vec<Seen> {
    let side = if index == 0 { Side::Left } else { Side::Right };
    let [px, py, pz] = if index == 0 {
        setup.recipe.ports.input
    } else {
        setup.recipe.ports.outputs[index - 1]
    };
    let channel = if index == 0 {
        Channel::Sensing
    } else {
        Channel::of_output(index - 1)
    };
    let outward = if index == 0 { -1.0 } else { 1.0 };
    let kinematics = Kinematics::new(&setup.spec, &setup.calibration, side);
    let look = |phase: &PhaseRecord, sample: &Sample| {
        let holder = sample.endpoints[side.index()];
        let tip = kinematics.chip_from_macro(holder.moved(sample.micro[side.index()]));
        Seen {
            time: sample.time,
            phase: phase.name,
            x: (tip.x - px) * 1e6,
            y: (tip.y - py) * 1e6,
            z: outward * (tip.z - pz) * 1e6,
            volts: sample.light[channel.index()],
        }
    };
    record
        .phases()
        .filter(|(phase, _)| phase.port == port)
        .flat_map(|(phase, samples)| samples.iter().map(move |sample| look(phase, sample)))
        .collect()
}

fn section(setup: &Setup, record: &Record, index: usize, fiber: &FiberRow) -> Result<String> {
    let mut html = format!("<h2>{}</h2>\n", fiber.port);
    debug_assert_eq!(fiber.port, PORTS[index]);
    let _ = writeln!(html, "<p>{}</p>", escape(&sentence(fiber)));
    let seen = seen(setup, record, index, fiber.port);
    let searching: Vec<&Seen> = seen
        .iter()
        .filter(|s| SEARCHING.contains(&s.phase))
        .collect();
    if seen.is_empty() {
        return Ok(html);
    }
    if let Some(last) = searching.last() {
        html.push_str("<div class=\"pair\">\n");
        let end = (last.x, last.y);
        html.push_str(&figure(
            &path(&searching, end, 20.0)?,
            "The search from first to last: where the tip was, as control believes (encoders and \
             commanded micro displacement, from the port's place by design), coloured by the light \
             (square root, from dark to bright). The cross is where it ended.",
        ));
        let close: Vec<&Seen> = searching
            .iter()
            .copied()
            .filter(|s| !BLIND.contains(&s.phase))
            .collect();
        if !close.is_empty() {
            html.push_str(&figure(
                &path(&close, end, 2.0)?,
                "The same from first light on: uphill, then along as the peak walks with the gap, \
                 then around the last centre.",
            ));
        }
        html.push_str("</div>\n");
    }
    html.push_str(&figure(
        &light(&seen)?,
        "Light of the photodiode that is followed, with the phases.",
    ));
    let approach: Vec<&Seen> = searching
        .iter()
        .copied()
        .filter(|s| s.phase == "approach")
        .collect();
    if approach.len() > 1 {
        html.push_str(&figure(
            &along_z(&approach, setup.recipe.approach.gap * 1e6)?,
            "The endpoint against z on approach: light leaves the angled facet at an angle, so the \
             peak walks across the chip as the gap closes, and the tip with it.",
        ));
    }
    Ok(html)
}

fn sentence(fiber: &FiberRow) -> String {
    match (fiber.offset_um, fiber.coupling_loss_db) {
        (Some(o), Some(loss)) => format!(
            "{}: {:+.3} um across, {:+.3} um up, {:+.2} um in z, {loss:.2} dB.",
            fiber.verdict(),
            o.x,
            o.y,
            o.z
        ),
        _ => format!("{}.", fiber.detail),
    }
}

fn path(seen: &[&Seen], end: (f64, f64), least: f64) -> Result<String> {
    let x = range_of(seen.iter().map(|s| s.x), least);
    let y = range_of(seen.iter().map(|s| s.y), least);
    // One scale on both axes: the figure's plot area is wider than high.
    let aspect = 460.0 / 358.0;
    let half = (0.5 * (y.end - y.start)).max(0.5 * (x.end - x.start) / aspect);
    let middle = |r: &std::ops::Range<f64>| 0.5 * (r.start + r.end);
    let axes = Axes {
        width: HALF,
        x: (
            middle(&x) - aspect * half..middle(&x) + aspect * half,
            "x from the port, um",
        ),
        y: (middle(&y) - half..middle(&y) + half, "y from the port, um"),
    };
    let (dark, bright) = seen
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(d, b), s| {
            (d.min(s.volts), b.max(s.volts))
        });
    let scale = 1.0 / (bright - dark).max(f64::MIN_POSITIVE);
    let every = seen.len().div_ceil(POINTS);
    let points: Vec<_> = seen
        .iter()
        .enumerate()
        .map(|(i, s)| (i, s.x, s.y, ((s.volts - dark) * scale).sqrt()))
        // Thinned where it is dark, never where there is light.
        .filter(|(i, .., light)| i % every == 0 || (*light > 0.4 && i % every.min(3) == 0))
        .map(|(_, x, y, light)| (x, y, light))
        .collect();
    coloured(&axes, &points, end)
}

fn light(seen: &[Seen]) -> Result<String> {
    let start = seen[0].time;
    let mut phases: Vec<(&str, f64, f64)> = Vec::new();
    for s in seen {
        let time = s.time - start;
        match phases.last_mut() {
            Some((name, _, end)) if *name == s.phase => *end = time,
            _ => phases.push((s.phase, time, time)),
        }
    }
    // Each phase reaches to the next one's start.
    for i in 1..phases.len() {
        phases[i - 1].2 = phases[i].1;
    }
    let curve: Vec<_> = seen.iter().map(|s| (s.time - start, s.volts)).collect();
    let brightest = curve.iter().fold(0.0, |b: f64, p| b.max(p.1));
    let end = curve.last().map_or(1.0, |p| p.0);
    let axes = Axes {
        width: WHOLE,
        x: (0.0..end, "time, s"),
        y: (0.0..1.15 * brightest.max(0.01), "light, V"),
    };
    over_time(&axes, &envelope(&curve, WHOLE as usize), &phases)
}

fn along_z(approach: &[&Seen], final_gap: f64) -> Result<String> {
    let end = approach.last().map_or(0.0, |s| s.z);
    let every = approach.len().div_ceil(1000);
    let against = |value: fn(&Seen) -> f64| -> Vec<(f64, f64)> {
        let first = value(approach[0]);
        approach
            .iter()
            .step_by(every)
            .map(|s| (s.z - end + final_gap, value(s) - first))
            .collect()
    };
    let (x, y) = (against(|s| s.x), against(|s| s.y));
    let gaps = range_of(x.iter().map(|p| p.0), 1.0);
    let axes = Axes {
        width: WHOLE,
        // The gap closes from left to right.
        x: (gaps.end..gaps.start, "gap as control believes, um"),
        y: (
            range_of(x.iter().chain(&y).map(|p| p.1), 1.0),
            "displacement, um",
        ),
    };
    curves(&axes, &[("x", x), ("y", y)])
}

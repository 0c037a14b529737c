//! The report of one alignment.

use super::figure::{Axes, HALF, WHOLE, coloured, curves, envelope, over_time, range_of};
use super::html::{configuration, figure, fixed, number, page, th, verdict};
use anyhow::Result;
use maud::{Markup, html};
use pigtail_control::kinematics::Kinematics;
use pigtail_control::procedure::PORTS;
use pigtail_control::station::Sample;
use pigtail_evaluate::align::{AlignmentDocument, FiberRow};
use pigtail_hal::{Channel, Side};
use pigtail_session::samples::{PhaseRecord, Record};
use pigtail_session::setup::Setup;

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
pub fn alignment(setup: &Setup, document: &AlignmentDocument, record: &Record) -> Result<String> {
    let title = format!(
        "{} on {}, seed {}",
        document.recipe, document.rig, document.seed
    );
    let body = html! {
        (summary(document))
        (table(document))
        p.soft {
            "Offsets are the truth, from the twin: x and y from the peak of the coupling at the fiber's \
             gap, z from the gap that was wanted. Control never sees them. All pictures show what control \
             saw: encoders, commanded micro displacement, photodiodes."
        }
        @for (index, fiber) in document.fibers.iter().enumerate() {
            (section(setup, record, index, fiber)?)
        }
        (configuration(&setup.rig.hashes, document.version))
    };
    Ok(page(&title, &body))
}

/// The report of an alignment on a bench that is controlled by position.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn bench_alignment(
    hashes: &[(String, String)],
    document: &AlignmentDocument,
    record: &Record,
) -> Result<String> {
    let title = format!(
        "{} on {}, seed {}",
        document.recipe, document.rig, document.seed
    );
    let light_of = |fiber: &FiberRow| -> Result<Markup> {
        let look = |phase: &PhaseRecord, sample: &Sample| Seen {
            time: sample.time,
            phase: phase.name,
            x: 0.0,
            y: 0.0,
            z: 0.0,
            // One meter is read at a time.
            volts: sample.light.iter().copied().fold(0.0, f64::max),
        };
        let phases = record
            .phases()
            .filter(|(phase, _)| phase.port == fiber.port);
        let seen: Vec<Seen> = phases
            .flat_map(|(phase, samples)| samples.iter().map(move |sample| look(phase, sample)))
            .collect();
        Ok(html! {
            h2 { (fiber.port) }
            p { (sentence(fiber)) }
            @if !seen.is_empty() {
                (figure(&light(&seen)?, "Light of the power meter, with the phases."))
            }
        })
    };
    let body = html! {
        (summary(document))
        (table(document))
        p.soft {
            "Offsets are the truth, from the twin: x and y from the peak of the coupling at the fiber's \
             gap, z from the gap that was wanted. Control never sees them."
        }
        @for fiber in &document.fibers { (light_of(fiber)?) }
        (configuration(hashes, document.version))
    };
    Ok(page(&title, &body))
}

fn summary(document: &AlignmentDocument) -> Markup {
    let aligned = document.fibers.iter().filter(|f| f.is_good()).count();
    let wrong = |f: &FiberRow| f.within_tolerance == Some(false);
    html! {
        p {
            span class=(verdict(document.is_success())) {
                (aligned) " of " (document.fibers.len()) " fibers aligned"
            }
            ", " (fixed(document.seconds_per_fiber, 2)) " s of machine time a fiber, by the "
            (document.procedure) " procedure."
            @if document.collision {
                " " span.bad { "A fiber hit the chip: nothing here counts." }
            }
            @if document.fibers.iter().any(wrong) {
                " " span.bad { "One that control believes aligned is not." }
            }
        }
    }
}

fn table(document: &AlignmentDocument) -> Markup {
    let names = document.phase_names();
    html! {
        div.scroll { table {
            tr {
                th { "fiber" }
                th { "outcome" }
                @for name in &names { (th(name, "s")) }
                (th("in all", "s")) (th("x", "um")) (th("y", "um")) (th("z", "um")) (th("loss", "dB"))
            }
            @for fiber in &document.fibers {
                @let offset = fiber.offset_um;
                tr {
                    td { (fiber.port) }
                    td class=(verdict(fiber.is_good())) { (fiber.verdict()) }
                    @for name in &names { td { (number(fiber.seconds_in(name), 2)) } }
                    td { (fixed(fiber.seconds, 2)) }
                    td { (number(offset.map(|o| o.x), 3)) }
                    td { (number(offset.map(|o| o.y), 3)) }
                    td { (number(offset.map(|o| o.z), 2)) }
                    td { (number(fiber.coupling_loss_db, 2)) }
                }
            }
        } }
    }
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
        setup.rig.recipe.ports.input
    } else {
        setup.rig.recipe.ports.outputs[index - 1]
    };
    let channel = if index == 0 {
        Channel::Sensing
    } else {
        Channel::of_output(index - 1)
    };
    let outward = if index == 0 { -1.0 } else { 1.0 };
    let kinematics = Kinematics::new(&setup.rig.spec, &setup.rig.calibration, side);
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

fn section(setup: &Setup, record: &Record, index: usize, fiber: &FiberRow) -> Result<Markup> {
    debug_assert_eq!(fiber.port, PORTS[index]);
    let seen = seen(setup, record, index, fiber.port);
    let searching: Vec<&Seen> = seen
        .iter()
        .filter(|s| SEARCHING.contains(&s.phase))
        .collect();
    let those = |of: &dyn Fn(&str) -> bool| -> Vec<&Seen> {
        searching.iter().copied().filter(|s| of(s.phase)).collect()
    };
    let close = those(&|phase| !BLIND.contains(&phase));
    let approach = those(&|phase| phase == "approach");
    Ok(html! {
        h2 { (fiber.port) }
        p { (sentence(fiber)) }
        @if let Some(last) = searching.last() {
            @let end = (last.x, last.y);
            div.pair {
                (figure(
                    &path(&searching, end, 20.0)?,
                    "The search from first to last: where the tip was, as control believes (encoders and \
                     commanded micro displacement, from the port's place by design), coloured by the light \
                     (square root, from dark to bright). The cross is where it ended."
                ))
                @if !close.is_empty() {
                    (figure(
                        &path(&close, end, 2.0)?,
                        "The same from first light on: uphill, then along as the peak walks with the gap, \
                         then around the last centre."
                    ))
                }
            }
        }
        @if !seen.is_empty() {
            (figure(&light(&seen)?, "Light of the photodiode that is followed, with the phases."))
        }
        @if approach.len() > 1 {
            (figure(
                &along_z(&approach, setup.rig.recipe.approach.gap * 1e6)?,
                "The endpoint against z on approach: light leaves the angled facet at an angle, so the \
                 peak walks across the chip as the gap closes, and the tip with it."
            ))
        }
    })
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

fn path(seen: &[&Seen], end: (f64, f64), least: f64) -> Result<Markup> {
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

fn light(seen: &[Seen]) -> Result<Markup> {
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

fn along_z(approach: &[&Seen], final_gap: f64) -> Result<Markup> {
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

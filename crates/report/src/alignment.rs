//! The report of one alignment.

use super::figure::{Axes, HALF, WHOLE, curves, envelope, range_of};
use super::html::{configuration, figure, fixed, number, page, prose, th, verdict};
use super::plot::Plot;
use super::text::swings;
use anyhow::Result;
use maud::{Markup, html};
use pigtail_control::kinematics::Kinematics;
use pigtail_control::station::Sample;
use pigtail_evaluate::align::{AlignmentDocument, FiberRow};
use pigtail_hal::{Channel, Side};
use pigtail_session::samples::{PhaseRecord, Record};
use pigtail_session::setup::Setup;
use std::borrow::Borrow;

/// Phases in which a fiber looks for light or follows it.
const SEARCHING: [&str; 6] = ["raster", "search", "climb", "centre", "approach", "final"];
/// Those of them in which nothing is followed yet.
const BLIND: [&str; 2] = ["raster", "search"];
/// Light that the brightest colour means at least, as a share of the photodiodes' range.
const LEAST_FULL: f64 = 0.01;
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
    let all: Vec<Vec<Seen>> = document
        .fibers
        .iter()
        .enumerate()
        .map(|(index, fiber)| seen(setup, record, index, fiber.port))
        .collect();
    // One meaning of colours for all fibers: where there is no light at all, noise stays dark.
    let full = all
        .iter()
        .flatten()
        .map(Seen::volts)
        .fold(LEAST_FULL * setup.rig.spec.photodiode.range, f64::max);
    let body = html! {
        (summary(document))
        (table(document))
        p.soft {
            "Offsets are the truth, from the twin: x and y from the peak of the coupling at the fiber's \
             gap, z from the gap that was wanted. Control never sees them. All pictures show what control \
             saw: encoders, commanded micro displacement, photodiodes."
        }
        @for (index, fiber) in document.fibers.iter().enumerate() {
            (section(setup, &all[index], full, &broken(document), fiber))
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
    let light_of = |fiber: &FiberRow| -> Markup {
        let look = |phase: &PhaseRecord, sample: &Sample| Seen {
            time: sample.time,
            phase: phase.name,
            x: 0.0,
            y: 0.0,
            z: 0.0,
            // One meter is read at a time.
            light: vec![sample.light.iter().copied().fold(0.0, f64::max)],
            followed: 0,
        };
        let phases = record
            .phases()
            .filter(|(phase, _)| phase.port == fiber.port);
        let seen: Vec<Seen> = phases
            .flat_map(|(phase, samples)| samples.iter().map(move |sample| look(phase, sample)))
            .collect();
        html! {
            h2 { (fiber.port) }
            p { (sentence(fiber)) }
            @if !seen.is_empty() {
                (figure(
                    &light(&seen, &["power meter"], &broken(document)),
                    format!("Light of the power meter, with the phases: {}.", phases_of(&seen))
                ))
            }
        }
    };
    let body = html! {
        (summary(document))
        (table(document))
        p.soft {
            "Offsets are the truth, from the twin: x and y from the peak of the coupling at the fiber's \
             gap, z from the gap that was wanted. Control never sees them."
        }
        @for fiber in &document.fibers { (light_of(fiber)) }
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
        @for said in swings(document) {
            p { (prose(&said)) }
        }
        @if let Some(arms) = &document.arms {
            p {
                "Of this time the left manipulator stands still for " (fixed(arms.idle_percent.left, 1)) " %, the right one for "
                (fixed(arms.idle_percent.right, 1)) " %; both move for " (fixed(arms.both_moving_percent, 1)) " %."
            }
        }
    }
}

fn table(document: &AlignmentDocument) -> Markup {
    let names = document.phase_names();
    html! {
        div.scroll { table.dense {
            tr {
                th { "fiber" }
                th.text { "outcome" }
                @for name in &names { (th(name, "s")) }
                (th("in all", "s")) (th("x", "um")) (th("y", "um")) (th("z", "um")) (th("loss", "dB"))
            }
            @for fiber in &document.fibers {
                @let offset = fiber.offset_um;
                tr {
                    td { (fiber.port) }
                    td.text.(verdict(fiber.is_good())) { (fiber.verdict()) }
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
    /// What the photodiodes saw, volts.
    light: Vec<f64>,
    /// Which of them is followed.
    followed: usize,
}

impl Seen {
    /// The light of the photodiode that is followed, volts.
    fn volts(&self) -> f64 {
        self.light[self.followed]
    }
}

/// Something that broke or stopped the machine: a name and when, seconds of machine time.
fn broken(document: &AlignmentDocument) -> Vec<(String, f64)> {
    let injected = document.injected.iter().filter_map(|text| {
        let (what, when) = text.rsplit_once('@')?;
        Some((
            format!("breaks: {what}"),
            when.strip_suffix('s')?.parse().ok()?,
        ))
    });
    let stopped = document.fault.iter().map(|fault| {
        let text = format!("stopped: {}, {}", fault.rule.code(), fault.axis);
        (text, fault.time)
    });
    injected.chain(stopped).collect()
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
            light: sample.light.to_vec(),
            followed: channel.index(),
        }
    };
    record
        .phases()
        .filter(|(phase, _)| phase.port == port)
        .flat_map(|(phase, samples)| samples.iter().map(move |sample| look(phase, sample)))
        .collect()
}

fn section(
    setup: &Setup,
    seen: &[Seen],
    full: f64,
    broken: &[(String, f64)],
    fiber: &FiberRow,
) -> Markup {
    let searching: Vec<&Seen> = seen
        .iter()
        .filter(|s| SEARCHING.contains(&s.phase))
        .collect();
    let those = |of: &dyn Fn(&str) -> bool| -> Vec<&Seen> {
        searching.iter().copied().filter(|s| of(s.phase)).collect()
    };
    let close = those(&|phase| !BLIND.contains(&phase));
    let approach = those(&|phase| phase == "approach");
    let diodes = Channel::ALL.map(Channel::name);
    html! {
        h2 { (fiber.port) }
        p { (sentence(fiber)) }
        @if let Some(last) = searching.last() {
            @let end = (last.x, last.y);
            div.pair {
                (figure(
                    &path(&searching, end, 20.0, full),
                    format!(
                        "The search from first to last ({}): where the tip was, as control believes (encoders and \
                         commanded micro displacement), coloured by the light of the photodiode {}. Places are from \
                         the port's place by design, not from the peak: the cross, where it ended, is at \
                         ({:.1}, {:.1}) um.",
                        phases_of(&searching), diodes[last.followed], end.0, end.1
                    )
                ))
                @if !close.is_empty() {
                    (figure(
                        &path(&close, end, 2.0, full),
                        format!("The same without the blind part: {}.", phases_of(&close))
                    ))
                }
            }
        }
        @if let Some(first) = seen.first() {
            (figure(
                &light(seen, &diodes, broken),
                format!(
                    "Light of the photodiodes, with the phases: {}. {} is the photodiode that is followed; the others see \
                     light that goes elsewhere.{}",
                    phases_of(seen),
                    diodes[first.followed],
                    if waited(seen) {
                        " The fiber was dim, and waited: where it is drawn straight, another one was brought, by whose light it went on."
                    } else {
                        ""
                    }
                )
            ))
        }
        @if closes(&approach) {
            (figure(
                &along_z(&approach, setup.rig.recipe.approach.gap * 1e6),
                "The endpoint against z on approach: light leaves the angled facet at an angle, so the \
                 peak walks across the chip as the gap closes, and the tip with it."
            ))
        }
    }
}

/// Micrometres that a gap closes by at least, so that a picture over it shows something.
const CLOSES: f64 = 2.0;

/// Whether the gap closed on approach: an axis that broke may have stood.
fn closes(approach: &[&Seen]) -> bool {
    let ends = range_of(approach.iter().map(|s| s.z), 0.0);
    ends.end - ends.start > CLOSES
}

/// Whether nothing was seen of a fiber for so long, between what was, that another one was at work.
fn waited(seen: &[Seen]) -> bool {
    const LONG: f64 = 0.3;
    let channel = seen.first().map(|s| s.followed);
    channel == Some(Channel::Sensing.index())
        && seen
            .windows(2)
            .any(|pair| pair[1].time - pair[0].time > LONG)
}

/// The phases in which this was seen, in order.
fn phases_of<S: Borrow<Seen>>(seen: &[S]) -> String {
    let mut names: Vec<&str> = Vec::new();
    for s in seen.iter().map(Borrow::borrow) {
        if !names.contains(&s.phase) {
            names.push(s.phase);
        }
    }
    names.join(", ")
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

fn path(seen: &[&Seen], end: (f64, f64), least: f64, full: f64) -> Markup {
    let axes = Axes {
        width: HALF,
        x: (
            range_of(seen.iter().map(|s| s.x), least),
            "x from the port, um",
        ),
        y: (
            range_of(seen.iter().map(|s| s.y), least),
            "y from the port, um",
        ),
    };
    let every = seen.len().div_ceil(POINTS);
    let points: Vec<_> = seen
        .iter()
        .enumerate()
        // Thinned where it is dark, never where there is light.
        .filter(|(i, s)| i % every == 0 || (s.volts() > 0.16 * full && i % every.min(3) == 0))
        .map(|(_, s)| (s.x, s.y, s.volts()))
        .collect();
    Plot::new(&axes)
        .equal()
        .colour(0.0, full, "light, V", true)
        .shaded_dots("tip", "", &points)
        .mark_point("where it ended", end)
        .draw()
}

fn light(seen: &[Seen], diodes: &[&str], broken: &[(String, f64)]) -> Markup {
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
    let brightest = seen
        .iter()
        .flat_map(|s| s.light.iter().copied())
        .fold(0.01, f64::max);
    let last = seen.last().map_or(1.0, |s| s.time - start);
    // What stopped the machine comes a moment after its last light.
    let those: Vec<_> = broken
        .iter()
        .map(|(what, when)| (what, when - start))
        .filter(|(_, when)| (0.0..=last + 1.0).contains(when))
        .collect();
    let end = those.iter().fold(last, |end, (_, when)| end.max(*when));
    let axes = Axes {
        width: WHOLE,
        x: (0.0..end, "time since the fiber's first phase, s"),
        y: (0.0..1.2 * brightest, "light, V"),
    };
    let mut plot = Plot::new(&axes);
    for (name, from, to) in &phases {
        plot = plot.band(name, *from, *to);
    }
    let followed = seen[0].followed;
    let order = std::iter::once(followed).chain((0..diodes.len()).filter(|k| *k != followed));
    for k in order {
        let curve: Vec<_> = seen.iter().map(|s| (s.time - start, s.light[k])).collect();
        let name = if k == followed && diodes.len() > 1 {
            format!("{} (followed)", diodes[k])
        } else {
            diodes[k].to_owned()
        };
        plot = plot.line(&name, &envelope(&curve, WHOLE as usize));
    }
    for (what, when) in those {
        plot = plot.mark_x(what, when, "limit");
    }
    plot.draw()
}

fn along_z(approach: &[&Seen], final_gap: f64) -> Markup {
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

//! The report of a tray: what each manipulator did, what limited it, and what became of every fiber.

use super::figure::{Axes, WHOLE};
use super::html::{figure, fixed, number, page, table};
use super::plot::Plot;
use anyhow::Result;
use maud::{Markup, html};
use pigtail_cycle::cell::Bar;
use pigtail_cycle::plan::{Plan, at_least, critical, idle_at_least, idle_by_cures, limits, work};
use pigtail_evaluate::produce::ProduceDocument;
use pigtail_hal::Side;

/// Kinds of bars, what they are called, and the class of their colour.
const KINDS: [(&str, &[&str], &str); 6] = [
    ("pick, retreat", &["pick", "retreat"], "c0"),
    ("adhesive", &["adhesive"], "c1"),
    ("align", &["align"], "c2"),
    ("cure", &["cure"], "c3"),
    ("holds still for the other", &["witness"], "c4"),
    (
        "release, verify, index",
        &["release", "verify", "index"],
        "c5",
    ),
];

/// What something is called: as in the legend, where that has words for it alone.
fn named(what: &str) -> String {
    let kind = KINDS.iter().find(|(_, whats, _)| *whats == [what]);
    kind.map_or(what, |(name, ..)| *name).to_owned()
}

/// A Gantt chart of bars within so many seconds, with the critical path.
fn gantt(bars: &[Bar], from: f64, to: f64) -> Markup {
    // From the top.
    let names = ["left", "right"];
    let on = critical(bars);
    let within = |bar: &Bar| bar.end > from && bar.start < to;
    let row = |bar: &Bar| f64::from(u8::from(bar.side == "left"));
    let axes = Axes {
        width: WHOLE,
        x: (from..to, "machine time, s"),
        y: (-0.6..1.6, ""),
    };
    let plot = Plot::new(&axes).rows(&names);
    let plot = KINDS.iter().fold(plot, |plot, (name, whats, class)| {
        let of = bars.iter().filter(|b| whats.contains(&b.what) && within(b));
        let boxes: Vec<_> = of
            .map(|b| {
                let y = row(b);
                [(b.start.max(from), y - 0.3), (b.end.min(to), y + 0.3)]
            })
            .collect();
        if boxes.is_empty() {
            return plot;
        }
        plot.boxes(name, class, &boxes)
    });
    let path: Vec<_> = bars
        .iter()
        .zip(&on)
        .filter(|(bar, on)| **on && within(bar))
        .map(|(b, _)| {
            let y = row(b);
            [(b.start.max(from), y + 0.32), (b.end.min(to), y + 0.40)]
        })
        .collect();
    plot.boxes("critical path", "ink", &path).draw()
}

/// A table of what is on the critical path.
fn critical_table(bars: &[Bar], seconds: f64) -> Markup {
    let rows: Vec<Vec<String>> = limits(bars)
        .into_iter()
        .map(|(what, s)| {
            vec![
                named(&what),
                fixed(s, 1),
                fixed(100.0 * s / seconds.max(1e-9), 1),
            ]
        })
        .collect();
    let header = ["on the critical path", "time\ns", "share\n%"];
    table(&header.map(str::to_owned), &rows)
}

/// What idle time cannot be below.
fn least(bars: &[Bar]) -> Markup {
    let [idle, apart, cures] =
        [idle_at_least, at_least, idle_by_cures].map(|of| Side::ALL.map(|side| of(bars, side)));
    let rows: Vec<Vec<String>> = work(bars)
        .into_iter()
        .map(|of| vec![named(&of.what), fixed(of.left, 1), fixed(of.right, 1)])
        .collect();
    let header = ["work", "left\ns", "right\ns"].map(str::to_owned);
    html! {
        p {
            "In whatever order these steps were done, each manipulator holding still for the other as here, it would be idle for at least: left "
            (fixed(idle[0], 1)) " %, right " (fixed(idle[1], 1)) " %. Without work of its own, idle or still, it is for at least: left "
            (fixed(apart[0], 1)) " %, right " (fixed(apart[1], 1)) " %. Were everything but the other's cures done in no time, still: left "
            (fixed(cures[0], 1)) " %, right " (fixed(cures[1], 1)) " %."
        }
        (table(&header, &rows))
    }
}

/// The Gantt chart of a plan as one HTML text; `says` is what it comes to.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn tray_plan(title: &str, says: &str, plan: &Plan) -> Result<String> {
    let (bars, seconds) = (&plan.bars, plan.seconds);
    let begins = |name: &str| {
        let of = bars.iter().filter(|b| b.device == name);
        of.map(|b| (b.start, b.end))
            .reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
    };
    let mut names: Vec<&str> = Vec::new();
    for bar in bars {
        if !names.contains(&bar.device.as_str()) {
            names.push(&bar.device);
        }
    }
    // The second is the first that has others before and behind it.
    let one = names.get(1).or(names.first());
    let one = one.and_then(|name| Some((*name, begins(name)?)));
    let body = html! {
        p { (says) "." }
        (least(bars))
        (figure(&gantt(bars, 0.0, seconds), "What each manipulator will do. The line above bars is the critical path: back from the end, what each step has to wait for."))
        @if let Some((name, (from, to))) = one {
            (figure(&gantt(bars, from, to), format!("Device {name} alone.")))
        }
        (critical_table(bars, seconds))
    };
    Ok(page(title, &body))
}

/// The report of a tray as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn produce(d: &ProduceDocument, bars: &[Bar]) -> Result<String> {
    let title = format!("Tray {}, seed {}", d.tray, d.seed);
    // The clock of the machine goes on from its start.
    let begin = bars.iter().map(|b| b.start).fold(f64::INFINITY, f64::min);
    let end = bars.iter().map(|b| b.end).fold(0.0, f64::max);
    let devices = d.produced.iter().filter(|t| t.produced.end > begin);
    let one = devices.clone().nth(1).or_else(|| devices.clone().next());
    let body = html! {
        p {
            (d.devices) " devices, " (d.fibers) " fibers; yield " (fixed(100.0 * d.passed, 1)) " %; "
            (fixed(d.devices_per_hour, 1)) " devices an hour. Loss after cure " (number(d.loss_db_after_cure.p50, 3))
            " dB (median), " (number(d.loss_db_after_cure.p99, 3)) " dB (99 %). Idle: left "
            (fixed(d.idle_percent.left, 1)) " %, right " (fixed(d.idle_percent.right, 1)) " %; under the lamp: left "
            (fixed(d.held_percent.left, 1)) " %, right " (fixed(d.held_percent.right, 1)) " %."
        }
        @if begin.is_finite() { (least(bars)) }
        @if let Some(fault) = &d.fault { p { "The machine has stopped: " (fault.to_string()) } }
        @if let Some(called) = &d.called { p { "A person is called: " (called) } }
        @if begin.is_finite() {
            h2 { "What each manipulator did" }
            (figure(&gantt(bars, begin, end), "All of the tray. The line above bars is the critical path: back from the end, what each step had to wait for."))
            @if let Some(one) = one {
                (figure(&gantt(bars, one.produced.start, one.produced.end), format!("Device {} alone.", one.produced.serial)))
            }
            (critical_table(bars, d.seconds))
        }
        h2 { "Devices and fibers" }
        (fibers(d))
    };
    Ok(page(&title, &body))
}

fn fibers(d: &ProduceDocument) -> Markup {
    let header = [
        "device",
        "port",
        "fiber",
        "from",
        "outcome",
        "time\ns",
        "pulled before gel\num",
        "off by light\num",
        "off in truth\num",
        "added by light\ndB",
        "added in truth\ndB",
        "loss\ndB",
    ];
    let mut rows = Vec::new();
    for told in &d.produced {
        for (fiber, truth) in told.produced.fibers.iter().zip(&told.truth) {
            let cured = fiber.cured;
            let long = |[x, y]: [f64; 2]| x.hypot(y);
            rows.push(vec![
                fiber.device.clone(),
                fiber.port.clone(),
                fiber.fiber.clone(),
                fiber.place.clone(),
                if fiber.passed {
                    "pigtailed".to_owned()
                } else {
                    fiber.cause.clone()
                },
                fixed(fiber.seconds, 1),
                number(cured.and_then(|c| c.before_um).map(long), 2),
                number(cured.map(|c| c.off_um), 2),
                number(truth.map(|t| t.offset_um[0].hypot(t.offset_um[1])), 2),
                number(cured.map(|c| c.after_release_db), 3),
                number(truth.map(|t| t.added_db), 3),
                number(truth.map(|t| t.loss_db), 3),
            ]);
        }
    }
    table(&header.map(str::to_owned), &rows)
}

//! The report of many trays: how much loss cure adds, what control says of it, and what became of each tray.

use super::campaign::percent;
use super::figure::{Axes, WHOLE, range_of};
use super::histogram::histogram;
use super::html::{figure, fixed, number, page, table};
use super::plot::Plot;
use anyhow::Result;
use maud::{Markup, html};
use pigtail_evaluate::trays::{TrayDone, TraysDocument};

/// The report of many trays as one HTML text; `accepted` is the most loss that cure may add, decibels.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn trays(d: &TraysDocument, all: &[TrayDone], accepted: f64) -> Result<String> {
    let title = format!(
        "{} trays of {}, fleet {}, seed {}",
        d.trays, d.tray, d.fleet, d.seed
    );
    let body = html! {
        p {
            (d.devices) " devices, " (d.fibers) " fibers; yield " (percent(d.passed)) "; "
            (fixed(d.devices_per_hour, 1)) " devices an hour. Idle: left " (fixed(d.idle_percent.left, 1)) " %, right "
            (fixed(d.idle_percent.right, 1)) " %; under the lamp: left " (fixed(d.held_percent.left, 1)) " %, right "
            (fixed(d.held_percent.right, 1)) " %. Machines refused when they were commissioned: " (d.trays_refused) "."
            @if d.interrupted { " It was stopped before all trays were done." }
        }
        (counts(d))
        (added(all, d, accepted)?)
        (told(all))
        h2 { "Trays" }
        (list(all))
    };
    Ok(page(&title, &body))
}

fn counts(d: &TraysDocument) -> Markup {
    let row = |what: &str, of: usize, count: usize, [low, high]: [f64; 2]| {
        vec![
            what.to_owned(),
            count.to_string(),
            of.to_string(),
            fixed(100.0 * low, 3),
            fixed(100.0 * high, 3),
        ]
    };
    let passed = d.devices - d.rejected.values().sum::<usize>();
    let mut rows = vec![
        row("devices passed", d.devices, passed, d.exact_95.passed),
        row(
            "fibers wrongly passed",
            d.fibers_passed,
            d.wrongly_passed,
            d.exact_95.wrongly_passed,
        ),
        row(
            "trays on which a chip was touched",
            d.trays,
            d.touched,
            d.exact_95.touched,
        ),
        row("trays on which holders met", d.trays, d.met, d.exact_95.met),
    ];
    for (cause, n) in &d.rejected {
        let cause = format!("devices rejected for {cause}");
        rows.push(vec![
            cause,
            n.to_string(),
            d.devices.to_string(),
            String::new(),
            String::new(),
        ]);
    }
    let header = [
        "what",
        "count",
        "of",
        "share at least\n%",
        "share at most\n%",
    ];
    html! {
        (table(&header.map(str::to_owned), &rows))
        p.soft {
            "In truth shares lie between the last two columns, with 95 % confidence (Clopper and Pearson, exact). Nothing came \
             nearer to a chip than " (number(d.smallest_gap_um, 2)) " um, nor one holder to the other than " (number(d.smallest_apart_mm, 2)) " mm."
        }
    }
}

/// Added loss in truth and by the light, and the standard deviation that is stated, of every fiber that was fixed.
fn fixed_fibers(all: &[TrayDone]) -> impl Iterator<Item = (f64, f64, f64)> {
    let devices = all
        .iter()
        .filter_map(|t| t.document.as_ref())
        .flat_map(|d| &d.produced);
    devices.flat_map(|told| {
        let fibers = told.produced.fibers.iter().zip(&told.truth);
        fibers.filter_map(|(fiber, truth)| {
            let (cured, truth) = (fiber.cured?, (*truth)?);
            Some((truth.added_db, cured.after_release_db, cured.sigma_db))
        })
    })
}

fn added(all: &[TrayDone], d: &TraysDocument, accepted: f64) -> Result<Markup> {
    let read = |tell: &mut dyn FnMut(usize, f64)| {
        fixed_fibers(all).for_each(|(truth, ..)| tell(0, truth));
        Ok(())
    };
    let p99 = d.added_loss_db.p99.unwrap_or(0.0);
    let marks = [("99 %", p99, false), ("accepted", accepted, true)];
    let drawn = histogram(
        WHOLE,
        &["fibers"],
        read,
        "loss that cure and release have added, dB (truth)",
        &marks,
    )?;
    Ok(drawn.map_or_else(Markup::default, |drawn| {
        figure(
            &drawn,
            "Every fiber that was fixed, from when the lamp was switched on.",
        )
    }))
}

fn told(all: &[TrayDone]) -> Markup {
    let points: Vec<(f64, f64)> = fixed_fibers(all)
        .map(|(truth, light, _)| (truth, light))
        .collect();
    if points.is_empty() {
        return Markup::default();
    }
    let both = || points.iter().flat_map(|(a, b)| [*a, *b]);
    let range = range_of(both(), 0.05);
    let axes = Axes {
        width: WHOLE,
        x: (range.clone(), "added in truth, dB"),
        y: (range.clone(), "added by the light, dB"),
    };
    let line = [(range.start, range.start), (range.end, range.end)];
    // A dot of a few must be seen, and those of thousands must not hide each other.
    let class = match points.len() {
        ..100 => "large",
        100..1000 => "",
        _ => "small mixed",
    };
    let plot = Plot::new(&axes)
        .dots("fibers", class, &points)
        .line("equal", &line);
    figure(
        &plot.draw(),
        "What control says that was added, beside the truth.",
    )
}

fn list(all: &[TrayDone]) -> Markup {
    let header = [
        "seed",
        "devices",
        "passed",
        "rejected for",
        "added, 99 %\ndB",
        "least gap\num",
        "idle left\n%",
        "idle right\n%",
        "time\ns",
    ];
    let rows: Vec<Vec<String>> = all
        .iter()
        .map(|tray| {
            let Some(d) = &tray.document else {
                let mut row = vec![tray.seed.to_string(), "0".to_owned(), String::new()];
                row.push(format!(
                    "machine refused: {}",
                    tray.refused.as_deref().unwrap_or_default()
                ));
                row.resize(header.len(), String::new());
                return row;
            };
            let rejected: Vec<String> = d
                .rejected
                .iter()
                .map(|(cause, n)| format!("{cause} ({n})"))
                .collect();
            vec![
                tray.seed.to_string(),
                d.devices.to_string(),
                (d.devices - d.rejected.values().sum::<usize>()).to_string(),
                rejected.join(", "),
                number(d.added_loss_db.p99, 3),
                fixed(d.smallest_gap_um, 2),
                fixed(d.idle_percent.left, 1),
                fixed(d.idle_percent.right, 1),
                fixed(d.seconds, 1),
            ]
        })
        .collect();
    table(&header.map(str::to_owned), &rows)
}

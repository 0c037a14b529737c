//! The report of a benchmark: a row an algorithm.

use super::campaign::percent;
use super::figure::{Axes, WHOLE, decades_of};
use super::html::{self, figure, fixed, number, page};
use super::plot::Plot;
use anyhow::Result;
use maud::{Markup, html};
use pigtail_evaluate::benchmark::{BenchmarkDocument, Measured};

/// The header, units below names, and a row an algorithm.
pub fn table(document: &BenchmarkDocument) -> Vec<Vec<String>> {
    let header = [
        "algorithm",
        "right",
        "wrong",
        "touched",
        "fault",
        "lost",
        "a right\nfiber, s",
        "p50\ns",
        "p99\ns",
        "readings",
        "p50 xy\num",
        "p99 xy\num",
        "p99 z\num",
    ];
    let mut rows = vec![header.map(str::to_owned).to_vec()];
    rows.extend(document.algorithms.iter().map(|row| {
        vec![
            row.name.to_owned(),
            row.right.to_string(),
            row.wrong.to_string(),
            row.touched.to_string(),
            row.faults.to_string(),
            row.lost.to_string(),
            number(row.seconds_per_right_fiber, 2),
            number(row.seconds_per_fiber.p50, 2),
            number(row.seconds_per_fiber.p99, 2),
            number(row.readings_per_right_fiber, 0),
            number(row.offset_xy_um.p50, 3),
            number(row.offset_xy_um.p99, 3),
            number(row.offset_z_um.p99, 2),
        ]
    }));
    rows
}

/// The report as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn benchmark(measured: &Measured) -> Result<String> {
    let document = &measured.document;
    let title = format!(
        "{} algorithms, {} devices from seed {}, {}",
        document.algorithms.len(),
        document.devices,
        document.seed,
        document.scenario
    );
    let names: Vec<&str> = document.algorithms.iter().map(|row| row.name).collect();
    let body = html! {
        @if let Some((header, rows)) = table(document).split_first() { (html::table(header, rows)) }
        p.soft {
            "Right: said to be aligned, and by the twin's truth within " (document.tolerance_xy_um)
            " um in x and y and " (document.tolerance_z_um) " um in z. Wrong: said to be, and is not. \
             Touched: something hit the chip. Fault: the guard or the machine stopped it. Lost: all others. \
             Seconds a right fiber and readings: all that was spent, over the right fibers."
        }
        h2 { "What came of the fibers" }
        (figure(
            &shares(document),
            "Share of the fibers of each algorithm: right, lost, then wrong, touched and fault together."
        ))
        h2 { "Seconds" }
        (figure(
            &boxes(
                &names,
                &measured.seconds,
                "machine time of a device over its three fibers, s",
                None
            ),
            "Each device is a dot. The box holds the middle half, its line is the median; whiskers end at \
             1 % and 99 %."
        ))
        h2 { "Offsets" }
        (figure(
            &boxes(
                &names,
                &measured.offsets,
                "offset across, the greater of x and y, um",
                Some(document.tolerance_xy_um)
            ),
            "The truth about each attached fiber, whatever was said of it. The red line is the tolerance."
        ))
        (entries(document))
        (replays(document))
    };
    Ok(page(&title, &body))
}

fn entries(document: &BenchmarkDocument) -> Markup {
    let between = |[low, high]: [f64; 2]| format!("{} to {}", percent(low), percent(high));
    html! {
        h2 { "Entries" }
        div.scroll { table {
            tr {
                th { "algorithm" } th.text { "what it does" } th { "right, 95 %" } th { "wrong, 95 %" }
                th { "left stands still" } th { "right stands still" } th { "both move" }
            }
            @for row in &document.algorithms {
                tr {
                    td { (row.name) }
                    td.text.long { (row.about) }
                    td { (between(row.right_confidence)) }
                    td { (between(row.wrong_confidence)) }
                    @if let Some(arms) = &row.arms {
                        td { (fixed(arms.idle_percent.left, 1)) " %" }
                        td { (fixed(arms.idle_percent.right, 1)) " %" }
                        td { (fixed(arms.both_moving_percent, 1)) " %" }
                    } @else { td {} td {} td {} }
                }
            }
        } }
        p.soft {
            "Shares of the time of all devices. A manipulator stands still that has nothing to do, waits for the other one, or holds what the \
             other one needs."
        }
    }
}

/// How to see again what was not right.
fn replays(document: &BenchmarkDocument) -> Markup {
    let causes = || {
        let rows = document.algorithms.iter();
        rows.flat_map(|row| {
            row.replay
                .iter()
                .map(move |(cause, seeds)| (row, cause, seeds))
        })
        .filter_map(|(row, cause, seeds)| Some((row.name, cause, seeds.first()?, seeds)))
    };
    if causes().next().is_none() {
        return Markup::default();
    }
    html! {
        h2 { "Not right" }
        div.scroll { table {
            tr { th { "algorithm" } th.text { "counted as" } th.text { "seeds, the first" } th.text { "replay" } }
            @for (name, cause, first, seeds) in causes() {
                @let shown: Vec<String> = seeds.iter().take(8).map(u64::to_string).collect();
                tr {
                    td { (name) }
                    td.text { (cause) }
                    td.text { (shown.join(", ")) }
                    td.text { code {
                        "pigtail benchmark --algorithm " (name) " --scenario " (document.scenario)
                        " --devices 1 --seed " (first) " --json"
                    } }
                }
            }
        } }
    }
}

/// Where the row of an algorithm is, from 0 (bottom) up.
fn level(k: usize, rows: usize) -> f64 {
    (rows - 1 - k) as f64
}

/// Shares of the fibers as bars that add up to all of them.
fn shares(document: &BenchmarkDocument) -> Markup {
    let names: Vec<&str> = document.algorithms.iter().map(|row| row.name).collect();
    let rows = names.len();
    let axes = Axes {
        width: WHOLE,
        x: (0.0..100.0, "fibers, %"),
        y: (-0.6..rows as f64 - 0.4, ""),
    };
    let mut kinds = [
        ("right", "right", Vec::new()),
        ("lost", "lost", Vec::new()),
        ("wrong, touched or fault", "limit", Vec::new()),
    ];
    for (k, row) in document.algorithms.iter().enumerate() {
        let y = level(k, rows);
        let mut from = 0.0;
        let counts = [row.right, row.lost, row.wrong + row.touched + row.faults];
        for (count, (.., boxes)) in counts.into_iter().zip(&mut kinds) {
            let to = from + 100.0 * count as f64 / document.fibers.max(1) as f64;
            if count > 0 {
                boxes.push([(from, y - 0.3), (to, y + 0.3)]);
            }
            from = to;
        }
    }
    let plot = Plot::new(&axes).rows(&names);
    let add =
        |plot: Plot, (name, class, boxes): &(&str, &str, Vec<_>)| plot.boxes(name, class, boxes);
    kinds.iter().fold(plot, add).draw()
}

/// A box an algorithm, and its values as dots, on a logarithmic axis.
fn boxes(names: &[&str], values: &[Vec<f64>], x: &str, limit: Option<f64>) -> Markup {
    // What is exactly nothing has no logarithm.
    let shown = |value: f64| value.max(1e-4);
    let all = values.iter().flatten().copied().chain(limit).map(shown);
    let rows = names.len();
    let axes = Axes {
        width: WHOLE,
        x: (decades_of(all), x),
        y: (-0.6..rows as f64 - 0.4, ""),
    };
    let (mut dots, mut whiskers, mut medians, mut middles) = (vec![], vec![], vec![], vec![]);
    let gap = (f64::NAN, f64::NAN);
    for (k, values) in values.iter().enumerate() {
        let y = level(k, rows);
        // Dots are spread by their order, which is by value: a pattern, but no two in one place.
        dots.extend(values.iter().enumerate().map(|(i, value)| {
            let aside = 0.28 * (((i * 7) % 13) as f64 / 6.0 - 1.0);
            (shown(*value), y + aside)
        }));
        let sorted = pigtail_numerics::statistics::Sorted::new(values.clone());
        let at = |share| sorted.percentile(share).map(shown);
        let (Some(q1), Some(median), Some(q3), Some(p1), Some(p99)) =
            (at(0.25), at(0.5), at(0.75), at(0.01), at(0.99))
        else {
            continue;
        };
        whiskers.extend([(p1, y), (q1, y), gap, (q3, y), (p99, y), gap]);
        medians.extend([(median, y - 0.3), (median, y + 0.3), gap]);
        middles.push([(q1, y - 0.3), (q3, y + 0.3)]);
    }
    let plot = Plot::new(&axes)
        .log_x()
        .rows(names)
        .dots("each value", "small mixed", &dots)
        .line_as("1 % to 99 %", "ink thin", &whiskers)
        .boxes("middle half", "ink open", &middles)
        .line_as("median", "ink bold", &medians);
    match limit {
        Some(limit) => plot.mark_x("tolerance", limit, "limit").draw(),
        None => plot.draw(),
    }
}

//! The report of a micro manipulator's identified piezos.

use super::figure::{Axes, HALF, WHOLE, curves, decades_of, envelope, range_of};
use super::html::{figure, fixed, page, th};
use super::hysteresis::{Curve, plot};
use super::plot::Plot;
use anyhow::Result;
use maud::{Markup, html};
use pigtail_control::compensation::hysteresis::{FORWARD, Model, Network, Rbf, Spectrum, UNITS};
use pigtail_evaluate::hysteresis::Identified;

/// The report of identified micros as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn micros(found: &[Identified]) -> Result<String> {
    let seed = found.first().map_or(0, |found| found.document.seed);
    let title = format!("Hysteresis of the piezos, seed {seed}");
    let body = html! {
        @for found in found { (micro(found)) }
    };
    Ok(page(&title, &body))
}

/// What was found of one micro.
fn micro(found: &Identified) -> Markup {
    let d = &found.document;
    html! {
        h1 { "The " (d.side) " micro" }
        p {
            "Forward and back over " (fixed(d.range_um, 0)) " um the ways part by "
            (fixed(d.uncompensated_opening_percent, 2)) " % of the range without compensation and by "
            (fixed(d.opening_percent, 2)) " % with the model " b { (d.model) } " of " (d.functions)
            " functions. The scale errs by " (signed(d.uncompensated_gain_error_percent))
            " % without and by " (signed(d.gain_error_percent)) " % with it. Errors are by the truth, and \
             those that the best straight line leaves."
        }
        div.scroll { table {
            tr {
                th { "path" }
                (th("none", "um rms")) (th("rbf", "um rms")) (th("times", "better"))
                (th("memory", "um rms")) (th("times", "better"))
            }
            @for p in &d.paths {
                tr {
                    td { (p.name) }
                    td { (fixed(p.uncompensated_um, 3)) }
                    td { (fixed(p.rbf_um, 3)) }
                    td { (fixed(p.rbf_improvement, 1)) }
                    td { (fixed(p.memory_um, 3)) }
                    td { (fixed(p.memory_improvement, 1)) }
                }
            }
        } }
        (light_and_curves(found))
        (networks(found))
        (compensated(found))
    }
}

fn signed(value: f64) -> String {
    format!("{value:+.2}")
}

/// Figs. 4.3, 4.4 and 4.6.
fn light_and_curves(found: &Identified) -> Markup {
    let piezo = &found.micro.piezos[0];
    let series = &piezo.series;
    // The first whole cycle: down to the bottom, forward, and back.
    let swings: Vec<_> = piezo.record.swings().collect();
    let light = |time: (f64, f64)| -> Vec<(f64, f64)> {
        let from = series.time.partition_point(|t| *t < time.0);
        let to = series.time.partition_point(|t| *t < time.1);
        let all: Vec<_> = (from..to)
            .map(|k| (series.volts[k][0], series.light[k]))
            .collect();
        envelope(&all, 500)
    };
    let begin = series.time.first().copied().unwrap_or(0.0);
    let ways: Vec<_> = swings
        .iter()
        .filter(|s| piezo.record.time[s.start] >= begin)
        .skip_while(|s| !s.rising)
        .skip(1)
        .collect();
    let first = ways.iter().position(|s| s.rising).map(|up| {
        let time = |k: usize| piezo.record.time[k];
        let (f, b) = (ways[up], ways[up + 1]);
        [
            ("forward", light((time(f.start), time(f.end)))),
            ("back", light((time(b.start), time(b.end)))),
        ]
    });
    let r = &piezo.ways;
    let loops: Vec<(f64, f64)> = (0..r.len())
        .filter(|k| r.weight[*k] > 0.0)
        .map(|k| (r.input[k], 1e6 * r.output[k]))
        .collect();
    html! {
        h2 { "What was measured" }
        @if let Some(pair) = first {
            (figure(
                &plot(WHOLE, "voltage, V", "light, V", &pair),
                "Light against the voltage of the first piezo, forward and back (thesis, Fig. 4.3)."
            ))
        }
        div.pair {
            (figure(
                &plot(HALF, "voltage, V", "displacement, um", &[("measured", loops)]),
                "Displacement against voltage: full ways, and the ways back from turning voltages across \
                 the range (Fig. 4.4)."
            ))
            @if let Model::Rbf(rbf) = &piezo.rbf {
                @if let Some(spectrum) = Spectrum::of(&piezo.ways, &rbf.input, &rbf.output) {
                    (power(&spectrum, rbf))
                }
            }
        }
    }
}

fn power(spectrum: &Spectrum, rbf: &Rbf) -> Markup {
    let curve: Vec<(f64, f64)> = spectrum
        .power
        .iter()
        .take_while(|p| p.0 <= 2.5)
        .copied()
        .collect();
    let axes = Axes {
        width: HALF,
        x: (range_of(curve.iter().map(|p| p.0), 1e-6), "frequency, 1/V"),
        y: (decades_of(curve.iter().map(|p| p.1.max(1e-12))), "power"),
    };
    figure(
        &Plot::new(&axes).log_y().line("", &curve).draw(),
        format!(
            "Power of the displacement over a way to the middle and back, against frequency along the \
             voltage (Fig. 4.6). Beyond {:.2} a volt less than half a percent of the range is left: \
             functions are 1/(2f) = {:.2} V apart, {} of them.",
            spectrum.highest(),
            spectrum.spacing(),
            rbf.forward.functions()
        ),
    )
}

/// Figs. 4.7 to 4.9.
fn networks(found: &Identified) -> Markup {
    let piezo = &found.micro.piezos[0];
    let Model::Rbf(rbf) = &piezo.rbf else {
        return Markup::default();
    };
    let samples = Rbf::samples(&piezo.ways, &rbf.input, &rbf.output);
    let every = samples.len().div_ceil(1500);
    let points: Vec<(f64, f64)> = samples
        .iter()
        .step_by(every)
        .map(|[turn, v, _]| (*turn, *v))
        .collect();
    let centres: Vec<_> = rbf.forward.parts().0.iter().map(|c| (c[0], c[1])).collect();
    let axes = Axes {
        width: WHOLE,
        x: (FORWARD - 1.0..UNITS + 1.0, "turning point v1, V"),
        y: (-0.5..UNITS + 0.5, "voltage vx, V"),
    };
    html! {
        h2 { "The networks of the first piezo" }
        (figure(
            &Plot::new(&axes).dots("training data", "small mixed", &points).dots("centres", "", &centres).draw(),
            format!(
                "Centres and training data (Fig. 4.7): the way forward at v1 = {FORWARD}, \
                 ways back below their turning points. Width {:.2} forward and {:.2} inverse, tuned from \
                 {:.2} by (4.6).",
                rbf.forward.width(),
                rbf.inverse.width(),
                Network::rule(rbf.forward.spacing())
            )
        ))
        div.pair {
            (figure(
                &ways(&rbf.forward, "voltage vx, V", "x, units"),
                "x = f(v1, vx) (Fig. 4.8): along the way forward and the ways back from 10 and from 5 V."
            ))
            (figure(
                &ways(&rbf.inverse, "x, units", "voltage vx, V"),
                "vx = g(v1, x) (Fig. 4.9): the same for the inverse."
            ))
        }
    }
}

/// What a network makes of the way forward and of ways back.
fn ways(network: &Network, x: &str, y: &str) -> Markup {
    let curve = |turn: f64, to: f64| -> Vec<(f64, f64)> {
        (0..=100)
            .map(|k| to * f64::from(k) / 100.0)
            .map(|at| (at, network.value([turn, at])))
            .collect()
    };
    let series: [Curve; 3] = [
        ("forward", curve(FORWARD, UNITS)),
        ("back from 10 V", curve(10.0, UNITS)),
        ("back from 5 V", curve(5.0, 5.0)),
    ];
    let all = || series.iter().flat_map(|(_, points)| points.iter());
    let axes = Axes {
        width: HALF,
        x: (range_of(all().map(|p| p.0), 0.1), x),
        y: (range_of(all().map(|p| p.1), 0.1), y),
    };
    curves(&axes, &series)
}

/// Fig. 4.10, and the same without.
fn compensated(found: &Identified) -> Markup {
    let errors = |i: usize| -> Vec<(f64, f64)> {
        let scan = &found.scans[i];
        let (errors, _) = scan.errors(found.from, 1);
        let wanted = &scan.wanted[found.from..];
        let every = errors.len().div_ceil(2000);
        (0..errors.len())
            .step_by(every)
            .map(|k| (1e6 * wanted[k], 1e6 * errors[k]))
            .collect()
    };
    let (x, y) = ("wanted displacement, um", "error, um");
    let all = [
        ("none", errors(0)),
        ("rbf", errors(1)),
        ("memory", errors(2)),
    ];
    let models = || all[1..].iter().flat_map(|(_, points)| points);
    let axes = Axes {
        width: HALF,
        x: (range_of(models().map(|p| p.0), 1e-6), x),
        y: (range_of(models().map(|p| p.1), 1e-6), y),
    };
    html! {
        h2 { "With and without compensation" }
        div.pair {
            (figure(
                &plot(HALF, x, y, &all),
                "Error over forward and back scans, by the truth (Fig. 4.10)."
            ))
            (figure(
                // A model keeps its colour.
                &Plot::new(&axes).line_as(all[1].0, "c1", &all[1].1).line_as(all[2].0, "c2", &all[2].1).draw(),
                "The same, of the models alone."
            ))
        }
    }
}

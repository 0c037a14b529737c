//! Figs. 4.3 to 4.10: the piezos' hysteresis and the networks that undo it.

use super::super::picture::{Content, Picture, Points, thin};
use super::super::{Bench, Figure};
use pigtail_control::compensation::hysteresis::{
    FORWARD, Model, Network, Rbf, Record, Sample, Spectrum, UNITS,
};
use pigtail_control::piezo;
use pigtail_evaluate::hysteresis::{Followed, Identified, identify_and_scan};
use pigtail_hal::Side;
use pigtail_records::hysteresis::Kind;
use pigtail_session::job::Ended;
use rayon::prelude::*;

pub(super) fn piezos(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    // The greatest difference that is left depends on the light's noise.
    let times: u64 = bench.count(4, 2);
    let all = (0..times)
        .into_par_iter()
        .map(|k| {
            let seed = bench.seed.wrapping_add(k);
            identify_and_scan(&bench.machine, Kind::Rbf, Side::Right, seed)
        })
        .collect::<Result<Vec<_>, Ended>>()?;
    let found = &all[0];
    let first = &found.micro.piezos[0];
    let mut figures = vec![
        figure_4_3(found),
        figure_4_4(&first.record),
        figure_4_5(&first.record),
    ];
    if let Model::Rbf(rbf) = &first.rbf {
        figures.push(figure_4_6(rbf, &first.ways));
        figures.extend(networks(first, rbf));
    }
    figures.push(figure_4_10(&all));
    Ok(figures)
}

/// A way forward and the way back from it whose turn lies nearest to a voltage, and which begin and
/// end at the bottom: the sample at which it begins, turns, and ends.
fn turned_at(record: &Record, volts: f64) -> Option<(usize, usize, usize)> {
    let range = record.input_range();
    let swings: Vec<_> = record.swings().collect();
    let bottom = |v: f64| v < range.low + 0.05 * range.width();
    let v = &record.input;
    swings
        .windows(2)
        .filter(|pair| pair[0].rising)
        .map(|pair| (pair[0].start, pair[1].start, pair[1].end - 1))
        .filter(|(start, _, end)| bottom(v[*start]) && bottom(v[*end]))
        .min_by(|a, b| (v[a.1] - volts).abs().total_cmp(&(v[b.1] - volts).abs()))
}

fn figure_4_3(found: &Identified) -> Figure {
    let d = &found.document;
    let first = &found.micro.piezos[0];
    let series = &first.series;
    let record = &first.record;
    let light = |from: usize, to: usize| -> Points {
        let from = series.time.partition_point(|t| *t < record.time[from]);
        let to = series.time.partition_point(|t| *t < record.time[to]);
        thin((from..to).map(|k| (series.volts[k][0], series.light[k])))
    };
    let mut figure = Figure::new("4.3", "Uncontrolled actuator response");
    if let Some((start, turn, end)) = turned_at(record, record.input_range().high) {
        figure = figure.picture(
            Picture::curves(
                "vx, V",
                "light, V",
                [
                    ("forward", light(start, turn)),
                    ("backward", light(turn, end)),
                ],
            )
            .x(0.0, 10.0)
            .caption("Light in the sensing fiber on the flank of the beam, forward and back."),
        );
    }
    figure.noted(
        "4.3-opening",
        d.uncompensated_opening_percent,
        "By the truth about the tip; the light agrees through (4.1).",
    )
}

fn figure_4_4(record: &Record) -> Figure {
    let width = record.output_range().width();
    let back = |turn: f64| -> Points {
        turned_at(record, turn).map_or_else(Vec::new, |(_, turn, end)| {
            (turn..end)
                .map(|k| (record.input[k], record.output[k]))
                .collect()
        })
    };
    // Greatest difference at one voltage between the way back from the top and that from half way.
    let (high, middle) = (back(10.0), back(5.0));
    let difference = middle
        .iter()
        .filter_map(|(v, x)| {
            let near = high
                .iter()
                .min_by(|a, b| (a.0 - v).abs().total_cmp(&(b.0 - v).abs()))?;
            Some((near.1 - x).abs())
        })
        .fold(0.0, f64::max);
    let um = |points: Points| thin(points.into_iter().map(|(v, x)| (v, 1e6 * x)));
    let forward = turned_at(record, 10.0).map_or_else(Vec::new, |(start, turn, _)| {
        (start..turn)
            .map(|k| (record.input[k], record.output[k]))
            .collect()
    });
    Figure::new("4.4", "Hysteresis curves")
        .picture(
            Picture::curves(
                "vx, V",
                "x, um",
                [
                    ("A to B", um(forward)),
                    ("back from 10 V", um(high)),
                    ("back from 7 V", um(back(7.0))),
                    ("back from 5 V", um(middle)),
                ],
            )
            .x(0.0, 10.0)
            .caption("Forward, and back from three turning points."),
        )
        .result("4.4-turns", difference / width)
}

fn figure_4_5(record: &Record) -> Figure {
    let until = record.time[0] + 40.0;
    let points = thin(
        record
            .time
            .iter()
            .zip(&record.input)
            .take_while(|(t, _)| **t < until)
            .map(|(t, v)| (t - record.time[0], *v)),
    );
    Figure::new("4.5", "Actuator input versus time").picture(
        Picture::curves("time, s", "vx, V", [("", points)])
            .caption("The voltage while the piezo was identified, with its turning points."),
    )
}

fn figure_4_6(rbf: &Rbf, ways: &Record) -> Figure {
    let figure = Figure::new("4.6", "Power spectral density of x for v1 = 5");
    let Some(spectrum) = Spectrum::of(ways, &rbf.input, &rbf.output) else {
        return figure;
    };
    let first = spectrum
        .power
        .iter()
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .map_or(f64::NAN, |p| p.0);
    let logs: Points = spectrum
        .power
        .iter()
        .take_while(|p| p.0 <= 2.5)
        .map(|(f, power)| (*f, power.max(1e-12)))
        .collect();
    figure
        .picture(
            Picture::curves("frequency, 1/V", "power", [("", logs)])
                .x(0.0, 2.5)
                .log_y()
                .caption(
                    "Over the way forward to 5 V and back, against frequency along the voltage.",
                ),
        )
        .result("4.6-first", first)
        .noted(
            "4.6-highest",
            spectrum.highest(),
            format!(
                "It sets the networks' functions {:.2} V apart.",
                spectrum.spacing()
            ),
        )
}

/// Figs. 4.7 to 4.9.
fn networks(first: &piezo::Identified, rbf: &Rbf) -> Vec<Figure> {
    let samples = Rbf::samples(&first.ways, &rbf.input, &rbf.output);
    let forward: Vec<Sample> = samples.iter().map(|[t, v, x]| ([*t, *v], *x)).collect();
    let inverse: Vec<Sample> = samples.iter().map(|[t, v, x]| ([*t, *x], *v)).collect();
    let every = samples.len().div_ceil(1200).max(1);
    let mut dots: Vec<(f64, f64, f64)> = samples
        .iter()
        .step_by(every)
        .map(|[turn, v, _]| (*turn, *v, 0.35))
        .collect();
    dots.extend(rbf.forward.parts().0.iter().map(|c| (c[0], c[1], 1.0)));
    let curves = |network: &Network| {
        [(FORWARD, UNITS), (10.0, 10.0), (7.0, 7.0), (5.0, 5.0)].map(|(turn, to)| {
            let points: Points = (0..=80)
                .map(|k| to * f64::from(k) / 80.0)
                .map(|at| (at, network.value([turn, at])))
                .collect();
            let name = if turn < 0.0 {
                "forward (v1 = -5)".to_owned()
            } else {
                format!("v1 = {turn}")
            };
            (name, points)
        })
    };
    let count = rbf.forward.functions();
    let note = |network: &Network| {
        format!(
            "{count} functions {:.2} V apart, width {:.2} tuned from {:.2} by (4.6).",
            network.spacing(),
            network.width(),
            Network::rule(network.spacing())
        )
    };
    vec![
        Figure::new("4.7", "Center points and training data distribution").picture(
            Picture::of("turning point v1, V", "vx, V", Content::Dots(dots))
                .colour("1: centre")
                .x(-6.0, 11.0)
                .y(-0.5, 10.5)
                .caption("Centres bright, training data dark; the way forward stands at v1 = -5."),
        ),
        Figure::new("4.8", "x = f(v1, vx)")
            .picture(
                Picture::curves("vx, V", "x, units", curves(&rbf.forward))
                    .x(0.0, 10.0)
                    .caption("The forward network along the way forward and three ways back."),
            )
            .noted(
                "4.8-forward",
                rbf.forward.error(&forward) / UNITS,
                note(&rbf.forward),
            ),
        Figure::new("4.9", "vx = g(v1, x)")
            .picture(
                Picture::curves("x, units", "vx, V", curves(&rbf.inverse))
                    .x(0.0, 10.0)
                    .caption("The inverse network along the same."),
            )
            .noted(
                "4.9-inverse",
                rbf.inverse.error(&inverse) / UNITS,
                note(&rbf.inverse),
            ),
    ]
}

fn figure_4_10(all: &[Identified]) -> Figure {
    let found = &all[0];
    let d = &found.document;
    let mean = |of: fn(&Identified) -> f64| all.iter().map(of).sum::<f64>() / all.len() as f64;
    let without = mean(|found| found.document.uncompensated_opening_percent);
    let with = mean(|found| found.document.opening_percent);
    let least = all
        .iter()
        .map(|found| found.document.uncompensated_opening_percent / found.document.opening_percent)
        .fold(f64::INFINITY, f64::min);
    let path = |f: &Followed| -> Points {
        thin((found.from..f.wanted.len()).map(|k| (1e6 * f.wanted[k], 1e6 * f.was[k])))
    };
    let error = |f: &Followed| -> Points {
        let (errors, _) = f.errors(found.from, 1);
        thin(
            errors
                .iter()
                .enumerate()
                .map(|(k, e)| (1e6 * f.wanted[found.from + k], 1e6 * e)),
        )
    };
    Figure::new("4.10", "Actuator response with neural network control")
        .picture(
            Picture::curves(
                "desired x, um",
                "x, um",
                [
                    ("without", path(&found.scans[0])),
                    ("with the network", path(&found.scans[1])),
                ],
            )
            .caption("Forward and back."),
        )
        .picture(
            Picture::curves(
                "desired x, um",
                "error, um",
                [
                    ("without", error(&found.scans[0])),
                    ("with the network", error(&found.scans[1])),
                    ("with plays", error(&found.scans[2])),
                ],
            )
            .caption("What is left of it, but for the best straight line."),
        )
        .noted(
            "4.10-factor",
            without / with,
            format!(
                "{without:.2} % and {with:.2} % of the range, {least:.1} in the worst of them; {:.1} times by \
                 the rms error.",
                d.improvement
            ),
        )
        .noted("4.10-worst", least, format!("Of {} identifications.", all.len()))
}

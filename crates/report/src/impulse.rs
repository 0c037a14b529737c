//! The report of what pulses do to an axis.

use super::figure::{Axes, HALF, WHOLE, curves, over_count, range_of};
use super::html::{figure, fixed, number, page, th};
use super::plot::Plot;
use anyhow::Result;
use maud::{Markup, html};
use pigtail_evaluate::impulse::response::{Figures, ResponseDocument};

/// The report of the response to pulses as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn response(d: &ResponseDocument, f: &Figures) -> Result<String> {
    let title = format!("Response of {} to pulses, seed {}", d.axis, d.seed);
    let body = html! {
        p {
            "The motor breaks away at " (fixed(d.fsm_v, 4)) " V, the unit fsm of all amplitudes here. \
             Pulses (4.7) last " (fixed(d.period_ms, 2)) " ms; between them the transmission is brought \
             back to zero torque by " (in_words(d.relax)) ". With a second harmonic of "
            (fixed(d.a2_fsm, 2)) " fsm there is a dead zone of " (fixed(d.dead_zone_fsm, 2)) " fsm in "
            (a(1)) ", and the displacement follows the parabola (4.8) with b = " (fixed(d.b_nm, 2))
            " nm, R" sup { "2" } " = " (fixed(d.r2, 3)) "; at " (a(1)) " = " (d.displacement_nm.a1)
            " fsm it is " (fixed(d.displacement_nm.value, 1)) " nm."
        }
        (single(d, f))
        (over_both(d))
        (curve(d, f))
        (in_a_row(d))
    };
    Ok(page(&title, &body))
}

/// The amplitude of a pulse's harmonic.
pub(super) fn a(harmonic: u8) -> Markup {
    html! { "a" sub { (harmonic) } }
}

/// Below this, nanometres, a displacement in the map is the probe's noise.
const NOISE: f64 = 4.0;

/// A caption, an axis's name, the time until which it goes, milliseconds, and named curves.
type Named<'a> = (&'a str, &'a str, f64, Vec<(&'a str, Vec<(f64, f64)>)>);

/// Figs. 4.13 to 4.16.
fn single(d: &ResponseDocument, f: &Figures) -> Markup {
    let t = &f.trace;
    let ms = |k: usize| 1e3 * t.time[k];
    let series = |of: &dyn Fn(usize) -> f64, until: f64| -> Vec<(f64, f64)> {
        (0..t.time.len())
            .take_while(|k| ms(*k) <= until)
            .map(|k| (ms(k), of(k)))
            .collect()
    };
    let rate = |k: usize, of: &dyn Fn(usize) -> f64| {
        let (low, high) = (k.saturating_sub(1), (k + 1).min(t.time.len() - 1));
        (of(high) - of(low)) / (t.time[high] - t.time[low])
    };
    let motor = |k: usize| 1e3 * t.angles[k].0;
    let output = |k: usize| 1e3 * t.angles[k].1;
    let plots: [Named; 4] = [
        (
            "Input (Fig. 4.13).",
            "voltage, V",
            4.0,
            vec![("voltage", series(&|k| t.voltage[k], 4.0))],
        ),
        (
            "Positions (Fig. 4.14): the motor's behind the gear.",
            "angle, mrad",
            12.0,
            vec![
                ("motor x gear", series(&motor, 12.0)),
                ("output", series(&output, 12.0)),
            ],
        ),
        (
            "Velocities (Fig. 4.15): the motor moves during the pulse, the output after it.",
            "velocity, mrad/s",
            6.0,
            vec![
                ("motor x gear", series(&|k| rate(k, &motor), 6.0)),
                ("output", series(&|k| rate(k, &output), 6.0)),
            ],
        ),
        (
            "Displacement of the output (Fig. 4.16).",
            "displacement, nm",
            20.0,
            vec![("output", series(&|k| 1e9 * t.output[k], 20.0))],
        ),
    ];
    let draw = |y: &str, until: f64, named: &[(&str, Vec<(f64, f64)>)]| {
        let values = named
            .iter()
            .flat_map(|(_, points)| points.iter().map(|p| p.1));
        let axes = Axes {
            width: HALF,
            x: (0.0..until, "time, ms"),
            y: (range_of(values, 1e-6), y),
        };
        curves(&axes, named)
    };
    html! {
        h2 { "A single pulse" }
        p {
            (a(1)) " = " (d.displacement_nm.a1) " fsm, " (a(2)) " = " (d.a2_fsm) " fsm"
            @if (d.a3_fsm, d.a4_fsm) != (0.0, 0.0) {
                ", " (a(3)) " = " (d.a3_fsm) ", " (a(4)) " = " (d.a4_fsm) " fsm"
            }
            ". These four are the truth, from the twin: no encoder sees them."
        }
        div.pair {
            @for (caption, y, until, named) in &plots {
                (figure(&draw(y, *until, named), caption))
            }
        }
    }
}

/// Fig. 4.17.
fn over_both(d: &ResponseDocument) -> Markup {
    let heading = html! { h2 { "Over both amplitudes" } };
    let (a1, a2) = (&d.map.a1_fsm, &d.map.a2_fsm);
    let (Some(right), Some(top)) = (a1.last(), a2.last()) else {
        return heading;
    };
    let reached = d.map.nm.iter().flatten().flatten();
    let highest = reached.clone().fold(1.0, |h: f64, v| h.max(*v));
    let size = (right / a1.len() as f64, top / a2.len() as f64);
    let cells: Vec<_> = a2
        .iter()
        .zip(&d.map.nm)
        .flat_map(|(y, row)| {
            let one = a1.iter().zip(row);
            one.filter_map(move |(x, nm)| {
                // The square root shows what is small, but not the probe's noise.
                let nm = (*nm)?;
                let seen = if nm > NOISE { nm } else { 0.0 };
                Some(([(x - size.0, y - size.1), (*x, *y)], seen))
            })
        })
        .collect();
    let axes = Axes {
        width: WHOLE,
        x: (0.0..*right, "first harmonic a1, fsm"),
        y: (0.0..*top, "second harmonic a2, fsm"),
    };
    let plot = Plot::new(&axes)
        .colour(0.0, highest, "moved, nm", true)
        .shaded_boxes("displacement", &cells);
    html! {
        (heading)
        (figure(
            &plot.draw(),
            format!(
                "Displacement from none (dark, the dead zone) to {highest:.0} nm (bright), by its square \
                 root (Fig. 4.17); below {NOISE} nm it is the probe's noise, and shown as none. Where there is no \
                 colour is beyond the amplifier's voltage."
            )
        ))
        div.scroll { table {
            tr { (th(a(2), "fsm")) (th(html! { "dead zone in " (a(1)) }, "fsm")) }
            @for row in &d.dead_zones {
                tr {
                    td { (fixed(row.a2_fsm, 2)) }
                    td {
                        @if let Some(zone) = row.dead_zone_fsm { (fixed(zone, 2)) }
                        @else { "above 5" }
                    }
                }
            }
        } }
    }
}

/// Figs. 4.18 and 4.19, or 4.21.
fn curve(d: &ResponseDocument, f: &Figures) -> Markup {
    let measured: Vec<(f64, f64)> = d.curve.iter().map(|r| (r.a1_fsm, r.nm)).collect();
    let parabola: Vec<(f64, f64)> = d
        .curve
        .iter()
        .map(|r| (r.a1_fsm, d.b_nm * r.a1_fsm * r.a1_fsm))
        .collect();
    let spread = |of: fn(&pigtail_evaluate::impulse::response::Spread) -> f64| -> Vec<(f64, f64)> {
        f.spread.iter().map(|s| (s.a1, of(s))).collect()
    };
    let draw = |named: &[(&str, Vec<(f64, f64)>)]| {
        let all = || named.iter().flat_map(|(_, points)| points.iter());
        let axes = Axes {
            width: HALF,
            x: (range_of(all().map(|p| p.0), 0.1), "first harmonic a1, fsm"),
            y: (range_of(all().map(|p| p.1), 1.0), "displacement, nm"),
        };
        curves(&axes, named)
    };
    html! {
        h2 { "Without dead zone" }
        div.pair {
            (figure(
                &draw(&[("measured", measured), ("b a1^2", parabola)]),
                html! {
                    "Measured, and the parabola (4.8) (Figs. 4.18, 4.21). R" sup { "2" } " = "
                    (fixed(d.r2, 3)) "."
                }
            ))
            (figure(
                &draw(&[
                    ("90 %", spread(|s| s.p90)),
                    ("50 %", spread(|s| s.p50)),
                    ("10 %", spread(|s| s.p10)),
                ]),
                "Over machines whose load friction differs by 10 % (one standard deviation) and whose \
                 motor is displaced by a tenth of a count: percentiles (Fig. 4.19)."
            ))
        }
    }
}

/// A way to relax in words.
fn in_words(relax: &str) -> &str {
    match relax {
        "start" => "nothing",
        other => other,
    }
}

/// The same pulse again and again.
fn in_a_row(d: &ResponseDocument) -> Markup {
    let named: Vec<(&str, Vec<(f64, f64)>)> = d
        .rows
        .iter()
        .map(|row| {
            let points = row.nm.iter().enumerate();
            (
                in_words(row.relax),
                points.map(|(k, nm)| ((k + 1) as f64, *nm)).collect(),
            )
        })
        .collect();
    let all = || named.iter().flat_map(|(_, points)| points.iter());
    let axes = Axes {
        width: WHOLE,
        x: (range_of(all().map(|p| p.0), 1.0), "pulse"),
        y: (range_of(all().map(|p| p.1), 1.0), "displacement, nm"),
    };
    html! {
        h2 { "The same pulse in a row" }
        p {
            "A pulse leaves the transmission wound up. Unless that is brought back, the next one moves the \
             output by something else."
        }
        (figure(
            &over_count(&axes, &named),
            "Displacement by each of them, by how the transmission is brought back to zero torque between \
             them."
        ))
        div.scroll { table {
            tr { th { "relaxed by" } (th("displacements", "nm")) th { "spread over mean" } }
            @for row in &d.rows {
                @let moved: Vec<String> = row.nm.iter().map(|nm| fixed(*nm, 0)).collect();
                tr {
                    td { (in_words(row.relax)) }
                    td { (moved.join(", ")) }
                    td { (number(row.unevenness, 3)) }
                }
            }
        } }
    }
}

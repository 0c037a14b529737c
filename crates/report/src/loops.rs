//! The report of windup loops on machines that differ.

use super::figure::{Axes, HALF, WHOLE, curves, range_of};
use super::html::{figure, fixed, number, page, th};
use anyhow::Result;
use maud::{Markup, html};
use pigtail_evaluate::loops::{Loop, LoopsDocument};
use pigtail_model::windup::{Windup, WindupState};

/// Points of a curve: more would show no more.
const POINTS: usize = 2000;

/// The report of windup loops as one HTML text.
///
/// # Errors
///
/// When a figure cannot be drawn.
pub fn loops(d: &LoopsDocument, loops: &[Loop]) -> Result<String> {
    let title = format!("Windup of {}, seed {}", d.axis, d.seed);
    let of = |figures: &[&str]| -> Vec<&Loop> {
        loops
            .iter()
            .filter(|l| figures.contains(&l.case.figure))
            .collect()
    };
    let plain = of(&["2.8", "2.11"]);
    let and_plain =
        |figure: &str| -> Vec<&Loop> { plain.iter().copied().chain(of(&[figure])).collect() };
    let first = plain.first().map_or("", |l| l.case.figure);
    let laws = of(&["2.14, 2.15"]);
    let body = html! {
        p {
            "Forward and back over " (fixed(d.range_um, 0)) " um, on the same specimen but for what is \
             varied. Input is the motor's encoder behind the gear, output what the probe sees."
        }
        (table(d))
        (figure(
            &over_input(&plain, WHOLE),
            format!(
                "What the output is ahead of the input, against the input, as the machine is (thesis, Fig. {first}, which shows \
                 the output itself). Here and below a curve has the means of {MEANS} stretches of time."
            )
        ))
        div.pair {
            (figure(
                &over_input(&and_plain("2.9"), HALF),
                "With other load friction (Fig. 2.9)."
            ))
            (figure(&over_input(&of(&["2.10"]), HALF), "Without load friction (Fig. 2.10)."))
            (figure(
                &over_input(&and_plain("2.12, 2.13"), HALF),
                "With a preload (Figs. 2.12, 2.13)."
            ))
        }
        @if !laws.is_empty() {
            h2 { "Laws of load friction" }
            @if let Some(nearest) = d.laws() { p { (nearest) "." } }
            div.pair {
                @for l in laws {
                    (figure(
                        &over_output(l),
                        format!(
                            "Windup against output under {}, beside (2.20) (Figs. 2.14, 2.15).",
                            l.case.name
                        )
                    ))
                }
            }
        }
    };
    Ok(page(&title, &body))
}

fn table(d: &LoopsDocument) -> Markup {
    html! {
        div.scroll { table {
            tr {
                th { "figure" } th.text { "machine" }
                (th("windup", "um")) (th("W_max", "um")) (th("Q", "um"))
                (th("(2.20) leaves", "um rms")) (th("at most", "um"))
            }
            @for case in &d.cases {
                tr {
                    td { (case.figure) }
                    td.text { (case.name) }
                    td { (fixed(case.windup_um, 2)) }
                    td { (number(case.w_max_um, 2)) }
                    td { (number(case.q_um, 2)) }
                    td { (number(case.residual_um, 2)) }
                    td { (number(case.largest_residual_um, 2)) }
                }
            }
        } }
    }
}

/// Points of a curve over input, each the mean of what lies between it and the next: a windup that is as small as a
/// count of the encoder would be hidden by it.
const MEANS: usize = 300;

/// Output against input, from the first turn on.
fn over_input(loops: &[&Loop], width: u32) -> Markup {
    let series: Vec<(&str, Vec<(f64, f64)>)> = loops
        .iter()
        .map(|l| {
            let um = l.um_per_radian;
            let (from, to) = (l.record.input.len() / 4, 3 * l.record.input.len() / 4);
            let every = (to - from).div_ceil(MEANS);
            let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
            let input = l.record.input[from..to].chunks(every);
            let output = l.record.output[from..to].chunks(every);
            let points = input.zip(output).map(|(input, output)| {
                let (input, output) = (mean(input), mean(output));
                (um * input, um * (output - input))
            });
            let points = points.collect();
            (l.case.name.as_str(), points)
        })
        .collect();
    let all = || series.iter().flat_map(|(_, points)| points.iter());
    let axes = Axes {
        width,
        x: (range_of(all().map(|p| p.0), 0.1), "input, um"),
        y: (range_of(all().map(|p| p.1), 0.1), "output less input, um"),
    };
    curves(&axes, &series)
}

/// Windup against output beside what (2.20) makes of it.
fn over_output(l: &Loop) -> Markup {
    let um = l.um_per_radian;
    let from = l.record.input.len() / 4;
    let every = (l.record.input.len() - from).div_ceil(POINTS);
    let thin = |w: &[f64]| -> Vec<(f64, f64)> {
        (from..w.len())
            .step_by(every)
            .map(|k| (um * l.record.output[k], um * w[k]))
            .collect()
    };
    let pairs = l.record.input.iter().zip(&l.record.output);
    let offset = l.fit.map_or(0.0, |fit| fit.offset);
    let measured: Vec<f64> = pairs.map(|(i, o)| i - o - offset).collect();
    let mut series = vec![("measured", thin(&measured))];
    if let Some(fit) = &l.fit {
        let model = Windup::Reversal(fit.model);
        let mut state = WindupState::default();
        let outputs = l.record.output.iter();
        let fitted: Vec<f64> = outputs.map(|o| model.next(&mut state, *o)).collect();
        series.push(("(2.20)", thin(&fitted)));
    }
    let all = || series.iter().flat_map(|(_, points)| points.iter());
    let axes = Axes {
        width: HALF,
        x: (range_of(all().map(|p| p.0), 0.1), "output, um"),
        y: (range_of(all().map(|p| p.1), 0.01), "windup, um"),
    };
    curves(&axes, &series)
}

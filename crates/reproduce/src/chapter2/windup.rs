//! Figs. 2.8 to 2.15: windup, what it depends on, and its function.

use super::super::picture::{Picture, Points, thin};
use super::super::{Bench, Figure};
use super::{FIVE_BAR, Z};
use pigtail_control::identify::{Path, WindupRecord, scan};
use pigtail_evaluate::loops::{Loop, middle_windup, windup};
use pigtail_model::windup::{Reversal, ReversalState, Windup};
use pigtail_numerics::line::Line;
use pigtail_session::identify::{range, scale};
use pigtail_session::job::Ended;
use pigtail_twin::plant::LoadLaw;

/// The machine of a case: load friction and preload relative to the rig's friction.
fn case(loops: &[Loop], load_friction: f64, preload: f64) -> Result<&Loop, Ended> {
    loops
        .iter()
        .find(|l| {
            (l.case.load_friction - load_friction).abs() < 1e-3
                && (l.case.preload - preload).abs() < 1e-3
        })
        .ok_or_else(|| {
            let message =
                format!("no machine with {load_friction} x friction and a preload of {preload}");
            pigtail_hal::Error::new("five_bar.joint", "preload", message).into()
        })
}

/// Input against output over the last way forward and back, micrometres.
fn input_output(l: &Loop) -> Points {
    let record = &l.record;
    let um = l.um_per_radian;
    let half = record.input.len() / 2;
    thin((half..record.input.len()).map(|k| (um * record.input[k], um * record.output[k])))
}

/// Windup against output over the same.
fn windup_output(l: &Loop) -> Points {
    let record = &l.record;
    let um = l.um_per_radian;
    let half = record.input.len() / 2;
    thin((half..record.input.len()).map(|k| {
        (
            um * record.output[k],
            um * (record.input[k] - record.output[k]),
        )
    }))
}

/// The last way back of a scan: input and output since it began, radians, and the windup over that
/// of the way forward.
fn way_back(record: &WindupRecord) -> Vec<(f64, f64, f64)> {
    let start = 3 * record.input.len() / 4;
    let (first_in, first_out) = (record.input[start], record.output[start]);
    (start..record.input.len())
        .map(|k| {
            (
                first_in - record.input[k],
                first_out - record.output[k],
                record.input[k] - record.output[k],
            )
        })
        .collect()
}

/// The share of the input's motion that the output follows over the first fifth of the transition.
fn slope(record: &WindupRecord) -> f64 {
    let back = way_back(record);
    let whole = middle_windup(record);
    let Some((_, _, first)) = back.first() else {
        return 0.0;
    };
    let end = back.iter().find(|(_, _, w)| first - w > 0.2 * whole);
    end.map_or(0.0, |(input, output, _)| output / input)
}

/// Greatest distance of the transition from the straight line through it, over the windup.
fn departure(record: &WindupRecord) -> f64 {
    let back = way_back(record);
    let whole = middle_windup(record);
    let Some((_, _, first)) = back.first() else {
        return f64::INFINITY;
    };
    // Clear of both ends, where servo errors and breaking away have their part.
    let part: Points = back
        .iter()
        .filter(|(_, _, w)| (0.05..0.95).contains(&((first - w) / whole)))
        .map(|(_, output, w)| (*output, first - w))
        .take_while(|p| p.1 < 0.95 * whole)
        .collect();
    let line = Line::through(part.iter().copied());
    part.iter()
        .map(|(x, y)| line.left(*x, *y).abs() / whole)
        .fold(0.0, f64::max)
}

pub(super) fn measured(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    let (_, loops) = windup(&bench.machine, FIVE_BAR, bench.seed)?;
    Ok(vec![
        figure_2_8(&loops)?,
        figure_2_10(&loops)?,
        figure_2_13(&loops)?,
        figure_2_14(bench, &loops)?,
        figure_2_15(bench, &loops)?,
    ])
}

fn input_output_picture<'a>(loops: impl IntoIterator<Item = (&'a str, &'a Loop)>) -> Picture {
    let curves = loops.into_iter().map(|(name, l)| (name, input_output(l)));
    Picture::curves("input, um", "output, um", curves)
}

fn figure_2_8(loops: &[Loop]) -> Result<Figure, Ended> {
    let l = case(loops, 1.0, 0.0)?;
    Ok(
        Figure::new("2.8", "Illustration of five-bar transmission windup")
            .picture(
                input_output_picture([("measured", l)])
                    .x(-50.0, 750.0)
                    .y(-50.0, 750.0)
                    .caption("Input by the encoder, output by the probe, forward and back."),
            )
            .result("2.8-windup", l.case.windup_um)
            .result("2.8-slope", slope(&l.record)),
    )
}

fn figure_2_10(loops: &[Loop]) -> Result<Figure, Ended> {
    let (with, without) = (case(loops, 1.0, 0.0)?, case(loops, 0.0, 0.0)?);
    Ok(
        Figure::new("2.10", "Five-bar response without frictional loading")
            .picture(
                input_output_picture([("no load friction", without)])
                    .x(-50.0, 750.0)
                    .y(-50.0, 750.0)
                    .caption("The link disconnected from the rest: no friction on the load."),
            )
            .noted(
                "2.10-factor",
                with.case.windup_um / without.case.windup_um,
                format!(
                    "{:.1} um and {:.2} um.",
                    with.case.windup_um, without.case.windup_um
                ),
            ),
    )
}

fn figure_2_13(loops: &[Loop]) -> Result<Figure, Ended> {
    let all = [
        ("none", case(loops, 1.0, 0.0)?),
        ("1.2 x friction", case(loops, 1.0, 1.2)?),
        ("2.4 x friction", case(loops, 1.0, 2.4)?),
    ];
    let um = all.map(|(_, l)| l.case.windup_um);
    Ok(Figure::new("2.13", "The effect of preloading")
        .picture(input_output_picture(all).caption(
            "Input and output with a preload on the load, relative to its static friction.",
        ))
        .noted(
            "2.13-half",
            um[0] / um[1],
            format!("{:.1} um and {:.1} um.", um[0], um[1]),
        )
        .noted("2.13-levels", um[2] / um[1], format!("{:.1} um.", um[2])))
}

fn figure_2_14(bench: &Bench, loops: &[Loop]) -> Result<Figure, Ended> {
    let l = case(loops, 1.0, 0.0)?;
    let setup = &bench.machine;
    let scale = scale(&setup.rig, FIVE_BAR.axis)?;
    let way = 0.5 * range(FIVE_BAR.axis) / scale.metres_per_radian;
    let path = Path {
        turns: [0.0, 1.0, 0.0, 1.0, 0.0].map(|t| t * way).to_vec(),
        speed: 0.5 * way,
    };
    let record = setup.experiment(bench.seed, |station| {
        Ok(scan(station, FIVE_BAR, &scale, &path, &Windup::None)?)
    })?;
    let half = l.um_per_radian * middle_windup(&record);
    Ok(Figure::new("2.14", "Transmission windup vs. load position")
        .picture(
            Picture::curves(
                "load position, um",
                "windup, um",
                [("measured", windup_output(l))],
            )
            .x(-50.0, 750.0)
            .caption("Input less output, forward and back."),
        )
        .result("2.14-range", half / l.case.windup_um))
}

/// What (2.20) tells along a record's outputs, radians, from the second way on.
fn prediction(model: &Reversal, record: &WindupRecord) -> Vec<f64> {
    let mut state = ReversalState::default();
    record
        .output
        .iter()
        .map(|output| model.next(&mut state, *output))
        .collect()
}

/// Root mean square of what (2.20) leaves, but for a constant, over the last three ways.
fn left(model: &Reversal, record: &WindupRecord) -> f64 {
    let prediction = prediction(model, record);
    let from = record.input.len() / 4;
    let errors: Vec<f64> = (from..prediction.len())
        .map(|k| record.input[k] - record.output[k] - prediction[k])
        .collect();
    let n = errors.len() as f64;
    let mean = errors.iter().sum::<f64>() / n;
    (errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / n).sqrt()
}

/// The least that the largest error of (2.20) comes to along a record's last two ways, but for a constant,
/// by the best of all `W_max` and `Q`, radians.
fn least_largest(near: &Reversal, record: &WindupRecord) -> f64 {
    const EVERY: usize = 20;
    let start = record.input.len() / 4;
    let largest = |model: &Reversal| {
        let mut state = ReversalState::default();
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for k in (0..record.input.len()).step_by(EVERY) {
            let error =
                record.input[k] - record.output[k] - model.next(&mut state, record.output[k]);
            if k >= 2 * start {
                (low, high) = (low.min(error), high.max(error));
            }
        }
        0.5 * (high - low)
    };
    let mut least = f64::INFINITY;
    for i in 0..=20 {
        for k in 0..=40 {
            least = least.min(largest(&Reversal {
                maximum: near.maximum * (0.8 + 0.02 * f64::from(i)),
                way: near.way * (0.4 + 0.04 * f64::from(k)),
            }));
        }
    }
    least
}

fn figure_2_15(bench: &Bench, loops: &[Loop]) -> Result<Figure, Ended> {
    let l = case(loops, 1.0, 0.0)?;
    let setup = &bench.machine;
    let Some(fit) = &l.fit else {
        return Ok(Figure::new(
            "2.15",
            "Transmission windup estimation function",
        ));
    };
    let um = l.um_per_radian;
    let prediction = prediction(&fit.model, &l.record);
    let half = l.record.input.len() / 2;
    let estimate = thin(
        (half..prediction.len())
            .map(|k| (um * l.record.output[k], um * (prediction[k] + fit.offset))),
    );
    let best = left(&fit.model, &l.record);
    let off = [0.8, 1.2].map(|by| {
        let model = Reversal {
            way: by * fit.model.way,
            ..fit.model
        };
        left(&model, &l.record)
    });
    let scale = scale(&setup.rig, FIVE_BAR.axis)?;
    let way = range(FIVE_BAR.axis) / scale.metres_per_radian;
    let path = Path {
        turns: [0.0, 1.0, 0.0, 1.0, 0.0].map(|t| t * way).to_vec(),
        speed: 0.5 * way,
    };
    let faster = setup.experiment(bench.seed, |station| {
        Ok(scan(station, FIVE_BAR, &scale, &path, &Windup::None)?)
    })?;
    let laws: Vec<String> = [LoadLaw::MaxwellSlip, LoadLaw::LuGre]
        .iter()
        .filter_map(|law| {
            let name = match law {
                LoadLaw::MaxwellSlip => "maxwell-slip",
                _ => "lugre",
            };
            let l = loops.iter().find(|l| l.case.law == name)?;
            Some(format!(
                "{:.1} um under {name}",
                l.case.largest_residual_um?
            ))
        })
        .collect();
    Ok(
        Figure::new("2.15", "Transmission windup estimation function")
            .picture(
                Picture::curves(
                    "load position, um",
                    "windup, um",
                    [("measured", windup_output(l)), ("(2.20)", estimate)],
                )
                .x(-50.0, 750.0)
                .caption(format!(
                    "The function (2.20) with W_max = {:.1} um, Q = {:.0} um.",
                    l.case.w_max_um.unwrap_or(0.0),
                    l.case.q_um.unwrap_or(0.0)
                )),
            )
            .noted(
                "2.15-fit",
                um * fit.largest,
                format!(
                    "{:.1} um rms; with the W_max and Q by which the largest is least, {:.1} um. Largest {} of \
                     load friction.",
                    um * fit.residual,
                    um * least_largest(&fit.model, &l.record),
                    laws.join(", ")
                ),
            )
            .result("2.15-robust", off[0].max(off[1]) / best)
            .noted(
                "2.15-rate",
                um * middle_windup(&faster) / l.case.windup_um,
                "At 350 um/s and 175 um/s.",
            ),
    )
}

pub(super) fn simulated(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    let (_, loops) = windup(&bench.nominal, FIVE_BAR, bench.seed)?;
    Ok(vec![figure_2_9(&loops)?, figure_2_12(&loops)?])
}

fn figure_2_9(loops: &[Loop]) -> Result<Figure, Ended> {
    let all = [
        ("all of the friction", case(loops, 1.0, 0.0)?),
        ("half", case(loops, 0.5, 0.0)?),
        ("a twentieth", case(loops, 0.05, 0.0)?),
    ];
    let um = all.map(|(_, l)| l.case.windup_um);
    Ok(
        Figure::new("2.9", "Numerical simulation of transmission windup")
            .picture(
                input_output_picture(all)
                    .x(-50.0, 750.0)
                    .y(-50.0, 750.0)
                    .caption("Three levels of friction on the output."),
            )
            .result("2.9-grows", um[1] / um[0])
            .result("2.9-eliminated", um[2] / um[0])
            .result("2.9-linear", departure(&all[0].1.record)),
    )
}

fn figure_2_12(loops: &[Loop]) -> Result<Figure, Ended> {
    let all = [
        ("none", case(loops, 1.0, 0.0)?),
        ("0.6 x friction", case(loops, 1.0, 0.6)?),
        ("1.2 x friction", case(loops, 1.0, 1.2)?),
    ];
    let um = all.map(|(_, l)| l.case.windup_um);
    let further = case(loops, 1.0, 2.4)?.case.windup_um;
    Ok(Figure::new("2.12", "Numerical simulation of preloading effect")
        .picture(
            input_output_picture(all).caption("Three preloads, relative to the output's static friction."),
        )
        .result("2.12-falls", um[1] / um[0])
        .result("2.12-above", um[2] / um[1])
        .remark(format!(
            "(2.6) hardens without end, and with it windup falls without end: to {further:.1} um with a preload \
             of 2.4 times the friction, {:.2} of what 1.2 times leave. That of the machine levels off (Fig. 2.13), \
             and the thesis puts it down to stiffness that is bounded.",
            further / um[2]
        )))
}

/// Speed of the scan of z, m/s. The thesis prints none, and viscous friction winds the stage up further
/// the faster it goes: this one was chosen for this figure, which is no prediction.
const Z_SPEED: f64 = 15e-6;

pub(super) fn z_stage(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    let setup = &bench.machine;
    let scale = scale(&setup.rig, Z.axis)?;
    let um = 1e6 * scale.metres_per_radian;
    let way = range(Z.axis) / scale.metres_per_radian;
    let at = |speed: f64| -> Result<WindupRecord, Ended> {
        let path = Path {
            turns: [0.0, 1.0, 0.0, 1.0, 0.0].map(|t| t * way).to_vec(),
            speed: speed / scale.metres_per_radian,
        };
        setup.experiment(bench.seed, |station| {
            Ok(scan(station, Z, &scale, &path, &Windup::None)?)
        })
    };
    let (record, slow) = (at(Z_SPEED)?, at(Z_SPEED / 3.0)?);
    let windup = um * middle_windup(&record);
    let half = record.input.len() / 2;
    let points = thin((half..record.input.len()).map(|k| {
        (
            um * record.output[k],
            um * (record.input[k] - record.output[k]),
        )
    }));
    Ok(vec![
        Figure::new("2.11", "Illustration of z-stage transmission windup")
            .picture(
                Picture::curves("output, um", "windup, um", [("measured", points)])
                    .x(-1.0, 21.0)
                    .caption(format!(
                        "Input less output over 20 um forward and back at {:.0} um/s: less than four counts.",
                        1e6 * Z_SPEED
                    )),
            )
            .noted(
                "2.11-windup",
                windup,
                format!(
                    "{:.2} um at a third of the speed, at which the stage sticks and slips.",
                    um * middle_windup(&slow)
                ),
            )
            .result("2.11-required", windup),
    ])
}

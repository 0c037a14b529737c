//! Fig. 3.5: staying at the peak.

use super::super::picture::{Picture, Points, thin};
use super::super::{Bench, Figure};
use super::THESIS_STEP;
use super::alignment::{aligned, mean};
use super::tradeoffs::{self, Step};
use pigtail_control::maximization::{Disturbance, Means};
use pigtail_control::recipe::Climb;
use pigtail_evaluate::maximize::{MACRO, PIEZOS, rejection, tracking};
use pigtail_session::job::Ended;
use pigtail_session::procedure::Procedure;
use rayon::prelude::*;

pub(super) fn peak(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    let setup = &bench.machine;
    let climb = Climb {
        step: THESIS_STEP,
        dwell: 4e-3,
        pause: 4e-3,
        ..setup.rig.recipe.climb
    };
    let means = Means::NinePoint(climb);
    let (tracked, (macro_moves, piezos_creep)) = rayon::join(
        || tracking(setup, bench.seed, means, "nine-point"),
        || {
            rayon::join(
                || rejection(setup, bench.seed, Disturbance::Macro(MACRO.0), means),
                || rejection(setup, bench.seed, Disturbance::Piezos(PIEZOS.0), means),
            )
        },
    );
    let ((row, curves), macro_moves, piezos_creep) = (tracked?, macro_moves?, piezos_creep?);
    let devices: u64 = bench.count(6, 1);
    let done = (0..devices)
        .into_par_iter()
        .map(|k| {
            let seed = bench.seed.wrapping_add(k);
            aligned(setup, Procedure::Thesis, seed)
        })
        .collect::<Result<Vec<_>, Ended>>()?;
    let dwells = tradeoffs::dwells(bench)?;
    let steps = tradeoffs::steps(bench)?;
    let xy = mean(&done.iter().collect::<Vec<_>>(), &["climb"]);
    let named = curves
        .iter()
        .map(|(name, points)| (name.clone(), thin(points.iter().copied())));
    let lag: Points = row
        .trials
        .iter()
        .filter_map(|t| Some((t.speed_um_s, t.lag_um?)))
        .collect();
    let lost = row
        .lost_um_s
        .map_or_else(String::new, |lost| format!("Lost at {lost} um/s."));
    let figure = Figure::new("3.5", "Light maximization algorithm for micro manipulator")
        .picture(
            Picture::curves("time, s", "light, % of before", named)
                .y(0.0, 110.0)
                .caption("Light while the peak drifts and nine-point patterns follow it."),
        )
        .picture(
            Picture::curves("drift, um/s", "distance from the peak, um", [("", lag)])
                .x(0.0, 4.5)
                .caption("How far the fiber trails, in truth, at the end of each drift."),
        )
        .result("3.5-period", 1.0 / (9.0 * climb.dwell + climb.pause))
        .result("3.5-closed", row.closed_form_um_s.unwrap_or(f64::NAN))
        .noted("3.5-tracking", row.limit_um_s, lost)
        .noted(
            "3.5-macro",
            macro_moves.mean_light_percent / 100.0,
            format!(
                "At the end {:.0} %: the macro goes by jerks.",
                macro_moves.light_percent
            ),
        )
        .noted(
            "3.5-creep",
            piezos_creep.mean_light_percent / 100.0,
            format!("At the end {:.0} %.", piezos_creep.light_percent),
        )
        .noted(
            "3.5-xy",
            xy,
            format!("Devices: {devices}, with the recipe's step."),
        );
    Ok(vec![trade_offs(figure, &dwells, &steps)])
}

/// What dwell and step are traded for.
fn trade_offs(figure: Figure, dwells: &[(f64, f64)], steps: &[Step]) -> Figure {
    let other = dwells.iter().filter(|d| d.0 != 4.0).map(|d| d.1);
    let best_other = other.fold(0.0, f64::max) / dwells[1].1;
    figure
        .picture(
            Picture::curves(
                "dwell, ms",
                "fastest drift followed, um/s",
                [("", dwells.to_vec())],
            )
            .x(0.0, 17.0)
            .caption("What the climb follows with other dwells and as long a pause, step 0.1 um."),
        )
        .picture(
            Picture::curves(
                "step, um",
                "um/s, s",
                [
                    (
                        "fastest drift followed, um/s",
                        steps.iter().map(|s| (s.um, s.followed)).collect(),
                    ),
                    (
                        "time of the climb, s",
                        steps.iter().map(|s| (s.um, s.seconds)).collect::<Points>(),
                    ),
                ],
            )
            .x(0.0, 0.42)
            .caption("Tracking and time with other steps."),
        )
        .noted(
            "3.5-dwell",
            best_other,
            dwells
                .iter()
                .map(|(ms, limit)| format!("{ms:.0} ms {limit:.2} um/s"))
                .collect::<Vec<_>>()
                .join(", ")
                + ".",
        )
        .result("3.5-step-tracking", steps[0].followed / steps[1].followed)
        .result("3.5-step-time", steps[0].seconds / steps[1].seconds)
}

//! Fig. 3.2: the light around the peak.

use super::super::picture::{Content, Picture, Points};
use super::super::{Bench, Figure};
use super::tradeoffs;
use pigtail_control::maximization::{self, Around};
use pigtail_hal::Side;
use pigtail_model::optics::{Coupler, GaussianMode, Misalignment};
use pigtail_session::job::Ended;
use pigtail_session::setup::unfit;

/// A Gaussian `c exp(-(a x^2 + b y^2))` through the light around a peak at which it stands: its `R^2`.
fn gaussian(around: &[Around]) -> f64 {
    // Least squares of the light itself over both widths: steps that halve where they fail.
    let peak = around.iter().fold(0.0_f64, |m, p| m.max(p.light));
    let error = |[c, a, b]: [f64; 3]| -> f64 {
        around
            .iter()
            .map(|p| {
                let prediction = c * (-a * p.x * p.x * 1e12 - b * p.y * p.y * 1e12).exp();
                (p.light - prediction).powi(2)
            })
            .sum()
    };
    let mut best = [peak, 0.1, 0.1];
    let mut step = 0.5;
    while step > 1e-4 {
        let mut better = false;
        for k in 0..3 {
            for factor in [1.0 + step, 1.0 / (1.0 + step)] {
                let mut tried = best;
                tried[k] *= factor;
                if error(tried) < error(best) {
                    best = tried;
                    better = true;
                }
            }
        }
        if !better {
            step *= 0.5;
        }
    }
    let mean = around.iter().map(|p| p.light).sum::<f64>() / around.len() as f64;
    let all: f64 = around.iter().map(|p| (p.light - mean).powi(2)).sum();
    1.0 - error(best) / all
}

/// The loss of a fiber that is off by all of the accuracies of 3.1 and tilted as far as the fixture lets
/// it, at the recipe's gap; and of one that is not.
fn losses(bench: &Bench) -> Result<[f64; 2], Ended> {
    let plant = &bench.nominal.plant;
    let [radius_x, radius_y] = plant.device.mode_radius;
    let fiber = plant.fiber.mode_radius;
    let coupler = Coupler::new(
        GaussianMode { radius_x, radius_y },
        GaussianMode {
            radius_x: fiber,
            radius_y: fiber,
        },
        plant.light.wavelength / plant.light.gap_index,
    )
    .map_err(unfit)?;
    let tilt = plant.misplacement.tilt;
    let gap = bench.machine.rig.recipe.approach.gap;
    let off = Misalignment {
        x: 0.1e-6,
        y: 0.1e-6,
        z: gap + 2e-6,
        tilt_x: tilt,
        tilt_y: tilt,
    };
    let there = Misalignment {
        z: gap,
        ..Misalignment::default()
    };
    Ok([off, there].map(|at| 1.0 - coupler.efficiency(&at)))
}

pub(super) fn profile(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    const HALF: f64 = 7.5e-6;
    let lines = bench.count(31, 16);
    let setup = &bench.machine;
    let around = setup.experiment(bench.seed, |station| {
        Ok(maximization::profile(
            station,
            &setup.rig.recipe,
            Side::Left,
            HALF,
            lines,
        )?)
    })?;
    let peak = around[0].light;
    let cell = 2.0 * HALF / (lines - 1) as f64;
    // As far aside as the thesis says, to within half a cell.
    let rim: Vec<f64> = around
        .iter()
        .filter(|p| (p.x.hypot(p.y) - 5e-6).abs() < 0.5 * cell)
        .map(|p| p.light / peak)
        .collect();
    let at_rim = rim.iter().sum::<f64>() / rim.len().max(1) as f64;
    let brightest = rim.iter().copied().fold(0.0, f64::max);
    let um = |metres: f64| 1e6 * metres;
    let cells = around[1..]
        .iter()
        .map(|p| {
            (
                um(p.x + 0.5 * cell),
                um(p.y + 0.5 * cell),
                (p.light / peak).clamp(0.0, 1.0),
            )
        })
        .collect();
    let middle = around[1..]
        .iter()
        .map(|p| p.y.abs())
        .fold(f64::INFINITY, f64::min);
    let across: Points = around[1..]
        .iter()
        .filter(|p| p.y >= 0.0 && p.y <= middle + 1e-9)
        .map(|p| (um(p.x), p.light / peak))
        .collect();
    let [loss, least] = losses(bench)?;
    let reach = tradeoffs::reach(bench)?;
    let gap = setup.rig.recipe.approach.gap;
    Ok(vec![
        Figure::new(
            "3.2",
            "Light intensity distribution around optimal alignment position",
        )
        .picture(
            Picture::of(
                "x, um",
                "y, um",
                Content::Cells(cells, (um(cell), um(cell))),
            )
            .colour("light, share")
            .x(-8.0, 8.0)
            .y(-8.0, 8.0)
            .equal()
            .caption(
                "Light at the first output over the input fiber's place around the peak, the output \
                         coupled.",
            ),
        )
        .picture(
            Picture::curves("x, um", "light, of the peak", [("across", across)])
                .x(-8.0, 8.0)
                .y(0.0, 1.1)
                .caption("The same through the peak."),
        )
        .picture(
            Picture::curves("gap, um", "reach aside, um", reach.curves())
                .x(0.0, 300.0)
                .caption(
                    "How far aside a fiber may be before its light falls below what the raster counts as light: \
                     one that is off, and two that are off alike.",
                ),
        )
        .noted("3.2-pair-gap", um(reach.pair_gap), "For a pair that is 5 um off.")
        .result("3.2-single", reach.wider)
        .result("3.2-back", reach.back)
        .result("3.2-gaussian", gaussian(&around))
        .noted(
            "3.2-radius",
            at_rim,
            format!("The mean around; {brightest:.3} where it is brightest."),
        )
        .noted(
            "3.2-loss",
            loss,
            format!(
                "At the recipe's gap of {:.0} um, where the best that can be is {least:.3}.",
                um(gap)
            ),
        ),
    ])
}

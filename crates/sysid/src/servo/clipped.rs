//! A voltage that the record does not show whole: cut off at a converter's or a logger's bound, sharply or softly.
//!
//! An amplifier that gave what is written is told from a record that was cut off by the motion itself: what the
//! axis does where the voltage is high is told by what it does where it is low.

use super::{Equations, Friction, Method, Record, Settings, VOLTAGE};
use crate::Unknown;
use nalgebra::DMatrix;
use pigtail_numerics::regression::least_squares;
use pigtail_numerics::signal::quantile;

/// Levels, as shares of the highest one, above which equations are left out.
const LEVELS: [f64; 6] = [0.95, 0.88, 0.8, 0.7, 0.6, 0.5];

/// So many times as many samples stand in the highest band as in the one below it, where a voltage is cut off. A
/// sine's are 2.4 times as many.
const PILED: f64 = 3.0;

/// Width of these bands, as a share of the highest level.
const BAND: f64 = 0.03;

/// A force is cut off where the motion asks for more than is written by this share of the highest level...
const SHORT: f64 = 0.02;

/// ... and by so many standard deviations; without samples piled up by so much more.
const SURE: f64 = 6.0;
const UNSEEN: f64 = 2.5;

/// Least share of the equations that have to be left.
const LEAST_LEFT: f64 = 0.3;

/// Equations by how high their voltage is.
struct Bands<'a> {
    columns: &'a Equations,
    x: DMatrix<f64>,
    /// Force of a volt.
    force: f64,
    /// The highest voltage backward and forward, V.
    bounds: [f64; 2],
    /// Directions in which voltages are looked at.
    sides: [bool; 2],
}

/// By how much more force the motion asks for than is written.
#[derive(Clone, Copy)]
struct Short {
    /// As a share of the highest force.
    by: f64,
    /// In standard deviations.
    sure: f64,
    /// Whether both directions say so.
    both: bool,
}

impl Bands<'_> {
    /// Direction and height of an equation's voltage.
    fn level(&self, i: usize) -> (usize, f64) {
        let u = self.columns.force[i] / (self.force * self.columns.one[i].max(0.1));
        let side = usize::from(u > 0.0);
        (side, u.abs() / self.bounds[side])
    }

    fn is_below(&self, i: usize, most: f64) -> bool {
        let (side, level) = self.level(i);
        level < most || !self.sides[side]
    }

    /// What equations in a band lack by what those below a level tell. `None` where the band is empty.
    fn short(&self, below: f64, band: (f64, f64)) -> Option<Short> {
        let n = self.columns.force.len();
        let rows: Vec<usize> = (0..n).filter(|i| self.is_below(*i, below)).collect();
        if (rows.len() as f64) < LEAST_LEFT * n as f64 {
            return Some(Short {
                by: f64::INFINITY,
                sure: 0.0,
                both: false,
            });
        }
        let force: Vec<f64> = rows.iter().map(|i| self.columns.force[*i]).collect();
        let found = least_squares(&self.x.select_rows(&rows), &force)?;
        let mut missing = [Vec::new(), Vec::new()];
        for i in 0..n {
            let (side, level) = self.level(i);
            if self.sides[side] && level >= band.0 && level < band.1 {
                let told: f64 = (0..self.x.ncols())
                    .map(|j| found.values[j] * self.x[(i, j)])
                    .sum();
                let own = self.columns.force[i];
                let most = self.force * self.bounds[side] * self.columns.one[i].max(0.1);
                missing[side].push(own.signum() * (told - own) / most);
            }
        }
        let all: Vec<f64> = missing.iter().flatten().copied().collect();
        if all.len() < 10 {
            return None;
        }
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len().max(1) as f64;
        let by = mean(&all);
        let spread = (all.iter().map(|m| (m - by).powi(2)).sum::<f64>() / all.len() as f64).sqrt();
        // Neighbours are not independent.
        let independent = (all.len() as f64 / 4.0).max(2.0);
        let both =
            |s: usize| !self.sides[s] || missing[s].len() < 5 || mean(&missing[s]) > 0.5 * by;
        Some(Short {
            by,
            sure: by * independent.sqrt() / spread.max(1e-9),
            both: both(0) && both(1),
        })
    }
}

/// Whether voltages pile up below their bound in a direction.
fn is_piled(volts: &[f64], sign: f64, bound: f64) -> bool {
    let within = |low: f64, high: f64| {
        let levels = volts.iter().map(|u| sign * u / bound);
        levels.filter(|l| *l >= low && *l < high).count() as f64
    };
    let top = within(1.0 - BAND, f64::INFINITY);
    top > 30.0 && top > PILED * within(1.0 - 2.0 * BAND, 1.0 - BAND).max(3.0)
}

/// Which equations are to be believed, where a voltage was cut off; and the level of it, V. `None` where it was not.
///
/// # Errors
///
/// Where too little is left.
pub(super) fn clipped(
    record: &Record,
    set: &Settings,
    columns: &Equations,
) -> Result<Option<(Vec<bool>, f64)>, Unknown> {
    let volts = record.column(VOLTAGE);
    // A share so small is spikes.
    let bounds = [-quantile(&volts, 0.0005), quantile(&volts, 0.9995)];
    if bounds.iter().any(|b| *b <= 0.0) {
        return Ok(None);
    }
    let piled = [
        is_piled(&volts, -1.0, bounds[0]),
        is_piled(&volts, 1.0, bounds[1]),
    ];
    let seen = piled != [false, false];
    let bands = Bands {
        columns,
        x: columns.matrix(Friction::Asymmetric, Method::LeastSquares),
        force: set.force_per_volt,
        bounds,
        sides: if seen { piled } else { [true, true] },
    };
    let wanted = if seen { SHORT } else { UNSEEN * SHORT };
    let most = [LEVELS[0], LEVELS[2]]
        .into_iter()
        .filter_map(|level| bands.short(level, (level, f64::INFINITY)))
        .filter(|short| short.by.is_finite())
        .max_by(|a, b| a.by.total_cmp(&b.by));
    let Some(most) = most.filter(|s| s.by >= wanted && s.sure >= SURE && s.both) else {
        return Ok(None);
    };
    for below in LEVELS {
        let left = bands
            .short(below, (below - 0.12, below))
            .map_or(0.0, |s| s.by);
        if left.is_infinite() {
            break;
        }
        if left < 0.3 * SHORT {
            let keep = (0..columns.force.len())
                .map(|i| bands.is_below(i, below))
                .collect();
            let bound = (0..2)
                .filter(|s| bands.sides[*s])
                .map(|s| bounds[s])
                .fold(0.0, f64::max);
            return Ok(Some((keep, below * bound)));
        }
    }
    Err(Unknown::all(format!(
        "its voltage is cut off: where it is high the motion asks for {:.0} % more than is written, and what is below \
         tells too little",
        100.0 * most.by
    )))
}

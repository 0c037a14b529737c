//! What fewer equations say: those in which the axis slides, and half as many, from positions and voltages filtered at half the cutoff.
//!
//! Filters smear the step of friction where an axis turns or stops, and differences reach over it. What that changes grows with their length, and
//! a residual need not show it: where an axis makes short moves, its acceleration is nearly what its other columns tell together, and a smear
//! of two thousandths of the force had made Coulomb friction a tenth too small. What equations twice as far apart say otherwise is more than
//! what smears these.

use super::bent::NAMES;
use super::other::{moves, symmetric};
use super::slides::{ASIDE, Slides};
use super::{Equations, Method, Moved, Record, Settings, Variant, check, supported};
use nalgebra::DMatrix;
use pigtail_numerics::regression::{Solution, least_squares, over, tolerance, without_attenuation};
use pigtail_numerics::signal::quantile;
use std::f64::consts::FRAC_PI_2;

/// Stretches of a record, half of each in the next one: enough to tell a deviation, and long beside what noise remembers.
const STRETCHES: usize = 32;

/// Least tolerance of a column beside the others.
const OWN: f64 = 1e-4;

/// Of what equations half as many say otherwise, what all of them are wrong by. Filters that run both ways, and differences about a sample,
/// smear a step alike to either side: what that changes grows with the square of their length, and is four times as much by twice of it.
const SMEARED: f64 = 1.0 / 3.0;

/// The same of equations in which the axis slides: those in which it stands are wrong, and all of them by what they add.
const STANDING: f64 = 1.0;

/// Makes parameters less sure by what fewer equations say otherwise, and tells so.
pub(super) fn fewer(
    (record, moved): (&Record, &Moved),
    set: &Settings,
    columns: &Equations,
    variants: &mut [Variant],
) -> Vec<String> {
    // A delay is told where the axis slides alone.
    let standing = match supported(variants) {
        Method::Delayed => None,
        _ => standing(columns, variants),
    };
    let coarser = coarser((record, moved), set, columns, variants);
    standing.into_iter().chain(coarser).collect()
}

/// By what equations half as many say otherwise.
fn coarser(
    (record, moved): (&Record, &Moved),
    set: &Settings,
    columns: &Equations,
    variants: &mut [Variant],
) -> Option<String> {
    let period = record.even.period;
    let half = Settings {
        cutoff: Some(0.5 * set.cutoff(period)),
        decimate: Some(2 * set.factor(period)),
        ..*set
    };
    let half_moved = Moved::of(record, &half);
    let mut others = half_moved.equations(record, &half);
    others.retain(&there(&columns.time, &others.time)?);
    let noise = [(moved, set), (&half_moved, &half)].map(|(m, s)| check::acceleration_noise(m, s));
    let [all, fewer] = [said(columns, noise[0])?, said(&others, noise[1])?];
    let any = less_sure((&all, &fewer), SMEARED, variants, |_| true);
    any.then(|| {
        "equations twice as far apart say otherwise than all of them: filters smear what friction does where it turns or stops, and \
         parameters are less sure by that"
            .to_owned()
    })
}

/// Parameters that were found from all equations, by what those say otherwise in which the axis slides: where it stands, friction is whatever
/// holds it. Where that is told surely and by far, they were left out before.
fn standing(columns: &Equations, variants: &mut [Variant]) -> Option<String> {
    if columns.one_way {
        return None;
    }
    let x = symmetric(columns);
    let slides = moves(columns);
    let whole = least_squares(&x, &columns.force)?;
    let moving = over(&x, &columns.force, |i| slides[i])?;
    let rows = |of: &dyn Fn(usize) -> bool| (0..x.nrows()).filter(|i| of(*i)).collect::<Vec<_>>();
    let whole = Told::of(&x, whole, &rows(&|_| true), &columns.time)?;
    let moving = Told::of(&x, moving, &rows(&|i| slides[i]), &columns.time)?;
    let any = less_sure((&whole, &moving), STANDING, variants, |v| {
        v.method != Method::Delayed
    });
    any.then(|| {
        "equations far from where it stands or turns say otherwise than all of them: parameters are less sure by that".to_owned()
    })
}

/// What a fit says, and by how much each of its equations moves that.
struct Told {
    values: Vec<f64>,
    time: Vec<f64>,
    /// A column for each parameter.
    moved: DMatrix<f64>,
}

impl Told {
    /// Of a fit over some rows, what it leaves being told of all of them, and the time of each.
    fn of(x: &DMatrix<f64>, found: Solution, rows: &[usize], time: &[f64]) -> Option<Self> {
        let part = x.select_rows(rows);
        let bread = part.tr_mul(&part).try_inverse()?;
        let mut moved = part * bread;
        for (mut row, i) in moved.row_iter_mut().zip(rows) {
            row *= found.residuals[*i];
        }
        Some(Self {
            values: found.values,
            time: rows.iter().map(|i| time[*i]).collect(),
            moved,
        })
    }

    /// What the equations of each stretch of a record move a parameter by. Stretches overlap by half and count by a sine, so that what enters
    /// at an end does not count at once ([`least_squares`]'s batches do the same).
    fn by_stretch(&self, parameter: usize, [begin, end]: [f64; 2]) -> [f64; STRETCHES + 1] {
        let half = (end - begin) / STRETCHES as f64;
        let mut sums = [0.0; STRETCHES + 1];
        for (t, moved) in self.time.iter().zip(self.moved.column(parameter).iter()) {
            let at = ((t - begin) / half).clamp(0.0, STRETCHES as f64);
            let k = (at as usize).min(STRETCHES - 1);
            let (sin, cos) = (FRAC_PI_2 * (at - k as f64)).sin_cos();
            sums[k] += cos * moved;
            sums[k + 1] += sin * moved;
        }
        sums
    }
}

/// How far two fits to one record differ by chance: by what each stretch of it moves the one otherwise than the other.
///
/// That fewer equations know less, and differ by what they know less (J. A. Hausman, 1978), holds where all of them are weighed as their noise is.
/// Here they are not: of a quiet position fewer, filtered more, know more, and of that difference nothing would be chance.
fn chance(all: &Told, fewer: &Told, parameter: usize) -> f64 {
    let ends = [all, fewer].map(|t| [t.time[0], t.time[t.time.len() - 1]]);
    let ends = [ends[0][0].min(ends[1][0]), ends[0][1].max(ends[1][1])];
    let [one, other] = [all, fewer].map(|t| t.by_stretch(parameter, ends));
    let squares: f64 = one.iter().zip(&other).map(|(a, b)| (a - b).powi(2)).sum();
    // What a fit has taken of its own noise is not left in it.
    let (stretches, taken) = (STRETCHES as f64, all.values.len() as f64);
    (squares * stretches / (stretches - taken)).sqrt()
}

/// Makes parameters less sure by a share of what a fit to fewer equations says otherwise by more than chance; whether that is more than what
/// they said.
fn less_sure(
    (all, fewer): (&Told, &Told),
    share: f64,
    variants: &mut [Variant],
    of: impl Fn(&Variant) -> bool,
) -> bool {
    let mut any = false;
    for (j, names) in NAMES.iter().enumerate() {
        let chance = chance(all, fewer, j);
        let off = (fewer.values[j] - all.values[j]).abs();
        if off <= ASIDE * chance {
            continue;
        }
        // Chance's own square is in it.
        let beyond = share * (off.powi(2) - chance.powi(2)).sqrt();
        let parameters = variants.iter_mut().filter(|v| of(v));
        let parameters = parameters.flat_map(|v| &mut v.parameters);
        let known = parameters
            .filter(|p| names.contains(&p.name))
            .filter_map(|p| p.known.as_mut());
        for known in known {
            any |= beyond > known.std_correlated;
            known.std_correlated = known.std_correlated.hypot(beyond);
        }
    }
    any
}

/// Which of the coarser equations are of moments of which an equation was kept.
fn there(kept: &[f64], coarser: &[f64]) -> Option<Vec<bool>> {
    let steps: Vec<f64> = kept.windows(2).map(|w| w[1] - w[0]).collect();
    let near = 0.75 * quantile(&steps, 0.5);
    let is_near = |t: &f64| {
        let behind = kept.partition_point(|k| k < t);
        let around = [behind.checked_sub(1), Some(behind)];
        let mut around = around.into_iter().flatten().filter_map(|k| kept.get(k));
        around.any(|k| (k - t).abs() < near)
    };
    (steps.len() > 1).then(|| coarser.iter().map(is_near).collect())
}

/// What equations say that have no turn near them, what the position's noise takes of an inertia given back.
fn said(columns: &Equations, noise: f64) -> Option<Told> {
    let Slides { x, force, rows } = Slides::of(columns, 0)?;
    let told = (0..x.ncols()).all(|j| tolerance(&x, j) > OWN);
    let mut found = told.then(|| least_squares(&x, &force))??;
    without_attenuation(&x, |_| true, 0, noise, &mut found);
    let time: Vec<f64> = rows.iter().map(|i| columns.time[*i]).collect();
    Told::of(&x, found, &(0..x.nrows()).collect::<Vec<_>>(), &time)
}

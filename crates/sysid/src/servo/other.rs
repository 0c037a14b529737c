//! What drives or holds an axis beside its inertia and its friction, and what changes within a record: no parameter here
//! stands for it, and those that there are would be off by it.

use super::slides::ASIDE;
use super::{
    Equations, Friction, LATE, Method, Moved, Record, SLOW, Settings, Unknown, Variant, check,
};
use nalgebra::{DMatrix, DVector};
use pigtail_numerics::golden::least;
use pigtail_numerics::regression::{
    Solution, least_squares, least_squares_alone, matrix, over, relative, tolerance,
};
use pigtail_numerics::signal::{quantile, rms};
use std::f64::consts::TAU;

/// A parameter is another one where it differs by more than this share of it, and by more than so many standard
/// deviations.
pub(super) const OTHER: f64 = 0.1;
pub(super) const SURELY: f64 = 5.0;

/// Equations over which decimation smears a step of friction.
const REACH: usize = 3;

/// Parts of a record whose inertias are compared.
const PARTS: usize = 6;

/// Waves of a force over the place that are looked for at most, the shortest of them as a share of the stroke, how many
/// are tried, and the share of what is left that one has to tell.
const WAVES: usize = 4;
const SHORTEST: f64 = 0.02;
const TRIED: usize = 160;
const WORTH: f64 = 0.1;

/// To what share of the way from one try to the next a wave's length is told.
const FINER: f64 = 0.01;

/// Most equations by which they are looked for.
const SEARCHED: usize = 20_000;

/// Share of the record to which a force of the place is fitted; the rest says whether there is one.
const FITTED: f64 = 0.7;

/// What is held back is told twice as well with a force of the place that is taken out.
pub(super) const TWICE: f64 = 0.5;

pub(super) fn symmetric(columns: &Equations) -> DMatrix<f64> {
    columns.matrix(Friction::Symmetric, Method::LeastSquares)
}

/// Whether one solution has one of these parameters otherwise than another, by such a share of it.
pub(super) fn differs(one: &Solution, other: &Solution, of: &[usize], share: f64) -> bool {
    of.iter().any(|j| {
        let off = (one.values[*j] - other.values[*j]).abs();
        let sure = one.std_correlated[*j].hypot(other.std_correlated[*j]);
        let size = one.values[*j].abs().max(other.values[*j].abs());
        off > share * size && off > SURELY * sure
    })
}

/// Which equations have no step of friction near them.
pub(super) fn moves(columns: &Equations) -> Vec<bool> {
    let speeds: Vec<f64> = columns.velocity.iter().map(|v| v.abs()).collect();
    let slow = SLOW * quantile(&speeds, 0.99);
    (0..speeds.len())
        .map(|i| {
            let near = &speeds[i.saturating_sub(REACH)..(i + REACH + 1).min(speeds.len())];
            near.iter().all(|v| *v > slow)
        })
        .collect()
}

/// Which equations are left where those at rest would decide on friction: where an axis stands, friction is whatever
/// holds it, and not its Coulomb level. `None` where they say the same as the others, or too few of the others are there.
pub(super) fn sliding(columns: &Equations) -> Option<Vec<bool>> {
    if columns.one_way {
        return None;
    }
    let slides = moves(columns);
    let moving = slides.iter().filter(|s| **s).count();
    if moving < super::LEAST_EQUATIONS || moving == slides.len() {
        return None;
    }
    let x = symmetric(columns);
    let all = least_squares(&x, &columns.force)?;
    let sliding = over(&x, &columns.force, |i| slides[i])?;
    differs(&all, &sliding, &[0, 1, 2], OTHER).then_some(slides)
}

/// A force that goes with the place: the weight on a lever or a slope, a spring, a motor's cogging. One part of it is
/// proportional to the place, the others are waves over it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    low: f64,
    stroke: f64,
    /// Waves over the stroke; none where it is zero.
    cycles: [f64; WAVES],
}

impl Place {
    fn share(&self, position: &[f64]) -> Vec<f64> {
        let of = |p: &f64| (p - self.low) / self.stroke - 0.5;
        position.iter().map(of).collect()
    }

    fn wave(share: &[f64], cycles: f64) -> [Vec<f64>; 2] {
        let of = |f: fn(f64) -> f64| share.iter().map(|p| f(TAU * cycles * p)).collect();
        [of(f64::sin), of(f64::cos)]
    }

    /// The columns whose sum such a force is.
    pub(super) fn columns(&self, position: &[f64]) -> Vec<Vec<f64>> {
        let share = self.share(position);
        let waves = self.cycles.iter().filter(|c| **c > 0.0);
        let mut columns: Vec<Vec<f64>> = waves.flat_map(|c| Self::wave(&share, *c)).collect();
        columns.push(share);
        columns
    }

    /// What tells best what inertia and friction leave, wave by wave.
    fn of(columns: &Equations, x: &DMatrix<f64>) -> Option<Self> {
        let ends = columns
            .position
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| {
                (low.min(*p), high.max(*p))
            });
        let mut place = Self {
            low: ends.0,
            stroke: ends.1 - ends.0,
            cycles: [0.0; WAVES],
        };
        if place.stroke.is_nan() || place.stroke <= 0.0 {
            return None;
        }
        // Where there are very many equations some of them tell the waves' lengths.
        let every = columns.force.len().div_ceil(SEARCHED);
        let some = |column: &[f64]| -> Vec<f64> { column.iter().copied().step_by(every).collect() };
        let (position, force) = (some(&columns.position), some(&columns.force));
        let rows: Vec<usize> = (0..columns.force.len()).step_by(every).collect();
        let x = x.select_rows(&rows);
        let share = place.share(&position);
        for k in 0..WAVES {
            let all = beside(&x, &place.columns(&position));
            let span = all.qr().q();
            let left = without(&span, &force);
            // What nothing else tells of the acceleration.
            let others = beside(&x.clone().remove_column(0), &place.columns(&position));
            let acceleration: Vec<f64> = x.column(0).iter().copied().collect();
            let alone = without(&others.qr().q(), &acceleration);
            let own_least = check::OWN * x.column(0).norm_squared();
            let told = |cycles: f64| {
                let waves = Self::wave(&share, cycles);
                let along = |c: &[f64]| DVector::from_column_slice(c).dot(&alone) / alone.norm();
                let [along_a, along_b] = [along(&waves[0]), along(&waves[1])];
                let [a, b] = waves.map(|c| without(&span, &c));
                let both = a.dot(&b) / a.norm_squared().max(f64::MIN_POSITIVE);
                let parts = [(along_b - along_a * both, b - &a * both), (along_a, a)];
                // A column of which the others tell nearly all tells nothing.
                let own = |c: &DVector<f64>| c.norm_squared() > 1e-6 * share.len() as f64;
                let own = || parts.iter().filter(|(_, c)| own(c));
                let hidden: f64 = own().map(|(k, c)| k.powi(2) / c.norm_squared()).sum();
                // Nor is one to tell what the acceleration does: where a motion repeats its ways it goes with the place.
                if alone.norm_squared() < (1.0 + hidden) * own_least {
                    return 0.0;
                }
                let tells = |c: &DVector<f64>| c.dot(&left).powi(2) / c.norm_squared();
                own().map(|(_, c)| tells(c)).sum::<f64>()
            };
            let cycles = |k: f64| 0.5 * (2.0 / SHORTEST).powf(k / (TRIED - 1) as f64);
            let tried = (0..TRIED).map(|k| (told(cycles(k as f64)), k));
            let best = tried.max_by(|a, b| a.0.total_cmp(&b.0))?;
            if best.0 < WORTH * left.norm_squared() {
                break;
            }
            // From one try to the next there are three hundredths more waves: of ten, a third of one at the end of the stroke.
            let near = |k: f64| -told(cycles(k));
            let at = best.1 as f64;
            let finer = least((at - 1.0, at + 1.0), FINER, near);
            // Between short ones there may be others that tell much, and some that would tell what the acceleration does.
            let at = if -near(finer) > best.0 { finer } else { at };
            place.cycles[k] = cycles(at);
        }
        Some(place)
    }
}

/// What an orthonormal span does not tell of a column.
fn without(span: &DMatrix<f64>, column: &[f64]) -> DVector<f64> {
    let column = DVector::from_column_slice(column);
    &column - span * span.tr_mul(&column)
}

pub(super) fn beside(x: &DMatrix<f64>, more: &[Vec<f64>]) -> DMatrix<f64> {
    let own = x.ncols();
    let mut all = x.clone().resize_horizontally(own + more.len(), 0.0);
    for (k, column) in more.iter().enumerate() {
        all.set_column(own + k, &DVector::from_column_slice(column));
    }
    all
}

/// Equations from which all that goes with the place is taken out: those of the rest of the force, whose parameters are
/// the same. How much goes with it is told by those in which the axis slides, if there are enough: what holds an axis that stands is no
/// force of the place, and would be spread over all the others.
pub(super) fn taken_out(columns: &mut Equations, place: &Place) {
    let of_place = place.columns(&columns.position);
    let slices: Vec<&[f64]> = of_place.iter().map(|c| &c[..]).collect();
    let all = matrix(&slices);
    let mut rows: Vec<usize> = (0..)
        .zip(moves(columns))
        .filter_map(|(i, s)| s.then_some(i))
        .collect();
    if rows.len() < super::LEAST_EQUATIONS {
        rows = (0..all.nrows()).collect();
    }
    let parts = all.select_rows(&rows).qr();
    let (span, shares) = (parts.q(), parts.r());
    let take_out = |column: &mut Vec<f64>| {
        let told = DVector::from_iterator(rows.len(), rows.iter().map(|i| column[*i]));
        let Some(shares) = shares.solve_upper_triangular(&span.tr_mul(&told)) else {
            return;
        };
        for (value, goes) in column.iter_mut().zip((&all * shares).iter()) {
            *value -= goes;
        }
    };
    let mut told = columns.clone();
    for column in told.regressors_mut() {
        take_out(column);
    }
    for column in [&mut columns.force, &mut columns.lag, &mut columns.curve] {
        take_out(column);
    }
    columns.told = Some(Box::new(told));
}

/// What is left of the last part by what is fitted to the first, per cent of the force.
pub(super) fn held_back(x: &DMatrix<f64>, force: &[f64]) -> Option<f64> {
    let n = force.len();
    let to = (FITTED * n as f64) as usize;
    let found = least_squares_alone(&x.rows(0, to).into_owned(), &force[..to])?;
    let told = x.rows(to, n - to) * DVector::from_column_slice(&found.values);
    let pairs = force[to..].iter().zip(told.iter());
    let left: Vec<f64> = pairs.map(|(f, t)| f - t).collect();
    Some(relative(&left, &force[to..]))
}

/// A force of the place that a record has.
#[derive(Debug, Default)]
pub(super) struct OfPlace {
    /// What is to be taken out.
    pub(super) place: Option<Place>,
    /// By how much less sure each symmetric parameter is, where it is too small to be taken out.
    pub(super) off: Vec<f64>,
}

/// The force of the place, where there is one that tells what it was not fitted to.
pub(super) fn of_place(
    record: &Record,
    moved: &Moved,
    set: &Settings,
    remarks: &mut Vec<String>,
) -> OfPlace {
    let mut columns = moved.equations(record, set);
    // An axis that rests at some places is held there by friction, and few equations from one turn to the next smear friction's steps over
    // the places where it turns, again and again.
    let slides = moves(&columns);
    let slide = slides.iter().filter(|s| **s).count() >= super::LEAST_EQUATIONS;
    if slide {
        columns.retain(&slides);
    }
    let columns = columns;
    let x = symmetric(&columns);
    let found = || {
        let plain = least_squares(&x, &columns.force)?;
        let place = Place::of(&columns, &x)?;
        let parts = place.columns(&columns.position);
        let all = beside(&x, &parts);
        let joint = least_squares(&all, &columns.force)?;
        let (before, after) = (
            held_back(&x, &columns.force)?,
            held_back(&all, &columns.force)?,
        );
        Some((plain, place, parts, joint, after / before))
    };
    let Some((plain, place, parts, joint, ratio)) = found() else {
        return OfPlace::default();
    };
    let shows = ratio < LATE;
    // Of a motion of one sine a spring alone is one with the inertia: as much of a force of the place as shows may hide there.
    if tolerance(&beside(&x, &parts), 0) < check::OWN {
        let hidden = || {
            let acceleration = rms(x.column(0).iter().copied());
            rms(plain.residuals.iter().copied()) / acceleration
        };
        let off = shows.then(hidden);
        return OfPlace {
            place: None,
            off: off.into_iter().collect(),
        };
    }
    if ratio > TWICE || !slide {
        // It may hide where it does not show: where a motion repeats its ways a spring is nearly one with the inertia, and how much of one is
        // there nobody knows better than the two together say.
        let off = |j: usize| {
            let off = (plain.values[j] - joint.values[j]).abs();
            let [one, both] = [&plain, &joint].map(|s| s.std_correlated[j]);
            if off > ASIDE * both {
                off
            } else if j == 0 {
                (both.powi(2) - one.powi(2)).max(0.0).sqrt()
            } else {
                0.0
            }
        };
        let all = 0..if shows || slide { x.ncols() } else { 0 };
        return OfPlace {
            place: None,
            off: all.map(off).collect(),
        };
    }
    let force = |i: usize| {
        let own = &joint.values[x.ncols()..];
        parts.iter().zip(own).map(|(c, v)| c[i] * v).sum::<f64>()
    };
    // Decimation's own gain is in the column of ones.
    let size = rms((0..columns.force.len()).map(force)) / rms(columns.one.iter().copied());
    remarks.push(format!(
        "a force goes with the place, {size:.3e} rms, as of a weight, a spring or a motor's cogging: it is taken out, and \
         neither fragment nor replay has it"
    ));
    OfPlace {
        place: Some(place),
        off: Vec::new(),
    }
}

impl OfPlace {
    /// Settings by which it is taken out.
    pub(super) fn settings(&self, set: &Settings) -> Settings {
        Settings {
            place: self.place,
            ..*set
        }
    }

    /// Makes parameters less sure by what a force of the place that stays would change.
    pub(super) fn widen(&self, variants: &mut [Variant]) {
        for variant in variants
            .iter_mut()
            .filter(|v| v.friction == Friction::Symmetric)
        {
            for (parameter, off) in variant.parameters.iter_mut().zip(&self.off) {
                if let Some(known) = &mut parameter.known {
                    known.std_correlated = known.std_correlated.hypot(*off);
                }
            }
        }
    }
}

/// That the axis is the same throughout the record, of which the whole tells an inertia: else no part does.
pub(super) fn changing(
    columns: &Equations,
    unknown: &[Unknown],
    remarks: &mut Vec<String>,
) -> Result<(), Unknown> {
    if unknown.iter().any(|u| u.covers("inertia")) {
        return Ok(());
    }
    let x = symmetric(columns);
    let n = columns.force.len();
    let parts = (n / super::LEAST_EQUATIONS).min(PARTS);
    let of = |part: usize| {
        let rows = part * n / parts..(part + 1) * n / parts;
        let force = &columns.force[rows.clone()];
        least_squares(&x.rows(rows.start, rows.len()).into_owned(), force)
    };
    let found: Vec<Solution> = (0..parts).filter_map(of).collect();
    let pairs = || (0..found.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
    if let Some((i, j)) = pairs().find(|(i, j)| differs(&found[*i], &found[*j], &[0], OTHER)) {
        let of = |k: usize| found[k].values[0];
        return Err(Unknown::all(format!(
            "one part of it says an inertia of {:.4e} and another one {:.4e}: did a load, a gain or a unit change within it?",
            of(j),
            of(i)
        )));
    }
    if columns.one_way || found.len() < 2 {
        return Ok(());
    }
    // Friction at the usual speed, of which viscous and Coulomb friction are parts.
    let speed = rms(columns.velocity.iter().copied()) / rms(columns.one.iter().copied());
    let friction = |s: &Solution| s.values[1] * speed + s.values[2];
    // Friction that drives is that of a part whose rows stand in reverse, or of one of whose columns a sign was turned.
    let drives = |s: &&Solution| {
        let sure = s.std_correlated[2].hypot(speed * s.std_correlated[1]);
        friction(s) < -SURELY * sure
    };
    if let Some(part) = found.iter().find(drives) {
        return Err(Unknown::all(format!(
            "in one part of it friction drives the axis, by {:.3e} at its usual speed: do its rows stand in reverse there, or \
             was a sign turned within it?",
            -friction(part)
        )));
    }
    let (first, last) = (&found[0], &found[found.len() - 1]);
    let (a, b) = (friction(first), friction(last));
    let sure = first.std_correlated[2].hypot(last.std_correlated[2]);
    if (a - b).abs() > (OTHER * a.abs().max(b.abs())).max(SURELY * sure) {
        remarks.push(format!(
            "friction changes within it: at the usual speed it is {a:.3e} at its beginning and {b:.3e} at its end; what is \
             printed lies between"
        ));
    }
    Ok(())
}

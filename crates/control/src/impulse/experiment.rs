//! What pulses do on a machine, found by playing them: the voltage at which its motor breaks away,
//! how its transmission is best relaxed, the dead zone and the second harmonic that removes it.

use super::{Impulses, Moved, Relax, Shape};
use crate::outcome::{Halt, Outcome};
use crate::station::Station;
use pigtail_hal::AxisName;
use pigtail_hal::quantity::Volts;
use pigtail_numerics::bisection::try_onset;

/// A pulse that displaces the output by less, metres, does not move it.
pub const MOVES: f64 = 0.3e-9;

/// Dithers begin with so many times the voltage at which the motor breaks away: enough to keep it
/// sliding, too little for it to move the load.
const DITHER: f64 = 4.5;

/// The voltage at which the motor at rest breaks away, volts: raised slowly, forward and backward in
/// turn, until the encoder moves, from a relaxed transmission each time. It is `R/k_m f_sm`, the unit
/// in which the thesis counts amplitudes, as a machine can tell it.
///
/// # Errors
///
/// A fault; [`Outcome::NoBreakAway`] where the whole voltage does not move it; [`Outcome::Lacking`]
/// without a sensor at the output.
pub fn break_away(station: &mut Station, at: AxisName, rest: f64) -> Result<f64, Halt> {
    // At first no more is known than the encoder tells, whose count may be much of a windup; what
    // that finds is enough for a dither.
    let first = break_away_from(station, at, rest, Relax::Servo)?;
    let dither = Relax::Dither {
        amplitude: DITHER * first,
    };
    break_away_from(station, at, rest, dither)
}

fn break_away_from(
    station: &mut Station,
    at: AxisName,
    rest: f64,
    relax: Relax,
) -> Result<f64, Halt> {
    /// Volts a second: half a millivolt a cycle.
    const RATE: f64 = 1.25;
    const TIMES: u32 = 4;
    let limit = station.spec().drive(at.axis).voltage;
    let step = RATE * station.spec().period();
    let impulses = Impulses {
        at,
        relax,
        rest,
        readings: 25,
    };
    let mut sum = 0.0;
    for k in 0..TIMES {
        impulses.begin(station)?;
        let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
        let start = station.encoder(at);
        let mut volts = 0.0;
        while station.encoder(at) == start {
            volts += step;
            if volts > limit {
                return Err(Outcome::NoBreakAway { at, limit }.into());
            }
            station.hold_voltage(at, Volts(sign * volts));
            station.cycle()?;
        }
        sum += volts;
        station.hold_voltage(at, Volts(0.0));
        station.run(rest)?;
    }
    impulses.begin(station)?;
    Ok(sum / f64::from(TIMES))
}

/// Each way to relax a transmission that there is, for a motor that breaks away at `unit` volts.
pub fn ways_to_relax(unit: f64) -> [Relax; 3] {
    [
        Relax::Start,
        Relax::Servo,
        Relax::Dither {
            amplitude: DITHER * unit,
        },
    ]
}

/// Spread of repeated displacements relative to their mean: what relaxing is judged by. Infinite
/// where the output does not move on the whole.
pub fn unevenness(moved: &[Moved]) -> f64 {
    let n = moved.len() as f64;
    let mean = moved.iter().map(|m| m.net).sum::<f64>() / n;
    let squares: f64 = moved.iter().map(|m| (m.net - mean).powi(2)).sum();
    if mean > MOVES {
        (squares / n).sqrt() / mean
    } else {
        f64::INFINITY
    }
}

/// Whether a pulse moves the output forward by more than [`MOVES`]. Played in both directions in
/// turn until the mean is clearly on one side, or as often as anyone would want to.
///
/// # Errors
///
/// As [`Impulses::respond`].
pub fn moves(
    station: &mut Station,
    impulses: &Impulses,
    shape: &Shape,
    a1: f64,
) -> Result<bool, Halt> {
    const LEAST: u32 = 4;
    const MOST: u32 = 48;
    const SURE: f64 = 4.0;
    let (mut mean, mut squares) = (0.0, 0.0);
    for k in 0..MOST {
        let forward = k % 2 == 0;
        let moved = impulses
            .respond(station, shape.pulse(a1, forward))?
            .displacement;
        let ahead = if forward { moved } else { -moved };
        let n = f64::from(k + 1);
        let deviation = ahead - mean;
        mean += deviation / n;
        squares += deviation * (ahead - mean);
        if k + 1 >= LEAST {
            let error = (squares / (n - 1.0) / n).sqrt();
            if (mean - MOVES).abs() > SURE * error {
                break;
            }
        }
    }
    Ok(mean > MOVES)
}

/// The least `a_1` (volts, from zero to `most`) that moves the output forward, to `most/256`; `None`
/// where not even the whole does.
///
/// # Errors
///
/// As [`Impulses::respond`].
pub fn dead_zone(
    station: &mut Station,
    impulses: &Impulses,
    shape: &Shape,
    most: f64,
) -> Result<Option<f64>, Halt> {
    least(most, |a1| moves(station, impulses, shape, a1))
}

/// The least second harmonic (volts, from zero to `most`) that leaves no dead zone, to `most/256`, with
/// the others in the proportions of `shape`: it moves the output without any `a_1`. `None` where not
/// even the whole does.
///
/// # Errors
///
/// As [`Impulses::respond`].
pub fn without_dead_zone(
    station: &mut Station,
    impulses: &Impulses,
    shape: &Shape,
    most: f64,
) -> Result<Option<f64>, Halt> {
    least(most, |a2| moves(station, impulses, &shape.scaled(a2), 0.0))
}

/// Where in 0 to `most` a condition begins to hold, by halving.
fn least(most: f64, mut holds: impl FnMut(f64) -> Result<bool, Halt>) -> Result<Option<f64>, Halt> {
    const HALVINGS: u32 = 8;
    if !holds(most)? {
        return Ok(None);
    }
    if holds(0.0)? {
        return Ok(Some(0.0));
    }
    let (low, high) = try_onset((0.0, most), HALVINGS, holds)?;
    Ok(Some(0.5 * (low + high)))
}

/// A parabola (4.8) through displacements: `b`, metres for a square volt, and `R^2`.
pub fn parabola(a1: &[f64], displacement: &[f64]) -> (f64, f64) {
    let pairs = || a1.iter().zip(displacement);
    let (upper, lower) = pairs().fold((0.0, 0.0), |(u, l), (a, d)| (u + a * a * d, l + a.powi(4)));
    let b = upper / f64::max(lower, f64::MIN_POSITIVE);
    let mean = displacement.iter().sum::<f64>() / displacement.len() as f64;
    let (left, all) = pairs().fold((0.0, 0.0), |(left, all), (a, d)| {
        (left + (d - b * a * a).powi(2), all + (d - mean).powi(2))
    });
    (b, 1.0 - left / all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_is_found_and_what_is_none_shows_it() {
        let a: Vec<f64> = (1..=20).map(|k| 0.25 * f64::from(k)).collect();
        let exact: Vec<f64> = a.iter().map(|a| 8e-9 * a * a).collect();
        let (b, r2) = parabola(&a, &exact);
        assert!((b / 8e-9 - 1.0).abs() < 1e-12 && (r2 - 1.0).abs() < 1e-12);
        let line: Vec<f64> = a.iter().map(|a| 8e-9 * a).collect();
        assert!(parabola(&a, &line).1 < 0.9);
    }

    #[test]
    fn where_a_condition_begins_is_found_by_halving() {
        let found = least(5.0, |a| Ok(a > 3.3))
            .expect("no fault")
            .expect("it does");
        assert!((found - 3.3).abs() < 5.0 / 256.0);
        assert_eq!(least(5.0, |_| Ok(false)), Ok(None));
        assert_eq!(least(5.0, |_| Ok(true)), Ok(Some(0.0)));
    }
}

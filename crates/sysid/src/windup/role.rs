//! Which side drives which, and whether the torque has its sign, by physics: a load lags its motor, a transmission winds up with
//! its torque, and an axis rubs.

use super::signals::Signals;
use super::{Fitted, LOAD, MOTOR, Parts, Record, fit};
use crate::Unknown;
use pigtail_numerics::regression::{least_squares, matrix};
use pigtail_numerics::signal::{quantile, rms};

/// A part of the windup is worth speaking of from this share of it.
pub(super) const WORTH: f64 = 0.03;

/// So many deviations show a torque's sign.
const SURE: f64 = 5.0;

/// A torque that tells the windup leaves less than this share of what is left without it.
const TELLS: f64 = 0.9;

/// What no drive does: a load that runs ahead of its motor, a transmission that winds up against its torque.
///
/// # Errors
///
/// Where nothing of the record is to be believed.
pub(super) fn passive(
    record: &Record,
    models: &[Fitted],
    chosen: &Fitted,
    signals: &Signals,
    raw: f64,
) -> Result<Option<Unknown>, Unknown> {
    // Friction on the motor's side takes a part of a measured torque that winds nothing up, so that
    // beside a torque (2.20) may have either sign; alone it may not, and nor may a compliance.
    let sign = |name: &str| {
        let known = chosen.parameters.iter().find(|(n, _)| *n == name);
        known.is_some_and(|(_, k)| k.value < -4.0 * k.std_correlated)
    };
    let torque = record.has_torque && chosen.parts.compliance;
    // What drives a load through something that gives way is ahead of it: of its friction, and of its inertia too.
    let ahead = "the load would run ahead of its motor: the two columns may be swapped";
    let backward: f64 = chosen.elements.iter().map(|e| e[1]).sum();
    if !torque && (sign("w_max") || backward < -WORTH * raw) {
        return Ok(Some(Unknown {
            parameters: vec!["w_max", "q", "offset", "time_skew"],
            because: ahead.to_owned(),
        }));
    }
    if !record.has_torque && runs_ahead(models, signals, raw) {
        return Err(Unknown::all(ahead));
    }
    let rubs = dissipation(signals);
    if rubs.iter().any(|t| *t < -SURE) {
        return Err(Unknown::all(
            "the torque would be less where it has friction to overcome: its sign is turned, or that of both positions",
        ));
    }
    let against: Vec<f64> = models
        .iter()
        .filter_map(|m| with_torque(m, signals, raw))
        .collect();
    let against = against.iter().sum::<f64>() / against.len().max(1) as f64;
    let own = signals.torque.as_deref();
    let own = own.and_then(|t| share(chosen, "compliance", t, raw));
    let linear = own.is_some_and(|own| own < -2.0 * WORTH);
    let turned = torque && sign("compliance") || linear || against < -0.5 * WORTH;
    let because = if record.has_torque && turned {
        "it would wind up against the torque: columns may be swapped, or the torque's sign turned"
            .to_owned()
    } else if !torque || rubs.iter().any(|t| *t > SURE) {
        return Ok(None);
    } else if sign("w_max") || backward < -WORTH * raw {
        // Friction of the motor's side would have made it so, and that is in the torque.
        "the load would run ahead of its motor where friction turns round, as where the torque has the motor's friction in it; \
         it shows none: the two columns may be swapped and a sign turned"
            .to_owned()
    } else if !winds(chosen, signals) {
        "the torque neither shows friction nor tells the windup: is it another axis's?".to_owned()
    } else {
        return Ok(None);
    };
    Ok(Some(Unknown {
        parameters: vec![
            "compliance",
            "cubic_compliance",
            "inertial_compliance",
            "w_max",
            "q",
            "offset",
        ],
        because,
    }))
}

/// Whether the torque tells the windup: its compliance is certain, and without it more is left.
fn winds(chosen: &Fitted, signals: &Signals) -> bool {
    let compliance = chosen.parameters.iter().find(|(n, _)| *n == "compliance");
    if compliance.is_none_or(|(_, k)| k.value < SURE * k.std_correlated) {
        return false;
    }
    let blind = Signals {
        torque: None,
        ..signals.clone()
    };
    let held_back = |s: &Signals| {
        fit(chosen.name, chosen.parts, s, None, 0.0).map_or(f64::INFINITY, |f| f.held_back)
    };
    held_back(signals) < TELLS * held_back(&blind)
}

/// Whether the load's column is too smooth to have been measured beside the motor's: what a program commands has no noise but
/// that of its last digit.
///
/// A servo that is soft winds up against its command as a transmission does against its load.
///
/// # Errors
///
/// That it is. A motor's encoder, behind its gear, may be as fine: of its column a remark says what it would be.
pub(super) fn commanded(record: &Record, remarks: &mut Vec<String>) -> Result<(), Unknown> {
    const QUIETER: f64 = 0.1;
    const NONE: f64 = 1e-3;
    let noise = |column: usize| {
        // Fourth differences of white noise have seventy times its power, and of a motion next to nothing.
        let stretches = record.even.stretches.iter();
        let fourth: Vec<f64> = stretches
            .flat_map(|s| s.columns[column].windows(5))
            .map(|w| (w[0] - 4.0 * w[1] + 6.0 * w[2] - 4.0 * w[3] + w[4]).abs())
            .collect();
        1.4826 * quantile(&fourth, 0.5) / 70f64.sqrt()
    };
    let digit = |column: usize| {
        let stretches = record.even.stretches.iter();
        let steps =
            stretches.flat_map(|s| s.columns[column].windows(2).map(|w| (w[1] - w[0]).abs()));
        // Steps that are none, but for a number's last digit.
        let largest = steps.clone().fold(0.0, f64::max);
        steps
            .filter(|s| *s > 1e-9 * largest)
            .fold(f64::INFINITY, f64::min)
    };
    let (motor, load) = (noise(MOTOR), noise(LOAD));
    let computed = |column: usize, own: f64, other: f64| {
        own < QUIETER * other && (own < 0.5 * digit(column) || own < NONE * other)
    };
    if computed(MOTOR, motor, load) {
        remarks.push(
            "the motor's position has no noise but that of its last digit: if it is the commanded one, what winds up is the servo too"
                .to_owned(),
        );
    }
    if computed(LOAD, load, motor) {
        return Err(Unknown::all(format!(
            "the load's position has no noise but that of its last digit ({load:.1e}), less than a tenth of the motor's \
             ({motor:.1e}): a commanded position is as smooth as that, and a servo that follows it winds up as a transmission \
             does"
        )));
    }
    Ok(())
}

/// Whether a torque that winds the transmission up leaves open which side is the motor's: columns that are swapped and a torque that is
/// turned would wind up as far, with a skew the other way, and neither friction of the load nor that in the torque says which it is.
pub(super) fn turned_unseen(chosen: &Fitted, signals: &Signals, raw: f64) -> bool {
    let w_max = chosen.parameters.iter().find(|(n, _)| *n == "w_max");
    let lags = w_max.is_some_and(|(_, k)| k.value > 4.0 * k.std_correlated)
        || chosen.elements.iter().map(|e| e[1]).sum::<f64>() > WORTH * raw;
    !lags && !dissipation(signals).iter().any(|t| *t > SURE)
}

/// That a torque hardly winds anything up, as where it is another axis's.
pub(super) fn idle(chosen: &Fitted) -> Option<String> {
    let (_, known) = chosen.parameters.iter().find(|(n, _)| *n == "compliance")?;
    (known.value < 2.0 * known.std_correlated).then(|| {
        "the compliance is within two of its deviations of none: the torque hardly winds anything up, or is another axis's".to_owned()
    })
}

/// That the load's column is ahead of the motor's in time, as a command is whose servo follows it: by its noise alone it is not told from a
/// measured position where it was written as coarsely.
pub(super) fn ahead(chosen: &Fitted) -> Option<String> {
    let (_, known) = chosen.parameters.iter().find(|(n, _)| *n == "time_skew")?;
    (known.value < -SURE * known.std_correlated).then(|| {
        format!(
            "the load was read {:.1e} s before the motor: a commanded position is ahead of its motor, too, and what winds up is \
             the servo then",
            -known.value
        )
    })
}

/// Says that nothing tells the two sides apart, and takes back what hangs on it.
pub(super) fn either(
    has_torque: bool,
    chosen: &Fitted,
    unknown: &mut Vec<Unknown>,
    remarks: &mut Vec<String>,
) {
    let which = "which of the two columns is the motor's does not show: neither friction nor inertia winds up one way in \
                 all models";
    if chosen.parts == Parts::NONE || has_torque {
        remarks.push(format!(
            "{which}; if they are swapped{}, skew and offset have the other sign",
            if has_torque {
                " and the torque's sign is turned"
            } else {
                ""
            }
        ));
    } else {
        unknown.push(Unknown {
            parameters: vec!["w_max", "q", "element", "offset", "inertial_compliance"],
            because: format!("{which}; record the torque too, or move so that more winds up"),
        });
    }
}

/// Whether all models that ask agree that friction, or inertia, makes the load lag.
///
/// A weight or a ratio that changes over the way looks as either of them in one model and as its opposite in the next:
/// so it is on a robot's arm. One that they agree on is the transmission's.
pub(super) fn lags(models: &[Fitted], signals: &Signals, raw: f64) -> bool {
    let w_max = |m: &Fitted| {
        let known = m.parameters.iter().find(|(n, _)| *n == "w_max");
        known.map(|(_, k)| k.value)
    };
    let friction = models
        .iter()
        .filter(|m| m.parts.reversal || m.parts.memory)
        .map(|m| w_max(m).unwrap_or_else(|| m.elements.iter().map(|e| e[1]).sum()) / raw);
    let inertia = models
        .iter()
        .filter_map(|m| share(m, "inertial_compliance", &signals.acceleration, raw));
    let agreed = |shares: Vec<f64>| !shares.is_empty() && shares.iter().all(|s| *s > WORTH);
    agreed(friction.collect()) || agreed(inertia.collect())
}

/// What the torque gives to the motion, beside inertia and a force that goes with the place, in its deviations: more than
/// nothing, for an axis rubs. With a force of the place straight, and to its third power; nothing without a torque.
///
/// The speed's column is made such that its factor is all power that friction takes, Coulomb's too.
fn dissipation(signals: &Signals) -> Vec<f64> {
    let Some(torque) = &signals.torque else {
        return Vec::new();
    };
    let v = &signals.velocity;
    let sides: Vec<f64> = v.iter().map(|v| v.signum()).collect();
    let together: f64 = v.iter().map(|v| v.abs()).sum();
    let squares: f64 = v.iter().map(|v| v * v).sum();
    let beside: Vec<f64> = sides
        .iter()
        .zip(v)
        .map(|(s, v)| s - v * together / squares)
        .collect();
    let one = vec![1.0; v.len()];
    // A spring goes with the place, and a weight on an arm with the sine of its angle.
    let places: Vec<Vec<f64>> = (1..=3)
        .map(|power| {
            let of = |q: &f64| ((q - signals.middle) / signals.range).powi(power);
            signals.position.iter().map(of).collect()
        })
        .collect();
    let power = |powers: usize| {
        let mut columns: Vec<&[f64]> = vec![v, &beside, &signals.acceleration, &one];
        columns.extend(places[..powers].iter().map(|p| &p[..]));
        let found = least_squares(&matrix(&columns), torque)?;
        Some(found.values[0] / found.std_correlated[0])
    };
    [1, 3].into_iter().filter_map(power).collect()
}

/// A parameter's part of the windup, with its sign, as a share of all of it.
fn share(model: &Fitted, name: &str, column: &[f64], raw: f64) -> Option<f64> {
    let known = model.parameters.iter().find(|(n, _)| *n == name)?.1;
    let mean = column.iter().sum::<f64>() / column.len().max(1) as f64;
    Some(known.value * rms(column.iter().map(|c| c - mean)) / raw)
}

/// How far it winds up with the torque, its cube's part too, as a share of all windup; negative against it.
fn with_torque(model: &Fitted, signals: &Signals, raw: f64) -> Option<f64> {
    let value = |name: &str| {
        model
            .parameters
            .iter()
            .find(|(n, _)| *n == name)
            .map(|(_, k)| k.value)
    };
    let (linear, cubic) = (value("compliance")?, value("cubic_compliance")?);
    let torque = signals.torque.as_ref()?;
    let mean = torque.iter().sum::<f64>() / torque.len() as f64;
    let (mut together, mut squares) = (0.0, 0.0);
    for t in torque {
        together += (linear * t + cubic * t.powi(3)) * (t - mean);
        squares += (t - mean).powi(2);
    }
    (squares > 0.0).then(|| together / (squares * torque.len() as f64).sqrt() / raw)
}

/// Whether a load that accelerates runs ahead of its motor, in all models that ask.
fn runs_ahead(models: &[Fitted], signals: &Signals, raw: f64) -> bool {
    let shares: Vec<f64> = models
        .iter()
        .filter_map(|m| share(m, "inertial_compliance", &signals.acceleration, raw))
        .collect();
    !shares.is_empty() && shares.iter().all(|s| *s < -WORTH)
}

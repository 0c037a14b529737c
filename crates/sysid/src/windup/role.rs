//! Which side drives which, and whether the torque has its sign, by physics: a load lags its motor, a transmission winds up with
//! its torque, and an axis rubs.

use super::signals::Signals;
use super::{Fitted, Parts, Record};
use crate::Unknown;
use pigtail_numerics::regression::{least_squares, matrix};
use pigtail_numerics::signal::rms;

/// A part of the windup is worth speaking of from this share of it.
const WORTH: f64 = 0.03;

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
    if brakes(signals) {
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
    Ok((record.has_torque && turned).then(|| Unknown {
        parameters: vec![
            "compliance",
            "cubic_compliance",
            "inertial_compliance",
            "w_max",
            "q",
            "offset",
        ],
        because: "it would wind up against the torque: columns may be swapped, or the torque's sign turned".to_owned(),
    }))
}

/// Says that nothing tells the two sides apart, and takes back what hangs on it.
pub(super) fn either(chosen: &Fitted, unknown: &mut Vec<Unknown>, remarks: &mut Vec<String>) {
    let which = "which of the two columns is the motor's does not show: neither friction nor inertia winds up one way in \
                 all models";
    if chosen.parts == Parts::NONE {
        remarks.push(format!(
            "{which}; if they are swapped, skew and offset have the other sign"
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

/// Whether what the torque gives to the motion, beside inertia and a force that goes with the place, is less than nothing: an
/// axis rubs.
///
/// The speed's column is made such that its factor is all power that friction takes, Coulomb's too.
fn brakes(signals: &Signals) -> bool {
    const SURE: f64 = 5.0;
    let Some(torque) = &signals.torque else {
        return false;
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
    [1, 3].into_iter().any(|powers| {
        let mut columns: Vec<&[f64]> = vec![v, &beside, &signals.acceleration, &one];
        columns.extend(places[..powers].iter().map(|p| &p[..]));
        least_squares(&matrix(&columns), torque)
            .is_some_and(|found| found.values[0] < -SURE * found.std_correlated[0])
    })
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

//! A twin of somebody's axis: its model beside its record, in closed loop.

use super::columns::Named;
use super::fragment::{Fragment, Kind};
use super::servo::Roles;
use super::{Answer, Figure, Shown, short};
use pigtail_hal::Error;
use pigtail_sysid::servo::{Replay, Settings, Sliding, replay};
use pigtail_sysid::{Account, Known, Parameter, Unknown};
use std::path::Path;

/// Simulates a fragment's axis under a law of friction, beside the fragment's record or another one of the
/// same columns.
///
/// # Errors
///
/// Bad input.
pub fn twin(
    file: &Path,
    fragment: &Fragment,
    data: Option<&Path>,
    law: (&'static str, Sliding),
) -> Result<(Answer, Option<Shown>), Error> {
    let name = file.display().to_string();
    let column = |role: &str| fragment.record.columns.get(role).map(Named::new);
    let needed = |role: &str| {
        column(role).ok_or_else(|| {
            let message = "is not there; accepted is a column as \"NAME:UNIT\"";
            Error::new(&name, format!("record.columns.{role}"), message)
        })
    };
    let Some(controller) = &fragment.controller else {
        let message = "is not there: the record did not tell the controller, and without one there is no closed \
                       loop; accepted is a [controller] table, such as identify servo --controller writes";
        return Err(Error::new(&name, "controller", message));
    };
    let roles = Roles {
        time: column("time"),
        rate: None,
        reference: Some(needed("reference")?),
        position: needed("position")?,
        voltage: needed("voltage")?,
        injected: column("injected"),
    };
    let read = roles.read(data.unwrap_or(&fragment.record.file))?;
    if read.kind != fragment.axis.kind {
        let message = "is not of the record's kind; accepted is \"linear\" for lengths, \"rotary\" for angles";
        return Err(Error::new(&name, "axis.kind", message));
    }
    let set = Settings::new(fragment.axis.force_per_volt);
    let axis = fragment.axis.axis();
    let names = parameters(fragment);
    let prediction = replay(
        &read.record,
        &axis,
        &law.1,
        &controller.controller(),
        (&set, usize::MAX),
    );
    let Some(prediction) = prediction else {
        let names = names.into_iter().map(|(p, unit)| (p.name, unit));
        let why = "the closed loop runs away from it, or it is too short to be replayed";
        let answer = Answer::nothing(names, Unknown::all(why), &read.remarks);
        return Ok((answer, None));
    };
    let mut answer = Answer {
        parameters: names,
        relative_error_percent: Some(prediction.velocity_error_percent),
        verdict: format!(
            "with {} friction the twin's velocity is {} % off the record's, its voltage {} %, its position {} %",
            law.0,
            short(prediction.velocity_error_percent),
            short(prediction.force_error_percent),
            short(prediction.position_error_percent)
        ),
        remarks: read.remarks,
        ..Answer::default()
    };
    for (key, value) in [
        ("velocity_error_percent", prediction.velocity_error_percent),
        ("force_error_percent", prediction.force_error_percent),
        ("position_error_percent", prediction.position_error_percent),
    ] {
        answer.more.insert(key.to_owned(), value.into());
    }
    answer.more.insert("friction".to_owned(), law.0.into());
    let shown = shown(&prediction, fragment.axis.kind);
    Ok((answer, Some(shown)))
}

/// What the fragment holds; how sure it was is in the identification's own answer.
fn parameters(fragment: &Fragment) -> Vec<(Parameter, String)> {
    let a = &fragment.axis;
    let (mass, viscous, force) = match a.kind {
        Kind::Linear => ("kg", "N s/m", "N"),
        Kind::Rotary => ("kg m^2", "N m s/rad", "N m"),
    };
    [
        ("inertia", a.inertia, mass),
        ("viscous_friction_forward", a.viscous[0], viscous),
        ("viscous_friction_backward", a.viscous[1], viscous),
        ("coulomb_friction_forward", a.coulomb[0], force),
        ("coulomb_friction_backward", a.coulomb[1], force),
        ("offset", a.offset, force),
    ]
    .into_iter()
    .map(|(name, value, unit)| {
        let known = Some(Known {
            value,
            std: f64::NAN,
            std_correlated: f64::NAN,
        });
        (Parameter { name, known }, unit.to_owned())
    })
    .collect()
}

fn shown(prediction: &Replay, kind: Kind) -> Shown {
    let (position, scale, unit) = match kind {
        Kind::Linear => ("m", 1e3, "mm"),
        Kind::Rotary => ("rad", 1f64.to_degrees(), "deg"),
    };
    let over = |values: &[f64], scale: f64| -> Vec<(f64, f64)> {
        let scaled = values.iter().map(|v| scale * v);
        prediction.time.iter().copied().zip(scaled).collect()
    };
    let lag = |of: &[f64]| -> Vec<f64> {
        let pairs = prediction.position[0].iter().zip(of);
        pairs.map(|(r, q)| r - q).collect()
    };
    let both = |measured, twin| vec![("record".to_owned(), measured), ("twin".to_owned(), twin)];
    let figure = |y: String, curves, caption: &str| Figure {
        x: "time, s".to_owned(),
        log_x: false,
        y,
        curves,
        caption: caption.to_owned(),
    };
    Shown {
        account: Account {
            time: prediction.time.clone(),
            measured: prediction.voltage[0].clone(),
            modelled: prediction.voltage[1].clone(),
            position: prediction.position[1].clone(),
            velocity: prediction.velocity[0].clone(),
        },
        quantity: ("voltage", "V"),
        position,
        figures: vec![
            figure(
                format!("position, {unit}"),
                both(
                    over(&prediction.position[1], scale),
                    over(&prediction.position[2], scale),
                ),
                "Position under the same reference.",
            ),
            figure(
                format!("reference less position, {unit}"),
                both(
                    over(&lag(&prediction.position[1]), scale),
                    over(&lag(&prediction.position[2]), scale),
                ),
                "How far each lags behind the reference.",
            ),
            figure(
                format!("velocity, {unit}/s"),
                both(
                    over(&prediction.velocity[0], scale),
                    over(&prediction.velocity[1], scale),
                ),
                "Velocity, both positions filtered alike.",
            ),
        ],
        ..Shown::default()
    }
}

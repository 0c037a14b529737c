//! Modes from a frequency response.

use super::columns::{self, Dimension, Named, Wanted};
use super::{Answer, Figure, Shown, short};
use nalgebra::Complex;
use pigtail_control::record::Unknown;
use pigtail_control::record::resonance::{NAMES, Record, bode, identify};
use pigtail_hal::Error;
use std::fmt::Write as _;
use std::path::Path;

/// Which columns of a file; those that are not named are looked for by their usual names.
#[derive(Debug, Clone, Default)]
pub struct Roles {
    /// Frequency.
    pub frequency: Option<Named>,
    /// Magnitude.
    pub magnitude: Option<Named>,
    /// Phase.
    pub phase: Option<Named>,
    /// Real and imaginary part.
    pub parts: Option<(Named, Named)>,
    /// Coherence.
    pub coherence: Option<Named>,
}

const FREQUENCIES: [&str; 9] = [
    "f_Hz",
    "freq_Hz",
    "frequency_Hz",
    "frequency_hz",
    "f",
    "freq",
    "frequency",
    "Frequency",
    "omega_rad/s",
];
const MAGNITUDES: [&str; 11] = [
    "magnitude",
    "magnitude_dB",
    "magnitude_db",
    "mag",
    "mag_dB",
    "mag_db",
    "gain",
    "gain_dB",
    "gain_db",
    "amplitude",
    "Magnitude",
];
const PHASES: [&str; 5] = ["phase_deg", "phase_rad", "phase", "arg_deg", "Phase"];
const REALS: [&str; 4] = ["re", "real", "Re", "Real"];
const IMAGINARIES: [&str; 5] = ["im", "imag", "imaginary", "Im", "Imag"];
const COHERENCES: [&str; 2] = ["coherence", "Coherence"];

/// Reads a frequency response and identifies its modes.
///
/// # Errors
///
/// Bad input.
pub fn resonance(roles: &Roles, path: &Path) -> Result<(Answer, Option<Shown>), Error> {
    let file = path.display().to_string();
    let there = columns::names(path)?;
    let usual = |given: &Option<Named>, names: &[&str]| {
        given.clone().or_else(|| {
            let found = names.iter().find(|n| there.iter().any(|t| t == *n));
            found.map(|n| Named::new(*n))
        })
    };
    let missing = |option: &str| {
        let message = format!(
            "no column has a usual name for it; name one: there are {}",
            there.join(", ")
        );
        Error::new(&file, option, message)
    };
    let frequency = usual(&roles.frequency, &FREQUENCIES).ok_or_else(|| missing("--frequency"))?;
    let parts = roles.parts.clone().or_else(|| {
        roles
            .magnitude
            .is_none()
            .then(|| usual(&None, &REALS).zip(usual(&None, &IMAGINARIES)))
            .flatten()
    });
    let coherence = usual(&roles.coherence, &COHERENCES);
    let names = [
        ("frequency_1", "Hz".to_owned()),
        ("damping_1", "1".to_owned()),
        ("delay", "s".to_owned()),
    ];
    let wanted = |option, named, of| Wanted { option, named, of };
    const RATIO: &[Dimension] = &[Dimension::Ratio];
    let (magnitude, phase);
    let mut list = vec![wanted(
        "--frequency",
        &frequency,
        &[Dimension::Frequency][..],
    )];
    if let Some((real, imaginary)) = &parts {
        list.push(wanted("--real", real, RATIO));
        list.push(wanted("--imaginary", imaginary, RATIO));
    } else {
        magnitude = usual(&roles.magnitude, &MAGNITUDES).ok_or_else(|| missing("--magnitude"))?;
        let Some(found) = usual(&roles.phase, &PHASES) else {
            let why = "it has no phase (--phase): without one neither a delay nor the sign of a mode is known";
            return Ok((Answer::nothing(&names, Unknown::all(why)), None));
        };
        phase = found;
        list.push(wanted(
            "--magnitude",
            &magnitude,
            &[Dimension::Ratio, Dimension::Decibel],
        ));
        list.push(wanted("--phase", &phase, &[Dimension::Angle]));
    }
    if let Some(coherence) = &coherence {
        list.push(wanted("--coherence", coherence, RATIO));
    }
    let read = columns::read(path, &list)?;
    let (a, b) = (&read[1], &read[2]);
    let response: Vec<Complex<f64>> = a
        .values
        .iter()
        .zip(&b.values)
        .map(|(a_k, b_k)| match (&parts, a.dimension) {
            (Some(_), _) => Complex::new(*a_k, *b_k),
            (None, Dimension::Decibel) => Complex::from_polar(10f64.powf(0.05 * a_k), *b_k),
            (None, _) => Complex::from_polar(*a_k, *b_k),
        })
        .collect();
    let weight = read.get(3).map(|c| &c.values[..]);
    let mut remarks = columns::remarks(&read);
    let large = b.values.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    if parts.is_none() && b.by == columns::By::Nothing && large > 7.0 {
        let message = format!(
            "reaches {large:.1}, which is much for radians; say its unit: \"{}:deg\" or \"{}:rad\"",
            b.name, b.name
        );
        return Err(Error::new(&file, &b.name, message));
    }
    if parts.is_none() && a.dimension == Dimension::Ratio && a.values.iter().any(|v| *v < 0.0) {
        let message = format!(
            "has values below zero, which no magnitude has; accepted are ratios, or decibels as \"{}:dB\"",
            a.name
        );
        return Err(Error::new(&file, &a.name, message));
    }
    let found = Record::new(&read[0].values, &response, weight).and_then(|r| identify(&r));
    let found = match found {
        Ok(found) => found,
        Err(unknown) => return Ok((Answer::nothing(&names, unknown), None)),
    };
    let unit = |name: &str| {
        if name.starts_with("frequency") {
            "Hz"
        } else if name == "delay" {
            "s"
        } else {
            "1"
        }
        .to_owned()
    };
    let mut answer = Answer {
        parameters: found
            .parameters
            .iter()
            .map(|p| (p.clone(), unit(p.name)))
            .collect(),
        relative_error_percent: Some(found.relative_error_percent),
        validation_error_percent: Some(found.validation_error_percent),
        condition: Some(found.condition),
        unknown: found.unknown.clone(),
        ..Answer::default()
    };
    answer.remarks.append(&mut remarks);
    let modes: Vec<String> = NAMES
        .iter()
        .take(found.modes)
        .filter_map(|[name, _]| {
            let parameter = found.parameters.iter().find(|p| p.name == *name)?;
            parameter.known.map(|k| format!("{} Hz", short(k.value)))
        })
        .collect();
    let told = format!(
        "{} modes, at {}: {} % off at the points held back",
        found.modes,
        modes.join(", "),
        short(found.validation_error_percent)
    );
    answer.verdict = answer.doubts().unwrap_or(told);
    answer.more.insert("modes".to_owned(), found.modes.into());
    let [magnitude, phase] = bode(&found.record.frequency, &found.record.response);
    let [told_magnitude, told_phase] = bode(&found.record.frequency, &found.told);
    let pair = |measured, told| {
        vec![
            ("measured".to_owned(), measured),
            ("modelled".to_owned(), told),
        ]
    };
    let errors: Vec<(f64, f64)> = found
        .record
        .frequency
        .iter()
        .zip(found.record.response.iter().zip(&found.told))
        .map(|(f, (h, t))| (*f, 100.0 * (h - t).norm() / h.norm().max(1e-300)))
        .collect();
    let figure = |y: &str, curves, caption: &str| Figure {
        x: "frequency, Hz".to_owned(),
        y: y.to_owned(),
        curves,
        caption: caption.to_owned(),
    };
    let shown = Shown {
        figures: vec![
            figure(
                "magnitude, dB",
                pair(magnitude, told_magnitude),
                "Magnitude, measured and by the modes.",
            ),
            figure(
                "phase, deg",
                pair(phase, told_phase),
                "Phase, measured and by the modes.",
            ),
            figure(
                "residual, %",
                vec![("residual".to_owned(), errors)],
                "How far the model is from each point, as a share of it.",
            ),
        ],
        ..Shown::default()
    };
    Ok((answer, Some(shown)))
}

/// The modes as a TOML text.
pub fn fragment(answer: &Answer) -> String {
    let mut text = "[resonance]\n".to_owned();
    for (parameter, unit) in &answer.parameters {
        if let Some(known) = parameter.known {
            let _ = writeln!(text, "{} = {:?} # {unit}", parameter.name, known.value);
        }
    }
    text
}

//! Modes from a frequency response.

use super::columns::{self, Named, TIME, Wanted, without_unit};
use super::{Answer, Figure, NOT_IDENTIFIABLE, Shown, short, with_units};
use nalgebra::Complex;
use pigtail_hal::Error;
use pigtail_hal::quantity::{ANGLE, Dimension, FREQUENCY, LEVEL, RATIO};
use pigtail_numerics::signal::quantile;
use pigtail_sysid::resonance::{Identified, NAMES, Record, bode, identify};
use pigtail_sysid::timeline::counted;
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

/// A name in lower case without its unit.
fn bare(name: &str) -> String {
    let low = without_unit(name).to_lowercase();
    let cut = low.as_str();
    let suffix = ["_hz", "_khz", "_db", "_deg", "_rad"];
    let cut = suffix
        .iter()
        .find_map(|unit| cut.strip_suffix(unit))
        .unwrap_or(cut);
    cut.to_owned()
}

/// The columns that were chosen.
struct Chosen {
    frequency: Named,
    /// Magnitude, or the real part.
    first: Named,
    /// Phase, or the imaginary part; a magnitude may be there alone.
    second: Option<Named>,
    polar: bool,
    coherence: Option<Named>,
}

/// A frequency response that was read.
struct Response {
    frequency: Vec<f64>,
    values: Vec<Complex<f64>>,
    phased: bool,
    weight: Option<Vec<f64>>,
    remarks: Vec<String>,
    understood: String,
    /// The magnitude's column where nobody said that it is a ratio, and no phase shows it.
    assumed: Option<String>,
}

impl Roles {
    /// The columns by their names, or by their usual names.
    fn choose(&self, table: &columns::Table) -> Result<Chosen, Error> {
        let there = table.names();
        let usual = |given: &Option<Named>, names: &[&str]| {
            given.clone().or_else(|| {
                let found = names.iter().find(|n| there.iter().any(|t| t == *n));
                // `Magnitude [dB]` is one too, where no other is.
                let mut like = there.iter().filter(|t| names.contains(&&*bare(t)));
                let like = like.next().filter(|_| like.next().is_none());
                let found = found.map(|n| (*n).to_owned()).or_else(|| like.cloned());
                found.map(Named::new)
            })
        };
        let missing = |option: &str| {
            let message = format!(
                "no column has a usual name for it; name one: there are {}",
                there.join(", ")
            );
            table.error(option, message)
        };
        let frequency =
            usual(&self.frequency, &FREQUENCIES).ok_or_else(|| missing("--frequency"))?;
        let coherence = usual(&self.coherence, &COHERENCES);
        let found = || usual(&None, &REALS).zip(usual(&None, &IMAGINARIES));
        let parts = self.parts.clone().or_else(|| {
            let polar = self.magnitude.is_some() || self.phase.is_some();
            if polar { None } else { found() }
        });
        if let Some((real, imaginary)) = parts {
            return Ok(Chosen {
                frequency,
                first: real,
                second: Some(imaginary),
                polar: false,
                coherence,
            });
        }
        let magnitude =
            usual(&self.magnitude, &MAGNITUDES).ok_or_else(|| missing("--magnitude"))?;
        Ok(Chosen {
            frequency,
            first: magnitude,
            second: usual(&self.phase, &PHASES),
            polar: true,
            coherence,
        })
    }
}

impl Chosen {
    fn read(&self, path: &Path, table: &columns::Table) -> Result<Response, Error> {
        let file = path.display().to_string();
        let wanted = |option, named, of| Wanted { option, named, of };
        let mut list = vec![wanted("--frequency", &self.frequency, &[FREQUENCY][..])];
        let [first, second] = if self.polar {
            ["--magnitude", "--phase"]
        } else {
            ["--real", "--imaginary"]
        };
        let sizes: &[Dimension] = if self.polar {
            &[RATIO, LEVEL]
        } else {
            &[RATIO]
        };
        list.push(wanted(first, &self.first, sizes));
        if let Some(coherence) = &self.coherence {
            list.push(wanted("--coherence", coherence, &[RATIO]));
        }
        if let Some(named) = &self.second {
            let of: &[Dimension] = if self.polar { &[ANGLE] } else { &[RATIO] };
            list.push(wanted(second, named, of));
        }
        let mut read = columns::read(table, &list)?;
        self.of_a_response(table, &list)?;
        let mut remarks = columns::remarks(&read);
        let understood = columns::understood(table, &list, &read, None);
        let b = self.second.is_some().then(|| read.pop()).flatten();
        let a = &read[1];
        let unsure = |b: &columns::Column| {
            let large = b.values.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            (self.polar && b.by == columns::By::Nothing && large > 7.0).then_some(large)
        };
        if let Some((b, large)) = b.as_ref().and_then(|b| unsure(b).map(|l| (b, l))) {
            let message = format!(
                "reaches {large:.1}, which is much for radians; say its unit: \"{}:deg\" or \"{}:rad\"",
                b.name, b.name
            );
            return Err(Error::new(&file, &b.name, message));
        }
        let below = a.values.iter().any(|v| *v < 0.0);
        if self.polar && a.dimension == RATIO && below {
            let message = format!(
                "has values below zero, which no magnitude has; accepted are ratios, or decibels as \
                 \"{}:dB\"",
                a.name
            );
            return Err(Error::new(&file, &a.name, message));
        }
        if b.is_none() {
            remarks.push(
                "no column of phase: modes are told by magnitude alone, a delay is not".to_owned(),
            );
        }
        let other = |k: usize| b.as_ref().map_or(0.0, |b| b.values[k]);
        let mut values: Vec<Complex<f64>> = a
            .values
            .iter()
            .enumerate()
            .map(|(k, a_k)| match (self.polar, a.dimension) {
                (false, _) => Complex::new(*a_k, other(k)),
                (true, LEVEL) => Complex::from_polar(10f64.powf(0.05 * a_k), other(k)),
                (true, _) => Complex::from_polar(*a_k, other(k)),
            })
            .collect();
        remarks.extend(without_zeros(&mut values));
        let assumed = self.polar && b.is_none() && a.by == columns::By::Nothing;
        let assumed = assumed.then(|| a.name.clone());
        let mut weight = (read.len() > 2).then(|| read.remove(2).values);
        let mut frequency = read.remove(0).values;
        if upwards(&mut frequency, &mut values, weight.as_mut()) {
            remarks.push("frequencies fall from row to row: read from the last one".to_owned());
        }
        Ok(Response {
            assumed,
            values,
            phased: b.is_some(),
            weight,
            frequency,
            remarks,
            understood,
        })
    }
}

impl Chosen {
    /// That no size is in a unit that none has: a response is of anything over anything, but no time, no frequency, and no level where
    /// a ratio is wanted; its two parts are in one unit, so that a phase is no imaginary part.
    fn of_a_response(&self, table: &columns::Table, list: &[Wanted]) -> Result<(), Error> {
        let said = |named: &Named| {
            let place = table.place(named.name()).ok()?;
            table.own_unit(place)
        };
        for want in list.iter().filter(|w| w.of.contains(&RATIO)) {
            if let Some((of, unit)) = said(want.named)
                && ([TIME, FREQUENCY].contains(&of) || of == LEVEL && !want.of.contains(&LEVEL))
            {
                let message = format!(
                    "its name says {unit}, which is no unit for {}; accepted is a ratio, or a size over what drives it",
                    want.option
                );
                return Err(table.error(want.named.name(), message));
            }
        }
        let Some(second) = self.second.as_ref().filter(|_| !self.polar) else {
            return Ok(());
        };
        let units = [said(&self.first), said(second)].map(|unit| unit.map(|(_, unit)| unit));
        if units[0] == units[1] {
            return Ok(());
        }
        let [real, imaginary] = units.map(|unit| unit.unwrap_or("no unit"));
        let message = format!(
            "its name says {imaginary}, and that of the real part, {}, {real}; accepted are two parts in one unit: is it a phase \
             (--magnitude, --phase)?",
            self.first.name()
        );
        Err(table.error(second.name(), message))
    }
}

/// Turns a response that was swept downwards round; whether it was.
fn upwards(
    frequency: &mut [f64],
    values: &mut [Complex<f64>],
    weight: Option<&mut Vec<f64>>,
) -> bool {
    let falls = frequency.len() > 2 && frequency.windows(2).all(|w| w[1] < w[0]);
    if falls {
        frequency.reverse();
        values.reverse();
        if let Some(weight) = weight {
            weight.reverse();
        }
    }
    falls
}

/// Takes the value of points at which the response is zero: none is that to the last digit, a reading that was lost is, and a narrow mode would
/// be told from it. Of a response that is zero throughout there is nothing else to be said.
fn without_zeros(values: &mut [Complex<f64>]) -> Option<String> {
    let zeros = values.iter().filter(|h| h.norm() == 0.0).count();
    if zeros == 0 || zeros == values.len() {
        return None;
    }
    for h in values.iter_mut().filter(|h| h.norm() == 0.0) {
        *h = Complex::new(f64::NAN, f64::NAN);
    }
    Some(format!(
        "{} at which the response is 0, left out: it was not measured, or is too small to be written",
        counted(zeros, "point")
    ))
}

/// Reads a frequency response and identifies its modes.
///
/// # Errors
///
/// Bad input.
pub fn resonance(roles: &Roles, path: &Path) -> Result<(Answer, Option<Shown>), Error> {
    let names = ["frequency_1", "damping_1", "delay"];
    let table = columns::Table::open(path)?;
    let read = roles.choose(&table)?.read(path, &table)?;
    let weight = read.weight.as_deref();
    let record = if read.phased {
        Record::new(&read.frequency, &read.values, weight)
    } else {
        let sizes: Vec<f64> = read.values.iter().map(|h| h.re).collect();
        Record::of_magnitude(&read.frequency, &sizes, weight)
    };
    let found = record.and_then(|record| identify(&record));
    if let Some(name) = &read.assumed
        && decibels(&read, found.as_ref().ok())
    {
        let message = format!(
            "is told better as decibels than as the ratio that it is taken for; say its unit: \"{name}:dB\" or \"{name}:1\""
        );
        return Err(Error::new(path.display().to_string(), &**name, message));
    }
    let (mut answer, shown) = match found {
        Ok(found) => (answer(&found, read.remarks), Some(shown(&found))),
        Err(unknown) => (
            Answer::nothing(names.map(|n| (n, unit(n))), unknown, &[]),
            None,
        ),
    };
    answer
        .more
        .insert("read".to_owned(), read.understood.into());
    Ok((answer, shown))
}

/// Whether a magnitude that is taken for a ratio is decibels: modes leave less of it beside its noise so.
fn decibels(read: &Response, found: Option<&Identified>) -> bool {
    /// Highest decibels that anybody writes, and the share of what is left that is left less.
    const MOST: f64 = 400.0;
    const LESS: f64 = 0.5;
    let sizes: Vec<f64> = read.values.iter().map(|h| h.re).collect();
    let powers: Vec<f64> = sizes.iter().map(|v| 10f64.powf(0.05 * v)).collect();
    if sizes.iter().any(|v| *v > MOST) {
        return false;
    }
    let weight = read.weight.as_deref();
    let Ok(other) =
        Record::of_magnitude(&read.frequency, &powers, weight).and_then(|r| identify(&r))
    else {
        return false;
    };
    let left = |error: f64, values: &[f64]| error / roughness(values);
    let own = found.map_or(f64::INFINITY, |f| left(f.relative_error_percent, &sizes));
    left(other.relative_error_percent, &powers) < LESS * own
}

/// How far magnitudes lie off the middle of their neighbours, as a share of themselves: what noise makes of them.
fn roughness(sizes: &[f64]) -> f64 {
    let off: Vec<f64> = sizes
        .windows(3)
        .map(|w| (w[1] - 0.5 * (w[0] + w[2])).abs() / w[1].abs().max(f64::MIN_POSITIVE))
        .filter(|off| off.is_finite())
        .collect();
    quantile(&off, 0.3).max(f64::MIN_POSITIVE)
}

/// Unit of a parameter.
fn unit(name: &str) -> String {
    if name.starts_with("frequency") {
        "Hz"
    } else if name == "delay" {
        "s"
    } else {
        "1"
    }
    .to_owned()
}

fn answer(found: &Identified, remarks: Vec<String>) -> Answer {
    let mut answer = Answer {
        parameters: with_units(&found.parameters, unit),
        relative_error_percent: Some(found.relative_error_percent),
        validation_error_percent: Some(found.validation_error_percent),
        condition: Some(found.condition),
        unknown: found.unknown.clone(),
        remarks,
        ..Answer::default()
    };
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
    // That a magnitude has no phase is no news, and nothing against its modes.
    answer.verdict = if found.record.is_phased() || found.unknown.len() > 1 {
        answer.doubts().unwrap_or(told)
    } else {
        format!(
            "{told}; the delay is {NOT_IDENTIFIABLE}, because {}",
            found.unknown[0].because
        )
    };
    answer.more.insert("modes".to_owned(), found.modes.into());
    answer
        .more
        .insert("peaks_Hz".to_owned(), found.peaks.clone().into());
    let poles = &found.real_poles;
    answer
        .more
        .insert("real_poles_Hz".to_owned(), poles.clone().into());
    let text = |f: &f64| format!("{} Hz", short(*f));
    let peaks: Vec<String> = found
        .peaks
        .iter()
        .map(|p| p.as_ref().map_or_else(|| "none".to_owned(), text))
        .collect();
    answer.remarks.push(format!(
        "frequencies are those of the poles; the magnitude is highest near them at {}",
        peaks.join(", ")
    ));
    if !found.set_aside.is_empty() {
        let apart: Vec<String> = found.set_aside.iter().map(text).collect();
        answer.remarks.push(format!(
            "{} apart from the neighbours set aside, at {}",
            counted(apart.len(), "point"),
            apart.join(", ")
        ));
    }
    answer
        .more
        .insert("set_aside_Hz".to_owned(), found.set_aside.clone().into());
    if !poles.is_empty() {
        let poles: Vec<String> = poles.iter().map(text).collect();
        let many = if poles.len() == 1 { "pole" } else { "poles" };
        answer.remarks.push(format!(
            "beside the modes {} real {many} (creep, a filter), at {}",
            poles.len(),
            poles.join(", ")
        ));
    }
    answer
}

fn shown(found: &Identified) -> Shown {
    let [magnitude, phase] = bode(&found.record.frequency, &found.record.response);
    let [predicted_magnitude, predicted_phase] = bode(&found.record.frequency, &found.prediction);
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
        .zip(found.record.response.iter().zip(&found.prediction))
        .map(|(f, (h, t))| (*f, 100.0 * (h - t).norm() / h.norm().max(1e-300)))
        .collect();
    let figure = |y: &str, curves, caption: &str| Figure {
        x: "frequency, Hz".to_owned(),
        log_x: true,
        y: y.to_owned(),
        curves,
        caption: caption.to_owned(),
    };
    let phases = figure(
        "phase, deg",
        pair(phase, predicted_phase),
        "Phase, measured and by the modes.",
    );
    let phases = found.record.is_phased().then_some(phases);
    Shown {
        figures: [
            Some(figure(
                "magnitude, dB",
                pair(magnitude, predicted_magnitude),
                "Magnitude, measured and by the modes.",
            )),
            phases,
            Some(figure(
                "residual, %",
                vec![("residual".to_owned(), errors)],
                "How far the model is from each point, as a share of it.",
            )),
        ]
        .into_iter()
        .flatten()
        .collect(),
        ..Shown::default()
    }
}

/// Whether all of its modes are known: what a fragment carries.
pub fn carries(answer: &Answer) -> bool {
    let modes = answer.parameters.iter().filter(|(p, _)| p.name != "delay");
    let known = modes.clone().filter(|(p, _)| p.known.is_some()).count();
    known > 0 && known == modes.count() && !super::servo::is_negative(answer)
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

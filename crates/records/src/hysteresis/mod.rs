//! Models of a piezo's hysteresis: from a record that a person brings, or from a machine.

mod data;
mod lost;
mod rates;

pub use data::{Columns, Data, Read, WantedPath};

use crate::columns::LengthUnit;
use pigtail_control::compensation::hysteresis::{
    Creep, Errors, Invalid, Memory, Model, Range, Rbf, Record, Zero, fit_memory, invert, judge,
    predict, straight,
};
use pigtail_hal::{Error, Side};
use pigtail_numerics::regression::{least_squares, matrix};
use pigtail_numerics::rounded;
use pigtail_numerics::signal::rms;
use serde::{Deserialize, Serialize};
use std::ops;
use std::path::Path;

/// Which model of hysteresis.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    strum::EnumMessage,
    strum::EnumString,
    strum::IntoStaticStr,
    strum::VariantArray,
    Serialize,
)]
#[strum(serialize_all = "kebab-case")]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Play operators behind a static curve, with creep: right after any history
    Memory,
    /// The thesis's radial basis networks of one turning point, (4.3)-(4.6)
    Rbf,
}

/// Which micro manipulators.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    strum::EnumMessage,
    strum::EnumString,
    strum::IntoStaticStr,
    strum::VariantArray,
)]
#[strum(serialize_all = "kebab-case")]
pub enum Micros {
    /// Each by itself
    Both,
    /// The one that carries the input fiber
    Left,
    /// The one that carries the output fibers and the sensing fiber
    Right,
}

impl Micros {
    /// Their sides.
    pub fn sides(self) -> &'static [Side] {
        match self {
            Self::Both => &[Side::Left, Side::Right],
            Self::Left => &[Side::Left],
            Self::Right => &[Side::Right],
        }
    }
}

/// Share of a record that a model is fitted to; the rest is held back.
const FITTED: f64 = 0.75;

/// A model on disk.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelFile {
    /// When it was found.
    pub date: String,
    /// By which run.
    pub origin: String,
    /// The columns it was made from; those of another record where none are named.
    pub columns: Columns,
    /// Unit of displacement in those records.
    pub unit: LengthUnit,
    /// The model, volts to micrometres.
    pub model: Model,
}

impl ModelFile {
    /// Reads a model.
    ///
    /// # Errors
    ///
    /// When the file cannot be read or is no model.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let name = path.display().to_string();
        let text = std::fs::read_to_string(path)
            .map_err(|error| Error::new(&name, "", format!("cannot be read: {error}")))?;
        let file: Self = serde_json::from_str(&text).map_err(|error| {
            let line = Some(error.line()).filter(|line| *line > 0);
            let message = format!("{error}; accepted is a model.json of `identify hysteresis`");
            Error {
                line,
                ..Error::new(&name, "", message)
            }
        })?;
        file.model
            .check()
            .map_err(|invalid| Error::new(&name, "model", invalid.to_string()))?;
        Ok(file)
    }
}

/// Errors of a model over a part of a record.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Part {
    /// Root mean square of the model's errors, micrometres.
    pub rms_um: f64,
    /// Largest of them, micrometres.
    pub max_um: f64,
    /// The same of the best straight line.
    pub uncompensated_rms_um: f64,
    /// Its largest.
    pub uncompensated_max_um: f64,
}

impl Part {
    fn new(model: &Errors, line: &Errors) -> Self {
        let um = |value: f64| rounded(value, 1e-6);
        Self {
            rms_um: um(model.rms),
            max_um: um(model.largest),
            uncompensated_rms_um: um(line.rms),
            uncompensated_max_um: um(line.largest),
        }
    }
}

/// What `identify hysteresis --data` and `predict` print as JSON and keep as `summary.json`.
///
/// Errors are of displacement; a percentage is root mean square over range.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HysteresisDocument {
    /// The model.
    pub model: &'static str,
    /// Root mean square of its errors: on the part held back, or on the whole of another record.
    pub rms_um: f64,
    /// Largest of them.
    pub max_um: f64,
    /// Range of the displacement.
    pub range_um: f64,
    /// `rms_um` over `range_um`.
    pub percent_of_range: f64,
    /// The same of the best straight line through the same samples.
    pub uncompensated_percent: f64,
    /// How many times better than that.
    pub improvement: f64,
    /// Number of basis functions or play operators.
    pub functions: usize,
    /// Largest error over range.
    pub max_percent: f64,
    /// Errors on what it was fitted to; not in a prediction.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fitted: Option<Part>,
    /// Errors on what was held back; not in a prediction.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub held_back: Option<Part>,
    /// By how much displacement lags behind voltage, milliseconds.
    pub lag_ms: f64,
    /// How far off the model would be without that lag, root mean square, per cent of the range: as far as it is off where the lag is of the
    /// record's logger and not of amplifier and sensor; only where it was fitted, and of a model with memory.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lag_percent: Option<f64>,
    /// How far off the model may be at the record's rates, root mean square, per cent of the range, whether its lag is of amplifier and
    /// sensor or of the record's logger: its own error and what the lag moves, at one rate whatever lag tells the record as well; with `lag_percent`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub known_to_percent: Option<f64>,
    /// What was taken off the prediction, for a sensor's zero is arbitrary; only in a prediction.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub offset_um: Option<f64>,
    /// Root mean square error of the voltage; only of an inverse with a voltage to compare with.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rms_v: Option<f64>,
    /// Samples that were judged.
    pub samples: usize,
    /// Why the model is none of the record; empty where it is.
    pub doubt: String,
    /// How the file was read, in words.
    pub read: String,
    /// What was done to the record, and assumed of it.
    pub remarks: Vec<String>,
    /// Path of the model.
    pub model_file: String,
    /// Path of the report.
    pub report: String,
}

impl HysteresisDocument {
    fn new(model: &Model, part: &Part, about_mean: f64, range: f64, samples: usize) -> Self {
        let percent = |um: f64| rounded(100.0 * um / range, 1e-6);
        Self {
            model: model.name(),
            rms_um: part.rms_um,
            max_um: part.max_um,
            range_um: rounded(range, 1e-6),
            percent_of_range: percent(part.rms_um),
            uncompensated_percent: percent(part.uncompensated_rms_um),
            improvement: rounded(
                part.uncompensated_rms_um / part.rms_um.max(f64::MIN_POSITIVE),
                1e-3,
            ),
            functions: model.functions(),
            max_percent: percent(part.max_um),
            fitted: None,
            held_back: None,
            lag_ms: rounded(1e3 * model.lag(), 1e-3),
            lag_percent: None,
            known_to_percent: None,
            offset_um: None,
            rms_v: None,
            samples,
            doubt: doubt(
                percent(part.rms_um),
                percent(part.uncompensated_rms_um),
                percent(about_mean),
            ),
            read: String::new(),
            remarks: Vec::new(),
            model_file: String::new(),
            report: String::new(),
        }
    }

    /// That a lag counts: a logger that reads displacement late looks as an amplifier or a sensor does that lags, and a model of the one is none
    /// of the other.
    fn of_a_logger(&self) -> Option<String> {
        let worth = self.lag_percent?;
        (self.lag_ms > 0.0 && worth > self.percent_of_range).then(|| {
            format!(
                "displacement lags by {:.3} ms, and the model with it, as of an amplifier or a sensor. Was it read late by the logger alone, then the model is \
                 {worth:.2} % of the range off at these rates, not {:.2}: no record tells the two apart",
                self.lag_ms, self.percent_of_range
            )
        })
    }
}

/// What errors, in per cent of the range, say against a model, beside those of the best straight line and of the mean.
fn doubt(own: f64, line: f64, mean: f64) -> String {
    const THIRD: f64 = 1.0 / 3.0;
    const WORSE: f64 = 1.5;
    if own > THIRD * mean {
        format!(
            "it is {own:.0} % of the range off, and the displacement's mean alone {mean:.0} %: are units and columns \
             right, and is it the same piezo?"
        )
    } else if own > WORSE * line {
        format!("it is {own:.2} % of the range off, the best straight line {line:.2} %")
    } else {
        String::new()
    }
}

/// Parts of a record whose gains are held against each other, and the share of all range that each has at least.
const PARTS: usize = 4;
const RANGE: f64 = 0.3;

/// Deviations by which gains differ where they do, and by which share of them that is said, and more than any piezo does.
const SURE: f64 = 3.0;
const SAID: f64 = 0.05;
const MOST: f64 = 0.15;

/// By which share the gains of a record's parts differ, by displacement over the model's; zero where they do not for certain.
fn gains_apart(prediction: &[f64], output: &[f64], over: &ops::Range<usize>) -> f64 {
    let whole = Range::of(&output[over.clone()]).width();
    let gains: Vec<[f64; 2]> = (0..PARTS)
        .filter_map(|part| {
            let at = |k: usize| over.start + k * over.len() / PARTS;
            let rows = at(part)..at(part + 1);
            let (told, is) = (&prediction[rows.clone()], &output[rows]);
            if Range::of(is).width() < RANGE * whole {
                return None;
            }
            let found = least_squares(&matrix(&[told, &vec![1.0; told.len()]]), is)?;
            Some([found.values[0], found.std_correlated[0]])
        })
        .collect();
    let by = |a: &&[f64; 2], b: &&[f64; 2]| a[0].total_cmp(&b[0]);
    let (Some(least), Some(most)) = (gains.iter().min_by(by), gains.iter().max_by(by)) else {
        return 0.0;
    };
    let apart = most[0] - least[0];
    if apart > SURE * most[1].hypot(least[1]) {
        apart
    } else {
        0.0
    }
}

/// Says that a gain changes within a record, and doubts a model of what changes by more than any piezo.
fn doubt_gain(document: &mut HysteresisDocument, apart: f64) {
    let said = format!(
        "its gain changes within the record: that of quarters differs by {:.0} %. Was a gain of the amplifier or the sensor another one?",
        100.0 * apart
    );
    if apart > MOST && document.doubt.is_empty() {
        document.doubt = said;
    } else if apart > SAID {
        document.remarks.push(said);
    }
}

/// Root mean square about the mean.
fn about_mean(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    rms(values.iter().map(|v| v - mean))
}

/// A model with the record it was fitted to or tried on.
#[derive(Debug, Clone)]
pub struct Tried {
    /// What to print.
    pub document: HysteresisDocument,
    /// The record, volts and micrometres.
    pub record: Record,
    /// The displacement that the model tells, at every sample of the record; in the record's zero.
    pub prediction: Vec<f64>,
    /// What was judged.
    pub judged: ops::Range<usize>,
    /// The model.
    pub model: Model,
}

impl Tried {
    /// Doubts a model of a record that says how long its samples are apart where it lags as no piezo does: its times are in another unit.
    pub fn doubt_lag(&mut self) {
        /// Seconds and sample periods: amplifiers and sensors take milliseconds, and what is averaged over a sample and held for another lags by
        /// one. Set after records whose milliseconds were read as seconds lagged by 1.49.
        const LONGEST: f64 = 0.3;
        const PERIODS: f64 = 1.0;
        let n = self.record.len();
        let period = (self.record.time[n - 1] - self.record.time[0]) / (n - 1) as f64;
        let lag = self.model.lag();
        if lag > LONGEST.max(PERIODS * period) && self.document.doubt.is_empty() {
            self.document.doubt = format!(
                "displacement lags behind voltage by {lag:.2} s, which no piezo does, of samples {period:.3} s apart: are times in another unit?"
            );
        }
    }
}

/// Fits a model to the first part of a record, and judges it on both parts.
///
/// # Errors
///
/// When the record says too little for that model.
pub fn fit(record: Record, kind: Kind) -> Result<Tried, Invalid> {
    let to = (FITTED * record.len() as f64) as usize;
    let mut remarks = Vec::new();
    let model = match kind {
        Kind::Memory => {
            let own = fit_memory(&record, to, None, Creep::Any)?;
            let ahead = rates::ahead(&record, to, &own);
            remarks.extend(ahead.map(|model| {
                format!(
                    "displacement is read {:.3} ms before the voltage of its row, by what that leaves; the model has it so",
                    -1e3 * model.lag
                )
            }));
            Model::Memory(ahead.unwrap_or(own))
        }
        Kind::Rbf => Model::Rbf(Rbf::train(&record.before(to)?)?),
    };
    let at_one = rates::at_one(&record);
    let prediction = predict(&model, &record);
    let from = record.known_from().min(to / 2);
    let part = |over: ops::Range<usize>| {
        let errors =
            |prediction: &[f64]| judge(prediction, &record.output, over.clone(), Zero::Known);
        Part::new(
            &errors(&prediction),
            &errors(&straight(&record, over.clone())),
        )
    };
    let (fitted, held_back) = (part(from..to), part(to..record.len()));
    let range = Range::of(&record.output[from..]).width();
    let mut document = HysteresisDocument::new(
        &model,
        &held_back,
        about_mean(&record.output[to..]),
        range,
        record.len() - to,
    );
    // What a model does not tell of what it was fitted to it knows nothing of, however well it goes with the rest.
    if document.doubt.is_empty() {
        let own = &record.output[from..to];
        let share = |um: f64| 100.0 * um / Range::of(own).width();
        let doubt = doubt(
            share(fitted.rms_um),
            share(fitted.uncompensated_rms_um),
            share(about_mean(own)),
        );
        if !doubt.is_empty() {
            document.doubt = format!("where it was fitted {doubt}");
        }
    }
    let share = |um: f64| rounded(100.0 * um / range, 1e-6);
    let worth = worth_of_lag(&model, &record, &prediction, to);
    document.lag_percent = worth.map(share);
    document.known_to_percent = worth.map(|worth| {
        let other = match &model {
            Model::Memory(_) if at_one.is_some() => rates::any_lag(&record, to, &prediction),
            _ => 0.0,
        };
        share(held_back.rms_um.hypot(worth.max(other)))
    });
    remarks.extend(at_one);
    remarks.extend(document.of_a_logger());
    document.remarks = remarks;
    document.fitted = Some(fitted);
    document.held_back = Some(held_back);
    doubt_gain(
        &mut document,
        gains_apart(&prediction, &record.output, &(from..record.len())),
    );
    Ok(Tried {
        document,
        judged: to..record.len(),
        prediction,
        model,
        record,
    })
}

/// How far a model's lag moves what it tells from a sample on, root mean square, micrometres.
fn worth_of_lag(model: &Model, record: &Record, prediction: &[f64], from: usize) -> Option<f64> {
    let Model::Memory(own) = model else {
        return None;
    };
    let without = predict(&Model::Memory(Memory { lag: 0.0, ..*own }), record);
    let apart = prediction.iter().zip(&without).skip(from);
    Some(rms(apart.map(|(a, b)| a - b)))
}

/// Lets a model tell another record.
pub fn tell(model: &Model, record: Record) -> Tried {
    let mut prediction = predict(model, &record);
    let over = record.known_from().min(record.len() / 2)..record.len();
    let errors = judge(&prediction, &record.output, over.clone(), Zero::Arbitrary);
    for x in &mut prediction {
        *x -= errors.offset;
    }
    let line = straight(&record, over.clone());
    let line = judge(&line, &record.output, over.clone(), Zero::Known);
    let range = Range::of(&record.output[over.clone()]).width();
    let part = Part::new(&errors, &line);
    let mut document = HysteresisDocument::new(
        model,
        &part,
        about_mean(&record.output[over.clone()]),
        range,
        over.len(),
    );
    document.offset_um = Some(rounded(errors.offset, 1e-6));
    document.remarks.extend(beyond(model, &record));
    doubt_gain(
        &mut document,
        gains_apart(&prediction, &record.output, &over),
    );
    Tried {
        document,
        prediction,
        judged: over,
        model: model.clone(),
        record,
    }
}

/// That a voltage goes beyond those that a model was made of, for what it tells there it was never shown.
fn beyond(model: &Model, record: &Record) -> Option<String> {
    /// Of the model's range: as much as noise and another amplifier's zero make.
    const SHARE: f64 = 0.02;
    let ((own, _), is) = (ranges(model), record.input_range());
    let room = SHARE * own.width();
    (is.low < own.low - room || is.high > own.high + room).then(|| {
        format!(
            "the voltage goes from {:.3} to {:.3} V, and the model was made of {:.3} to {:.3} V: what it tells beyond it was never shown",
            is.low, is.high, own.low, own.high
        )
    })
}

/// A path and the voltages for it.
#[derive(Debug, Clone)]
pub struct Inverted {
    /// Seconds.
    pub time: Vec<f64>,
    /// What is wanted, micrometres.
    pub wanted: Vec<f64>,
    /// The voltage for it.
    pub volts: Vec<f64>,
    /// What was added to the path to lie where the model is.
    pub offset: f64,
}

/// The voltages for a path. A path that does not lie in the model's range of displacement is moved
/// to its middle.
pub fn voltages(model: &Model, time: Vec<f64>, wanted: Vec<f64>) -> Inverted {
    let (input, output) = ranges(model);
    let path = Range::of(&wanted);
    let inside = path.low >= output.low && path.high <= output.high;
    let offset = if inside {
        0.0
    } else {
        0.5 * (output.low + output.high - path.low - path.high)
    };
    let moved: Vec<f64> = wanted.iter().map(|x| x + offset).collect();
    let volts = invert(model, &model.switched_on(), &time, &moved, &input);
    Inverted {
        time,
        wanted,
        volts,
        offset,
    }
}

impl Inverted {
    /// By how much a path goes further than a model ever did, micrometres over micrometres: no voltage of its range brings a piezo
    /// there.
    pub fn too_far(model: &Model, wanted: &[f64]) -> Option<(f64, f64)> {
        /// Of the model's range: what creep adds to it.
        const SHARE: f64 = 0.02;
        let (path, own) = (Range::of(wanted).width(), ranges(model).1.width());
        (path > (1.0 + SHARE) * own).then_some((path, own))
    }

    /// That a path is not reached where the voltage stands at an end of its range.
    pub fn at_ends(&self, model: &Model) -> Option<String> {
        let (input, _) = ranges(model);
        let often = self.volts.iter();
        let often = often
            .filter(|v| **v <= input.low || **v >= input.high)
            .count();
        (often > 0).then(|| {
            format!(
                "{often} of {} voltages stand at an end of the model's {:.3} to {:.3} V: the path is not reached there",
                self.volts.len(),
                input.low,
                input.high
            )
        })
    }
}

/// The voltages for the displacements of a record, beside those that were there. An error of the
/// voltage counts as the displacement that it makes by the straight line through the record.
pub fn voltages_of(model: &Model, record: Record) -> (Tried, Inverted) {
    let mut tried = tell(model, record);
    let record = &tried.record;
    let offset = tried.document.offset_um.unwrap_or(0.0);
    let (input, _) = ranges(model);
    let start = model.at_rest(record.input[0]);
    let moved: Vec<f64> = record.output.iter().map(|x| x + offset).collect();
    let volts = invert(model, &start, &record.time, &moved, &input);
    let over = tried.judged.clone();
    let errors = judge(&volts, &record.input, over.clone(), Zero::Known);
    // The line through voltage against displacement, and what it is worth in displacement.
    let worth = record.output_range().width() / record.input_range().width();
    if let Ok(swapped) = Record::new(
        record.time.clone(),
        record.output.clone(),
        record.input.clone(),
    ) {
        let line = straight(&swapped, over.clone());
        let line = judge(&line, &record.input, over.clone(), Zero::Known);
        let in_um = |e: &Errors| Errors {
            rms: worth * e.rms,
            largest: worth * e.largest,
            offset: e.offset,
        };
        let part = Part::new(&in_um(&errors), &in_um(&line));
        let range = tried.document.range_um;
        let mut document = HysteresisDocument::new(
            model,
            &part,
            about_mean(&record.output[over.clone()]),
            range,
            over.len(),
        );
        document.offset_um = tried.document.offset_um;
        document.rms_v = Some(rounded(errors.rms, 1e-6));
        // What its account of the displacement showed is so for the voltage, too.
        document.remarks = std::mem::take(&mut tried.document.remarks);
        if document.doubt.is_empty() {
            document.doubt = std::mem::take(&mut tried.document.doubt);
        }
        tried.document = document;
    }
    let inverted = Inverted {
        time: record.time.clone(),
        wanted: record.output.clone(),
        volts,
        offset,
    };
    tried.document.remarks.extend(inverted.at_ends(model));
    (tried, inverted)
}

/// Voltages and displacements of a model.
pub fn ranges(model: &Model) -> (Range, Range) {
    match model {
        Model::Rbf(model) => (model.input, model.output),
        Model::Memory(model) => (model.input, model.output),
    }
}

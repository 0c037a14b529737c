//! Records that a person brings: columns of a file, read as every other record is.

use super::lost;
use crate::columns::{self, By, LengthUnit, Named, TIME, Table, Wanted};
use pigtail_control::compensation::hysteresis::{Invalid, Range, Record};
use pigtail_hal::Error;
use pigtail_hal::quantity::{LENGTH, VOLTAGE};
use pigtail_numerics::signal::quantile;
use pigtail_sysid::outliers;
use pigtail_sysid::timeline::{Clock, Even, counted};
use std::path::{Path, PathBuf};

/// Which columns of a file.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Columns {
    /// The voltage's.
    pub input: String,
    /// The displacement's.
    pub output: String,
    /// The time's; samples are a second apart where there is none.
    pub time: Option<String>,
}

/// A record's file.
#[derive(Debug, Clone)]
pub struct Data {
    path: PathBuf,
    table: Table,
    rate: Option<f64>,
}

/// A record that was read.
#[derive(Debug, Clone)]
pub struct Read {
    /// Volts and micrometres.
    pub record: Record,
    /// The columns, time's too.
    pub columns: Columns,
    /// Unit of the displacement in the file.
    pub unit: LengthUnit,
    /// How the file was read, in words.
    pub understood: String,
    /// What was done to it.
    pub remarks: Vec<String>,
    /// Whether it says how long its samples are apart.
    pub timed: bool,
}

/// A path that is wanted, and no voltages.
#[derive(Debug, Clone)]
pub struct WantedPath {
    /// Seconds.
    pub time: Vec<f64>,
    /// Micrometres.
    pub wanted: Vec<f64>,
    /// How the file was read, in words.
    pub understood: String,
    /// What was done to it.
    pub remarks: Vec<String>,
    /// Whether it says how long its samples are apart.
    pub timed: bool,
}

/// What is said of a record without times.
const UNTIMED: &str = "no column of time: samples are taken to be a second apart";

/// Time, displacement and voltage.
type Samples = (Vec<f64>, Vec<f64>, Vec<f64>);

/// Largest share of samples that may be set aside as spikes.
const SPIKES: f64 = 0.02;

/// Of a voltage's range less than this share is said.
const LESS: f64 = 0.95;

/// A plateau lies within so many of its noise's standard deviations.
const PLATEAU: f64 = 8.0;

/// A record of more gaps than this was not taken evenly.
const FEW_GAPS: usize = 8;

/// Whether a sample of the displacement is further from its neighbours than any motion of the record goes.
fn stands_apart(even: &Even) -> bool {
    const FAR: f64 = 3.0;
    let columns = even.stretches.iter().map(|s| &s.columns[0]);
    let steps: Vec<f64> = columns
        .flat_map(|c| c.windows(2).map(|w| (w[1] - w[0]).abs()))
        .collect();
    let usual = quantile(&steps, 0.99);
    steps.iter().any(|step| *step > FAR * usual)
}

impl Data {
    /// Reads the names of its columns; `rate` is how many rows a second there are, hertz, where no column says when they
    /// were taken.
    ///
    /// # Errors
    ///
    /// When it cannot be read.
    pub fn open(path: &Path, rate: Option<f64>) -> Result<Self, Error> {
        Ok(Self {
            path: path.to_owned(),
            table: Table::open(path)?,
            rate,
        })
    }

    /// Whether there is a column of that name.
    pub fn has(&self, name: &str) -> bool {
        self.table.has(name)
    }

    /// Unit of a displacement's column: as given, else that of its name or header, else `other`.
    ///
    /// # Errors
    ///
    /// When there is no such column.
    pub fn unit(
        &self,
        name: &str,
        given: Option<LengthUnit>,
        other: LengthUnit,
    ) -> Result<LengthUnit, Error> {
        let own = match (self.table.place(name), name.rsplit_once(':')) {
            (Ok(place), _) => self.table.unit(place),
            (Err(_), Some((_, unit))) => Some(unit),
            (Err(error), None) => return Err(error),
        };
        Ok(given
            .or_else(|| own.and_then(LengthUnit::named))
            .unwrap_or(other))
    }

    /// The columns in SI units, without rows that lack a value, and times; what was understood, and remarks.
    fn with_time(
        &self,
        columns: &Columns,
        unit: Option<LengthUnit>,
        is_path: bool,
    ) -> Result<(Columns, LengthUnit, Vec<columns::Column>, String), Error> {
        let given = columns.time.as_ref().map(Named::new);
        let time = match given {
            Some(named) => Some(columns::time_named(&self.table, Some(&named), self.rate)?),
            None => columns::usual_time(&self.table, self.rate),
        };
        let time_name = time.as_ref().map(|named| named.name().to_owned());
        // The samples are a second apart where nothing says otherwise.
        let time = time.unwrap_or_else(|| Named::new("rows:1 Hz"));
        let input = Named::new(&*columns.input);
        // Without any unit the displacement is in that of the option.
        let output = Named::new(&*columns.output);
        let mut list = vec![
            Wanted {
                option: "--time",
                named: &time,
                of: &[TIME],
            },
            Wanted {
                option: "--displacement",
                named: &output,
                of: &[LENGTH],
            },
        ];
        if !is_path {
            list.push(Wanted {
                option: "--voltage",
                named: &input,
                of: &[VOLTAGE],
            });
        }
        let mut read = columns::read(&self.table, &list)?;
        let own = LengthUnit::named(read[1].unit);
        let unit = match (read[1].by, unit, own) {
            (By::Nothing, unit, _) => {
                let unit = unit.unwrap_or(LengthUnit::Um);
                for value in &mut read[1].values {
                    *value *= unit.metres();
                }
                read[1].unit = unit.into();
                unit
            }
            (_, Some(said), Some(own)) if said != own => {
                let (said, own): (&str, &str) = (said.into(), own.into());
                let message = format!(
                    "is said to be in {said} by --unit, but its name or header says {own}; accepted is one of both"
                );
                return Err(self.table.error(&*columns.output, message));
            }
            (_, _, own) => own.unwrap_or(LengthUnit::Um),
        };
        let understood = columns::understood(&self.table, &list, &read, None);
        let found = Columns {
            input: columns.input.clone(),
            output: columns.output.clone(),
            time: time_name.filter(|name| !name.is_empty()),
        };
        Ok((found, unit, read, understood))
    }

    /// A record of these columns. The displacement's unit is what its name, its header or `unit` says, micrometres
    /// where none does.
    ///
    /// # Errors
    ///
    /// When a column is missing, or the record is none that a model could be made of or tried on.
    pub fn record(&self, columns: &Columns, unit: Option<LengthUnit>) -> Result<Read, Error> {
        if columns.input == columns.output {
            self.table.place(&columns.input)?;
            let message = "is both input and output; accepted are two columns";
            return Err(self.table.error(&*columns.input, message));
        }
        let (found, unit, read, understood) = self.with_time(columns, unit, false)?;
        let mut remarks: Vec<String> = columns::remarks(&read[..1]);
        remarks.extend(columns::remarks(&read[2..]));
        let even = columns::on_even_grid(&self.path, &read, 100)?;
        remarks.extend(even.remarks());
        let timed = self.is_timed(&found);
        if !timed {
            remarks.push(UNTIMED.to_owned());
        }
        let uneven =
            matches!(even.clock, Clock::Stamps) && even.jitter > 0.5 || even.gaps > FEW_GAPS;
        let (time, output, input) = if uneven {
            remarks.push("samples are at uneven times, and were taken when they say".to_owned());
            columns::rising(&self.path, &read[0])?;
            let whole = |k: &usize| read.iter().all(|c| c.values[*k].is_finite());
            let rows: Vec<usize> = (0..read[0].values.len()).filter(whole).collect();
            let of = |c: usize| {
                rows.iter()
                    .map(|k| read[c].values[*k])
                    .collect::<Vec<f64>>()
            };
            (of(0), of(1), of(2))
        } else {
            self.even(even, &found, &mut remarks)?
        };
        let output: Vec<f64> = output.into_iter().map(|x| 1e6 * x).collect();
        self.of_a_piezo(&found, &output)?;
        self.of_an_amplifier(&found, &input)?;
        self.saturated((&found.output, &output), (&input, 0.02))?;
        // What is held moves on by creep alone.
        self.saturated((&found.input, &input), (&output, 0.1))?;
        self.lags(&found, &input, &output)?;
        let record =
            Record::new(time, input, output).map_err(|invalid| self.explain(&invalid, &found))?;
        Ok(Read {
            record,
            columns: found,
            unit,
            understood,
            remarks,
            timed,
        })
    }

    /// Whether the file says how long its samples are apart.
    fn is_timed(&self, found: &Columns) -> bool {
        found.time.is_some() || self.rate.is_some() || self.table.period().is_some()
    }

    /// That samples have times where those of a model's record had: it creeps and lags by seconds, which a sample a second apart is
    /// none of.
    ///
    /// # Errors
    ///
    /// When they have none.
    pub fn timed_as(&self, model: &Columns, timed: bool) -> Result<(), Error> {
        let Some(time) = model.time.as_ref().filter(|_| !timed) else {
            return Ok(());
        };
        let message = format!(
            "no column of time is known, and the model was made of a record that had one, {time}; accepted is --time, or --rate"
        );
        Err(self.table.error("--time", message))
    }

    /// The longest stretch of an even record, without what no motion makes.
    fn even(
        &self,
        mut even: Even,
        found: &Columns,
        remarks: &mut Vec<String>,
    ) -> Result<Samples, Error> {
        // The tip of a triangle is none.
        if stands_apart(&even) {
            let spikes = outliers::smooth(&mut even, 0);
            if spikes.spikes as f64 > SPIKES * even.samples() as f64 {
                let message = format!(
                    "{} samples stand apart as no motion makes them; accepted are few",
                    spikes.spikes
                );
                return Err(self.table.error(&*found.output, message));
            }
            if spikes.steps > outliers::MOST_STEPS {
                let message = format!(
                    "jumps as no motion does at {} places; accepted are {}",
                    spikes.steps,
                    outliers::MOST_STEPS
                );
                return Err(self.table.error(&*found.output, message));
            }
            remarks.extend(spikes.remarks("displacement"));
        }
        let volts = lost::bridge(&mut even);
        if volts as f64 > SPIKES * even.samples() as f64 {
            let message = format!(
                "{volts} samples stand apart, and the displacement does not go with them; accepted are few"
            );
            return Err(self.table.error(&*found.input, message));
        }
        if volts > 0 {
            remarks.push(format!(
                "{} of the voltage, with which the displacement does not go, set aside and bridged",
                counted(volts, "sample")
            ));
        }
        // What a piezo did in a gap nobody knows.
        let all = even.samples();
        let (count, period) = (even.stretches.len(), even.period);
        let volts = even.stretches.iter().flat_map(|s| &s.columns[1]);
        let whole = Range::of(&volts.copied().collect::<Vec<f64>>()).width();
        let longest = even
            .stretches
            .into_iter()
            .max_by_key(|s| s.columns[0].len())
            .ok_or_else(|| self.table.error("", "has no rows; accepted is a record"))?;
        let n = longest.columns[0].len();
        if count > 1 {
            remarks.push(format!(
                "only its longest stretch without a gap or a jump was taken, {n} of {all} samples"
            ));
            let own = Range::of(&longest.columns[1]).width();
            if own < LESS * whole {
                remarks.push(format!(
                    "its voltage goes over {own:.3} V there, {:.0} % of the whole record's: beyond these the model was shown nothing",
                    100.0 * own / whole
                ));
            }
        }
        let time = (0..n).map(|k| longest.start + period * k as f64).collect();
        let mut columns = longest.columns.into_iter();
        let output = columns.next().unwrap_or_default();
        Ok((time, output, columns.next().unwrap_or_default()))
    }

    /// That a displacement is one of a piezo: not less than an atom, nor more than levers make of it.
    fn of_a_piezo(&self, found: &Columns, output: &[f64]) -> Result<(), Error> {
        /// Micrometres.
        const STROKES: std::ops::RangeInclusive<f64> = 1e-3..=1e4;
        let stroke = Range::of(output).width();
        if STROKES.contains(&stroke) || stroke <= 0.0 {
            return Ok(());
        }
        let message = format!(
            "moves over {stroke:.3e} um, which no piezo does: is it in another unit? Accepted is a displacement over a nanometre \
             to 10 mm, its unit as \"{}:UNIT\"",
            found.output
        );
        Err(self.table.error(&*found.output, message))
    }

    /// That a voltage is one that drives a piezo: amplifiers end at some thousand volts, and what is less than a millivolt drives none.
    fn of_an_amplifier(&self, found: &Columns, input: &[f64]) -> Result<(), Error> {
        /// Volts.
        const SPANS: std::ops::RangeInclusive<f64> = 1e-3..=5e3;
        let span = Range::of(input).width();
        if SPANS.contains(&span) || span <= 0.0 {
            return Ok(());
        }
        let message = format!(
            "goes over {span:.3e} V, which drives no piezo: is it in another unit? Accepted is a voltage over a millivolt to 5 kV, \
             its unit as \"{}:UNIT\"",
            found.input
        );
        Err(self.table.error(&*found.input, message))
    }

    /// A column that stands at an end of its range while the `other` moves on, by more than a share of its range,
    /// was cut off.
    fn saturated(
        &self,
        (name, values): (&str, &[f64]),
        (other, share): (&[f64], f64),
    ) -> Result<(), Error> {
        let range = |values: &[f64]| Range::of(values).width();
        let (own, most_other) = (Range::of(values), range(other));
        if own.width() <= 0.0 {
            return Ok(());
        }
        // A plateau is as flat as the column's noise.
        let seconds: Vec<f64> = values
            .windows(3)
            .map(|w| (w[0] - 2.0 * w[1] + w[2]).abs())
            .collect();
        let noise = 1.4826 * quantile(&seconds, 0.5) / 6f64.sqrt();
        let flat = (PLATEAU * noise).max(1e-6 * own.width());
        // Within so much of its range a column that is not cut off moves with the other.
        let share = share + 3.0 * flat / own.width();
        for end in [own.low, own.high] {
            let mut from = 0;
            for k in 0..=values.len() {
                if k < values.len() && (values[k] - end).abs() <= flat {
                    continue;
                }
                if k > from + 4 && range(&other[from..k]) > share * most_other {
                    let message = format!(
                        "stands at {end:.6}, an end of its range, for {} samples in which the other column moves on: \
                         cut off; accepted is a record within the range of its instruments",
                        k - from
                    );
                    return Err(self.table.error(name, message));
                }
                from = k + 1;
            }
        }
        Ok(())
    }

    /// Displacement lags behind voltage, as what takes work has to: a loop that goes round the other way is of columns that are
    /// swapped, of time that runs backwards, or of a voltage that was stamped late.
    fn lags(&self, found: &Columns, input: &[f64], output: &[f64]) -> Result<(), Error> {
        /// Mean of the way by which a displacement may lead, as a share of its range: what a voltage that is a part of a
        /// sample late makes of a stage that has no hysteresis.
        const LEADS: f64 = 0.003;
        let (u, x) = (Range::of(input), Range::of(output));
        let at = |k: usize| (input[k] - u.low, output[k] - x.low);
        let area = |a: (f64, f64), b: (f64, f64)| 0.5 * (a.0 * b.1 - a.1 * b.0);
        let steps = (1..input.len()).map(|k| (at(k - 1), at(k)));
        let way: f64 = steps.clone().map(|(a, b)| (b.0 - a.0).abs()).sum();
        // Without a way back there is no loop to go round.
        if way < 1.5 * u.width() {
            return Ok(());
        }
        let round: f64 = steps.map(|(a, b)| area(a, b)).sum();
        let round = round + area(at(input.len() - 1), at(0));
        let leads = -round / (way * x.width()).max(f64::MIN_POSITIVE);
        if leads > LEADS {
            let message = format!(
                "runs ahead of the voltage, by {:.2} % of its range on average, where a piezo's lags: are the two columns \
                 swapped, their times reversed, or is the voltage stamped late? Accepted is a displacement that lags",
                100.0 * leads
            );
            return Err(self.table.error(&*found.output, message));
        }
        Ok(())
    }

    /// A path without voltages.
    ///
    /// # Errors
    ///
    /// When a column is missing, is not of numbers, or there are no rows.
    pub fn path(&self, columns: &Columns, unit: Option<LengthUnit>) -> Result<WantedPath, Error> {
        let (found, _, mut read, understood) = self.with_time(columns, unit, true)?;
        columns::rising(&self.path, &read[0])?;
        let timed = self.is_timed(&found);
        let mut remarks = columns::remarks(&read[..1]);
        if !timed {
            remarks.push(UNTIMED.to_owned());
        }
        let output = read.pop().unwrap_or_else(|| read[0].clone()).values;
        let time = read.swap_remove(0).values;
        let rows = time.len();
        let whole = |(t, x): &(f64, f64)| t.is_finite() && x.is_finite();
        let (time, wanted): (Vec<f64>, Vec<f64>) = time
            .into_iter()
            .zip(output.into_iter().map(|x| 1e6 * x))
            .filter(whole)
            .unzip();
        if time.len() < rows {
            let missing = counted(rows - time.len(), "row");
            remarks.push(format!(
                "{missing} without a time or a displacement left out: no voltage is told for them"
            ));
        }
        Ok(WantedPath {
            time,
            wanted,
            understood,
            remarks,
            timed,
        })
    }

    /// An error about a record, in the names of its file.
    pub fn explain(&self, invalid: &Invalid, columns: &Columns) -> Error {
        let key = match invalid.what {
            "input" => columns.input.as_str(),
            "output" => columns.output.as_str(),
            "time" => columns.time.as_deref().unwrap_or_default(),
            _ => "",
        };
        let message = format!("{}; accepted is {}", invalid.value, invalid.accepted);
        self.table.error(key, message)
    }
}

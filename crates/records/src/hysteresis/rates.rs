//! What a record says of a piezo's rates: a displacement that is read before the voltage of its row, and a voltage that goes at one rate
//! alone.

use pigtail_control::compensation::hysteresis::{
    Creep, Memory, Model, Record, Zero, fit_memory, judge, predict,
};
use pigtail_numerics::golden::least;
use pigtail_numerics::signal::{quantile, rms};

/// Leads up to this many sample periods are looked for: as many as lags.
const PERIODS: f64 = 10.0;

/// A lead is believed where it leaves less than this share of the error: of records at one rate, whose loops' shape passes for some of one,
/// 0.96 to 0.99 had been left, of others 0.34 to 0.71. Chosen after these.
const FAR_LESS: f64 = 0.9;

/// Accuracy of a lead, sample periods.
const ACCURATE: f64 = 0.02;

/// The same model of a record whose displacement was read before the voltage of its row, where that leaves far less.
///
/// Amplifiers and sensors only lag. A logger that reads one channel after the other, or a filter of the voltage's channel alone, makes it seem to
/// lead, and all that a model without a lead can do is to open its loops or close them.
pub(super) fn ahead(record: &Record, to: usize, own: &Memory) -> Option<Memory> {
    // A search from no lag on ends a little beyond it.
    let period = record.period();
    if own.lag > 0.1 * period {
        return None;
    }
    let from = record.known_from().min(to / 2);
    let left = |model: &Memory| {
        let told = predict(&Model::Memory(*model), record);
        judge(&told, &record.output, from..to, Zero::Known).rms
    };
    // Beyond half a way a motion to and fro comes back to where it was.
    let ways: Vec<f64> = swings(record).map(|[time, _]| time).collect();
    let longest = PERIODS.min(0.5 * quantile(&ways, 0.5) / period);
    let by = |lead: f64| fit_memory(record, to, Some(-lead * period), Creep::Any).ok();
    let error = |lead: f64| by(lead).map_or(f64::INFINITY, |m| left(&m));
    let tried = [0.25, 0.5, 1.0, 2.0, 4.0, 8.0];
    let near = tried
        .into_iter()
        .filter(|lead| *lead <= longest)
        .map(|lead| (error(lead), lead))
        .min_by(|a, b| a.0.total_cmp(&b.0))?;
    // Between what was tried it may leave less still.
    if near.0 > 0.5 * (1.0 + FAR_LESS) * left(own) {
        return None;
    }
    let found = by(least(
        (0.5 * near.1, (2.0 * near.1).min(longest)),
        ACCURATE,
        error,
    ))?;
    (left(&found) < FAR_LESS * left(own)).then_some(found)
}

/// How far a model may be off the displacement itself where the voltage goes at one rate, root mean square, micrometres: any lag may be of a logger
/// that leaves half as much again as the model does at most, for a loop passes for one.
pub(super) fn any_lag(record: &Record, to: usize, prediction: &[f64]) -> f64 {
    /// Sample periods that are tried: up to as many as leads.
    const LAGS: [f64; 6] = [0.5, 1.0, 2.0, 4.0, 7.0, PERIODS];
    /// What may be left beside what the model leaves.
    const AS_WELL: f64 = 1.5;
    let from = record.known_from().min(to / 2);
    let left = |told: &[f64]| judge(told, &record.output, from..to, Zero::Known).rms;
    let least = left(prediction);
    let off = |lag: f64| {
        let other = fit_memory(record, to, Some(lag * record.period()), Creep::Any).ok()?;
        let told = predict(&Model::Memory(other), record);
        let without = predict(&Model::Memory(Memory { lag: 0.0, ..other }), record);
        let apart = prediction.iter().zip(&without).skip(to);
        (left(&told) < AS_WELL * least).then(|| rms(apart.map(|(a, b)| a - b)))
    };
    LAGS.into_iter().filter_map(off).fold(0.0, f64::max)
}

/// Swings of the voltage that count, shares of its range; and the ratio of two rates that tell a lag from a loop.
const SWING: f64 = 0.1;
const APART: f64 = 2.0;

/// How long each swing of the voltage takes that counts, seconds, and how far it goes, volts.
fn swings(record: &Record) -> impl Iterator<Item = [f64; 2]> + '_ {
    let least = SWING * record.input_range().width();
    record
        .swings()
        .map(|s| {
            let between = |column: &[f64]| column[s.end] - column[s.start];
            [between(&record.time), between(&record.input).abs()]
        })
        .filter(move |[_, way]| *way >= least)
}

/// That a voltage goes at one rate alone: a lag looks as a loop does then, and nobody knows how much of it is left at another one.
pub(super) fn at_one(record: &Record) -> Option<String> {
    let mut rates: Vec<[f64; 2]> = swings(record)
        .map(|[time, way]| [way / time, way])
        .collect();
    rates.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let all: f64 = rates.iter().map(|r| r[1]).sum();
    // A few ways of another rate tell nothing: a tenth of all that was gone on either side is left out.
    let at = |share: f64| {
        let mut gone = 0.0;
        let found = rates.iter().find(|r| {
            gone += r[1];
            gone >= share * all
        });
        found.map(|r| r[0])
    };
    let (low, high) = (at(0.1)?, at(0.9)?);
    (high < APART * low).then(|| {
        format!(
            "the voltage goes at {low:.3} to {high:.3} V/s on average, one rate nearly: a lag of amplifier or sensor looks as a loop does there. \
             What is said holds at that rate; at another one the model may be off by much more, which a record with slow and fast ways shows"
        )
    })
}

//! Kinds of models of a response, held against each other.

use super::record::{Filter, Record};
use super::search::{self, Found, pruned, search, squares, without_idle_modes, without_idle_poles};
use super::{ENOUGH, Unknown, delay, modes_of};

/// Models of a response that it does not exclude, settled on all of its points, the likeliest first; and of each how likely it is beside that, and its
/// error at the points held back.
///
/// A filter behind all, a sensor's or an amplifier's, is one number. As a sum it is a pole of its own and turns the residue of every mode; where
/// nobody looks for that, a mode without a peak stands in for it, at a frequency that no part of the machine has, or a delay. Creep
/// before the modes turns them too, by some thousandths. So both are kinds of models beside sums of proportional damping and of another one, and
/// the Bayesian information criterion says how likely each is.
pub(super) fn models(record: &Record) -> Result<Vec<Model>, Unknown> {
    let kind = |skewed: bool, rate: bool, filter: Filter| {
        let kind = Record {
            skewed,
            rate,
            filter,
            ..record.clone()
        };
        settled(&kind, &search(&kind))
    };
    let plain = kind(false, false, Filter::None);
    let why = plain.as_ref().err().cloned();
    let skewed = kind(true, false, Filter::None);
    // Of a velocity each mode's part goes with the frequency, and nothing else has that.
    let rate = match (&plain, &skewed) {
        (Ok(plain), Ok(skewed)) => turned_more(plain, skewed),
        (_, skewed) => skewed.is_ok(),
    };
    let rates = [Filter::None, Filter::Pole].into_iter().filter(|_| rate);
    let mut found: Vec<Model> = [plain, skewed, kind(false, false, Filter::Pole)]
        .into_iter()
        .chain(rates.map(|filter| kind(false, true, filter)))
        .flatten()
        .collect();
    let two: Vec<Model> = found.iter().filter_map(Model::behind_two).collect();
    found.extend(two);
    let before: Vec<Model> = found.iter().filter_map(Model::creeping).collect();
    found.extend(before);
    let within = |m: &Model| {
        let all = record.frequency[0]..search::FARTHEST * record.highest();
        m.record.filter == Filter::None
            || m.record
                .corner(&m.coded)
                .is_some_and(|corner| all.contains(&corner))
    };
    found.retain(within);
    let left = |m: &Model| m.record.residuals(&m.coded);
    let least = found
        .iter()
        .map(left)
        .min_by(|a, b| squares(a).total_cmp(&squares(b)));
    let Some(least) = least else {
        return Err(why.unwrap_or_else(|| Unknown::all("the fit to its points failed")));
    };
    let points = search::own_points(&least);
    let criterion = |m: &Model| search::criterion(&m.record, &m.coded, points);
    let best = found.iter().map(criterion).fold(f64::INFINITY, f64::min);
    for model in &mut found {
        model.likely = (0.5 * (best - criterion(model))).exp();
    }
    // What stands in for something else, as a mode that is none, is not believed while there is another model that is not excluded.
    let stands_in = |m: &Model| m.likely < EXCLUDED || !m.has_modes_alone();
    found.sort_by(|a, b| {
        let likely = b.likely.total_cmp(&a.likely);
        stands_in(a).cmp(&stands_in(b)).then(likely)
    });
    Ok(found)
}

/// Whether the second of two models is the one that the Bayesian information criterion asks for.
fn turned_more(one: &Model, other: &Model) -> bool {
    let points = search::own_points(&other.record.residuals(&other.coded));
    let [one, other] = [one, other].map(|m| search::criterion(&m.record, &m.coded, points));
    other < one
}

/// A model so much less likely than another is excluded.
const EXCLUDED: f64 = 0.01;

/// A model of a response.
#[derive(Clone)]
pub(super) struct Model {
    pub(super) record: Record,
    pub(super) coded: Vec<f64>,
    pub(super) error: f64,
    /// How many times as likely as the likeliest.
    pub(super) likely: f64,
}

impl Model {
    /// Whether all its modes are some.
    fn has_modes_alone(&self) -> bool {
        let modes = self.record.modes(&self.coded);
        let pairs = self.coded[..2 * modes].chunks(2);
        pairs
            .into_iter()
            .all(|pair| search::is_mode(&self.record, pair))
    }

    /// The same behind Butterworth's filter of two poles; where modes need not be of proportional damping those take what it does.
    fn behind_two(&self) -> Option<Self> {
        if self.record.skewed {
            return None;
        }
        let (record, start) = delay::behind_two(&self.record, &self.coded);
        let (coded, _) = record.settle(&start)?;
        let coded = search::without_idle_modes(&record, coded);
        Some(Self {
            record,
            coded,
            ..*self
        })
    }

    /// The same with its slowest real pole before the modes.
    fn creeping(&self) -> Option<Self> {
        let (record, start) = delay::in_series(&self.record, &self.coded)?;
        let (coded, _) = record.settle(&start)?;
        Some(Self {
            record,
            coded,
            ..*self
        })
    }
}

fn settled(record: &Record, found: &Found) -> Result<Model, Unknown> {
    modes_of(record, found)?;
    let (record, found) = without_idle_poles(record, found)
        .ok_or_else(|| Unknown::all("the fit to all of its points failed"))?;
    let every = record.frequency.len().div_ceil(2 * ENOUGH);
    let (even, odd) = (record.points(0, 2 * every), record.points(every, 2 * every));
    let (coded, error) = pruned(found.coded, record.poles + record.factors(), |coded| {
        let (settled, _) = even.settle(coded)?;
        let (values, _) = even.linear(&settled)?;
        Some(odd.error(&settled, &values)).filter(|e| e.is_finite())
    })
    .ok_or_else(|| Unknown::all("the fit to its points failed"))?;
    let (coded, _) = record
        .settle(&coded)
        .ok_or_else(|| Unknown::all("the fit to all of its points failed"))?;
    let coded = without_idle_modes(&record, coded);
    Ok(Model {
        record,
        coded,
        error,
        likely: 1.0,
    })
}

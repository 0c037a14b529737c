//! What models of a transmission are made of, and how they are fitted.

use super::{LEAST, LOAD, MOTOR, Parts, Record, TORQUE, WAYS};
use nalgebra::DMatrix;
use pigtail_model::windup::{Reversal, ReversalState};
use pigtail_numerics::golden::least;
use pigtail_numerics::regression::{Rest, Solution, least_squares_alone, least_squares_of_time};
use pigtail_numerics::signal::{Lowpass, between, derivative, quantile};

/// Spacing of the ways that are tried first, as a factor.
const SPACING: f64 = 1.45;

/// The signals that models are made of.
#[derive(Clone)]
pub(super) struct Signals {
    pub(super) time: Vec<f64>,
    pub(super) windup: Vec<f64>,
    pub(super) position: Vec<f64>,
    /// The same without its noise, whose steps are no reversals.
    pub(super) path: Vec<f64>,
    /// Steps of the path that are its noise.
    pub(super) dead: f64,
    pub(super) velocity: Vec<f64>,
    pub(super) acceleration: Vec<f64>,
    pub(super) torque: Option<Vec<f64>>,
    /// Where stretches begin.
    pub(super) begins: Vec<usize>,
    /// Samples that models are fitted to.
    pub(super) settled: Vec<usize>,
    pub(super) middle: f64,
    pub(super) range: f64,
}

impl Signals {
    /// The signals, with a load's channel that is older by `skew` seconds than its stamps.
    pub(super) fn new(record: &Record, skew: f64) -> Self {
        let period = record.even.period;
        let mut signals = Self {
            time: Vec::new(),
            windup: Vec::new(),
            position: Vec::new(),
            path: Vec::new(),
            dead: 0.0,
            velocity: Vec::new(),
            acceleration: Vec::new(),
            torque: record.has_torque.then(Vec::new),
            begins: Vec::new(),
            settled: Vec::new(),
            middle: 0.0,
            range: 0.0,
        };
        // Fast enough for any transmission's motion, slow enough for two differences.
        let filter = Lowpass::butterworth(2, (60.0 * period).clamp(0.02, 0.5));
        for stretch in &record.even.stretches {
            let (motor, load) = (&stretch.columns[MOTOR], &stretch.columns[LOAD]);
            if motor.len() < LEAST / 4 {
                continue;
            }
            signals.begins.push(signals.time.len());
            let smooth = settled(&filter, motor);
            let velocity = derivative(&smooth, period);
            signals.acceleration.extend(derivative(&velocity, period));
            signals.velocity.extend(velocity);
            signals.position.extend_from_slice(motor);
            signals.path.extend_from_slice(&smooth);
            for (k, m) in motor.iter().enumerate() {
                signals.time.push(stretch.start + k as f64 * period);
                signals
                    .windup
                    .push(m - between(load, k as f64 + skew / period));
            }
            if let Some(torque) = &mut signals.torque {
                torque.extend(settled(&filter, &stretch.columns[TORQUE]));
            }
        }
        // Of white noise the filter leaves at most as much as it takes.
        let taken = signals.position.iter().zip(&signals.path);
        let taken: Vec<f64> = taken.map(|(q, s)| (q - s).abs()).collect();
        let dead = 2.0 * quantile(&taken, 0.5);
        signals.thin();
        let (low, high) = signals
            .position
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
                (l.min(*v), h.max(*v))
            });
        signals.range = high - low;
        signals.dead = dead.min(1e-4 * signals.range);
        signals.middle = 0.5 * (low + high);
        signals.settle();
        signals
    }

    /// Every so many samples, where there are very many: what models are made of changes slowly.
    fn thin(&mut self) {
        const MOST: usize = 40_000;
        let n = self.time.len();
        let every = n.div_ceil(MOST);
        if every <= 1 {
            return;
        }
        let kept: Vec<usize> = (0..n).step_by(every).collect();
        let pick = |column: &mut Vec<f64>| *column = kept.iter().map(|k| column[*k]).collect();
        pick(&mut self.time);
        pick(&mut self.windup);
        pick(&mut self.position);
        pick(&mut self.path);
        pick(&mut self.velocity);
        pick(&mut self.acceleration);
        if let Some(torque) = &mut self.torque {
            pick(torque);
        }
        for begin in &mut self.begins {
            *begin = begin.div_ceil(every);
        }
        self.begins.retain(|begin| *begin < kept.len());
        self.begins.dedup();
    }

    /// (2.20)-(2.26) with a maximum of one.
    pub(super) fn reversal(&self, way: f64) -> Vec<f64> {
        let model = Reversal { maximum: 1.0, way };
        let mut state = ReversalState::default();
        self.histories(|q, begins| {
            if begins {
                state = ReversalState::default();
                model.next(&mut state, 0.0);
            }
            model.next(&mut state, q)
        })
    }

    /// Deflection of an element over its way.
    fn element(&self, way: f64) -> Vec<f64> {
        let (mut share, mut last) = (0.0_f64, 0.0);
        self.histories(|q, begins| {
            if begins {
                (share, last) = (0.0, q);
            }
            share = (share + (q - last) / way).clamp(-1.0, 1.0);
            last = q;
            share
        })
    }

    /// What a model with memory tells along the way since each stretch's beginning.
    fn histories(&self, mut next: impl FnMut(f64, bool) -> f64) -> Vec<f64> {
        let mut begin = 0.0;
        let (mut forward, mut farthest) = (true, 0.0);
        (0..self.path.len())
            .map(|k| {
                let begins = self.begins.binary_search(&k).is_ok();
                if begins {
                    begin = self.path[k];
                    farthest = 0.0;
                }
                let mut told = 0.0;
                let between = self.turn(k).filter(|_| !begins);
                for place in between.into_iter().chain([self.path[k]]) {
                    let q = place - begin;
                    // It goes on, or has turned round for certain: the way back is then whole.
                    let back = if forward { farthest - q } else { q - farthest };
                    if back <= 0.0 {
                        farthest = q;
                    } else if back > 2.0 * self.dead {
                        forward = !forward;
                        farthest = q;
                    }
                    told = next(farthest, begins);
                }
                told
            })
            .collect()
    }

    /// How far it went before it turned round between a sample and the one before, by the parabola through the three about the turn: of a coarse
    /// record no sample is where it turned, and each turn would be cut off, as by a mean over one period.
    fn turn(&self, k: usize) -> Option<f64> {
        let vertex = |at: usize| {
            let [before, here, behind] = self.path.get(at.checked_sub(1)?..at + 2)? else {
                return None;
            };
            let (slope, bend) = (0.5 * (behind - before), behind - 2.0 * here + before);
            let from = -slope / bend;
            (from.abs() <= 0.5).then_some((from, here + 0.5 * slope * from))
        };
        let later = vertex(k.checked_sub(1)?).filter(|v| v.0 > 0.0);
        later
            .or_else(|| vertex(k).filter(|v| v.0 < 0.0))
            .map(|v| v.1)
    }

    pub(super) fn columns(&self, parts: Parts, way: f64) -> Vec<(&'static str, Vec<f64>)> {
        let n = self.time.len();
        let mut columns = vec![
            ("offset", vec![1.0; n]),
            ("time_skew", self.velocity.clone()),
        ];
        if parts.reversal {
            columns.push(("w_max", self.reversal(way)));
        }
        if parts.compliance {
            if let Some(torque) = &self.torque {
                let cube = torque.iter().map(|t| t.powi(3)).collect();
                columns.push(("compliance", torque.clone()));
                columns.push(("cubic_compliance", cube));
            }
            // The motor's own inertia takes a part of its torque; without a torque, the load's tells it.
            columns.push(("inertial_compliance", self.acceleration.clone()));
        }
        if parts.ratio {
            let q: Vec<f64> = self.position.iter().map(|q| q - self.middle).collect();
            let square = q.iter().map(|q| q * q).collect();
            columns.push(("ratio_error", q));
            columns.push(("ratio_change", square));
        }
        if parts.memory {
            columns.extend(
                WAYS.iter()
                    .map(|share| ("element", self.element(share * self.range))),
            );
        }
        columns
    }

    /// The samples at which a windup has forgotten in what state its stretch began, which nobody knows: once the path has ranged over the
    /// way of the longest element both ways. The same for all models, which are held against each other. All, where that would leave out more than a
    /// tenth: what a short record tells is worth more.
    fn settle(&mut self) {
        let n = self.path.len();
        let reach = 2.0 * WAYS[WAYS.len() - 1] * self.range;
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        self.settled = (0..n)
            .filter(|k| {
                let q = self.path[*k];
                if self.begins.binary_search(k).is_ok() {
                    (low, high) = (q, q);
                }
                (low, high) = (low.min(q), high.max(q));
                high - low >= reach
            })
            .collect();
        if 10 * self.settled.len() < 9 * n {
            self.settled = (0..n).collect();
        }
    }

    /// A fit to the settled samples.
    pub(super) fn fit(&self, parts: Parts, way: f64) -> Option<Solution> {
        let columns = self.columns(parts, way);
        let rows = &self.settled;
        least_squares_of_time(&over(&columns, rows), &self.windup_at(rows), 1)
    }

    fn windup_at(&self, rows: &[usize]) -> Vec<f64> {
        rows.iter().map(|k| self.windup[*k]).collect()
    }

    /// Values of `columns` that fit best over some of the samples.
    pub(super) fn values(
        &self,
        columns: &[(&'static str, Vec<f64>)],
        rows: &[usize],
    ) -> Option<Vec<f64>> {
        least_squares_alone(&over(columns, rows), &self.windup_at(rows)).map(|s| s.values)
    }

    pub(super) fn residuals(
        &self,
        columns: &[(&'static str, Vec<f64>)],
        values: &[f64],
    ) -> Vec<f64> {
        (0..self.time.len())
            .map(|k| {
                let prediction: f64 = columns.iter().zip(values).map(|((_, c), v)| c[k] * v).sum();
                self.windup[k] - prediction
            })
            .collect()
    }

    /// Ways that are tried first.
    pub(super) fn ways(&self) -> impl Iterator<Item = f64> {
        let range = self.range;
        (0..14).map(move |k| 0.003 * SPACING.powi(k) * range)
    }

    /// The way `Q` of (2.20) that fits best.
    pub(super) fn way(&self, parts: Parts) -> f64 {
        if !parts.reversal {
            return 0.0;
        }
        let others = Parts {
            reversal: false,
            ..parts
        };
        let others = self.columns(others, 0.0);
        let rows = &self.settled;
        let Some(rest) = Rest::new(&over(&others, rows), &self.windup_at(rows)) else {
            return self.range;
        };
        let squares = |way: f64| {
            let reversal = self.reversal(way);
            let own: Vec<f64> = rows.iter().map(|k| reversal[*k]).collect();
            rest.squares(&own)
        };
        let coarse = self
            .ways()
            .map(|way| (squares(way), way))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map_or(self.range, |(_, way)| way);
        // Between the neighbours of the best by the golden section, in logarithms.
        let around = (coarse.ln() - SPACING.ln(), coarse.ln() + SPACING.ln());
        least(around, 1e-4, |x| squares(x.exp())).exp()
    }

    /// How sure a model's values are, its way (the last) among them, from what it leaves.
    pub(super) fn uncertainty(&self, parts: Parts, way: f64, whole: &Solution) -> Option<Solution> {
        let columns = self.with_way(parts, way, &whole.values)?;
        least_squares_of_time(&over(&columns, &self.settled), &whole.residuals, 1)
    }

    /// The columns, and what a change of the way makes of the windup.
    fn with_way(
        &self,
        parts: Parts,
        way: f64,
        values: &[f64],
    ) -> Option<Vec<(&'static str, Vec<f64>)>> {
        const STEP: f64 = 0.02;
        let mut columns = self.columns(parts, way);
        let maximum = columns.iter().position(|(name, _)| *name == "w_max")?;
        let size = values[maximum];
        let (more, less) = (
            self.reversal(way * (1.0 + STEP)),
            self.reversal(way * (1.0 - STEP)),
        );
        let slope: Vec<f64> = more
            .iter()
            .zip(&less)
            .map(|(a, b)| size * (a - b) / (2.0 * STEP * way))
            .collect();
        columns.push(("q", slope));
        Some(columns)
    }

    /// By how much a model's parameters are other ones at some of its samples, each with its deviation; by the columns' order, its way the last.
    pub(super) fn changes(
        &self,
        parts: Parts,
        (way, values): (f64, &[f64]),
        of: impl Fn(usize) -> bool,
    ) -> Option<Vec<Change>> {
        let columns = self.told(parts, way, values);
        self.refit(&columns, values, of)
    }

    /// The same of all samples beside columns that are no part of the model, which come last.
    pub(super) fn changes_beside(
        &self,
        parts: Parts,
        (way, values): (f64, &[f64]),
        added: &[(&'static str, Vec<f64>)],
    ) -> Option<Vec<Change>> {
        let mut columns = self.told(parts, way, values);
        columns.extend_from_slice(added);
        self.refit(&columns, values, |_| true)
    }

    fn told(&self, parts: Parts, way: f64, values: &[f64]) -> Vec<(&'static str, Vec<f64>)> {
        self.with_way(parts, way, values)
            .unwrap_or_else(|| self.columns(parts, way))
    }

    fn refit(
        &self,
        columns: &[(&'static str, Vec<f64>)],
        values: &[f64],
        of: impl Fn(usize) -> bool,
    ) -> Option<Vec<Change>> {
        let residuals = self.residuals(&columns[..values.len()], values);
        let rows: Vec<usize> = self.settled.iter().copied().filter(|k| of(*k)).collect();
        if rows.len() < LEAST.max(10 * columns.len()) {
            return None;
        }
        let left: Vec<f64> = rows.iter().map(|k| residuals[*k]).collect();
        let found = least_squares_of_time(&over(columns, &rows), &left, 1)?;
        let known = found.values.iter().zip(&found.std_correlated);
        let names = columns.iter().map(|(name, _)| *name);
        Some(
            names
                .zip(known)
                .map(|(name, (by, std))| (name, *by, *std))
                .collect(),
        )
    }

    /// How a column changes with time, in each stretch for itself.
    pub(super) fn slope(&self, column: &[f64]) -> Vec<f64> {
        let ends = self.begins[1..].iter().copied().chain([column.len()]);
        self.begins
            .iter()
            .zip(ends)
            .flat_map(|(from, to)| {
                let time = &self.time[*from..to];
                let period = (time[time.len() - 1] - time[0]) / (time.len() - 1).max(1) as f64;
                derivative(&column[*from..to], period)
            })
            .collect()
    }

    /// What winds up by the way that the motor has gone.
    pub(super) fn winds(&self, parts: Parts, way: f64, values: &[f64]) -> Vec<f64> {
        let columns = self.columns(parts, way);
        let mut winds = vec![0.0; self.time.len()];
        let by_way = |name: &str| name == "w_max" || name == "element";
        for ((_, column), value) in columns.iter().zip(values).filter(|((n, _), _)| by_way(n)) {
            for (w, c) in winds.iter_mut().zip(column) {
                *w += value * c;
            }
        }
        winds
    }

    /// The mean time from one turn to the next, seconds.
    pub(super) fn between_turns(&self) -> f64 {
        let turns = self.velocity.windows(2);
        let turns = turns.filter(|v| (v[0] < 0.0) != (v[1] < 0.0)).count();
        let period = self.time.get(1).map_or(0.0, |t| t - self.time[0]);
        self.time.len() as f64 * period / (turns.max(1)) as f64
    }

    /// The same before a pole of so many seconds.
    pub(super) fn ahead(&self, seconds: f64) -> Self {
        let path = self.path.iter().zip(&self.velocity);
        Self {
            path: path.map(|(q, v)| q + seconds * v).collect(),
            ..self.clone()
        }
    }

    /// What a pole of so many seconds makes of a column, of each stretch by itself.
    pub(super) fn through_pole(&self, column: &[f64], seconds: f64) -> Vec<f64> {
        let mut last = (0.0, 0.0, 0.0);
        (0..column.len())
            .map(|k| {
                let (time, now) = (self.time[k], column[k]);
                let (before, input, output) = last;
                let output = if self.begins.binary_search(&k).is_ok() {
                    now
                } else {
                    // Of a column that goes straight from one sample to the next.
                    let step = time - before;
                    let slope = (now - input) / step;
                    let kept = (-step / seconds).exp();
                    now - slope * seconds + (output - input + slope * seconds) * kept
                };
                last = (time, now, output);
                output
            })
            .collect()
    }

    /// A column so many seconds sooner.
    pub(super) fn sooner(&self, column: &[f64], seconds: f64) -> Vec<f64> {
        let period = self.time.get(1).map_or(1.0, |t| t - self.time[0]);
        (0..column.len())
            .map(|k| between(column, k as f64 + seconds / period))
            .collect()
    }

    /// What a mean over so many seconds makes of a column, of each stretch by itself; over less at its ends.
    pub(super) fn through_mean(&self, column: &[f64], seconds: f64) -> Vec<f64> {
        let ends = self.begins[1..].iter().copied().chain([column.len()]);
        let mut all = Vec::with_capacity(column.len());
        for (from, to) in self.begins.iter().copied().zip(ends) {
            let part = &column[from..to];
            let period = self.time.get(from + 1).map_or(1.0, |t| t - self.time[from]);
            let reach = (0.5 * seconds / period) as usize;
            let sums: Vec<f64> = std::iter::once(0.0)
                .chain(part.iter().scan(0.0, |sum, c| {
                    *sum += c;
                    Some(*sum)
                }))
                .collect();
            all.extend((0..part.len()).map(|k| {
                let reach = reach.min(k).min(part.len() - 1 - k);
                (sums[k + reach + 1] - sums[k - reach]) / (2 * reach + 1) as f64
            }));
        }
        all
    }

    /// The same with a path that goes farther where it turns, by so much of its acceleration.
    pub(super) fn bent(&self, by: f64) -> Self {
        let path = self.path.iter().zip(&self.acceleration);
        Self {
            path: path.map(|(q, a)| q - by * a).collect(),
            ..self.clone()
        }
    }
}

/// By how much a parameter is another one, and its deviation.
pub(super) type Change = (&'static str, f64, f64);

/// Columns at the samples `rows`.
fn over(columns: &[(&'static str, Vec<f64>)], rows: &[usize]) -> DMatrix<f64> {
    DMatrix::from_fn(rows.len(), columns.len(), |i, j| columns[j].1[rows[i]])
}

/// A column filtered both ways, turned over at its ends for so long that the filter has settled where it begins:
/// one that has not makes motions of its own, which wind up.
fn settled(filter: &Lowpass, column: &[f64]) -> Vec<f64> {
    const LONG: usize = 200;
    let n = column.len();
    let long = LONG.min(n - 1);
    let (first, last) = (column[0], column[n - 1]);
    let before = (1..=long).rev().map(|k| 2.0 * first - column[k]);
    let behind = (1..=long).map(|k| 2.0 * last - column[n - 1 - k]);
    let whole: Vec<f64> = before.chain(column.iter().copied()).chain(behind).collect();
    filter.both_ways(&whole)[long..long + n].to_vec()
}

//! Tuning a PID on the machine (thesis 2.3): the cost, and two searches for its minimum.

use crate::calibration::AxisGains;
use crate::characterize::{StepResponse, Trace, record, step_response};
use crate::servo::Pid;
use crate::station::Station;
use pigtail_hal::quantity::Counts;
use pigtail_hal::spec::StepSpec;
use pigtail_hal::{AxisName, Fault};
use rand::{Rng, RngExt};

/// The three gains: V/count, V/(count s), V s/count.
pub type Gains = [f64; 3];

/// What is measured in a trial.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Experiment {
    /// The axis.
    pub at: AxisName,
    /// The larger of the two steps, counts; the other is half of it.
    pub step: i64,
    /// Whether the cost is that of the larger step alone.
    pub one_size: bool,
    /// How long each response is watched, `T` of (2.16), seconds.
    pub window: f64,
    /// Gains that are known to hold the axis, for going back after a trial that went wrong.
    pub safe: Gains,
    /// Bound of the integral's part of the voltage, volts.
    pub integral_limit: f64,
    /// What the response to the larger step must be, if anything.
    pub specified: Option<StepSpec>,
}

/// Gains aim so far within what is specified, or the same gains would miss it on the next day.
const WITHIN: f64 = 0.995;

/// So many times the share of what is specified that is missed do gains cost more, up to [`FAR`] of it:
/// farther away the ITAE alone leads there as it would without.
const MISSED: f64 = 10.0;

/// Share of what is specified.
const FAR: f64 = 0.05;

impl Experiment {
    /// The controller with some gains.
    pub fn pid(&self, station: &Station, gains: Gains) -> Pid {
        let [kp, ki, kd] = gains;
        let spec = station.spec();
        let gains = AxisGains {
            kp,
            ki,
            kd,
            integral_limit: self.integral_limit,
            speed: None,
            date: String::new(),
            origin: String::new(),
        };
        Pid::new(&gains, spec.drive(self.at.axis).voltage, spec.period())
    }

    /// The cost of some gains: the ITAE (2.16), `sum t |e| dt`, of a step forward and of a step
    /// of half the size back, each over its size, averaged; milliseconds squared. Two sizes, for
    /// a load that happens to stick near its goal in one of them does not in the other. It is
    /// more for gains that miss what is specified, which the ITAE alone may: near its minimum rise and
    /// settling can be had for each other at hardly any cost.
    ///
    /// Infinite for gains that let the axis run away or ring; it is then brought back to rest
    /// with the safe gains.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub fn cost(&self, station: &mut Station, gains: Gains) -> Result<f64, Fault> {
        let home = station.encoder(self.at);
        let sizes = [self.step, -(self.step / 2)];
        let sizes = if self.one_size { &sizes[..1] } else { &sizes };
        let mut cost = 0.0;
        for &size in sizes {
            station.set_pid(self.at, self.pid(station, gains));
            let trace = self.step_by(station, size)?;
            match itae(&trace, size as f64) {
                Some(itae) if self.is_calm(&trace, size) => {
                    cost += itae / sizes.len() as f64;
                    if size == self.step {
                        let response = step_response(&trace, size as f64);
                        cost *= 1.0 + MISSED * self.missed(&response, WITHIN).min(FAR);
                    }
                }
                _ => {
                    cost = f64::INFINITY;
                    break;
                }
            }
        }
        // Back to where it began, by gains that are known.
        station.set_pid(self.at, self.pid(station, self.safe));
        station.reference(self.at, home);
        station.run(2.0 * self.window)?;
        Ok(cost * 1e6)
    }

    /// By what shares of what is specified, times `within`, a response is too slow; both together.
    pub fn missed(&self, response: &StepResponse, within: f64) -> f64 {
        self.specified.map_or(0.0, |specified| {
            let over = |value: f64, most: f64| (value / (within * most) - 1.0).max(0.0);
            over(response.rise, specified.rise) + over(response.settling, specified.settling)
        })
    }

    /// The response to a step of `size` counts under the present gains; cut short where the axis
    /// runs away.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub fn step_by(&self, station: &mut Station, size: i64) -> Result<Trace, Fault> {
        let (goal, bound) = (size as f64, 1.5 * size.abs() as f64 + 20.0);
        record(
            station,
            self.at,
            self.window,
            |_| goal,
            |trace| {
                trace
                    .encoder
                    .last()
                    .is_none_or(|count| (count - goal).abs() <= bound)
            },
        )
    }

    /// The response to a step under some gains, from rest and back.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub fn response(&self, station: &mut Station, gains: Gains) -> Result<Trace, Fault> {
        let Counts(home) = station.encoder(self.at);
        station.set_pid(self.at, self.pid(station, gains));
        let trace = self.step_by(station, self.step)?;
        station.set_pid(self.at, self.pid(station, self.safe));
        station.reference(self.at, Counts(home));
        station.run(2.0 * self.window)?;
        Ok(trace)
    }

    /// Whether a response was watched to its end and does not ring there: in its last third the
    /// position stays within a tenth of the step.
    fn is_calm(&self, trace: &Trace, size: i64) -> bool {
        let expected = (self.window / trace.period).round() as usize;
        let end = &trace.encoder[trace.encoder.len() * 2 / 3..];
        let (low, high) = end
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), c| {
                (l.min(*c), h.max(*c))
            });
        trace.encoder.len() == expected && high - low <= 0.1 * size.abs() as f64
    }
}

/// ITAE of a step response over its size, s^2; `None` for an empty trace.
fn itae(trace: &Trace, size: f64) -> Option<f64> {
    let sum: f64 = trace
        .encoder
        .iter()
        .enumerate()
        .map(|(k, count)| (k + 1) as f64 * trace.period * (count - size).abs())
        .sum();
    (!trace.encoder.is_empty()).then(|| sum * trace.period / size.abs())
}

/// A trial of a search that was better than all before it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Its number, from one.
    pub trial: u32,
    /// Its gains.
    pub gains: Gains,
    /// Its cost.
    pub cost: f64,
}

/// How a search went.
#[derive(Debug, Clone, PartialEq)]
pub struct Search {
    /// Trials taken.
    pub trials: u32,
    /// The successful ones, in order; the last is the best.
    pub path: Vec<Progress>,
}

impl Search {
    /// The best gains and their cost.
    ///
    /// # Panics
    ///
    /// Never: a search takes at least one trial, and the first is on its path.
    pub fn best(&self) -> Progress {
        *self.path.last().expect("a search takes at least one trial")
    }
}

/// Notes trials, and which of them were better than all before.
struct Notebook<'a, E> {
    cost: &'a mut dyn FnMut(Gains) -> Result<f64, E>,
    search: Search,
    most: u32,
}

impl<E> Notebook<'_, E> {
    fn try_out(&mut self, gains: Gains) -> Result<f64, E> {
        let cost = (self.cost)(gains)?;
        self.search.trials += 1;
        if self.search.path.last().is_none_or(|best| cost < best.cost) {
            let trial = self.search.trials;
            self.search.path.push(Progress { trial, gains, cost });
        }
        Ok(cost)
    }

    fn is_over(&self) -> bool {
        self.search.trials >= self.most
    }
}

fn notebook<E>(cost: &mut dyn FnMut(Gains) -> Result<f64, E>, most: u32) -> Notebook<'_, E> {
    Notebook {
        cost,
        search: Search {
            trials: 0,
            path: Vec::new(),
        },
        most,
    }
}

/// Random neighbourhood search (2.3.1): draws gains around the best ones so far, each by a factor
/// of up to `reach`, and moves there when they are better.
///
/// # Errors
///
/// What `cost` fails with.
pub fn random_neighbourhood<E>(
    start: Gains,
    trials: u32,
    reach: f64,
    rng: &mut impl Rng,
    cost: &mut dyn FnMut(Gains) -> Result<f64, E>,
) -> Result<Search, E> {
    let mut notebook = notebook(cost, trials);
    notebook.try_out(start)?;
    while !notebook.is_over() {
        let best = notebook.search.best().gains;
        let drawn = best.map(|gain| gain * reach.powf(2.0 * rng.random::<f64>() - 1.0));
        notebook.try_out(drawn)?;
    }
    Ok(notebook.search)
}

/// A simplex whose edges are all shorter than this, in the logarithm of a gain, has collapsed.
const COLLAPSED: f64 = 0.06;

/// The simplex search of Nelder and Mead on the logarithms of the gains: it learns the valley's
/// direction from its own trials, where random neighbours have to guess it each time.
///
/// # Source
///
/// J. A. Nelder and R. Mead, "A simplex method for function minimization", The Computer Journal
/// 7, 308 (1965).
///
/// # Errors
///
/// What `cost` fails with.
pub fn simplex<E>(
    start: Gains,
    trials: u32,
    reach: f64,
    cost: &mut dyn FnMut(Gains) -> Result<f64, E>,
) -> Result<Search, E> {
    let mut notebook = notebook(cost, trials);
    let gains = |point: [f64; 3]| point.map(f64::exp);
    let origin = start.map(f64::ln);
    let mut corners: Vec<([f64; 3], f64)> = Vec::with_capacity(4);
    for k in 0..4 {
        let mut point = origin;
        if k > 0 {
            point[k - 1] += reach.ln();
        }
        corners.push((point, notebook.try_out(gains(point))?));
    }
    let mut edge = reach.ln();
    while !notebook.is_over() {
        corners.sort_by(|a, b| a.1.total_cmp(&b.1));
        let best = corners[0].0;
        let size = corners[1..]
            .iter()
            .flat_map(|corner| corner.0.iter().zip(best).map(|(a, b)| (a - b).abs()))
            .fold(0.0, f64::max);
        if size < COLLAPSED {
            // Too small to see a slope through the steps of the cost: begin anew around the best,
            // the other way round.
            edge *= -0.6;
            for (k, corner) in corners[1..].iter_mut().enumerate() {
                if notebook.is_over() {
                    break;
                }
                corner.0 = best;
                corner.0[k] += edge;
                corner.1 = notebook.try_out(gains(corner.0))?;
            }
            continue;
        }
        let worst = corners[3];
        let middle: [f64; 3] =
            std::array::from_fn(|i| corners[..3].iter().map(|c| c.0[i]).sum::<f64>() / 3.0);
        let along = |t: f64| -> [f64; 3] {
            std::array::from_fn(|i| middle[i] + t * (worst.0[i] - middle[i]))
        };
        let reflected = (along(-1.0), notebook.try_out(gains(along(-1.0)))?);
        if reflected.1 < corners[0].1 && !notebook.is_over() {
            let expanded = (along(-2.0), notebook.try_out(gains(along(-2.0)))?);
            corners[3] = if expanded.1 < reflected.1 {
                expanded
            } else {
                reflected
            };
        } else if reflected.1 < corners[2].1 {
            corners[3] = reflected;
        } else if !notebook.is_over() {
            let t = if reflected.1 < worst.1 { -0.5 } else { 0.5 };
            let contracted = (along(t), notebook.try_out(gains(along(t)))?);
            if contracted.1 < worst.1.min(reflected.1) {
                corners[3] = contracted;
            } else {
                for corner in &mut corners[1..] {
                    if notebook.is_over() {
                        break;
                    }
                    corner.0 = std::array::from_fn(|i| 0.5 * (corner.0[i] + best[i]));
                    corner.1 = notebook.try_out(gains(corner.0))?;
                }
            }
        }
    }
    Ok(notebook.search)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use std::convert::Infallible;

    /// A curved valley in the logarithms of the gains.
    #[expect(clippy::unnecessary_wraps, reason = "a cost on a machine may fail")]
    fn valley(gains: Gains) -> Result<f64, Infallible> {
        let [x, y, z] = gains.map(f64::ln);
        Ok(1.0 + (x + y).powi(2) + 10.0 * (x - z).powi(2) + 0.3 * (x - 1.0).powi(2))
    }

    #[test]
    fn both_searches_go_down_and_keep_count() {
        let start = [0.1, 10.0, 3.0];
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(1);
        let random = random_neighbourhood(start, 100, 1.5, &mut rng, &mut valley).unwrap();
        let simplex = simplex(start, 50, 1.5, &mut valley).unwrap();
        for (search, most) in [(&random, 100), (&simplex, 50)] {
            assert_eq!(search.trials, most);
            assert!(search.path.windows(2).all(|w| w[1].cost < w[0].cost));
            assert!(
                search.best().cost < 0.2 * search.path[0].cost,
                "{:?}",
                search.best()
            );
        }
    }

    #[test]
    fn the_itae_of_a_dead_axis_is_half_the_window_squared() {
        let trace = Trace {
            period: 1e-3,
            encoder: vec![0.0; 1000],
            ..Trace::default()
        };
        assert!((itae(&trace, 50.0).unwrap() - 0.5).abs() < 1e-3);
    }
}

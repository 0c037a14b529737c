//! The claims on machines that are drawn: how many of them hold on how many.
//!
//! A specimen is what `reproduce --specimen` measures on: machine, device and fixture as `variation` and
//! `misplacement` of the plant have them. Claims of the model, or of numbers that are no part of a machine, are the
//! same on all of them and stay out, with the reason.

use crate::claims::{self, Group, Statement, Subject};
use crate::queue::work;
use crate::{Bench, Experiment, Figure, experiments};
use pigtail_hal::Error;
use pigtail_numerics::statistics::Sorted;
use pigtail_session::job::Ended;
use pigtail_session::setup::Setup;
use serde::Serialize;

/// How far apart the seeds of two specimens are: an experiment takes some dozens of seeds from its bench's on.
const STRIDE: u64 = 1000;

/// What drawn machines are asked.
#[derive(Debug)]
pub struct Specimens {
    benches: Vec<Bench>,
    selected: Vec<&'static str>,
}

/// A claim on drawn specimens.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OnSpecimens {
    /// The claim.
    pub id: &'static str,
    /// What it rests on.
    pub basis: Group,
    /// On how many it holds; `null` where it is not judged on specimens.
    pub held: Option<usize>,
    /// On how many it was judged.
    pub of: usize,
    /// The least that came out; `null` where nothing did.
    pub least: Option<f64>,
    /// The median.
    pub median: Option<f64>,
    /// The most.
    pub most: Option<f64>,
    /// Why it is not judged on specimens; `null` where it is.
    pub not_drawn: Option<&'static str>,
}

/// Claims of one group on drawn specimens.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Tally {
    /// How often one of them held on a specimen.
    pub hold: usize,
    /// How often one was judged on a specimen.
    pub of: usize,
    /// Those that hold on every specimen.
    pub on_all: usize,
    /// Those that are judged on specimens.
    pub claims: usize,
}

/// Claims on drawn specimens, by what they rest on.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Tallies {
    /// Those to which nothing was fitted.
    pub predictions: Tally,
    /// Those for which a number was set, or may have been.
    pub calibrated: Tally,
    /// Those that cannot fail by construction.
    pub definitions: Tally,
}

impl Tallies {
    /// The tally of a group.
    pub fn group(&self, group: Group) -> Tally {
        match group {
            Group::Prediction => self.predictions,
            Group::Calibrated => self.calibrated,
            Group::Definition => self.definitions,
        }
    }

    fn count(&mut self, claim: &OnSpecimens) {
        let Some(held) = claim.held else { return };
        let tally = match claim.basis {
            Group::Prediction => &mut self.predictions,
            Group::Calibrated => &mut self.calibrated,
            Group::Definition => &mut self.definitions,
        };
        tally.hold += held;
        tally.of += claim.of;
        tally.on_all += usize::from(held == claim.of);
        tally.claims += 1;
    }
}

/// An experiment that a specimen brought to an end. Its claims count as not held.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct EndedEarly {
    /// The specimen.
    pub seed: u64,
    /// What it was to give.
    pub figures: Vec<&'static str>,
    /// How it ended.
    pub how: String,
}

/// What came of the claims on drawn specimens.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SpecimensDocument {
    /// The seed of each: `reproduce --specimen --seed SEED` is the same machine.
    pub seeds: Vec<u64>,
    /// The claims, in the order of the thesis.
    pub claims: Vec<OnSpecimens>,
    /// The same, counted.
    pub accounts: Tallies,
    /// The experiments that came to no end.
    pub ended: Vec<EndedEarly>,
}

impl Specimens {
    /// So many specimens of a rig, for the claims of some figures.
    ///
    /// # Errors
    ///
    /// As [`Bench::new`].
    pub fn new(
        setup: &Setup,
        (seed, quick): (u64, bool),
        count: u32,
        selected: &[&'static str],
    ) -> Result<Self, Error> {
        let benches = (0..u64::from(count))
            .map(|k| {
                let seed = seed.wrapping_add(STRIDE.wrapping_mul(k));
                Bench::new(setup.clone(), seed, quick, true)
            })
            .collect::<Result<_, Error>>()?;
        Ok(Self {
            benches,
            selected: selected.to_vec(),
        })
    }

    /// How many experiments that is.
    pub fn experiments(&self) -> usize {
        self.jobs().len()
    }

    fn statements(&self) -> impl Iterator<Item = &'static Statement> {
        claims::all().filter(|statement| self.selected.contains(&statement.figure()))
    }

    /// The experiments that can give another result on another specimen, on each.
    fn jobs(&self) -> Vec<(usize, &'static Experiment)> {
        let drawn = |e: &&Experiment| {
            let mut drawn = self.statements().filter(|s| s.subject == Subject::Machine);
            drawn.any(|s| e.figures.contains(&s.figure()))
        };
        let chosen: Vec<&Experiment> = experiments().filter(drawn).collect();
        (0..self.benches.len())
            .flat_map(|k| chosen.iter().map(move |e| (k, *e)))
            .collect()
    }

    /// Runs them. `done` is told of each experiment that is through, from any thread.
    ///
    /// # Errors
    ///
    /// What is wrong with the rig. A machine that stops is a result.
    pub fn run(&self, done: &(dyn Fn(&[&'static str]) + Sync)) -> Result<SpecimensDocument, Ended> {
        let jobs = self.jobs();
        let made = work(
            &jobs,
            |(_, e)| e.cost,
            |(k, e)| {
                let made = match (e.run)(&self.benches[*k]) {
                    Err(ended @ (Ended::Input(_) | Ended::Unrecorded(_))) => return Err(ended),
                    made => made.map_err(|ended| ended.to_string()),
                };
                done(e.figures);
                Ok(made)
            },
        )?;
        let mut figures: Vec<Figure> = Vec::new();
        let mut ended = Vec::new();
        for ((k, e), made) in jobs.iter().zip(made) {
            match made {
                Ok(made) => figures.extend(made),
                Err(how) => ended.push(EndedEarly {
                    seed: self.benches[*k].seed,
                    figures: e.figures.to_vec(),
                    how,
                }),
            }
        }
        let claims: Vec<OnSpecimens> = self
            .statements()
            .filter_map(|statement| {
                let stopped = ended
                    .iter()
                    .filter(|e| e.figures.contains(&statement.figure()))
                    .count();
                judged(statement, &figures, stopped)
            })
            .collect();
        let mut accounts = Tallies::default();
        for claim in &claims {
            accounts.count(claim);
        }
        Ok(SpecimensDocument {
            seeds: self.benches.iter().map(|bench| bench.seed).collect(),
            claims,
            accounts,
            ended,
        })
    }
}

/// A claim on all specimens, by the figures that were made and how many came to no end; `None` where a quick run
/// leaves it out.
fn judged(statement: &Statement, figures: &[Figure], stopped: usize) -> Option<OnSpecimens> {
    let mut judged = OnSpecimens {
        id: statement.id,
        basis: statement.basis.group(),
        held: None,
        of: 0,
        least: None,
        median: None,
        most: None,
        not_drawn: statement.subject.not_drawn(),
    };
    if judged.not_drawn.is_some() {
        return Some(judged);
    }
    let made: Vec<&Figure> = figures
        .iter()
        .filter(|f| f.id == statement.figure() && !f.left_out.contains(&statement.id))
        .collect();
    judged.of = made.len() + stopped;
    if judged.of == 0 || (made.is_empty() && figures.iter().any(|f| f.id == statement.figure())) {
        return None;
    }
    let ours: Vec<f64> = made
        .iter()
        .filter_map(|f| f.claim(statement, true).ours)
        .collect();
    let holds = |value: &&f64| statement.kind.holds(statement.thesis, **value);
    judged.held = Some(ours.iter().filter(holds).count());
    let sorted = Sorted::new(ours);
    [judged.least, judged.median, judged.most] =
        [0.0, 0.5, 1.0].map(|share| sorted.percentile(share).map(claims::four_digits));
    Some(judged)
}

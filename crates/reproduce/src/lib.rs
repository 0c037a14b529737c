//! Every experiment of the thesis on the twin, through the control code of a real run, and each of
//! its results beside the printed one.
//!
//! - [`claims`]: what the thesis says, how near a result must come, and what each claim rests on;
//! - [`accounts`]: claims counted by that, and [`specimens`]: the same on drawn machines;
//! - `chapter2` to `chapter4`: a function a figure; figures that come from one experiment stand below
//!   one [`Experiment`];
//! - [`errata`]: where the thesis slips.
//!
//! What the thesis simulated is simulated with its model, (2.1)-(2.13), whose numbers are those of
//! `plant.toml`; what it measured is measured on the machine as it says that it departs from that model,
//! which is `measured.toml`. Either is the one in the middle of all specimens. The seed draws device,
//! fixture, noise and the searches' luck; where it is asked for, a specimen of the machine too, on which
//! then all is measured. What was simulated stays in the middle: a simulation knows its parameters.
//!
//! In goes a [`Bench`], out come figures and a [`ReproductionDocument`] of claims. Start with [`claims`].
//!
//! ```
//! use pigtail_reproduce::{experiments, select};
//!
//! // Every figure belongs to one experiment.
//! let chosen = select(&["2.8".to_owned()]).expect("a figure of the thesis");
//! assert_eq!(experiments().filter(|e| e.figures.contains(&chosen[0])).count(), 1);
//! ```

pub mod accounts;
mod chapter2;
mod chapter3;
mod chapter4;
pub mod claims;
pub mod errata;
mod noted;
pub mod picture;
mod queue;
pub mod specimens;

use accounts::Accounts;
use claims::{Claim, Statement};
use picture::Picture;
use pigtail_hal::Error;
use pigtail_session::job::Ended;
use pigtail_session::setup::Setup;
use pigtail_twin::plant::{Spread, Variation};
use serde::Serialize;
use specimens::SpecimensDocument;
use std::time::Instant;

/// What experiments are done on.
#[derive(Debug, Clone)]
pub struct Bench {
    /// The machine on which is measured what the thesis measured.
    pub machine: Setup,
    /// The model, without what specimens differ by, for what the thesis simulated.
    pub nominal: Setup,
    /// Whether the seed draws a specimen of the machine.
    pub specimen: bool,
    /// The seed.
    pub seed: u64,
    /// Whether to take fewer steps, devices and runs.
    pub quick: bool,
}

impl Bench {
    /// A bench with a rig in the middle of its specimens, or with one that the seed draws.
    ///
    /// # Errors
    ///
    /// As [`Setup::measured`].
    pub fn new(setup: Setup, seed: u64, quick: bool, specimen: bool) -> Result<Self, Error> {
        let mut machine = setup.measured()?;
        let mut nominal = setup;
        // The device's loss stays: it is no part of the machine.
        let middle = Variation {
            inertia: 0.0,
            friction: 0.0,
            stiffness: 0.0,
            motor: 0.0,
            micro_gain: 0.0,
            hysteresis: 0.0,
            creep: 0.0,
            links: 0.0,
            loss: nominal.plant.variation.loss,
            resonance: 0.0,
            damping: 0.0,
            spread: Spread::Uniform,
        };
        if !specimen {
            machine.plant.variation = middle.clone();
        }
        nominal.plant.variation = middle;
        Ok(Self {
            machine,
            nominal,
            specimen,
            seed,
            quick,
        })
    }

    /// One of two numbers: how many there are in a full run, and in a quick one.
    pub(crate) fn count<T>(&self, full: T, quick: T) -> T {
        if self.quick { quick } else { full }
    }
}

/// A figure of the thesis, made here.
#[derive(Debug, Clone)]
pub struct Figure {
    /// Its number, or `budget` for the times of 3.4.
    pub id: &'static str,
    /// Its caption in the thesis.
    pub title: &'static str,
    /// What is drawn.
    pub pictures: Vec<Picture>,
    /// Results by the name of the claim, and what else there is to know of each.
    pub results: Vec<(&'static str, f64, String)>,
    /// Claims that this run leaves out, for a quick one has no time for them.
    pub left_out: Vec<&'static str>,
    /// What was surprising; may be empty.
    pub remark: String,
}

impl Figure {
    fn new(id: &'static str, title: &'static str) -> Self {
        Self {
            id,
            title,
            pictures: Vec::new(),
            results: Vec::new(),
            left_out: Vec::new(),
            remark: String::new(),
        }
    }

    fn picture(mut self, picture: Picture) -> Self {
        self.pictures.push(picture);
        self
    }

    fn result(self, id: &'static str, value: f64) -> Self {
        self.noted(id, value, "")
    }

    fn noted(mut self, id: &'static str, value: f64, note: impl Into<String>) -> Self {
        self.results.push((id, value, note.into()));
        self
    }

    fn without(mut self, ids: &[&'static str]) -> Self {
        self.left_out.extend(ids);
        self
    }

    fn remark(mut self, text: impl Into<String>) -> Self {
        self.remark = text.into();
        self
    }

    /// Its claims, in the order of the list.
    fn claims(&self, specimen: bool) -> Vec<Claim> {
        claims::all()
            .filter(|statement| statement.figure() == self.id)
            .filter(|statement| !self.left_out.contains(&statement.id))
            .map(|statement| self.claim(statement, specimen))
            .collect()
    }

    /// A claim beside what came of it here.
    fn claim(&self, statement: &Statement, specimen: bool) -> Claim {
        let found = self.results.iter().find(|r| r.0 == statement.id);
        let note = found.map_or("Not measured.", |r| r.2.as_str());
        Claim::new(statement, found.map(|r| r.1), note, specimen)
    }
}

/// Figures that come from one experiment.
pub struct Experiment {
    /// Their numbers, in the order in which it returns them.
    pub figures: &'static [&'static str],
    /// How long it takes beside the others, about: the longest begin first.
    cost: u32,
    run: fn(&Bench) -> Result<Vec<Figure>, Ended>,
}

impl Experiment {
    const fn new(
        figures: &'static [&'static str],
        cost: u32,
        run: fn(&Bench) -> Result<Vec<Figure>, Ended>,
    ) -> Self {
        Self { figures, cost, run }
    }
}

/// Every experiment, in the order of the thesis.
pub fn experiments() -> impl Iterator<Item = &'static Experiment> {
    [
        chapter2::EXPERIMENTS,
        chapter3::EXPERIMENTS,
        chapter4::EXPERIMENTS,
    ]
    .into_iter()
    .flatten()
}

/// The name of the section of times, which has no figure of its own.
pub const BUDGET: &str = "budget";

/// The chapter of a figure.
pub fn chapter(figure: &str) -> &str {
    if figure == BUDGET {
        return "3";
    }
    figure.split('.').next().unwrap_or(figure)
}

/// The figures that chapters and figures name; all of them where none is named.
///
/// # Errors
///
/// The first name that is neither, and what is accepted.
pub fn select(names: &[String]) -> Result<Vec<&'static str>, Error> {
    let all: Vec<&'static str> = experiments().flat_map(|e| e.figures).copied().collect();
    for name in names {
        if !all.iter().any(|id| id == name || chapter(id) == name) {
            let message = format!(
                "no such chapter or figure; accepted are the chapters 2, 3 and 4, the figures {}, and \
                 `{BUDGET}` for the times of 3.4",
                ranges(&all)
            );
            return Err(Error::new(name, "", message));
        }
    }
    let named = |id: &str| names.iter().any(|name| name == id || name == chapter(id));
    let mut selected: Vec<&str> = all
        .into_iter()
        .filter(|id| names.is_empty() || named(id))
        .collect();
    selected.sort_by_key(|id| place(id));
    Ok(selected)
}

/// Chapter and number of a figure.
fn number(id: &str) -> Option<(u32, u32)> {
    let (chapter, figure) = id.split_once('.')?;
    Some((chapter.parse().ok()?, figure.parse().ok()?))
}

/// Its place in the thesis; the times of 3.4 come after the figures of their chapter.
fn place(id: &str) -> (u32, u32) {
    number(id).unwrap_or((chapter(id).parse().unwrap_or(u32::MAX), u32::MAX))
}

/// Numbers of figures as ranges, for a person.
fn ranges(all: &[&str]) -> String {
    let mut numbers: Vec<_> = all.iter().filter_map(|id| number(id)).collect();
    numbers.sort_unstable();
    let mut ranges: Vec<((u32, u32), u32)> = Vec::new();
    for (chapter, figure) in numbers {
        match ranges.last_mut() {
            Some((first, last)) if first.0 == chapter && *last + 1 == figure => *last = figure,
            _ => ranges.push(((chapter, figure), figure)),
        }
    }
    ranges
        .iter()
        .map(|((chapter, first), last)| {
            if first == last {
                format!("{chapter}.{first}")
            } else {
                format!("{chapter}.{first} to {chapter}.{last}")
            }
        })
        .collect::<Vec<_>>()
        .join(", ")
}

/// What `reproduce` prints as JSON and keeps as `summary.json`. Keys are a contract: more may come,
/// none changes its name or meaning. The same seed gives the same bytes, `seconds` apart.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReproductionDocument {
    /// The claims of the figures that were made, in the order of the thesis.
    pub claims: Vec<Claim>,
    /// Those that hold.
    pub held: usize,
    /// All of them.
    pub of: usize,
    /// How long it took by a clock on the wall.
    pub seconds: f64,
    /// Of those that hold, the ones for which no number was chosen: predictions and definitions.
    pub predicted: usize,
    /// All of that sort.
    pub of_predicted: usize,
    /// The same, counted by what they rest on, and what was changed of them.
    pub accounts: Accounts,
    /// The claims on drawn specimens; `null` where that was not asked for.
    pub specimens: Option<SpecimensDocument>,
    /// The rig as it was named.
    pub rig: String,
    /// The seed.
    pub seed: u64,
    /// Whether it was a quick run.
    pub quick: bool,
    /// Whether the seed drew the machine too.
    pub specimen: bool,
    /// The program's version.
    pub version: &'static str,
}

impl ReproductionDocument {
    /// Whether every claim holds but for those whose failing is explained.
    pub fn is_as_known(&self) -> bool {
        self.claims.iter().all(|c| c.holds || c.explained)
    }
}

/// All that was made.
#[derive(Debug, Clone)]
pub struct Reproduction {
    /// What is printed.
    pub document: ReproductionDocument,
    /// The figures, in the order of the thesis.
    pub figures: Vec<Figure>,
    /// The thesis's slips, with what was computed to check them.
    pub errata: Vec<errata::Erratum>,
}

/// Makes figures. `done` is told of each experiment that is through, from any thread; results do not
/// depend on the number of threads.
///
/// # Errors
///
/// A rig that lacks something, a machine that cannot be built or stopped, no fiber at its peak.
pub fn reproduce(
    bench: &Bench,
    selected: &[&'static str],
    done: &(dyn Fn(&[&'static str]) + Sync),
) -> Result<Reproduction, Ended> {
    let start = Instant::now();
    let chosen: Vec<&Experiment> = experiments()
        .filter(|e| e.figures.iter().any(|id| selected.contains(id)))
        .collect();
    let made = queue::work(
        &chosen,
        |e| e.cost,
        |e| {
            let made = (e.run)(bench)?;
            done(e.figures);
            Ok(made)
        },
    )?;
    let mut figures: Vec<Figure> = made
        .into_iter()
        .flatten()
        .filter(|figure| selected.contains(&figure.id))
        .collect();
    figures.sort_by_key(|figure| place(figure.id));
    let claims: Vec<Claim> = figures
        .iter()
        .flat_map(|figure| figure.claims(bench.specimen))
        .collect();
    let count = |keep: fn(&Claim) -> bool| claims.iter().filter(|c| keep(c)).count();
    let document = ReproductionDocument {
        held: count(|c| c.holds),
        of: claims.len(),
        predicted: count(|c| c.holds && !c.calibrated),
        of_predicted: count(|c| !c.calibrated),
        accounts: Accounts::new(&claims, selected),
        specimens: None,
        claims,
        seconds: pigtail_numerics::rounded(start.elapsed().as_secs_f64(), 1e-3),
        rig: bench.machine.rig.name.clone(),
        seed: bench.seed,
        quick: bench.quick,
        specimen: bench.specimen,
        version: env!("CARGO_PKG_VERSION"),
    };
    Ok(Reproduction {
        document,
        figures,
        errata: errata::all(&bench.nominal),
    })
}

//! A fiber on its way to a port, whatever aligns it: its phases, what was found out on the way, how it went.

use crate::beam::{Beam, SpotSize};
use crate::belief::{Across, Place};
use crate::dynamics::Dynamics;
use crate::gap_by_light::Spread;
use crate::outcome::{Halt, Outcome};
use crate::reactor::Reactor;
use crate::recipe::Recipe;
use crate::shaking::{Measured, Shaking};
use crate::station::Level;
use pigtail_hal::spec::{MICRO_AXES, OUTPUTS};
use pigtail_hal::{AxisName, Channel, Fault, Side};
use pigtail_model::frames::{Chip, Displacement, Point};

/// How one fiber's alignment went.
#[derive(Debug, Clone, PartialEq)]
pub struct FiberReport {
    /// The port's name.
    pub port: &'static str,
    /// The manipulator that carried the fiber.
    pub side: Side,
    /// How it ended.
    pub outcome: Outcome,
    /// How its tip shakes, where it was watched.
    pub shaking: Option<Measured>,
    /// How the axes of its micro swing, where steps have told.
    pub dynamics: Option<[Dynamics; MICRO_AXES]>,
    /// How light spreads in its micro's scale, where widths of the spot have told.
    pub spread: Option<Spread>,
    /// How wide its spot of light was, where circles at the chip have told.
    pub spot: Option<SpotSize>,
    /// How many times as far as its calibration says each piezo of its micro goes, where light has taught that and it was made use of.
    pub strokes: Option<[f64; MICRO_AXES]>,
    /// Axes that have swung at rest under their gains until then, and how many times as large as its calibration says these are since.
    pub gains: Vec<(AxisName, f64)>,
    /// By when its micro has come to rest, seconds, where the camera has seen that it swings for longer than was believed.
    pub rests: Option<f64>,
    /// Where it is believed to be, where it was attached and that is known.
    pub place: Option<Place>,
    /// Its phases in order, seconds of machine time each.
    pub phases: Vec<(&'static str, f64)>,
}

impl FiberReport {
    /// Machine time of all phases, seconds.
    pub fn seconds(&self) -> f64 {
        self.phases.iter().map(|(_, seconds)| seconds).sum()
    }
}

/// The names of the ports, input first.
pub const PORTS: [&str; 1 + OUTPUTS] = ["input", "output1", "output2"];

/// A fiber on its way to a port.
pub(crate) struct Job<'r> {
    pub(crate) recipe: &'r Recipe,
    /// Which output it is for; none for the input.
    pub(crate) output: Option<usize>,
    name: &'static str,
    /// The manipulator that carries it.
    pub(crate) side: Side,
    /// The port by design, chip's frame.
    pub(crate) port: Point<Chip>,
    /// The photodiode that sees its light.
    pub(crate) channel: Channel,
    phases: Vec<(&'static str, f64)>,
    /// How its tip shakes, as far as circles have told.
    pub(crate) shaking: Option<Shaking>,
    /// How the axes of its micro swing, where steps have told.
    pub(crate) dynamics: Option<[Dynamics; MICRO_AXES]>,
    /// How light spreads in its micro's scale, where widths of the spot have told.
    pub(crate) spread: Option<Spread>,
    /// How wide its spot of light was, where circles at the chip have told.
    pub(crate) spot: Option<SpotSize>,
    /// How many times as far as believed each piezo of its micro goes, where that was learned and made use of.
    pub(crate) strokes: Option<[f64; MICRO_AXES]>,
    /// Axes that have swung at rest, and what is left of their gains.
    pub(crate) gains: Vec<(AxisName, f64)>,
    /// By when its micro has come to rest, seconds, where it was seen to swing for longer than was believed.
    pub(crate) rests: Option<f64>,
    /// By how much its light differs from one turn of a circle to the next by itself, of its own, as far as circles have told.
    pub(crate) flicker: f64,
    /// Where it is believed to be.
    pub(crate) place: Option<Place>,
    /// Whether it is to be left at its peak, not attached; and what was known of it there.
    pub(crate) holds: bool,
    pub(crate) at_peak: Option<AtPeak>,
}

/// A fiber at its peak before its port, held and not attached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AtPeak {
    /// The manipulator that holds it.
    pub side: Side,
    /// The photodiode that sees its light.
    pub channel: Channel,
    /// Its level there, volts.
    pub level: Level,
    /// The level without its light, volts.
    pub background: f64,
    /// How well its place across is known, where the procedure can say so.
    pub across: Option<Across>,
    /// The light between it and its guide, as believed.
    pub beam: Beam,
    /// The gap, metres.
    pub gap: f64,
    /// How the peak walks as the gap closes, metres in the manipulator's x and y for a metre.
    pub walk: Displacement,
    /// How much nearer to the facet who guards the machine would let it come, who asks vision alone, metres.
    pub room: f64,
}

/// Aligns the fibers of a device one after the other, the input first. Outputs are
/// attempted where the input is aligned, and nothing once the machine has stopped.
pub(crate) async fn run_all<'r>(
    recipe: &'r Recipe,
    mut align: impl AsyncFnMut(&mut Job<'r>) -> Result<(), Halt>,
    mut put_back: impl AsyncFnMut(&mut Job<'r>) -> Result<(), Fault>,
) -> Vec<FiberReport> {
    let mut reports: Vec<FiberReport> = Vec::with_capacity(PORTS.len());
    for mut job in Job::all(recipe) {
        let dark = job.output.is_some() && reports[0].outcome != Outcome::Aligned;
        let stopped = reports
            .iter()
            .any(|report| report.outcome.fault().is_some());
        reports.push(if dark || stopped {
            job.report(Outcome::NotAttempted)
        } else {
            job.run(&mut align, &mut put_back).await
        });
    }
    reports
}

/// The reports of a device on which nothing could be begun.
pub fn not_begun(recipe: &Recipe, fault: Fault) -> Vec<FiberReport> {
    let mut outcomes =
        std::iter::once(Outcome::Stopped(fault)).chain(std::iter::repeat(Outcome::NotAttempted));
    Job::all(recipe)
        .map(|mut job| job.report(outcomes.next().unwrap_or(Outcome::NotAttempted)))
        .collect()
}

impl<'r> Job<'r> {
    /// What circles have told of how its tip shakes.
    pub(crate) fn has_shaken(&mut self, shaking: Shaking) {
        self.shaking = Some(self.shaking.map_or(shaking, |before| before.and(shaking)));
    }

    /// The ways of a device's fibers, the input's first.
    fn all(recipe: &'r Recipe) -> impl Iterator<Item = Self> {
        let outputs = (0..recipe.ports.outputs.len()).map(Some);
        std::iter::once(None)
            .chain(outputs)
            .map(|output| Self::of(recipe, output))
    }

    /// The way to the input, or to an output.
    pub(crate) fn of(recipe: &'r Recipe, output: Option<usize>) -> Self {
        let ports = &recipe.ports;
        let (name, side, [x, y, z], channel) = match output {
            None => (PORTS[0], Side::Left, ports.input, Channel::Sensing),
            Some(k) => (
                PORTS[1 + k],
                Side::Right,
                ports.outputs[k],
                Channel::of_output(k),
            ),
        };
        Self {
            recipe,
            output,
            name,
            side,
            port: Point::new(x, y, z),
            channel,
            phases: Vec::with_capacity(8),
            shaking: None,
            dynamics: None,
            spread: None,
            spot: None,
            strokes: None,
            gains: Vec::new(),
            rests: None,
            flicker: 0.0,
            place: None,
            holds: false,
            at_peak: None,
        }
    }

    /// How its tip shakes, where it was watched.
    pub(crate) fn shakes(&self) -> Option<Measured> {
        let watched = self.shaking.filter(Shaking::is_watched);
        watched.map(|shaking| shaking.measured())
    }

    /// How it went.
    pub(crate) fn report(&mut self, outcome: Outcome) -> FiberReport {
        FiberReport {
            port: self.name,
            side: self.side,
            outcome,
            shaking: self.shakes(),
            dynamics: self.dynamics,
            spread: self.spread,
            spot: self.spot,
            strokes: self.strokes,
            gains: std::mem::take(&mut self.gains),
            rests: self.rests,
            place: self.place.take(),
            phases: std::mem::take(&mut self.phases),
        }
    }

    /// Runs a whole alignment. One that fails leaves the machine well: the fiber is put back, away from the chip and into the
    /// tray.
    pub(crate) async fn run(
        &mut self,
        align: impl AsyncFnOnce(&mut Self) -> Result<(), Halt>,
        put_back: impl AsyncFnOnce(&mut Self) -> Result<(), Fault>,
    ) -> FiberReport {
        let outcome = match align(self).await {
            Ok(()) => Outcome::Aligned,
            Err(Halt::Fault(fault)) => Outcome::Stopped(fault),
            Err(Halt::Outcome(outcome)) => match put_back(self).await {
                Ok(()) => outcome,
                Err(fault) => Outcome::Stopped(fault),
            },
        };
        self.report(outcome)
    }

    /// Runs a phase and notes its time, also of one that ends early.
    pub(crate) async fn phase<T>(
        &mut self,
        bench: &Reactor<'_>,
        name: &'static str,
        work: impl AsyncFnOnce(&mut Self) -> Result<T, Halt>,
    ) -> Result<T, Halt> {
        bench.announce(self.name, name);
        let start = bench.now();
        let result = work(self).await;
        self.phases.push((name, bench.now() - start));
        bench.conclude(self.name, name);
        result
    }
}

//! Alignment on any bench, by poses and light alone: nobody has a camera here, and no sensing fiber.
//!
//! A person has taught where each fiber touches the chip's facet at its port's peak ([`Taught`]); chip and fiber of the day
//! are some micrometres from there. Both fibers of a guide stand back until the light between them is as wide as that:
//! there it is seen at once, or after some places around it (`first_light`). Circles find both peaks
//! ([`conical_scan`](crate::conical_scan)) and follow them while the gap closes along the beam. A fiber is attached only where
//! its place is sure.

mod climb;
mod fiber;
mod first_light;
mod measure;
mod observed;

use crate::tuning::TUNING;
pub use climb::{Found, find_peak};
pub use measure::{Known, MeasuredArm, MeasuredDark, MovedAxis, measure, measure_dark, move_axes};

use crate::beam::Beam;
use crate::outcome::{Halt, Outcome};
use crate::procedure::{FiberReport, PORTS};
use crate::reactor::{LONGEST, Reactor, refused};
use crate::recipe::Recipe;
use crate::station::Observer;
use fiber::Fiber;
use first_light::first_light;
pub(crate) use observed::Observed;
use pigtail_hal::bench::{Group, Law, Limits, Meter, Pose, Request};
use pigtail_hal::{Bench, Fault, Side};

/// A pose that was taught: with the coarse group there and the fine group in its middle the fiber's tip touches the
/// facet at the port's peak.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Taught {
    /// The arm.
    pub arm: usize,
    /// The port of its side, counted from zero.
    pub port: usize,
    /// Pose of the coarse group, in the frame of the arm.
    pub pose: Pose,
    /// How far the peak of a device is from there, in x and in y, one standard deviation, metres.
    pub across: f64,
    /// How far its facet may be from there along z, at most, metres...
    pub bound_z: f64,
    /// ...beside a normal deviation, metres.
    pub sigma_z: f64,
}

impl Taught {
    /// The gap at which light is searched for, metres: there it is wider than what is not known of where it is.
    pub fn search_gap(&self, recipe: &Recipe) -> f64 {
        let beam = Beam::new(&recipe.mode, recipe.ports.exit_angle);
        let wide = TUNING.taught.wide * self.across / beam.width(0.0);
        let back = beam.gap_of((wide * wide - 1.0).max(0.0));
        back.max(4.0 * recipe.approach.gap)
    }

    /// Pose of the coarse group so far aside of the beam, x and y, at a gap, metres.
    pub fn at_gap(&self, recipe: &Recipe, gap: f64, aside: [f64; 2]) -> Pose {
        let exit = recipe.ports.exit_angle;
        // The frame of the second arm is turned by half a turn.
        let walk = if self.arm == 0 {
            exit.tan()
        } else {
            -exit.tan()
        };
        self.pose + Pose::at(aside[0] + walk * gap, aside[1], -gap)
    }
}

/// What is believed of a bench that has no vision. Arm 0 carries the input, arm 1 the outputs.
///
/// The frame of arm 0 has the chip's axes, that of arm 1 is turned by half a turn about y: light that leaves the chip at
/// the recipe's exit angle goes to positive x of the chip on both sides.
#[derive(Debug, Clone, PartialEq)]
pub struct Belief {
    /// A pose for each port.
    pub taught: Vec<Taught>,
    /// What measures the light of each output.
    pub meters: Vec<Meter>,
}

impl Belief {
    /// The pose that was taught for a port of an arm.
    pub fn taught(&self, arm: usize, port: usize) -> Option<&Taught> {
        let of = |taught: &&Taught| (taught.arm, taught.port) == (arm, port);
        self.taught.iter().find(of)
    }
}

/// Aligns the input fiber and the output fibers of one device. Its outputs come after its input, which needs the first of
/// them to be seen.
pub fn align(
    bench: &mut dyn Bench,
    belief: &Belief,
    recipe: &Recipe,
    observer: &mut dyn Observer,
) -> Vec<FiberReport> {
    let mut bench = Observed::new(bench, observer);
    let bench = Reactor::new(&mut bench);
    let mut device = Device {
        bench: &bench,
        belief,
        recipe,
        dark: Dark::default(),
        reports: Vec::with_capacity(1 + recipe.ports.outputs.len()),
    };
    bench.run(device.align());
    device.reports
}

/// A meter without the laser.
#[derive(Debug, Clone, Copy, Default)]
struct Dark {
    /// Volts.
    mean: f64,
    /// Standard deviation of a sample, volts.
    sigma: f64,
}

impl Dark {
    /// The light without the laser, which is on afterwards.
    async fn measure(bench: &Reactor<'_>, meter: Meter) -> Result<Self, Halt> {
        bench.ask(Request::Laser(false), LONGEST).await?;
        // A meter forgets the laser in some samples.
        bench.look(meter.0, 5).await?;
        let (mean, sigma) = bench.look(meter.0, TUNING.taught.dark).await?;
        bench.ask(Request::Laser(true), LONGEST).await?;
        bench.look(meter.0, 5).await?;
        let step = bench.caps().channels[meter.0].resolution;
        Ok(Self {
            mean,
            sigma: sigma.max(step),
        })
    }
}

/// A device on its way.
struct Device<'d, 'b> {
    bench: &'d Reactor<'b>,
    belief: &'d Belief,
    recipe: &'d Recipe,
    dark: Dark,
    reports: Vec<FiberReport>,
}

/// Phases of a fiber, and their times.
type Phases = Vec<(&'static str, f64)>;

impl<'d> Device<'d, '_> {
    async fn align(&mut self) {
        let (mut phases, mut place) = (Phases::new(), None);
        let mut output = None;
        let input = self.input_fiber(&mut phases, &mut place, &mut output).await;
        let lit = self.report(0, input, phases, place).await;
        for port in 0..self.recipe.ports.outputs.len() {
            let (mut phases, mut place) = (Phases::new(), None);
            let result = if lit && !self.has_stopped() {
                let here = output.take();
                self.output_fiber(port, here, &mut phases, &mut place).await
            } else {
                Err(Outcome::NotAttempted.into())
            };
            self.report(1 + port, result, phases, place).await;
        }
    }

    fn has_stopped(&self) -> bool {
        let fault = |report: &FiberReport| report.outcome.fault().is_some();
        self.reports.iter().any(fault)
    }

    /// The input and the first output to their peaks at the last gap, and the input attached.
    async fn input_fiber(
        &mut self,
        phases: &mut Phases,
        place: &mut Option<crate::belief::Place>,
        output: &mut Option<Fiber<'d>>,
    ) -> Result<(), Halt> {
        let (mut left, mut right) = (self.fiber(0, 0)?, self.fiber(1, 0)?);
        self.phase(0, phases, "coarse", async |device: &mut Self| {
            device.dark = Dark::measure(device.bench, left.meter).await?;
            for fiber in [&mut left, &mut right] {
                fiber.load(device.bench).await?;
            }
            let pair = [&mut left, &mut right];
            Fiber::come_near(device.bench, pair).await
        })
        .await?;
        self.phase(0, phases, "search", async |device: &mut Self| {
            first_light(device.bench, &device.dark, &mut [&mut left, &mut right]).await
        })
        .await?;
        self.phase(0, phases, "centre", async |device: &mut Self| {
            // Each narrows what the other sees.
            for _ in 0..2 {
                left.centre(device.bench, &device.dark, "centre").await?;
                right.centre(device.bench, &device.dark, "centre").await?;
            }
            Ok(())
        })
        .await?;
        self.phase(0, phases, "approach", async |device: &mut Self| {
            let gap = device.recipe.approach.gap;
            right.approach(device.bench, &device.dark, gap).await?;
            left.approach(device.bench, &device.dark, gap).await
        })
        .await?;
        self.phase(0, phases, "final", async |device: &mut Self| {
            right.centre(device.bench, &device.dark, "final").await?;
            *place = Some(left.finish(device.bench, &device.dark).await?);
            Ok(())
        })
        .await?;
        *output = Some(right);
        Ok(())
    }

    /// An output to its port, from the tray or from where it has been seen already.
    async fn output_fiber(
        &mut self,
        port: usize,
        here: Option<Fiber<'d>>,
        phases: &mut Phases,
        place: &mut Option<crate::belief::Place>,
    ) -> Result<(), Halt> {
        let mut fiber = if let Some(fiber) = here {
            fiber
        } else {
            let mut fiber = self.fiber(1, port)?;
            self.phase(1 + port, phases, "coarse", async |device: &mut Self| {
                fiber.load(device.bench).await?;
                Fiber::come_near(device.bench, [&mut fiber]).await
            })
            .await?;
            self.phase(1 + port, phases, "search", async |device: &mut Self| {
                first_light(device.bench, &device.dark, &mut [&mut fiber]).await
            })
            .await?;
            self.phase(1 + port, phases, "centre", async |device: &mut Self| {
                fiber.centre(device.bench, &device.dark, "centre").await
            })
            .await?;
            self.phase(1 + port, phases, "approach", async |device: &mut Self| {
                let gap = device.recipe.approach.gap;
                fiber.approach(device.bench, &device.dark, gap).await
            })
            .await?;
            fiber
        };
        self.phase(1 + port, phases, "final", async |device: &mut Self| {
            *place = Some(fiber.finish(device.bench, &device.dark).await?);
            Ok(())
        })
        .await
    }

    fn fiber(&self, arm: usize, port: usize) -> Result<Fiber<'d>, Outcome> {
        let taught = self.belief.taught(arm, port).ok_or(Outcome::NotTaught)?;
        // The input's light is seen behind the first output.
        let meter = self.belief.meters.get(if arm == 0 { 0 } else { port });
        let meter = *meter.ok_or(Outcome::NotTaught)?;
        Fiber::new(self.bench, self.recipe, taught, meter)
    }

    async fn phase<T>(
        &mut self,
        port: usize,
        phases: &mut Phases,
        name: &'static str,
        work: impl AsyncFnOnce(&mut Self) -> Result<T, Halt>,
    ) -> Result<T, Halt> {
        let start = self.bench.now();
        self.bench.announce(PORTS[port], name);
        let result = work(self).await;
        phases.push((name, self.bench.now() - start));
        self.bench.conclude(PORTS[port], name);
        result
    }

    /// Notes how a fiber went. One that did not go well is taken back, and the machine left well. Whether it is aligned.
    async fn report(
        &mut self,
        port: usize,
        result: Result<(), Halt>,
        phases: Phases,
        place: Option<crate::belief::Place>,
    ) -> bool {
        let side = Side::ALL[port.min(1)];
        let outcome = match result {
            Ok(()) => Outcome::Aligned,
            Err(Halt::Fault(fault)) => Outcome::Stopped(fault),
            Err(Halt::Outcome(Outcome::NotAttempted)) => Outcome::NotAttempted,
            Err(Halt::Outcome(outcome)) => {
                // Where the input fails its first output goes back too.
                let mut ended = outcome;
                for arm in if port == 0 { 0..2 } else { 1..2 } {
                    if let Err(fault) = self.put_back(arm).await {
                        ended = Outcome::Stopped(fault);
                        break;
                    }
                }
                ended
            }
        };
        let aligned = outcome == Outcome::Aligned;
        self.reports.push(FiberReport {
            port: PORTS[port],
            side,
            outcome,
            shaking: None,
            spread: None,
            spot: None,
            strokes: None,
            place: place.filter(|_| aligned),
            phases,
        });
        aligned
    }

    /// An arm goes away from the chip, and its fiber back.
    async fn put_back(&mut self, arm: usize) -> Result<(), Fault> {
        if let Ok(fiber) = self.fiber(arm, 0)
            && let Err(Halt::Fault(fault)) = fiber.go_back(self.bench).await
        {
            return Err(fault);
        }
        match self.bench.ask(Request::Unload { arm }, LONGEST).await {
            Err(Halt::Fault(fault)) => Err(fault),
            Ok(()) | Err(Halt::Outcome(_)) => Ok(()),
        }
    }
}

/// A group goes straight to a pose and comes to rest.
async fn line(bench: &Reactor<'_>, group: Group, to: Pose, speed: Option<f64>) -> Result<(), Halt> {
    let limits = Limits { speed };
    let ticket = bench
        .play(group, Law::Line { to, limits })
        .map_err(|why| refused(&why))?;
    bench.done(vec![ticket], LONGEST).await
}

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
use crate::job::{FiberReport, Job, run_all};
use crate::outcome::{Halt, Outcome};
use crate::reactor::{LONGEST, Reactor};
use crate::recipe::Recipe;
use crate::station::Observer;
use fiber::Fiber;
use first_light::first_light;
pub(crate) use observed::Observed;
use pigtail_hal::bench::{Meter, Pose, Request};
use pigtail_hal::{Bench, Fault};

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
    let device = Device {
        bench: &bench,
        belief,
        recipe,
    };
    bench.run(device.align())
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
        bench.wait(bench.forgets_laser(meter.0)).await?;
        let (mean, sigma) = bench.look(meter.0, TUNING.taught.dark).await?;
        bench.ask(Request::Laser(true), LONGEST).await?;
        bench.wait(bench.forgets_laser(meter.0)).await?;
        let step = bench.caps().channels[meter.0].resolution;
        Ok(Self {
            mean,
            sigma: sigma.max(step),
        })
    }
}

/// A device on its way.
#[derive(Clone, Copy)]
struct Device<'d, 'b> {
    bench: &'d Reactor<'b>,
    belief: &'d Belief,
    recipe: &'d Recipe,
}

/// What the fibers of a device have in common.
#[derive(Default)]
struct Shared<'d> {
    dark: Dark,
    /// The first output's fiber, which has been at its peak while the input was aligned.
    output: Option<Fiber<'d>>,
}

impl<'d> Device<'d, '_> {
    async fn align(self) -> Vec<FiberReport> {
        let mut shared = Shared::default();
        run_all(
            self.recipe,
            async |job| match job.output {
                None => self.input_fiber(job, &mut shared).await,
                Some(port) => self.output_fiber(job, port, &mut shared).await,
            },
            async |job| {
                // Where the input fails its first output goes back too.
                for arm in if job.output.is_none() { 0..2 } else { 1..2 } {
                    self.put_back(arm).await?;
                }
                Ok(())
            },
        )
        .await
    }

    /// The input and the first output to their peaks at the last gap, and the input attached.
    async fn input_fiber(&self, job: &mut Job<'_>, shared: &mut Shared<'d>) -> Result<(), Halt> {
        let bench = self.bench;
        let (mut left, mut right) = (self.fiber(0, 0)?, self.fiber(1, 0)?);
        job.phase(bench, "coarse", async |_| {
            shared.dark = Dark::measure(bench, left.meter).await?;
            for fiber in [&mut left, &mut right] {
                fiber.load(bench).await?;
            }
            Fiber::come_near(bench, [&mut left, &mut right]).await
        })
        .await?;
        let dark = &shared.dark;
        job.phase(bench, "search", async |_| {
            first_light(bench, dark, &mut [&mut left, &mut right]).await
        })
        .await?;
        job.phase(bench, "centre", async |_| {
            // Each narrows what the other sees.
            for _ in 0..2 {
                left.centre(bench, dark, "centre").await?;
                right.centre(bench, dark, "centre").await?;
            }
            Ok(())
        })
        .await?;
        let gap = self.recipe.approach.gap;
        job.phase(bench, "approach", async |_| {
            right.approach(bench, dark, gap).await?;
            left.approach(bench, dark, gap).await
        })
        .await?;
        job.phase(bench, "final", async |job| {
            right.centre(bench, dark, "final").await?;
            left.finish(job, bench, dark).await
        })
        .await?;
        shared.output = Some(right);
        Ok(())
    }

    /// An output to its port, from the tray or from where it has been seen already.
    async fn output_fiber(
        &self,
        job: &mut Job<'_>,
        port: usize,
        shared: &mut Shared<'d>,
    ) -> Result<(), Halt> {
        let (bench, dark) = (self.bench, &shared.dark);
        let mut fiber = if let Some(fiber) = shared.output.take() {
            fiber
        } else {
            let mut fiber = self.fiber(1, port)?;
            job.phase(bench, "coarse", async |_| {
                fiber.load(bench).await?;
                Fiber::come_near(bench, [&mut fiber]).await
            })
            .await?;
            job.phase(bench, "search", async |_| {
                first_light(bench, dark, &mut [&mut fiber]).await
            })
            .await?;
            job.phase(bench, "centre", async |_| {
                fiber.centre(bench, dark, "centre").await
            })
            .await?;
            let gap = self.recipe.approach.gap;
            job.phase(bench, "approach", async |_| {
                fiber.approach(bench, dark, gap).await
            })
            .await?;
            fiber
        };
        job.phase(bench, "final", async |job| {
            fiber.finish(job, bench, dark).await
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

    /// An arm goes away from the chip, and its fiber back.
    async fn put_back(&self, arm: usize) -> Result<(), Fault> {
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

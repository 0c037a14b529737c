//! A bench measured by its light alone: what its groups lag behind, how far its coarse axes fall short when they turn back, where
//! they come to stand, and how wide the spot is.
//!
//! Both fibers of a guide are brought to their peaks and stay back from the chip, where an axis may go by more than its backlash
//! either way. Then one axis at a time goes to and fro over the peak. To the light at a time belongs where the group was a lag
//! earlier: forward the peak is seen that much late, and backward that much early.
//!
//! ```text
//! lag = (c+ - c-) / 2 v                 c+, c-: where a group is measured to be as it passes the peak at speed v
//! lag = (d(v) - d(u)) / 2 (v - u)       d = c+ - c- of an axis with backlash, which adds the same at every speed
//! ```
//!
//! Backlash is how far the fine group's peak moves when the coarse one comes to the same place from above and not from below. Along
//! z no peak is seen; but the light leaves the chip at an angle, so that a gap that differs moves the peak across.

use super::fiber::Fiber;
use super::first_light::first_light;
use super::observed::Observed;
use super::{Belief, Dark};
use crate::beam::Beam;
use crate::outcome::{Halt, Outcome};
use crate::reactor::{LONGEST, Reactor};
use crate::recipe::Recipe;
use crate::station::Observer;
use crate::tuning::TUNING;
use nalgebra::Vector3;
use pigtail_hal::Bench;
use pigtail_hal::bench::{Degree, Group, Meter, Pose, Request, Stage};
use pigtail_numerics::normal::Normal;
use std::f64::consts::TAU;

/// A value and its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Known {
    /// The value.
    pub value: f64,
    /// Its standard deviation.
    pub deviation: f64,
}

/// How an axis went where it was told to go, far from the chip.
#[derive(Debug, Clone, PartialEq)]
pub struct MovedAxis {
    /// The axis, such as `left.fine.x`.
    pub name: String,
    /// How far it was sent, metres.
    pub told: f64,
    /// How far it is measured to have gone, metres.
    pub went: f64,
    /// How long it took until it was done, seconds.
    pub seconds: f64,
    /// What it may be off by its datasheet, metres.
    pub accepted: f64,
}

impl MovedAxis {
    /// Whether it went where it was told to go.
    pub fn is_well(&self) -> bool {
        (self.went - self.told).abs() <= self.accepted
    }
}

/// A meter without fibers before it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredDark {
    /// Its level without the laser, volts.
    pub level: f64,
    /// Standard deviation of a sample, volts.
    pub noise: f64,
}

/// What the light told of an arm.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredArm {
    /// Gap at which all of it was measured, metres.
    pub gap: f64,
    /// Light at the peak there, volts.
    pub light: f64,
    /// Standard deviation of its samples, as a share of it.
    pub noise: f64,
    /// How much later light is than the fine group's pose, seconds.
    pub fine_lag: Known,
    /// The same of the coarse group.
    pub coarse_lag: Known,
    /// How far the coarse axes fall short when they turn back, x, y and z, metres; `None` where light does not tell.
    pub backlash: [Option<Known>; 3],
    /// How far, rms, the coarse group is from where it was told to stand, x and y, from below, metres...
    pub stands: [f64; 2],
    /// ...over a way of so many metres.
    pub over: f64,
    /// How wide the spot is at the chip, along x and y of the arm: where light has fallen to 1/e, metres. Along x it is wider than across the
    /// light, which leaves the chip at an angle.
    pub spot: [Known; 2],
}

/// A peak on lines to and fro.
struct Passed {
    /// Where it is, the middle of both ways, metres.
    centre: Known,
    /// How far forward it is seen beyond where backward, metres.
    apart: Known,
    /// Distance at which light has fallen to 1/e, metres.
    width: Known,
}

/// Sends each axis of each group forth and back, z away from the chip.
///
/// # Errors
///
/// A fault; what a bench refuses or fails.
pub fn move_axes(
    bench: &mut dyn Bench,
    observer: &mut dyn Observer,
) -> Result<Vec<MovedAxis>, Halt> {
    let mut bench = Observed::new(bench, observer);
    let bench = Reactor::new(&mut bench);
    bench.run(async {
        let mut moved = Vec::new();
        let groups = bench.caps().groups.clone();
        for (i, caps) in groups.iter().enumerate() {
            let group = Group(i);
            for degree in Degree::ALL {
                let Some(axis) = caps.axes[degree.index()] else {
                    continue;
                };
                let before = pose(&bench, group)?;
                let way = TUNING.lines.way * (axis.range.1 - axis.range.0);
                let away = before.0[degree.index()] - way;
                let told = if degree == Degree::Z || away >= axis.range.0 {
                    -way
                } else {
                    way
                };
                let to = before.with(degree, before.0[degree.index()] + told);
                let begin = bench.now();
                bench.line(group, to, None).await?;
                let seconds = bench.now() - begin;
                let went = pose(&bench, group)?.0[degree.index()] - before.0[degree.index()];
                bench.line(group, before, None).await?;
                moved.push(MovedAxis {
                    name: format!("{}.{}", caps.name, degree.name()),
                    told,
                    went,
                    seconds,
                    accepted: axis.backlash + 5.0 * axis.repeatability.max(axis.resolution),
                });
            }
        }
        Ok(moved)
    })
}

/// Each meter in the dark, and the laser off.
///
/// # Errors
///
/// A fault; a meter that is silent.
pub fn measure_dark(
    bench: &mut dyn Bench,
    observer: &mut dyn Observer,
) -> Result<Vec<MeasuredDark>, Halt> {
    let mut bench = Observed::new(bench, observer);
    let bench = Reactor::new(&mut bench);
    bench.run(async {
        let mut meters = Vec::new();
        for meter in 0..bench.caps().channels.len() {
            let dark = Dark::measure(&bench, Meter(meter)).await?;
            meters.push(MeasuredDark {
                level: dark.mean,
                noise: dark.sigma,
            });
        }
        bench.ask(Request::Laser(false), LONGEST).await?;
        Ok(meters)
    })
}

/// Brings both fibers of the first guide to their peaks and measures both arms there. The fibers go back afterwards, however it ends but by a
/// fault.
///
/// # Errors
///
/// A fault; how the alignment ended where there is no light or no peak; [`BenchFailed`](Outcome::BenchFailed) where what is seen on
/// a line is no peak.
pub fn measure(
    bench: &mut dyn Bench,
    belief: &Belief,
    recipe: &Recipe,
    observer: &mut dyn Observer,
) -> Result<[MeasuredArm; 2], Halt> {
    let mut bench = Observed::new(bench, observer);
    let bench = Reactor::new(&mut bench);
    bench.run(async {
        let taught = |arm| belief.taught(arm, 0).ok_or(Outcome::NotTaught);
        let meter = *belief.meters.first().ok_or(Outcome::NotTaught)?;
        let mut left = Fiber::new(&bench, recipe, taught(0)?, meter)?;
        let mut right = Fiber::new(&bench, recipe, taught(1)?, meter)?;
        let measured = measure_both(&bench, [&mut left, &mut right], recipe).await;
        if let Err(Halt::Fault(_)) = measured {
            return measured;
        }
        for fiber in [&left, &right] {
            fiber.go_back(&bench).await?;
            let arm = fiber.arm();
            match bench.ask(Request::Unload { arm }, LONGEST).await {
                // One that was not loaded is not there.
                Err(Halt::Outcome(_)) if measured.is_err() => {}
                unloaded => unloaded?,
            }
        }
        measured
    })
}

/// The fibers of both arms to their peaks, and what is measured there.
async fn measure_both(
    bench: &Reactor<'_>,
    [left, right]: [&mut Fiber<'_>; 2],
    recipe: &Recipe,
) -> Result<[MeasuredArm; 2], Halt> {
    let dark = Dark::measure(bench, left.meter).await?;
    left.load(bench).await?;
    right.load(bench).await?;
    Fiber::come_near(bench, [&mut *left, &mut *right]).await?;
    first_light(bench, &dark, &mut [&mut *left, &mut *right]).await?;
    for _ in 0..2 {
        left.centre(bench, &dark, "centre").await?;
        right.centre(bench, &dark, "centre").await?;
    }
    // There the spot is hardly wider than at the chip, and axes may go either way.
    let gap = Beam::new(&recipe.mode, recipe.ports.exit_angle).gap_of(1.0);
    right.approach(bench, &dark, gap).await?;
    left.approach(bench, &dark, gap).await?;
    let mut both = [
        measure_arm(bench, &dark, left, recipe).await?,
        measure_arm(bench, &dark, right, recipe).await?,
    ];
    for (fiber, measured) in [left, right].into_iter().zip(&mut both) {
        fiber.approach(bench, &dark, recipe.approach.gap).await?;
        measured.spot = spot(bench, &dark, fiber, recipe).await?;
    }
    Ok(both)
}

async fn measure_arm(
    bench: &Reactor<'_>,
    dark: &Dark,
    fiber: &Fiber<'_>,
    recipe: &Recipe,
) -> Result<MeasuredArm, Halt> {
    let beam = Beam::new(&recipe.mode, recipe.ports.exit_angle);
    let arm = Lines {
        bench,
        dark: dark.mean,
        meter: fiber.meter.0,
    };
    let (coarse, fine) = (
        group(bench, fiber, Stage::Coarse)?,
        group(bench, fiber, Stage::Fine)?,
    );
    let gap = fiber.measured_gap(bench);
    let width = beam.width(gap);
    let (light, sigma) = bench.look(arm.meter, 40).await?;
    let light = light - dark.mean;
    let middle = pose(bench, fine)?;
    let rate = bench.caps().channels[arm.meter].rate;
    let speed = 2.0 * TUNING.lines.half * width * rate / TUNING.lines.samples;
    let fine_line = Line {
        width,
        speed,
        beyond: TUNING.lines.beyond * width,
        lower: 0.0,
        times: TUNING.lines.lines,
    };
    let x = arm.passed(fine, Degree::X, middle, fine_line).await?;
    let y = arm.passed(fine, Degree::Y, middle, fine_line).await?;
    let peak = middle
        .with(Degree::X, x.centre.value)
        .with(Degree::Y, y.centre.value);
    bench.line(fine, peak, None).await?;
    let lag = |passed: &Passed| over(passed.apart, 2.0 * speed);
    let fine_lag = together(lag(&x), lag(&y));
    let here = pose(bench, coarse)?;
    let run = fiber.run_up(bench).min(0.25 * gap);
    let steps = Steps {
        arm: &arm,
        run,
        coarse,
        fine,
        here,
        peak,
        width,
        speed,
    };
    // Along z, coming from above is coming from nearer to the chip.
    let walk = fiber.walk();
    let backlash = [
        Some(steps.backlash(Degree::X, Degree::X, 1.0).await?),
        Some(steps.backlash(Degree::Y, Degree::Y, 1.0).await?),
        if walk.abs() > TUNING.lines.steep {
            Some(steps.backlash(Degree::Z, Degree::X, walk).await?)
        } else {
            None
        },
    ];
    let play = backlash[0].map_or(0.0, |play| play.value.max(0.0));
    let at = |speed| Line {
        width,
        speed,
        // Before it is seen the play has been used up, and on the way back it is seen as much lower.
        beyond: run.max(2.0 * play),
        lower: play,
        times: TUNING.lines.many,
    };
    let fast = arm.passed(coarse, Degree::X, here, at(2.0 * speed)).await?;
    let slow = arm.passed(coarse, Degree::X, here, at(speed)).await?;
    bench.line(coarse, here, None).await?;
    let coarse_lag = over(
        Known {
            value: fast.apart.value - slow.apart.value,
            deviation: fast.apart.deviation.hypot(slow.apart.deviation),
        },
        2.0 * speed,
    );
    let (stands_x, over_x) = steps.stands(Degree::X).await?;
    let (stands_y, over_y) = steps.stands(Degree::Y).await?;
    Ok(MeasuredArm {
        gap,
        light,
        noise: sigma / light,
        fine_lag,
        coarse_lag,
        backlash,
        stands: [stands_x, stands_y],
        over: over_x.min(over_y),
        spot: [x.width, y.width],
    })
}

/// How wide the spot of a fiber is at the chip, which stands near to it. Two Gaussian modes a way `z` apart see a spot of the squared width
/// `S + (lambda z / 2 pi)^2 / S`, of which `S` is looked for. Farther off, where both parts are as large, it would tell nothing of `S`.
async fn spot(
    bench: &Reactor<'_>,
    dark: &Dark,
    fiber: &Fiber<'_>,
    recipe: &Recipe,
) -> Result<[Known; 2], Halt> {
    let arm = Lines {
        bench,
        dark: dark.mean,
        meter: fiber.meter.0,
    };
    let fine = group(bench, fiber, Stage::Fine)?;
    let gap = fiber.measured_gap(bench);
    let width = Beam::new(&recipe.mode, recipe.ports.exit_angle).width(gap);
    let rate = bench.caps().channels[arm.meter].rate;
    let of = Line {
        width,
        speed: 2.0 * TUNING.lines.half * width * rate / TUNING.lines.samples,
        beyond: TUNING.lines.beyond * width,
        lower: 0.0,
        times: TUNING.lines.lines,
    };
    let middle = pose(bench, fine)?;
    let x = arm.passed(fine, Degree::X, middle, of).await?.width;
    let y = arm.passed(fine, Degree::Y, middle, of).await?.width;
    bench.line(fine, middle, None).await?;
    let length = recipe.mode.wavelength / recipe.mode.gap_index / TAU;
    let spread = |gap: f64| length * gap / recipe.ports.exit_angle.cos();
    let unsure = fiber.unsure_of_gap();
    let at_chip = |seen: Known| {
        let of = |gap: f64| {
            let squared = 0.5 * seen.value * seen.value;
            let root = (squared * squared - spread(gap).powi(2)).max(0.0).sqrt();
            (squared + root).sqrt()
        };
        Known {
            value: of(gap),
            deviation: seen.deviation.hypot(of(gap) - of(gap + unsure)),
        }
    };
    Ok([at_chip(x), at_chip(y)])
}

fn group(bench: &Reactor<'_>, fiber: &Fiber<'_>, stage: Stage) -> Result<Group, Outcome> {
    bench
        .caps()
        .group(fiber.arm(), stage)
        .ok_or(Outcome::NotTaught)
}

fn pose(bench: &Reactor<'_>, group: Group) -> Result<Pose, Outcome> {
    let at = bench.pose(group, bench.now()).map(|at| at.pose);
    at.ok_or_else(|| Outcome::BenchFailed {
        why: format!(
            "{} does not say where it is",
            bench.caps().groups[group.0].name
        ),
    })
}

fn over(of: Known, by: f64) -> Known {
    Known {
        value: of.value / by,
        deviation: of.deviation / by.abs(),
    }
}

/// The mean of two that should be the same; known no better than they agree.
fn together(a: Known, b: Known) -> Known {
    let value = 0.5 * (a.value + b.value);
    let stated = 0.5 * a.deviation.hypot(b.deviation);
    Known {
        value,
        deviation: stated.max(0.5 * (a.value - b.value).abs()),
    }
}

/// Mean of four or more values and its standard deviation: by so few that is Student's.
fn mean(values: &[f64]) -> Known {
    let n = values.len() as f64;
    let value = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|v| (v - value).powi(2)).sum();
    Known {
        value,
        deviation: (squares / ((n - 3.0) * n)).sqrt(),
    }
}

/// A line to and fro over a peak.
#[derive(Clone, Copy)]
struct Line {
    /// Width of the light, metres.
    width: f64,
    /// Metres a second.
    speed: f64,
    /// How much farther it goes than light is looked at, metres.
    beyond: f64,
    /// How much lower the peak is on the way back, metres.
    lower: f64,
    /// How often.
    times: usize,
}

/// Lines over a peak, and what measures its light.
struct Lines<'l, 'b> {
    bench: &'l Reactor<'b>,
    /// Volts.
    dark: f64,
    meter: usize,
}

impl Lines<'_, '_> {
    /// To and fro over the peak so many times along an axis of a group, about a middle.
    async fn passed(
        &self,
        group: Group,
        degree: Degree,
        middle: Pose,
        of: Line,
    ) -> Result<Passed, Halt> {
        let at = middle.0[degree.index()];
        let half = TUNING.lines.half * of.width;
        let far = half + of.beyond;
        let [low, high] = [-far, far].map(|by| middle.with(degree, at + by));
        self.bench.line(group, low, None).await?;
        let (mut centres, mut aparts, mut widths) = (Vec::new(), Vec::new(), Vec::new());
        for _ in 0..of.times {
            let forth = self.peak(group, (degree, at, half), high, of.speed).await?;
            let back = self
                .peak(group, (degree, at - of.lower, half), low, of.speed)
                .await?;
            centres.push(0.5 * (forth.0 + back.0));
            aparts.push(forth.0 - back.0);
            widths.push(0.5 * (forth.1 + back.1));
        }
        Ok(Passed {
            centre: mean(&centres),
            apart: mean(&aparts),
            width: mean(&widths),
        })
    }

    /// Where the peak is seen on the way to a pose, and how wide, metres: by light that is no farther than so much from a middle.
    async fn peak(
        &self,
        group: Group,
        (degree, middle, half): (Degree, f64, f64),
        to: Pose,
        speed: f64,
    ) -> Result<(f64, f64), Halt> {
        let (bench, begin) = (self.bench, self.bench.now());
        bench.send_to(group, to, Some(speed))?;
        let mut seen = Vec::new();
        while bench.moving(group) {
            if let Some((time, volts)) = bench.sample(self.meter, begin + LONGEST).await?
                && let Some(at) = bench.pose(group, time)
            {
                let at = at.pose.0[degree.index()];
                if (at - middle).abs() <= half {
                    seen.push((at, volts - self.dark));
                }
            }
            if bench.is_past(begin + LONGEST) {
                let why = "a line was not done".to_owned();
                return Err(Outcome::BenchFailed { why }.into());
            }
        }
        gaussian(&seen).ok_or_else(|| {
            let name = &bench.caps().groups[group.0].name;
            let why = format!(
                "light has no peak on a line of {name} along {}",
                degree.name()
            );
            Outcome::BenchFailed { why }.into()
        })
    }
}

/// Peak and 1/e width of light over places, by the parabola of its logarithm; `None` where it is no peak.
fn gaussian(seen: &[(f64, f64)]) -> Option<(f64, f64)> {
    let brightest = seen.iter().map(|(_, volts)| *volts).fold(0.0, f64::max);
    let (first, last) = (seen.first()?.0, seen.last()?.0);
    let (middle, scale) = (0.5 * (first + last), 0.5 * (last - first).abs());
    let mut normal = Normal::<3>::default();
    let bright = seen
        .iter()
        .filter(|(_, volts)| *volts > TUNING.lines.dim * brightest);
    let mut count = 0;
    for (at, volts) in bright {
        let u = (at - middle) / scale;
        normal.add_weighted(&Vector3::new(1.0, u, u * u), volts.ln(), volts * volts);
        count += 1;
    }
    let [_, slope, curvature] = normal.solve()?.into();
    let centre = -0.5 * slope / curvature;
    (count >= 4 && curvature < 0.0 && centre.abs() < 2.0)
        .then(|| (middle + scale * centre, scale / (-curvature).sqrt()))
}

/// A coarse group that is set to places, and a fine one that finds the peak from each.
struct Steps<'s, 'l, 'b> {
    arm: &'s Lines<'l, 'b>,
    /// From how far below, or above, a place is come to, metres.
    run: f64,
    coarse: Group,
    fine: Group,
    /// Where the coarse group stands, come from below.
    here: Pose,
    /// Where the fine group has its peak then.
    peak: Pose,
    width: f64,
    speed: f64,
}

impl Steps<'_, '_, '_> {
    /// The coarse group to a pose, every axis from below but `above`.
    async fn stand(&self, at: Pose, above: Option<Degree>) -> Result<(), Halt> {
        let (bench, run) = (self.arm.bench, self.run);
        let mut before = at + Pose::at(-run, -run, -run);
        if let Some(degree) = above {
            before = before.with(degree, at.0[degree.index()] + run);
        }
        bench.line(self.coarse, before, None).await?;
        bench.line(self.coarse, at, None).await
    }

    /// Where the fine group sees the peak along an axis, from so far from where it was, metres.
    async fn sees(&self, degree: Degree, from: f64) -> Result<f64, Halt> {
        let (fine, width, bench) = (self.fine, self.width, self.arm.bench);
        let line_of = Line {
            width,
            speed: self.speed,
            beyond: TUNING.lines.beyond * width,
            lower: 0.0,
            times: TUNING.lines.few,
        };
        let most = super::climb::range(bench, fine, degree)
            - (TUNING.lines.half + TUNING.lines.beyond) * width;
        let mut about = self.peak.0[degree.index()] + from;
        let mut seen = about;
        for _ in 0..TUNING.lines.looks {
            about = about.clamp(-most, most);
            let middle = self.peak.with(degree, about);
            seen = self
                .arm
                .passed(fine, degree, middle, line_of)
                .await?
                .centre
                .value;
            if (seen - about).abs() < 0.5 * TUNING.lines.half * width {
                break;
            }
            about = seen;
        }
        bench.line(fine, self.peak, None).await?;
        Ok(seen)
    }

    /// How far an axis falls short when it comes from above: by that the peak is lower along `seen`, `gain` times.
    async fn backlash(&self, degree: Degree, seen: Degree, gain: f64) -> Result<Known, Halt> {
        let mut short = Vec::new();
        for _ in 0..TUNING.lines.turned {
            self.stand(self.here, None).await?;
            let below = self.sees(seen, 0.0).await?;
            self.stand(self.here, Some(degree)).await?;
            short.push((below - self.sees(seen, 0.0).await?) / gain);
        }
        self.stand(self.here, None).await?;
        Ok(mean(&short))
    }

    /// How far the coarse group is from where it was told to stand along an axis, rms about the mean, from below; and over which way.
    async fn stands(&self, degree: Degree) -> Result<(f64, f64), Halt> {
        let bench = self.arm.bench;
        let range = super::climb::range(bench, self.fine, degree);
        let beyond = self.peak.0[degree.index()].abs()
            + (TUNING.lines.half + TUNING.lines.beyond) * self.width;
        let far = (TUNING.lines.follows * range).min(range - beyond).max(0.0);
        let step = far / f64::from(TUNING.lines.places);
        let mut left = Vec::new();
        for k in -TUNING.lines.places..=TUNING.lines.places {
            let by = f64::from(k) * step;
            let at = self.here.with(degree, self.here.0[degree.index()] + by);
            self.stand(at, None).await?;
            left.push((by, self.sees(degree, -by).await? + by));
        }
        self.stand(self.here, None).await?;
        let n = left.len() as f64;
        let mean = left.iter().map(|(_, at)| at).sum::<f64>() / n;
        let squares: f64 = left.iter().map(|(_, at)| (at - mean).powi(2)).sum();
        Ok(((squares / (n - 1.0)).sqrt(), 2.0 * far))
    }
}

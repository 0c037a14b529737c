//! Hold and nudge: aligning with the macro alone, for rigs without a micro (thesis 4.3.3).
//!
//! The servo brings the fiber to first light and lets go of the five-bar. From then on pulses move it,
//! friction holds it, and the light is the sensor: a few readings around where the fiber is believed to
//! be give the peak of known width, and also by how much pulses move the fiber more or less than
//! believed.

use crate::beam::{Beam, Peak, Reading};
use crate::cell::AlignmentCell;
use crate::impulse::belief::ImpulseBelief;
use crate::impulse::response::Response;
use crate::job::{FiberReport, Job};
use crate::outcome::{Halt, Lack, Outcome, SearchEvidence};
use crate::procedure::{each_fiber, look, lost, no_light, outward};
use crate::recipe::Recipe;
use crate::search::Searcher;
use crate::station::{Station, VoltageMachine};
use crate::tip_estimator::Tip;
use crate::tuning::{Care, TUNING};
use pigtail_hal::quantity::Volts;
use pigtail_hal::{Axis, AxisName, Channel, Side};
use pigtail_model::frames::{Displacement, Macro, Point};

/// The joints that pulses move.
const JOINTS: [Axis; 2] = [Axis::A, Axis::B];

/// Aligns the input fiber and the output fibers of one device without moving any micro.
pub fn macro_only(station: &mut Station, recipe: &Recipe) -> Vec<FiberReport> {
    let cell = AlignmentCell::over(station);
    let cell = &cell;
    cell.run(each_fiber(cell, recipe, async |job| {
        if job.output.is_none() {
            cell.laser(true)?;
        }
        align(job, cell).await
    }))
}

/// Aligns one fiber; the servo has the joints back in the end, whatever came of it.
async fn align(job: &mut Job<'_>, cell: &AlignmentCell<'_>) -> Result<(), Halt> {
    let result = held_and_nudged(job, cell).await;
    let side = job.side;
    cell.voltage(|machine| {
        for axis in JOINTS {
            machine.close_loop(AxisName { side, axis });
        }
    });
    result
}

async fn held_and_nudged(job: &mut Job<'_>, cell: &AlignmentCell<'_>) -> Result<(), Halt> {
    let (side, recipe) = (job.side, job.recipe);
    let index = job.output.unwrap_or(0);
    job.phase(cell, "coarse", async |job| {
        job.withdraw(cell, side).await?;
        if !cell.carries(side) {
            cell.load(side, index).await?;
        }
        let start = job.search_start();
        job.place(cell, side, Tip::Fiber, start, recipe.raster.gap)
            .await
    })
    .await?;
    let mut top = None;
    if side == Side::Left {
        top = Some(
            job.phase(cell, "sensing", async |job| {
                job.find_top(cell, recipe.ports.outputs[0]).await
            })
            .await?,
        );
    }
    let (searcher, place) = job
        .phase(cell, "search", async |job| {
            let start = cell.wanted(side);
            let step = recipe.sensing.sidestep;
            let mut evidence: Option<SearchEvidence> = None;
            // The guided light may pass beside the sensing fiber's core, to either side.
            let asides: &[f64] = if top.is_some() {
                &[0.0, step, -step]
            } else {
                &[0.0]
            };
            for aside in asides {
                if let Some(top) = &top {
                    job.beside_top(cell, top, *aside).await?;
                }
                match search(job, cell, start).await {
                    Ok(found) => return Ok(found),
                    Err(halt) => evidence = Some(halt.no_light()?.after(evidence)),
                }
            }
            Err(no_light(evidence))
        })
        .await?;
    let mut nudger = job
        .phase(cell, "centre", async |job| {
            let mut nudger = Nudger::new(cell, job, &searcher)?;
            relaxed_at(job, cell, place).await?;
            nudger.hold(cell);
            nudger.find(cell, recipe.raster.gap).await?;
            nudger
                .centre(cell, recipe.raster.gap, &TUNING.nudge.first)
                .await?;
            Ok(nudger)
        })
        .await?;
    let before = nudger.level(cell, TUNING.nudge.last.seconds).await?;
    job.phase(cell, "approach", async |job| {
        let (_, z) = look(cell, side, Tip::Fiber, recipe.approach.frames).await?;
        let mut gap = outward(side) * (z - job.port.z);
        let steps = ((gap - recipe.approach.gap) / TUNING.nudge.step)
            .ceil()
            .max(1.0);
        let step = (gap - recipe.approach.gap) / steps;
        for _ in 0..steps as u32 {
            let end = cell.wanted(side).shifted(0.0, 0.0, step);
            cell.go(side, end).await?;
            cell.wait(0.04).await?;
            gap -= step;
            nudger.walk(cell, job, step).await?;
            nudger.centre(cell, gap, &TUNING.nudge.approach).await?;
        }
        Ok(())
    })
    .await?;
    job.phase(cell, "final", async |job| {
        nudger
            .centre(cell, recipe.approach.gap, &TUNING.nudge.last)
            .await?;
        let last = cell.level(job.channel, TUNING.nudge.last.seconds).await?;
        let after = last.mean - nudger.background;
        Outcome::of_growth(before, after, recipe.accept.growth * before)?;
        job.attach(cell, last, nudger.background, (None, None))
            .await
    })
    .await
}

/// Looks for light in columns, from the middle outward, all of them upward; where it is, the micro in
/// its middle all the time.
async fn search(
    job: &mut Job<'_>,
    cell: &AlignmentCell<'_>,
    start: Point<Macro>,
) -> Result<(Searcher, Point<Macro>), Halt> {
    let (side, recipe) = (job.side, job.recipe);
    let raster = &recipe.raster;
    cell.move_micro(side, Displacement::ZERO)?;
    let searcher = Searcher::measure(cell, side, job.channel, raster.significance, 0.5).await?;
    let beam = cell.beam(side, recipe);
    let pitch = TUNING.nudge.pitch * beam.width(raster.gap);
    let columns = (0.5 * raster.x / pitch).ceil() as i32 + 1;
    let mut evidence = SearchEvidence {
        phase: "search",
        samples: 0,
        width: 0.0,
        height: raster.height(),
        brightest: f64::NEG_INFINITY,
        dismissed: 0,
        threshold: searcher.threshold,
    };
    for k in 0..=2 * columns {
        // 0, 1, -1, 2, -2 and so on.
        let column = f64::from((k + 1) / 2) * if k % 2 == 1 { 1.0 } else { -1.0 };
        let low = start.shifted(column * pitch, 0.0, 0.0);
        job.arrive(cell, side, low).await?;
        let top = low.shifted(0.0, raster.height(), 0.0);
        evidence.width = f64::from(k + 1) * pitch;
        let Some(first) =
            brightest(cell, &searcher, top, TUNING.nudge.speed, &mut evidence).await?
        else {
            continue;
        };
        // What fluctuates is not there again.
        let below = Point::new(low.x, first.y - TUNING.nudge.around, low.z);
        job.arrive(cell, side, below).await?;
        let above = below.shifted(0.0, 2.0 * TUNING.nudge.around, 0.0);
        match brightest(cell, &searcher, above, TUNING.nudge.slow, &mut evidence).await? {
            Some(again) => return Ok((searcher, Point::new(low.x, again.y, low.z))),
            None => evidence.dismissed += 1,
        }
    }
    Err(no_light(Some(evidence)))
}

/// The brightest place on a line to `end`, if it is bright at all; stops soon after.
async fn brightest(
    cell: &AlignmentCell<'_>,
    searcher: &Searcher,
    end: Point<Macro>,
    speed: f64,
    evidence: &mut SearchEvidence,
) -> Result<Option<Point<Macro>>, Halt> {
    let side = searcher.side;
    cell.start_line(side, end, Some(speed))?;
    let mut best: Option<(f64, Point<Macro>)> = None;
    while cell.is_moving(side) {
        let Some(volts) = cell.light(searcher.channel, f64::INFINITY).await? else {
            continue;
        };
        evidence.samples += 1;
        evidence.brightest = f64::max(evidence.brightest, volts);
        let level = volts - searcher.background.mean;
        let bright = volts > searcher.threshold;
        if bright && best.is_none_or(|(most, _)| level > most) {
            best = Some((level, cell.endpoint(side)));
        }
        if best.is_some_and(|(most, _)| level < 0.2 * most) {
            cell.brake(side)?;
        }
    }
    Ok(best.map(|(_, place)| place))
}

/// Brings an endpoint to a place such that, by what is believed of the windup, its transmissions carry
/// nothing there: from below beyond it, and back until they are relaxed.
async fn relaxed_at(
    job: &Job<'_>,
    cell: &AlignmentCell<'_>,
    place: Point<Macro>,
) -> Result<(), Halt> {
    let side = job.side;
    let windup = || {
        let of = |machine: &mut dyn VoltageMachine| {
            let of = |axis| machine.windup(AxisName { side, axis });
            of(Axis::A) - of(Axis::B)
        };
        cell.voltage(of).unwrap_or(0.0)
    };
    let mut back = TUNING.nudge.first_back;
    for _ in 0..3 {
        let beyond = place.shifted(0.0, back, 0.0);
        job.arrive(cell, side, beyond).await?;
        let wound = windup();
        let end = beyond.shifted(0.0, -TUNING.nudge.most_back, 0.0);
        cell.start_line(side, end, Some(TUNING.nudge.slow))?;
        while cell.is_moving(side) && windup() * wound > 0.0 {
            cell.next(cell.now() + cell.caps().cycle).await?;
        }
        cell.brake(side)?;
        cell.wait(0.1).await?;
        let gone = beyond.y - cell.wanted(side).y;
        if (gone - back).abs() < 2e-6 || gone > 0.9 * TUNING.nudge.most_back {
            break;
        }
        back = gone;
    }
    Ok(())
}

/// A five-bar whose joints are held by friction and moved by pulses.
struct Nudger {
    side: Side,
    channel: Channel,
    background: f64,
    noise: f64,
    beam: Beam,
    belief: ImpulseBelief,
    response: Response,
    /// Displacement of the endpoint in x and y for one of a joint's output, metres for a metre along
    /// its probe's arm: columns for the joints.
    columns: [Displacement; 2],
    /// Where the fiber is believed to be, from where it was let go.
    at: Displacement,
    /// By what share more than believed pulses move each joint forward, and less backward: what the
    /// transmissions carry pushes one way.
    lean: [f64; 2],
    /// The way of each joint since the last fit, back and forth, metres.
    way: [f64; 2],
    readings: Vec<Reading>,
}

impl Nudger {
    fn new(cell: &AlignmentCell<'_>, job: &Job<'_>, searcher: &Searcher) -> Result<Self, Outcome> {
        let side = job.side;
        let (belief, kinematics) = cell
            .voltage(|machine| (machine.five_bar_pulses(), machine.kinematics(side).clone()))
            .ok_or(Outcome::Lacking(Lack::Pulses))?;
        let belief = belief.ok_or(Outcome::Lacking(Lack::Pulses))?;
        let probe = cell.spec().probe.as_ref();
        let arm = belief.arm.or(probe.map(|probe| probe.arm));
        let arm = arm.ok_or(Outcome::Lacking(Lack::PulseArm))?;
        let here = kinematics
            .outputs_at(cell.wanted(side))
            .map_err(Outcome::Immobile)?;
        let mut columns = [Displacement::ZERO; 2];
        for (joint, column) in columns.iter_mut().enumerate() {
            let small = 1e-5;
            let moved = |sign: f64| {
                let mut outputs = here;
                outputs[joint] += sign * small;
                kinematics.endpoint_at(outputs)
            };
            let (low, high) = (moved(-1.0), moved(1.0));
            let low = low.map_err(Outcome::Immobile)?;
            let high = high.map_err(Outcome::Immobile)?;
            let per_metre = 1.0 / (2.0 * small * arm);
            *column = (high.across() - low.across()) * per_metre;
        }
        let recipe = job.recipe;
        let step = cell.spec().photodiode.step();
        Ok(Self {
            side,
            channel: job.channel,
            background: searcher.background.mean,
            noise: searcher.background.sigma.max(step),
            beam: cell.beam(side, recipe),
            response: Response::curve(&belief),
            belief,
            columns,
            at: Displacement::ZERO,
            lean: [0.0; 2],
            way: [0.0; 2],
            readings: Vec::with_capacity(TUNING.nudge.recent + 1),
        })
    }

    /// Lets go of the joints.
    fn hold(&self, cell: &AlignmentCell<'_>) {
        let side = self.side;
        cell.voltage(|machine| {
            for axis in JOINTS {
                machine.hold_voltage(AxisName { side, axis }, Volts(0.0));
            }
        });
    }

    /// The light above the background, volts.
    async fn level(&self, cell: &AlignmentCell<'_>, seconds: f64) -> Result<f64, Halt> {
        Ok(cell.level(self.channel, seconds).await?.mean - self.background)
    }

    /// Moves the fiber by pulses on both joints.
    async fn nudge(&mut self, cell: &AlignmentCell<'_>, by: Displacement) -> Result<(), Halt> {
        let mut left = self.joints(by);
        let most = self.belief.curve.last().map_or(0.0, |last| last[1]);
        // Less than that is not worth a pulse.
        let least = 0.01 * most;
        let pulses = left
            .iter()
            .fold(0.0, |n: f64, way| n.max(way.abs() / most))
            .ceil();
        for k in 0..pulses as u32 {
            let share = 1.0 / (pulses - f64::from(k));
            for (i, axis) in JOINTS.into_iter().enumerate() {
                let part = share * left[i];
                if part.abs() < least {
                    continue;
                }
                let gain = 1.0 + part.signum() * self.lean[i];
                let choice = self.response.choose(part.abs() / gain, 1.0, part > 0.0);
                let side = self.side;
                let pulse = self.belief.shape().pulse(choice.a1, part > 0.0);
                cell.voltage(|machine| machine.pulse(AxisName { side, axis }, pulse))
                    .unwrap_or(Err(Outcome::Lacking(Lack::Pulses)))?;
                left[i] -= part.signum() * gain * choice.expected;
                self.way[i] += choice.expected;
            }
            cell.wait(self.belief.period + self.belief.rest).await?;
        }
        // What was left out was not gone.
        let [a, b] = self.columns;
        self.at += by - a * left[0] - b * left[1];
        Ok(())
    }

    /// Ways of the joints along their arms for one of the endpoint, metres.
    fn joints(&self, by: Displacement) -> [f64; 2] {
        let [a, b] = self.columns;
        let determinant = a.cross(b);
        [by.cross(b) / determinant, a.cross(by) / determinant]
    }

    /// Learns from a peak that has run away so far while pulses went back and forth: it is they who did
    /// not.
    fn learn(&mut self, by: Displacement) {
        let away = self.joints(by);
        for ((lean, way), away) in self.lean.iter_mut().zip(self.way).zip(away) {
            if way > 0.0 {
                *lean = (*lean - TUNING.nudge.learned * away / way)
                    .clamp(-TUNING.nudge.most_lean, TUNING.nudge.most_lean);
            }
        }
    }

    /// Follows the light across while a facet comes nearer by `step` metres.
    async fn walk(
        &mut self,
        cell: &AlignmentCell<'_>,
        job: &Job<'_>,
        step: f64,
    ) -> Result<(), Halt> {
        let kinematics = cell.frame(self.side);
        let aside = -step * job.recipe.ports.exit_angle.tan();
        let from = kinematics.macro_from_chip(job.port);
        let to = kinematics.macro_from_chip(job.port.shifted(aside, 0.0, 0.0));
        let by = to.across() - from.across();
        self.nudge(cell, by).await?;
        // In the light's frame nothing has moved.
        for reading in &mut self.readings {
            reading.at += by;
        }
        Ok(())
    }

    async fn read(
        &mut self,
        cell: &AlignmentCell<'_>,
        gap: f64,
        seconds: f64,
    ) -> Result<f64, Halt> {
        let volts = self.level(cell, seconds).await?;
        if self.readings.len() == TUNING.nudge.recent {
            self.readings.remove(0);
        }
        self.readings.push(Reading {
            at: self.at,
            gap,
            volts,
        });
        Ok(volts)
    }

    /// Looks for light in a growing square around where it was seen, and once more, in a finer one,
    /// around the brightest place of that.
    async fn find(&mut self, cell: &AlignmentCell<'_>, gap: f64) -> Result<(), Halt> {
        let enough = 10.0 * self.noise;
        let mut best = (self.read(cell, gap, TUNING.nudge.look).await?, self.at);
        for pitch in [1.0, 0.5] {
            let pitch = pitch * self.beam.width(gap);
            if self.square(cell, gap, pitch, enough, &mut best).await? {
                return Ok(());
            }
            self.nudge(cell, best.1 - self.at).await?;
        }
        Err(lost("centre", best.0, enough))
    }

    /// A growing square from where the fiber is, until there is light enough; keeps the brightest light
    /// and its place.
    async fn square(
        &mut self,
        cell: &AlignmentCell<'_>,
        gap: f64,
        pitch: f64,
        enough: f64,
        best: &mut (f64, Displacement),
    ) -> Result<bool, Halt> {
        const TURNS: i32 = 9;
        for turn in 0..TURNS {
            let sign = if turn % 4 < 2 { pitch } else { -pitch };
            let by = if turn % 2 == 0 {
                Displacement::new(sign, 0.0)
            } else {
                Displacement::new(0.0, sign)
            };
            for _ in 0..=turn / 2 {
                if best.0 > enough {
                    return Ok(true);
                }
                self.nudge(cell, by).await?;
                let volts = self.read(cell, gap, TUNING.nudge.look).await?;
                if volts > best.0 {
                    *best = (volts, self.at);
                }
            }
        }
        Ok(best.0 > enough)
    }

    /// Goes to the light's peak, by patterns around where it is believed to be, until it is found
    /// where it was.
    async fn centre(
        &mut self,
        cell: &AlignmentCell<'_>,
        gap: f64,
        care: &Care,
    ) -> Result<(), Halt> {
        let radius = care.radius * self.beam.width(gap);
        let noise = self.noise / (care.seconds * cell.spec().photodiode.rate).sqrt().max(1.0);
        let (mut before, mut brightest, mut last): (Option<Peak>, f64, f64) = (None, 0.0, 0.0);
        self.way = [0.0; 2];
        for k in 0..TUNING.nudge.patterns {
            let centre = self.at;
            // Triangles, turned by a third of a third each time.
            for corner in 0..3 {
                let angle = std::f64::consts::TAU * (f64::from(corner) + f64::from(k) / 3.0) / 3.0;
                let to = centre + Displacement::polar(radius, angle);
                self.nudge(cell, to - self.at).await?;
                brightest = brightest.max(self.read(cell, gap, care.seconds).await?);
            }
            let Some(peak) = self.fit(noise) else {
                return Err(lost("centre", 0.0, self.noise));
            };
            if let Some(before) = before.replace(peak) {
                self.learn(peak.at - before.at);
            }
            self.way = [0.0; 2];
            self.nudge(cell, peak.at - self.at).await?;
            let volts = self.read(cell, gap, care.seconds).await?;
            // Light fluctuates: what was brighter long ago may never come again.
            brightest = TUNING.nudge.fade * brightest.max(volts / TUNING.nudge.fade);
            last = volts;
            let moved = (peak.at - centre).norm();
            if k + 1 >= care.least && moved < care.near && volts > care.bright * brightest {
                return Ok(());
            }
        }
        if care.must {
            // How far from the brightest place the light is as bright.
            let off = |share: f64| self.beam.width(gap) * (1.0 - share).max(0.0).sqrt();
            return Err(Outcome::Unsure {
                deviation: off(last / brightest),
                accuracy: off(care.bright),
            }
            .into());
        }
        Ok(())
    }

    /// The peak through the latest readings.
    fn fit(&self, noise: f64) -> Option<Peak> {
        self.beam.fit(&self.readings, noise)
    }
}

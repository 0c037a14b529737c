//! The fast procedure: what the thesis does in 20 seconds a fiber, on the same machine.
//!
//! Nothing stands still for a look: vision's frames are put together on the way
//! ([`tip_estimator`](crate::tip_estimator)), both manipulators move at once, and the dark is measured meanwhile.
//! The sensing fiber stands back, where the guided light has spread as wide as its core, and looks
//! over the chip's top, where no scattered light comes: it need not stand exactly. Lines at
//! constant speed find first light ([`sweep`](crate::sweep)), circles follow it to the peak and
//! through the approach ([`conical_scan`](crate::conical_scan)), the walk of the peak fed forward.
//!
//! Where this does not come to a good end a fiber is tried again, and at last its light is searched by the thesis's
//! own raster. Where the piezos' hysteresis is not known, circles are none: there the thesis's own procedure has the
//! last turn.

mod approach_moves;
mod by_output;
mod centre;
mod gap;
mod laser;
mod last;
mod pair;
mod ratio;
mod resting;
mod seen;
mod single;

use crate::cell::AlignmentCell;
use crate::conical_scan::{Closing, ConicalScan, Watch};
use crate::job::{FiberReport, Job};
use crate::last_turns::Rest;
use crate::outcome::{Halt, Outcome, SearchEvidence, is_for_askew};
use crate::procedure::{Found, each_fiber};
use crate::recipe::{Fast, Pass, Recipe};
use crate::station::{Station, coarse, fine};
use crate::sweep::{Spot, Swept, first_light};
use crate::tip_estimator::Tip;
use crate::tuning::TUNING;
use approach_moves::{Aim, calm_down, cock, lines, swings};
use by_output::Waiting;
use gap::unhurried;
pub use gap::vision_knows;
pub use pair::{swing_tips, watch_tips};
use pigtail_hal::Side;
use pigtail_hal::bench::Meter;
use pigtail_hal::spec::{CHANNELS, Channel};
use pigtail_model::frames::{Displacement, Macro, Point};
use ratio::Ratios;
pub use ratio::{Ratio, measure_ratios};
use resting::Resting;
use seen::{DarkLevel, Top};
pub use single::{Aligner, Way};

/// A pass of a search for one fiber.
#[derive(Debug, Clone, Copy)]
struct Look {
    /// Gap between facet and tip, metres.
    gap: f64,
    /// How far to the side of where the light is expected, metres.
    aside: f64,
    /// How far below the port the holder starts, metres.
    below: f64,
    /// Metres.
    width: f64,
    /// The same upward.
    height: f64,
    /// Distance of its lines, metres.
    spacing: f64,
    /// How much slower than usual they are.
    slow: f64,
    /// Whether the tip is yet to be brought to its start.
    again: bool,
}

/// Aligns the input fiber and the output fibers of one device.
pub fn fast(station: &mut Station, recipe: &Recipe) -> Vec<FiberReport> {
    let cell = AlignmentCell::over(station);
    cell.run(Shared::new(recipe).align(&cell))
}

/// What the fibers of a device have in common.
struct Shared<'r> {
    recipe: &'r Recipe,
    fast: &'r Fast,
    /// The photodiodes without the laser.
    dark: [DarkLevel; CHANNELS],
    /// Relative standard deviation of the scattered light, as the sensing fiber saw it.
    fluctuation: f64,
    /// How far the micros go in y for a displacement in x, where that is to be measured on the way.
    ratios: Option<Ratios>,
    /// The chip's top as the sensing fiber saw it, and how much too high over it that stands, metres.
    top: Option<Top>,
    too_high: f64,
    /// The laser's power, percent.
    power: u8,
    /// When that was lowered, seconds: photodiodes remember what it was before.
    dimmed_at: f64,
    /// Whether the light is to tell the gap although vision should know it: it did not.
    asks_light: bool,
    /// Where the last pass of a search saw the brightest of what was no light for sure: height of a holder, metres.
    perhaps: Option<f64>,
    /// Whether the input fiber may wait for the first output's where its light is dim; and that, once it waits.
    may_wait: bool,
    waiting: Option<Waiting<'r>>,
}

impl<'r> Shared<'r> {
    fn new(recipe: &'r Recipe) -> Self {
        Self {
            recipe,
            fast: &recipe.fast,
            dark: [DarkLevel::default(); CHANNELS],
            fluctuation: 0.0,
            top: None,
            too_high: 0.0,
            ratios: None,
            power: 100,
            dimmed_at: f64::NEG_INFINITY,
            asks_light: false,
            perhaps: None,
            may_wait: true,
            waiting: None,
        }
    }

    async fn align(&mut self, cell: &AlignmentCell<'_>) -> Vec<FiberReport> {
        let recipe = self.recipe;
        each_fiber(cell, recipe, async |job| {
            Box::pin(self.fiber(job, cell)).await
        })
        .await
    }

    fn exit(&self) -> f64 {
        self.recipe.ports.exit_angle
    }

    /// How far below a port a search starts, metres.
    fn below(&self) -> f64 {
        self.recipe.raster.below()
    }

    /// A fiber to its port.
    async fn fiber(&mut self, job: &mut Job<'r>, cell: &AlignmentCell<'_>) -> Result<(), Halt> {
        let fast = self.fast;
        let aim = Aim::at_fiber(job);
        // The sensing fiber sees the input's light alone.
        let (seen, gap, spacing) = match job.output {
            None => (true, fast.input_gap, fast.input_spacing),
            Some(_) => (false, fast.output_gap, fast.output_spacing),
        };
        let mut waiting = self.waiting.take();
        // Where it is not in its place there is nothing to look for.
        let passes: &[Pass] = if waiting.is_some() || self.bring(job, cell, &aim).await? {
            &fast.retry.passes
        } else {
            &[]
        };
        let passes = passes.iter().filter(|pass| seen || pass.sensing == 0.0);
        let latest = cell.now() + fast.retry.longest;
        for (attempt, pass) in passes.enumerate() {
            if cell.is_past(latest) {
                break;
            }
            if seen && attempt == 1 {
                self.down_to_the_top(cell).await?;
            }
            if seen {
                let aside = pass.sensing * fast.sensing.sidestep;
                cell.glide_micro(Side::Right, Displacement::new(aside, -self.too_high))?;
            }
            let look = self.look(pass, gap, spacing, attempt > 0);
            let result = match waiting.take() {
                Some(waiting) => self.go_on(job, cell, &aim, waiting).await,
                None => self.attempt(job, cell, &aim, &look).await,
            };
            if !self.again(&result, attempt) && !self.learns_to_ask(cell, &result) {
                return result;
            }
        }
        if seen {
            cell.glide_micro(Side::Right, Displacement::ZERO)?;
        }
        if !cell.follows(job.side) {
            return job.align(cell).await;
        }
        let found = job.find(cell).await?;
        self.after_raster(job, cell, &aim, &found).await
    }

    /// A fiber to the start of its search, and the sensing fiber over the chip's top if it is to see its light: whether it is there.
    async fn bring(
        &mut self,
        job: &mut Job<'_>,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
    ) -> Result<bool, Halt> {
        if let Some(index) = job.output {
            let change = async |_: &mut Job<'_>| self.change_fiber(cell, aim, index).await;
            job.phase(cell, "coarse", change).await?;
            return Ok(true);
        }
        let [x, y, z] = self.recipe.ports.outputs[0];
        let sensing = Aim {
            side: Side::Right,
            tip: Tip::Sensing,
            port: Point::new(x, y, z),
        };
        if !cell.carries(Side::Left) {
            cell.load(Side::Left, 0).await?;
        }
        job.phase(cell, "coarse", async |_| {
            self.come_near(cell, aim, &sensing).await
        })
        .await?;
        let over = job.phase(cell, "sensing", async |_| {
            self.over_the_top(cell, &sensing).await?;
            // The input fiber has stood still meanwhile: vision knows it better now.
            self.straighten(cell, aim, (self.fast.input_gap, 0.0))
        });
        match over.await {
            Err(Halt::Outcome(_)) => Ok(false),
            over => over.map(|()| true),
        }
    }

    /// Whether to try a fiber again after this many tries, of which the last came to this.
    fn again(&self, result: &Result<(), Halt>, before: usize) -> bool {
        let unsure = before < self.fast.retry.unsure as usize;
        match result {
            Ok(()) | Err(Halt::Fault(_)) => false,
            Err(Halt::Outcome(Outcome::UnsurePlace {
                deviation, askew, ..
            })) => unsure && !is_for_askew(*deviation, *askew),
            // What vision does not know it never will.
            Err(Halt::Outcome(Outcome::UnsureGap { bound, .. })) => *bound == 0.0 && unsure,
            Err(Halt::Outcome(outcome)) => !matches!(
                outcome,
                // What is attached is not to be aligned any more.
                Outcome::NotArrived { .. } | Outcome::Slipped { .. }
            ),
        }
    }

    /// Whether to try again by light after vision did not know the gap as well as it should have.
    fn learns_to_ask(&mut self, cell: &AlignmentCell<'_>, result: &Result<(), Halt>) -> bool {
        let unsure = matches!(result, Err(Halt::Outcome(Outcome::UnsureGap { .. })));
        let learns = unsure && self.vision_tells(cell);
        self.asks_light |= learns;
        learns
    }

    /// A pass for fibers of which light is searched at a gap by lines of a spacing, metres.
    fn look(&self, pass: &Pass, gap: f64, spacing: f64, again: bool) -> Look {
        let below = pass.height * self.below();
        Look {
            gap,
            below,
            height: 2.0 * below + self.fast.overscan,
            aside: pass.aside * self.recipe.raster.x,
            width: pass.width * self.recipe.raster.x,
            spacing: pass.spacing * spacing,
            slow: pass.slow,
            again,
        }
    }

    fn watch(&self, side: Side, channel: Channel) -> Watch {
        let dark = self.dark[channel.index()];
        Watch {
            group: fine(side),
            meter: Meter(channel.index()),
            background: dark.level.mean,
            noise: dark.level.sigma,
            still: dark.still,
            still_degrees: dark.degrees,
        }
    }

    /// One try at a fiber, from the start of its search on; a later one from wherever the tip is.
    async fn attempt(
        &mut self,
        job: &mut Job<'_>,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        look: &Look,
    ) -> Result<(), Halt> {
        let (mut scan, before) = self.find(job, cell, aim, look).await?;
        if self.is_dim(job, cell, aim, &mut scan) {
            // Seldom gone, and long: not within every other way.
            return Box::pin(self.by_output(job, cell, aim, (scan, before))).await;
        }
        self.close(job, cell, aim, (scan, before), None).await
    }

    /// The peak at the gap of a search, and the light there, volts at no gap. Where there is no light but something that noise seldom makes of
    /// itself, that is looked at once more, slowly.
    async fn find(
        &mut self,
        job: &mut Job<'_>,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        look: &Look,
    ) -> Result<(ConicalScan<'r>, f64), Halt> {
        self.perhaps = None;
        let found = self.find_at(job, cell, aim, look).await;
        let (Err(Halt::Outcome(Outcome::NoLight(_))), Some(at)) = (&found, self.perhaps) else {
            return found;
        };
        let port = aim.holder(cell, self.exit(), 0.0, look.gap).y;
        let band = TUNING.search.band;
        let near = Look {
            below: port - at + 0.5 * band,
            height: band + TUNING.search.few_lines * look.spacing,
            slow: look.slow * TUNING.search.closely,
            again: true,
            ..*look
        };
        self.find_at(job, cell, aim, &near).await
    }

    async fn find_at(
        &mut self,
        job: &mut Job<'_>,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        look: &Look,
    ) -> Result<(ConicalScan<'r>, f64), Halt> {
        let (mut dismissed, mut begun): (usize, Option<(Watch, Point<Macro>)>) = (0, None);
        let most_dismissed = self.fast.retry.dismissed as usize;
        loop {
            let (watch, spot) = job
                .phase(cell, "search", async |job| {
                    let (watch, start) = match begun {
                        None => {
                            if look.again {
                                self.back_to_start(cell, aim, look).await?;
                            }
                            (self.background(cell, job).await?, cell.wanted(aim.side))
                        }
                        Some((watch, start)) => {
                            cock(cell, aim.side, look.width)?;
                            let here = Point::new(start.x, cell.wanted(aim.side).y, start.z);
                            cell.go(aim.side, here).await?;
                            cell.wait(cell.settling(aim.side)).await?;
                            (watch, start)
                        }
                    };
                    begun = Some((watch, start));
                    let top = start.y + look.height;
                    let eye = (aim, job.channel);
                    let spot = self.search(cell, eye, &watch, look, top, dismissed).await?;
                    let watch = Watch {
                        background: spot.background,
                        ..watch
                    };
                    Ok((watch, spot))
                })
                .await?;
            let centred = job
                .phase(cell, "centre", async |_| {
                    self.centre(cell, aim, watch, spot).await
                })
                .await;
            match centred {
                // What was bright there was no peak: on from here.
                Err(Halt::Outcome(Outcome::LightLost { .. })) if dismissed < most_dismissed => {
                    dismissed += 1;
                }
                centred => return centred,
            }
        }
    }

    /// From light that the thesis's raster has found to an attached fiber. Its patterns would find the peak too, but
    /// cannot say how the tip shakes, nor whether the micro goes where it is told.
    async fn after_raster(
        &mut self,
        job: &mut Job<'_>,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        found: &Found,
    ) -> Result<(), Halt> {
        let watch = Watch {
            background: found.background,
            ..self.watch(job.side, job.channel)
        };
        let at = cell.wanted(aim.side).across() + cell.micro(aim.side);
        let spot = Spot {
            at,
            end: 0.0,
            level: found.level,
            background: found.background,
        };
        let (scan, before) = job
            .phase(cell, "centre", async |_| {
                self.centre(cell, aim, watch, spot).await
            })
            .await?;
        self.close(job, cell, aim, (scan, before), None).await
    }

    /// From the peak at the gap of a search, where light of `before` volts at no gap was, to an attached fiber. Where that light goes through another
    /// one, too, that is `resting` at its peak.
    async fn close(
        &mut self,
        job: &mut Job<'_>,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        (mut scan, before): (ConicalScan<'_>, f64),
        resting: Option<&mut Resting<'_, '_>>,
    ) -> Result<(), Halt> {
        let far = aim.gap(cell);
        let before = self.dim(job, cell, aim, &mut scan, before).await?;
        if let Some(mut ratios) = self.ratios.take() {
            let known = job
                .phase(cell, "ratio", async |_| {
                    let mut again = 0;
                    loop {
                        match ratios.measure(cell, aim, &mut scan).await {
                            // The macro did not go as believed, or the micro swings along with its turns.
                            Err(Halt::Outcome(
                                Outcome::Unsure { .. } | Outcome::MicroRange { .. },
                            )) if again < self.fast.retry.ratio => {
                                again += 1;
                                scan.slow_down();
                            }
                            known => break known,
                        }
                    }
                })
                .await;
            self.ratios = Some(ratios);
            known?;
        }
        job.phase(cell, "approach", async |job| {
            self.doubt(job, cell, aim, &mut scan, before).await?;
            self.come_close(job, cell, aim, (&mut scan, before), resting)
                .await
        })
        .await?;
        job.phase(cell, "final", async |job| {
            let last = self.finish(job, cell, aim, &mut scan, (before, far)).await;
            let strokes = cell.voltage(|machine| machine.learned_strokes(job.side));
            job.strokes = strokes.flatten();
            // Whoever goes to the peak next should know why this did not come to an end.
            let given_up = matches!(last, Err(Halt::Outcome(_))) && !scan.shaking().is_watched();
            if given_up && cell.follows(job.side) {
                let gap = aim.gap(cell);
                scan.watch_shaking(cell, gap, TUNING.watch.first).await?;
            }
            job.has_shaken(scan.shaking());
            job.spot = scan.spot().or(job.spot);
            let Rest {
                look,
                foreseen,
                across,
            } = last?;
            let known = (Some(foreseen), Some(across));
            job.attach(cell, look, scan.background(), known).await
        })
        .await
    }

    /// Light of `before` volts at no gap that may be none of a peak is looked at once more on the way to the chip.
    async fn doubt(
        &self,
        job: &Job<'_>,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        scan: &mut ConicalScan<'_>,
        before: f64,
    ) -> Result<(), Halt> {
        let dark = self.dark[job.channel.index()].level.mean;
        let level = before * cell.beam(aim.side, self.recipe).share(aim.gap(cell));
        let scattered = scan.background() - dark;
        let least = TUNING.search.doubtful * self.fast.significance * scan.noise();
        if level < least.max(TUNING.search.scattered * scattered) {
            // What is no peak may stand as far aside as vision errs, where the inclined facet is nearer.
            let (first, facet) = (self.fast.doubtful_gap, aim.facet(self.recipe));
            let [bound, _] = cell.spec().vision.believed();
            for gap in [first, 0.5 * first] {
                let gap = gap + facet.stands_out(cell.spec(), aim.beside(cell), bound);
                let gap = gap.max(aim.gap(cell) - facet.room_aside(cell, aim.side));
                self.approach(cell, aim, scan, before, (gap, TUNING.search.doubting))
                    .await?;
            }
        }
        Ok(())
    }

    /// What there is without the fiber's light, where its search starts.
    async fn background(&self, cell: &AlignmentCell<'_>, job: &Job<'_>) -> Result<Watch, Halt> {
        let dark = self.watch(job.side, job.channel);
        let before = cell.level(job.channel, 0.02).await?;
        // Scattered light fluctuates slowly: a short look sees too little of it.
        let scattered = self.fluctuation * (before.mean - dark.background).max(0.0);
        Ok(Watch {
            background: before.mean,
            noise: dark.noise.hypot(scattered),
            ..dark
        })
    }

    async fn search(
        &mut self,
        cell: &AlignmentCell<'_>,
        (aim, channel): (&Aim, Channel),
        watch: &Watch,
        look: &Look,
        top: f64,
        dismissed: usize,
    ) -> Result<Spot, Halt> {
        let threshold = self.fast.significance * watch.noise;
        let area = (aim.facet(self.recipe), look.width, look.spacing);
        let side = aim.side;
        let Swept {
            spot,
            evidence,
            perhaps,
        } = loop {
            let sweep = lines(cell, side, self.recipe, (look.width, look.gap), look.slow);
            let eye = (side, channel);
            let (until, goes_on) = ((top, threshold), || !swings(cell, side));
            let swept = first_light(cell, eye, watch, &sweep, area, until, goes_on).await?;
            if !swings(cell, side) {
                break swept;
            }
            calm_down(cell, aim, self.recipe).await?;
            self.back_to_start(cell, aim, look).await?;
        };
        self.perhaps = perhaps;
        // What is brightest at the end of a line has its peak beyond it as likely as not.
        let beam = cell.beam(side, self.recipe);
        let beyond = TUNING.search.beyond * beam.width(look.gap);
        let spot = spot.map(|spot| Spot {
            at: spot.at + Displacement::new(spot.end * beyond, 0.0),
            ..spot
        });
        spot.ok_or_else(|| {
            Outcome::NoLight(SearchEvidence {
                dismissed,
                ..evidence
            })
            .into()
        })
    }

    /// The least light of a fiber at no gap, volts, that comes out of the guide, after so much `before`. Of modes wider than designed a
    /// greater share crosses the gap of a search, so that there seems to be more light than there is: by how much the spot tells, at the chip.
    fn least_light(&self, cell: &AlignmentCell<'_>, aim: &Aim, before: f64) -> f64 {
        let known = cell.measured_spread(aim.side).is_some();
        let share = if known { 1.0 } else { TUNING.search.unlike };
        share * self.fast.accept * before
    }

    /// Closes the gap to `gap` metres on the circle and stays there for some turns, for as long as the light is
    /// `before` volts at no gap and does not stray.
    async fn approach(
        &self,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        scan: &mut ConicalScan<'_>,
        before: f64,
        (gap, turns): (f64, u64),
    ) -> Result<(), Halt> {
        let way = aim.gap_at_rest(cell) - gap;
        let end = cell.wanted(aim.side).shifted(0.0, 0.0, way);
        cell.start_line(aim.side, end, Some(unhurried(cell, aim, gap)))?;
        let way = Closing {
            group: coarse(aim.side),
            rests: None,
            turns,
            before,
            least: self.least_light(cell, aim, before),
            stray: self.fast.stray,
        };
        scan.close(cell, &way, || aim.led(cell), || aim.gap(cell))
            .await
    }
}

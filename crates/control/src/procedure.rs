//! The thesis's alignment procedure (3.2.2, 3.3): straight lines over a bench with a camera.

mod attach;

pub(crate) use attach::{light_check, place_at};

use crate::belief::Across;
use crate::cell::AlignmentCell;
use crate::job::{FiberReport, Job, run_all};
use crate::outcome::{Halt, Outcome, SearchEvidence};
use crate::peak::{NinePoint, Spot, Vertex};
use crate::recipe::Recipe;
use crate::search::{Hit, Searcher, centre_sensing, edge_from_below};
use crate::shaking::Shaking;
use crate::station::{Level, Station, fine};
use crate::tip_estimator::Tip;
use crate::tuning::TUNING;
use crate::upward::Facet;
use pigtail_hal::bench::Fix;
use pigtail_hal::spec::GuardSpec;
use pigtail_hal::{Channel, Fault, Side};
use pigtail_model::frames::{Chip, Displacement, Macro, Point};

/// Aligns the input fiber and the output fibers of one device, as the thesis does.
pub fn thesis(station: &mut Station, recipe: &Recipe) -> Vec<FiberReport> {
    let cell = AlignmentCell::over(station);
    cell.run(each_fiber(&cell, recipe, async |job| {
        if job.output.is_none() {
            cell.laser(true)?;
        }
        job.align(&cell).await
    }))
}

/// Aligns the fibers of a device one after the other, the input first; one that fails goes back into the tray.
pub(crate) async fn each_fiber<'r>(
    cell: &AlignmentCell<'_>,
    recipe: &'r Recipe,
    mut align: impl AsyncFnMut(&mut Job<'r>) -> Result<(), Halt>,
) -> Vec<FiberReport> {
    let align = async |job: &mut Job<'r>| {
        let end = align(job).await;
        let gains = cell.voltage(|machine| machine.gentler_gains());
        job.gains = gains.unwrap_or_default();
        let micro = fine(job.side);
        job.rests = cell.swings(micro).then(|| cell.settling(job.side));
        end
    };
    run_all(recipe, align, async |job| job.put_back(cell).await).await
}

/// Lights the guides of a device for an experiment: the input fiber aligned and attached as in
/// [`thesis`], to `accuracy` metres, for which some more or less light is no matter. The sensing
/// fiber then stands before the first output.
///
/// # Errors
///
/// The machine's fault, or why the input could not be aligned.
pub fn light_guides(station: &mut Station, recipe: &Recipe, accuracy: f64) -> Result<(), Halt> {
    let cell = AlignmentCell::over(station);
    cell.run(lit(&cell, recipe, accuracy))
}

/// The same, as a line of control.
pub(crate) async fn lit(
    cell: &AlignmentCell<'_>,
    recipe: &Recipe,
    accuracy: f64,
) -> Result<(), Halt> {
    let mut recipe = recipe.clone();
    recipe.last.accuracy = accuracy;
    cell.laser(true)?;
    Job::of(&recipe, None).align(cell).await
}

/// Light that was found, with the macro brought to it.
pub(crate) struct Found {
    /// The photodiode's level without it, volts.
    pub(crate) background: f64,
    /// Its level above that, volts.
    pub(crate) level: f64,
}

/// Where the sensing fiber passed the chip's top.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Top {
    /// Its holder.
    holder: Point<Macro>,
    /// How far vision placed its tip from the facet, metres.
    gap: f64,
}

impl Job<'_> {
    /// Takes the fiber away from the chip and back into the tray.
    pub(crate) async fn put_back(&mut self, cell: &AlignmentCell<'_>) -> Result<(), Fault> {
        let well = |result: Result<(), Halt>| match result {
            Err(Halt::Fault(fault)) => Err(fault),
            Ok(()) | Err(Halt::Outcome(_)) => Ok(()),
        };
        // What cannot be stopped is on its way: withdrawing says so again.
        let _ = cell.brake(self.side);
        well(self.withdraw(cell, self.side).await)?;
        well(cell.unload(self.side).await)
    }

    /// Aligns the fiber, be it carried already or not.
    pub(crate) async fn align(&mut self, cell: &AlignmentCell<'_>) -> Result<(), Halt> {
        let found = self.find(cell).await?;
        self.finish(cell, &found).await
    }

    /// Brings the fiber to the peak before its port, and leaves it there, not attached.
    pub(crate) async fn reach(&mut self, cell: &AlignmentCell<'_>) -> Result<(), Halt> {
        let found = self.find(cell).await?;
        self.maximize(cell, &found, async |_, _, _| Ok(())).await
    }

    /// From the tray to first light.
    pub(crate) async fn find(&mut self, cell: &AlignmentCell<'_>) -> Result<Found, Halt> {
        let (side, recipe) = (self.side, self.recipe);
        let port = self.output.unwrap_or(0);
        if self.output.is_none() && !cell.carries(side) {
            cell.load(side, port).await?;
        }
        self.phase(cell, "coarse", async |job| {
            if job.output.is_some() {
                // Loaded only now, and away from the chip: an output fiber stands out beyond the
                // sensing fiber.
                job.withdraw(cell, side).await?;
                if !cell.carries(side) {
                    cell.load(side, port).await?;
                }
            }
            let start = job.search_start();
            job.place(cell, side, Tip::Fiber, start, recipe.raster.gap)
                .await
        })
        .await?;
        // It sees the input's light alone.
        let sensing = if self.output.is_none() {
            let output = recipe.ports.outputs[0];
            let top = async |job: &mut Self| job.find_top(cell, output).await;
            Some(self.phase(cell, "sensing", top).await?)
        } else {
            None
        };
        self.phase(cell, "raster", async |job| job.rasters(cell, sensing).await)
            .await
    }

    /// From first light to an attached fiber.
    async fn finish(&mut self, cell: &AlignmentCell<'_>, found: &Found) -> Result<(), Halt> {
        self.maximize(cell, found, async |job, last, peak| {
            job.is_at_its_peak(cell, &peak)?;
            job.attach(cell, last, found.background, (None, None)).await
        })
        .await
    }

    /// That a fiber which patterns have brought to its peak is there. The thesis asked neither whether a tip shakes nor whether stages stand
    /// square; but what was seen of the tip, or measured of either, is known.
    fn is_at_its_peak(&self, cell: &AlignmentCell<'_>, peak: &Vertex) -> Result<(), Outcome> {
        let (side, recipe) = (self.side, self.recipe);
        let beam = cell.beam(side, recipe);
        let askew = beam.aside(beam.squared_widths(recipe.approach.gap));
        let beside = |deviation: f64| Across {
            sigma: askew.map(|(sigma, _)| sigma.hypot(peak.deviation).hypot(deviation)),
            bound: [0, 1].map(|i| askew[i].1 + peak.elsewhere[i]),
            askew,
        };
        let tolerance = recipe.accept.aside;
        if let Some(shaking) = self.shaking.filter(Shaking::is_watched) {
            // Its patterns know a peak no better than the tip shakes while they are drawn.
            let tip = shaking.believed();
            return tip.is_sure(tolerance, beside(tip.deviation()));
        }
        let measured = cell.measured_shaking(side);
        let shakes = measured.map_or(0.0, |measured| measured.of_means());
        beside(shakes).is_sure(tolerance, shakes)
    }

    /// That more patterns would make a peak no surer: it is sure, or would not be if the light told all.
    fn is_known(&self, cell: &AlignmentCell<'_>, peak: &Vertex) -> bool {
        let told = Vertex {
            elsewhere: [0.0; 2],
            ..*peak
        };
        self.is_at_its_peak(cell, peak).is_ok() || self.is_at_its_peak(cell, &told).is_err()
    }

    /// From first light to the peak at the chip (thesis 3.3), where something is done.
    async fn maximize(
        &mut self,
        cell: &AlignmentCell<'_>,
        found: &Found,
        there: impl AsyncFnOnce(&mut Self, Level, Vertex) -> Result<(), Halt>,
    ) -> Result<(), Halt> {
        let recipe = self.recipe;
        let background = found.background;
        let (mut peak, before, noise) = self
            .phase(cell, "climb", async |job| {
                let mut peak = NinePoint::new(&recipe.climb, cell, job.side, job.channel);
                peak.climb(cell).await?;
                if job.channel == Channel::Sensing {
                    centre_sensing(cell).await?;
                }
                let before = cell.level(job.channel, 0.04).await?;
                let level = before.mean - background;
                if level < TUNING.search.still_there * found.level {
                    return Err(lost("climb", level, found.level));
                }
                Ok((peak, level, before.sigma))
            })
            .await?;
        self.phase(cell, "approach", async |job| {
            let (_, z) = look(cell, job.side, Tip::Fiber, recipe.approach.frames).await?;
            let gap = outward(job.side) * (z - job.port.z);
            let start = cell.wanted(job.side);
            let mut closer = async |to: f64| {
                let end = Point::new(start.x, start.y, start.z + gap - to);
                cell.start_line(job.side, end, Some(recipe.approach.speed))?;
                while cell.is_moving(job.side) {
                    peak.step(cell).await?;
                }
                Ok::<_, Halt>(())
            };
            // What is no peak may stand far aside, where the inclined facet is nearer than here: on
            // the way light must have grown already.
            let doubtful = recipe.fast.doubtful_gap;
            if gap > doubtful && doubtful > recipe.approach.gap {
                closer(doubtful).await?;
                let after = cell.level(job.channel, 0.04).await?.mean - background;
                Outcome::of_growth(before, after, recipe.accept.growth.sqrt() * before)?;
            }
            closer(recipe.approach.gap).await
        })
        .await?;
        self.phase(cell, "final", async |job| {
            peak.climb(cell).await?;
            let beam = cell.beam(job.side, recipe);
            let spot = Spot {
                background,
                squared_widths: beam.squared_widths(recipe.approach.gap),
            };
            let peak = peak
                .settle(cell, &recipe.last, &spot, |peak| job.is_known(cell, peak))
                .await?;
            let last = cell.level(job.channel, 0.04).await?;
            let after = last.mean - background;
            Outcome::of_growth(before, after, recipe.accept.growth * before)?;
            let sigma = last.sigma.min(noise);
            there(job, Level { sigma, ..last }, peak).await
        })
        .await
    }

    /// Where the blind search starts.
    pub(crate) fn search_start(&self) -> Point<Chip> {
        self.port
            .shifted(self.walk(), -self.recipe.raster.below(), 0.0)
    }

    /// How far to the side of a port its light is at the gap of the search, by design.
    pub(crate) fn walk(&self) -> f64 {
        self.recipe.raster.gap * self.recipe.ports.exit_angle.tan()
    }

    /// Goes to `to` from below, so that the transmissions are wound up as on every arrival: what
    /// they hold back is then the same each time (thesis 2.4). Not as near to where the facet stands out as who guards the machine would stop it. What they held back so far comes out at once when joints turn back, across as well,
    /// where an inclined facet stands out: straight back first, where it would be near.
    pub(crate) async fn arrive(
        &self,
        cell: &AlignmentCell<'_>,
        side: Side,
        to: Point<Macro>,
    ) -> Result<(), Halt> {
        let (facet, here, room) = (self.facet(), cell.wanted(side), self.room(cell, side));
        // The sensing fiber is not before this port, and is kept off the facet by where it is placed.
        let to = match cell.room_before(side, self.port.z, 0.0) {
            Some(room) if side == self.side => facet.off(cell, side, to, room - (to.z - here.z)),
            _ => to,
        };
        let below = to.shifted(0.0, -self.recipe.coarse.run_up, 0.0);
        let aside = TUNING.gap.turns_back * cell.spec().guard.windup;
        let nearer = facet.stands_out(cell.spec(), 0.0, aside) - room;
        if nearer > 0.0 {
            let z = here.z.min(to.z) - nearer;
            cell.line(side, Point::new(here.x, here.y, z), None).await?;
            cell.line(side, Point::new(below.x, below.y, z), None)
                .await?;
        }
        cell.line(side, below, None).await?;
        cell.line(side, to, None).await
    }

    /// The facet before which light is searched.
    fn facet(&self) -> Facet {
        Facet {
            port: self.port,
            slope: self.recipe.ports.slope(),
        }
    }

    /// How much nearer to its facet the holder of a side may come, by vision, or by design where none has seen its fiber, metres.
    fn room(&self, cell: &AlignmentCell<'_>, side: Side) -> f64 {
        let ports = &self.recipe.ports;
        let z = [ports.input, ports.outputs[0]][side.index()][2];
        let by_design = outward(side) * (cell.holder(side).z - z);
        cell.room_before(side, z, 0.0).unwrap_or(by_design)
    }

    /// Moves a holder straight back until its fiber, by design, is clear of the chip.
    pub(crate) async fn withdraw(&self, cell: &AlignmentCell<'_>, side: Side) -> Result<(), Halt> {
        let gap = outward(side) * self.recipe.coarse.clearance;
        let here = cell.wanted(side);
        let ports = &self.recipe.ports;
        let [x, y, z] = [ports.input, ports.outputs[0]][side.index()];
        let clear = cell.frame(side).macro_from_chip(Point::new(x, y, z + gap));
        cell.line(side, Point::new(here.x, here.y, here.z.min(clear.z)), None)
            .await
    }

    /// Brings a tip to `wanted` (chip's frame) at `gap` from its facet, as well as vision can see
    /// and the fixture holds.
    pub(crate) async fn place(
        &self,
        cell: &AlignmentCell<'_>,
        side: Side,
        tip: Tip,
        wanted: Point<Chip>,
        gap: f64,
    ) -> Result<(), Halt> {
        let coarse = &self.recipe.coarse;
        let holder_from_tip = match tip {
            Tip::Fiber => [0.0; 3],
            Tip::Sensing => cell.spec().sensing_fiber.offset.map(|d| -d),
        };
        let at_gap = |cell: &AlignmentCell<'_>, gap: f64| {
            let [x, y, z] = holder_from_tip;
            let p = wanted.shifted(0.0, 0.0, outward(side) * gap);
            cell.frame(side).macro_from_chip(p).shifted(x, y, z)
        };
        // Back before sideways: the holder may still stand at the chip.
        self.withdraw(cell, side).await?;
        cell.move_micro(side, Displacement::ZERO)?;
        let clear = at_gap(cell, coarse.clearance);
        self.arrive(cell, side, clear).await?;
        let far = at_gap(cell, self.recipe.first_look(cell.spec()));
        cell.line(side, far, None).await?;
        let tolerances = TUNING.vision.arrives.map(|times| times * coarse.tolerance);
        let each = |tolerance| std::iter::repeat_n(tolerance, coarse.looks as usize);
        for tolerance in tolerances.into_iter().flat_map(each) {
            let (x, z) = look(cell, side, tip, coarse.frames).await?;
            let kinematics = cell.frame(side);
            let seen = kinematics.macro_from_chip(Point::new(x, wanted.y, wanted.z));
            let aim = kinematics.macro_from_chip(wanted);
            let error = aim.x - seen.x;
            let way = outward(side) * (z - wanted.z) - gap;
            let here = cell.wanted(side);
            if error.abs() > tolerance {
                self.arrive(cell, side, here.shifted(error, 0.0, 0.0))
                    .await?;
            } else {
                return cell.line(side, here.shifted(0.0, 0.0, way), None).await;
            }
        }
        let [.., tolerance] = tolerances;
        Err(Outcome::TipAstray { side, tolerance }.into())
    }

    /// Places the sensing fiber before the first output (thesis 3.2.2): aligned by vision in x
    /// and z, it rises from below until it has passed the chip's top.
    pub(crate) async fn find_top(
        &self,
        cell: &AlignmentCell<'_>,
        output: [f64; 3],
    ) -> Result<Top, Halt> {
        let recipe = self.recipe;
        let side = Side::Right;
        cell.laser(false)?;
        // The photodiode forgets the laser.
        cell.wait(0.01).await?;
        let dark = cell.level(Channel::Sensing, 0.1).await?;
        cell.laser(true)?;
        let [x, y, z] = output;
        let start = Point::new(x + self.walk(), y - recipe.sensing.below, z);
        // Where it may step aside later, the facet may stand out as far.
        let passes = recipe.raster.retry.passes.iter();
        let steps = passes.map(|pass| pass.sensing.abs()).fold(0.0, f64::max);
        let out = self.out_before_sensing(cell, steps * recipe.sensing.sidestep);
        let core = cell.spec().sensing_fiber.core;
        let height = recipe.sensing.below + recipe.raster.y + recipe.raster.overscan + core;
        let guard = &cell.spec().guard;
        // A stage that stands askew comes nearer as it rises.
        let nearer = GuardSpec::SIGMAS * guard.askew * height;
        let gap = out + guard.clearance + 2.0 * TUNING.gap.upward + nearer;
        let gap = gap.max(recipe.raster.gap);
        self.place(cell, side, Tip::Sensing, start, gap).await?;
        edge_from_below(
            cell,
            &recipe.sensing,
            &dark,
            recipe.raster.significance,
            height,
        )
        .await?;
        let holder = cell.wanted(side);
        Ok(Top { holder, gap })
    }

    /// How far the facet of the first output may stand out before a sensing fiber that was placed by vision and is so far aside of there, metres.
    fn out_before_sensing(&self, cell: &AlignmentCell<'_>, aside: f64) -> f64 {
        let [bound, _] = cell.spec().vision.believed();
        self.facet()
            .stands_out(cell.spec(), self.walk(), bound + aside)
    }

    /// Has the sensing fiber stand so far aside of where it passed the chip's top, metres. What its joints let out as they turn it goes straight back
    /// before, as far as the facet may stand out then.
    pub(crate) async fn beside_top(
        &self,
        cell: &AlignmentCell<'_>,
        top: &Top,
        aside: f64,
    ) -> Result<(), Halt> {
        let guard = &cell.spec().guard;
        let let_out = TUNING.gap.turns_back * guard.windup;
        let out = self.out_before_sensing(cell, aside.abs() + let_out);
        let nearer = out + guard.clearance - top.gap;
        let there = top.holder.shifted(aside, 0.0, 0.0);
        if nearer <= 0.0 {
            return self.arrive(cell, Side::Right, there).await;
        }
        let here = cell.wanted(Side::Right);
        let back = there.shifted(0.0, 0.0, -nearer);
        let away = Point::new(here.x, here.y, back.z);
        cell.line(Side::Right, away, None).await?;
        self.arrive(cell, Side::Right, back).await?;
        cell.line(Side::Right, there, None).await
    }

    /// Rasters from where the fiber stands, one pass after the other until there is light. What the `sensing` fiber is to see is looked for wherever
    /// that is to stand; what it does not see only in the passes in which it stays.
    async fn rasters(&self, cell: &AlignmentCell<'_>, sensing: Option<Top>) -> Result<Found, Halt> {
        let (raster, step) = (&self.recipe.raster, self.recipe.sensing.sidestep);
        let lowest = cell.wanted(self.side);
        let between = raster.retry.between * raster.mesh;
        let mut evidence: Option<SearchEvidence> = None;
        let passes = raster.retry.passes.iter();
        for pass in passes.filter(|pass| sensing.is_some() || pass.sensing == 0.0) {
            if evidence.is_some() {
                if let Some(top) = &sensing {
                    self.beside_top(cell, top, pass.sensing * step).await?;
                }
                cell.move_micro(self.side, Displacement::ZERO)?;
                let start = lowest.shifted(pass.aside * raster.x, -between, 0.0);
                self.arrive(cell, self.side, start).await?;
            }
            match self.find_light(cell).await {
                Ok(found) => return Ok(found),
                Err(halt) => evidence = Some(halt.no_light()?.after(evidence)),
            }
        }
        Err(no_light(evidence))
    }

    /// The raster from where the fiber stands, with the macro brought to what it found. A hit
    /// that does not bear a second look was a fluctuation of the scattered light, and the raster
    /// goes on above it.
    async fn find_light(&self, cell: &AlignmentCell<'_>) -> Result<Found, Halt> {
        let raster = &self.recipe.raster;
        let searcher =
            Searcher::measure(cell, self.side, self.channel, raster.significance, 0.5).await?;
        let start = cell.wanted(self.side);
        let top = start.y + raster.height();
        let mut evidence = None;
        loop {
            let sweep = searcher.raster(cell, raster, self.facet(), top).await?;
            let seen = sweep.evidence.following(evidence);
            let hit = match sweep.hit {
                Some(hit) if seen.dismissed < raster.retry.dismissed as usize => hit,
                _ => return Err(no_light(Some(seen))),
            };
            if let Some(found) = self.confirm(cell, &searcher, &hit).await? {
                return Ok(found);
            }
            evidence = Some(SearchEvidence {
                dismissed: seen.dismissed + 1,
                ..seen
            });
            cell.move_micro(self.side, Displacement::ZERO)?;
            let here = Point::new(start.x, hit.endpoint.y, start.z);
            self.arrive(cell, self.side, here).await?;
        }
    }

    /// Brings the macro to a hit and looks again: `None` where nothing bears that second look.
    pub(crate) async fn confirm(
        &self,
        cell: &AlignmentCell<'_>,
        searcher: &Searcher,
        hit: &Hit,
    ) -> Result<Option<Found>, Halt> {
        // The light may have slipped away farther than is looked around for at first.
        let around = &self.recipe.raster.retry.around;
        for far in around {
            self.recentre(cell, searcher, hit, *far).await?;
            let level = searcher.contrast(cell, self.recipe.raster.mesh).await?;
            if level > 0.5 * hit.level {
                // The look aside and back has left the piezos elsewhere.
                self.regain(cell, searcher, level, around[0]).await?;
                return Ok(Some(Found {
                    background: searcher.background.mean,
                    level,
                }));
            }
        }
        Ok(None)
    }

    /// Brings the macro to where the search saw its brightest light and the micro back to its
    /// centre, arriving from below as the search came.
    pub(crate) async fn recentre(
        &self,
        cell: &AlignmentCell<'_>,
        searcher: &Searcher,
        hit: &Hit,
        around: f64,
    ) -> Result<(), Halt> {
        cell.move_micro(self.side, Displacement::ZERO)?;
        self.arrive(cell, self.side, hit.endpoint.moved(hit.micro))
            .await?;
        self.regain(cell, searcher, hit.level, around).await
    }

    /// Looks around with the micro where lags, counts, friction or the piezos' hysteresis have let
    /// light of a level slip away: it cannot be far.
    async fn regain(
        &self,
        cell: &AlignmentCell<'_>,
        searcher: &Searcher,
        level: f64,
        around: f64,
    ) -> Result<(), Halt> {
        let mesh = self.recipe.raster.mesh;
        let now = cell.level(self.channel, 0.02).await?.mean - searcher.background.mean;
        if now < 0.5 * level
            && let Some(again) = searcher
                .micro_raster(cell, around * mesh, 0.4 * mesh)
                .await?
                .hit
        {
            cell.move_micro(self.side, again.micro)?;
            cell.wait(0.02).await?;
        }
        Ok(())
    }
}

/// Averages `frames` vision frames of a tip: its x and z in the chip's frame.
pub(crate) async fn look(
    cell: &AlignmentCell<'_>,
    side: Side,
    tip: Tip,
    frames: u32,
) -> Result<(f64, f64), Halt> {
    let (mut x, mut z) = (0.0, 0.0);
    for _ in 0..frames {
        let frame = cell.next_frame().await?;
        let of = |fix: &&Fix| (fix.arm, fix.tip) == (side.index(), tip);
        let Some(fix) = frame.fixes.iter().find(of) else {
            return Err(Outcome::FiberUnseen { side }.into());
        };
        x += fix.x;
        z += fix.z;
    }
    let n = f64::from(frames);
    Ok((x / n, z / n))
}

/// Direction along the chip's z in which a facet faces.
pub(crate) fn outward(side: Side) -> f64 {
    [-1.0, 1.0][side.index()]
}

/// No search has found light, whatever was searched.
pub(crate) fn no_light(evidence: Option<SearchEvidence>) -> Halt {
    evidence
        .map_or(Outcome::NothingSearched, Outcome::NoLight)
        .into()
}

pub(crate) fn lost(phase: &'static str, level: f64, expected: f64) -> Halt {
    Outcome::LightLost {
        phase,
        level,
        expected,
    }
    .into()
}

//! The thesis's alignment procedure (3.2.2, 3.3): straight-line functions over a station.

mod attach;

pub(crate) use attach::place_at;

use crate::belief::{Across, Place};
use crate::outcome::{Halt, Outcome, SearchEvidence};
use crate::peak::NinePoint;
use crate::recipe::Recipe;
use crate::search::{Hit, STILL_THERE, Searcher, centre_sensing, edge_from_below};
use crate::shaking::{Measured, Shaking};
use crate::station::{Level, Station};
use crate::tip_estimator::Tip;
use pigtail_hal::spec::OUTPUTS;
use pigtail_hal::{Channel, Fault, FiberHandling, Side};
use pigtail_model::frames::{Chip, Displacement, Macro, Point};

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

/// How far aside a raster is repeated that has found nothing, in its width: piezos without
/// compensation do not sweep as far as they are told.
const ASIDE: f64 = 0.25;

/// How far around a bright place light is looked for that has slipped away, in meshes: first, and
/// once more before the place is dismissed.
pub(crate) const AROUND: [f64; 2] = [3.0, 6.0];

/// After so many bright places that did not bear a second look there is more scattered light than
/// a search can live with.
pub(crate) const MOST_DISMISSED: usize = 5;

/// A fiber on its way to a port.
pub(crate) struct Job<'r> {
    pub(crate) recipe: &'r Recipe,
    name: &'static str,
    /// The manipulator that carries it.
    pub(crate) side: Side,
    /// The port by design, chip's frame.
    pub(crate) port: Point<Chip>,
    /// The photodiode that sees its light.
    pub(crate) channel: Channel,
    phases: Vec<(&'static str, f64)>,
    /// How its tip shakes, as far as circles have told.
    shaking: Option<Shaking>,
    /// Where it is believed to be.
    place: Option<Place>,
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
    /// The gap, metres.
    pub gap: f64,
    /// How the peak walks as the gap closes, metres in the manipulator's x and y for a metre.
    pub walk: Displacement,
}

/// Aligns the input fiber and the output fibers of one device, as the thesis does.
pub fn thesis(station: &mut Station, recipe: &Recipe) -> Vec<FiberReport> {
    station.laser(true);
    each_fiber(station, recipe, |job, station, port| match port {
        None => job.align_input(station),
        Some(k) => job.align_output(station, k),
    })
}

/// Aligns the fibers of a device one after the other, the input (`None`) first. Outputs are
/// attempted where the input is aligned, and nothing once the machine has stopped.
pub(crate) fn each_fiber(
    station: &mut Station,
    recipe: &Recipe,
    mut align: impl FnMut(&mut Job, &mut Station, Option<usize>) -> Result<(), Halt>,
) -> Vec<FiberReport> {
    let mut reports: Vec<FiberReport> = Vec::with_capacity(PORTS.len());
    for port in std::iter::once(None).chain((0..recipe.ports.outputs.len()).map(Some)) {
        let mut job = port.map_or_else(|| Job::input(recipe), |k| Job::output(recipe, k));
        let dark = port.is_some() && reports[0].outcome != Outcome::Aligned;
        let stopped = reports
            .iter()
            .any(|report| report.outcome.fault().is_some());
        reports.push(if dark || stopped {
            job.report(Outcome::NotAttempted)
        } else {
            job.run(station, |job, station| align(job, station, port))
        });
    }
    reports
}

/// The reports of a device on which nothing could be begun.
pub fn not_begun(recipe: &Recipe, fault: Fault) -> Vec<FiberReport> {
    let mut outcomes =
        std::iter::once(Outcome::Stopped(fault)).chain(std::iter::repeat(Outcome::NotAttempted));
    std::iter::once(Job::input(recipe))
        .chain((0..recipe.ports.outputs.len()).map(|k| Job::output(recipe, k)))
        .map(|mut job| job.report(outcomes.next().unwrap_or(Outcome::NotAttempted)))
        .collect()
}

/// Lights the guides of a device for an experiment: the input fiber aligned and attached as in
/// [`thesis`], to `accuracy` metres, for which some more or less light is no matter. The sensing
/// fiber then stands before the first output.
///
/// # Errors
///
/// The machine's fault, or why the input could not be aligned.
pub fn light_guides(station: &mut Station, recipe: &Recipe, accuracy: f64) -> Result<(), Halt> {
    let mut recipe = recipe.clone();
    recipe.last.accuracy = accuracy;
    station.laser(true);
    Job::input(&recipe).align_input(station)
}

/// Light that was found, with the macro brought to it.
pub(crate) struct Found {
    /// The photodiode's level without it, volts.
    pub(crate) background: f64,
    /// Its level above that, volts.
    pub(crate) level: f64,
}

impl<'r> Job<'r> {
    /// What circles have told of how its tip shakes.
    pub(crate) fn has_shaken(&mut self, shaking: Shaking) {
        self.shaking = Some(self.shaking.map_or(shaking, |before| before.and(shaking)));
    }

    /// The input fiber's way to its port.
    pub(crate) fn input(recipe: &'r Recipe) -> Self {
        let port = recipe.ports.input;
        Self::new(recipe, PORTS[0], Side::Left, port, Channel::Sensing)
    }

    /// The way of an output fiber.
    pub(crate) fn output(recipe: &'r Recipe, index: usize) -> Self {
        let (name, port) = (PORTS[1 + index], recipe.ports.outputs[index]);
        Self::new(recipe, name, Side::Right, port, Channel::of_output(index))
    }

    fn new(
        recipe: &'r Recipe,
        name: &'static str,
        side: Side,
        [x, y, z]: [f64; 3],
        channel: Channel,
    ) -> Self {
        Self {
            recipe,
            name,
            side,
            port: Point::new(x, y, z),
            channel,
            phases: Vec::with_capacity(8),
            shaking: None,
            place: None,
            holds: false,
            at_peak: None,
        }
    }

    /// How it went.
    pub(crate) fn report(&mut self, outcome: Outcome) -> FiberReport {
        FiberReport {
            port: self.name,
            side: self.side,
            outcome,
            shaking: self
                .shaking
                .filter(Shaking::is_watched)
                .map(|shaking| shaking.measured()),
            place: self.place.take(),
            phases: std::mem::take(&mut self.phases),
        }
    }

    /// Runs a whole alignment. One that fails leaves the machine well: away from the chip, and the
    /// fiber back in the tray.
    pub(crate) fn run(
        &mut self,
        station: &mut Station,
        align: impl FnOnce(&mut Self, &mut Station) -> Result<(), Halt>,
    ) -> FiberReport {
        let outcome = match align(self, station) {
            Ok(()) => Outcome::Aligned,
            Err(Halt::Fault(fault)) => Outcome::Stopped(fault),
            Err(Halt::Outcome(outcome)) => match self.put_back(station) {
                Ok(()) => outcome,
                Err(fault) => Outcome::Stopped(fault),
            },
        };
        self.report(outcome)
    }

    /// Takes the fiber away from the chip and back into the tray.
    fn put_back(&mut self, station: &mut Station) -> Result<(), Fault> {
        station.halt(self.side);
        match self.withdraw(station, self.side) {
            Err(Halt::Fault(fault)) => return Err(fault),
            Ok(()) | Err(Halt::Outcome(_)) => {}
        }
        station.handle_fiber(self.side, FiberHandling::Unload)
    }

    /// Runs a phase and notes its time, also of one that ends early.
    pub(crate) fn phase<T>(
        &mut self,
        station: &mut Station,
        name: &'static str,
        work: impl FnOnce(&mut Self, &mut Station) -> Result<T, Halt>,
    ) -> Result<T, Halt> {
        station.announce(self.name, name);
        let start = station.time();
        let result = work(self, station);
        self.phases.push((name, station.time() - start));
        station.conclude(self.name, name);
        result
    }

    /// Aligns the input fiber, be it carried already or not.
    pub(crate) fn align_input(&mut self, station: &mut Station) -> Result<(), Halt> {
        let found = self.find_input(station)?;
        self.finish(station, &found)
    }

    /// Brings the input fiber to the peak before its port, and leaves it there, not attached.
    pub(crate) fn reach_input(&mut self, station: &mut Station) -> Result<(), Halt> {
        let found = self.find_input(station)?;
        self.maximize(station, &found, |_, _, _| Ok(()))
    }

    /// From the tray to first light.
    pub(crate) fn find_input(&mut self, station: &mut Station) -> Result<Found, Halt> {
        if !station.carries(Side::Left) {
            station.handle_fiber(Side::Left, FiberHandling::Load(0))?;
        }
        let recipe = self.recipe;
        let output = recipe.ports.outputs[0];
        self.phase(station, "coarse", |job, station| {
            job.place(
                station,
                Side::Left,
                Tip::Fiber,
                job.search_start(),
                recipe.raster.gap,
            )
        })?;
        let top = self.phase(station, "sensing", |job, station| {
            job.find_top(station, output)
        })?;
        self.phase(station, "raster", |job, station| {
            let lowest = station.wanted(Side::Left);
            // The guided light may have passed beside the sensing fiber's core: to either side. Or
            // beside the area, which piezos without compensation do not sweep to its edges.
            let step = recipe.sensing.sidestep;
            let aside = ASIDE * recipe.raster.x;
            // And between the lines of the first.
            let between = 0.5 * recipe.raster.mesh;
            let mut evidence: Option<SearchEvidence> = None;
            for (sensing, area) in [
                (0.0, 0.0),
                (step, 0.0),
                (-step, 0.0),
                (0.0, aside),
                (0.0, -aside),
                (step, aside),
                (-step, -aside),
            ] {
                if evidence.is_some() {
                    job.arrive(station, Side::Right, top.shifted(sensing, 0.0, 0.0))?;
                    station.move_micro(Side::Left, Displacement::ZERO);
                    job.arrive(station, Side::Left, lowest.shifted(area, -between, 0.0))?;
                }
                match job.find_light(station) {
                    Ok(found) => return Ok(found),
                    Err(halt) => evidence = Some(halt.no_light()?.after(evidence)),
                }
            }
            Err(no_light(evidence))
        })
    }

    /// Aligns an output fiber, be it carried already or not.
    pub(crate) fn align_output(&mut self, station: &mut Station, index: usize) -> Result<(), Halt> {
        let found = self.find_output(station, index)?;
        self.finish(station, &found)
    }

    /// Brings an output fiber to the peak before its port, and leaves it there, not attached.
    pub(crate) fn reach_output(&mut self, station: &mut Station, index: usize) -> Result<(), Halt> {
        let found = self.find_output(station, index)?;
        self.maximize(station, &found, |_, _, _| Ok(()))
    }

    /// From the tray to first light.
    pub(crate) fn find_output(
        &mut self,
        station: &mut Station,
        index: usize,
    ) -> Result<Found, Halt> {
        let recipe = self.recipe;
        self.phase(station, "coarse", |job, station| {
            // Loaded only now, and away from the chip: an output fiber stands out beyond the
            // sensing fiber.
            job.withdraw(station, Side::Right)?;
            if !station.carries(Side::Right) {
                station.handle_fiber(Side::Right, FiberHandling::Load(index as u8))?;
            }
            job.place(
                station,
                Side::Right,
                Tip::Fiber,
                job.search_start(),
                recipe.raster.gap,
            )
        })?;
        self.phase(station, "raster", |job, station| {
            let lowest = station.wanted(Side::Right);
            let aside = ASIDE * recipe.raster.x;
            // And between the lines of the first.
            let between = 0.5 * recipe.raster.mesh;
            let mut evidence: Option<SearchEvidence> = None;
            for area in [0.0, aside, -aside] {
                if evidence.is_some() {
                    station.move_micro(Side::Right, Displacement::ZERO);
                    job.arrive(station, Side::Right, lowest.shifted(area, -between, 0.0))?;
                }
                match job.find_light(station) {
                    Ok(found) => return Ok(found),
                    Err(halt) => evidence = Some(halt.no_light()?.after(evidence)),
                }
            }
            Err(no_light(evidence))
        })
    }

    /// From first light to an attached fiber.
    fn finish(&mut self, station: &mut Station, found: &Found) -> Result<(), Halt> {
        self.maximize(station, found, |job, station, last| {
            // The thesis did not ask whether a tip shakes; but where it was seen, it is known.
            let watched = job.shaking.filter(Shaking::is_watched);
            if let Some(shaking) = watched {
                let recipe = job.recipe;
                // Its patterns know a peak no better than the tip shakes while they are drawn.
                let known = recipe.last.accuracy.hypot(shaking.deviation());
                shaking.is_sure(recipe.accept.aside, Across::of(known))?;
            }
            job.attach(station, last, found.background, None)
        })
    }

    /// From first light to the peak at the chip (thesis 3.3), where something is done.
    fn maximize(
        &mut self,
        station: &mut Station,
        found: &Found,
        there: impl FnOnce(&mut Self, &mut Station, Level) -> Result<(), Halt>,
    ) -> Result<(), Halt> {
        let recipe = self.recipe;
        let background = found.background;
        let (mut peak, before, noise) = self.phase(station, "climb", |job, station| {
            let mut peak = NinePoint::new(&recipe.climb, station, job.side, job.channel);
            peak.climb(station)?;
            if job.channel == Channel::Sensing {
                centre_sensing(station)?;
            }
            let before = station.level(job.channel, 0.04)?;
            let level = before.mean - background;
            if level < STILL_THERE * found.level {
                return Err(lost("climb", level, found.level));
            }
            Ok((peak, level, before.sigma))
        })?;
        self.phase(station, "approach", |job, station| {
            let (_, z) = look(station, job.side, Tip::Fiber, recipe.approach.frames)?;
            let gap = outward(job.side) * (z - job.port.z);
            let start = station.wanted(job.side);
            let mut closer = |station: &mut Station, to: f64| {
                let end = Point::new(start.x, start.y, start.z + gap - to);
                station.start_line(job.side, end, Some(recipe.approach.speed))?;
                while station.moving(job.side) {
                    peak.step(station)?;
                }
                Ok::<_, Halt>(())
            };
            // What is no peak may stand far aside, where the inclined facet is nearer than here: on
            // the way light must have grown already.
            let doubtful = recipe.fast.doubtful_gap;
            if gap > doubtful && doubtful > recipe.approach.gap {
                closer(station, doubtful)?;
                let after = station.level(job.channel, 0.04)?.mean - background;
                if after < recipe.accept.growth.sqrt() * before {
                    return Err(Outcome::FalseLight { before, after }.into());
                }
            }
            closer(station, recipe.approach.gap)
        })?;
        self.phase(station, "final", |job, station| {
            peak.climb(station)?;
            peak.settle(station, recipe.last.patterns, recipe.last.accuracy)?;
            let last = station.level(job.channel, 0.04)?;
            let after = last.mean - background;
            if after < recipe.accept.growth * before {
                return Err(Outcome::FalseLight { before, after }.into());
            }
            let sigma = last.sigma.min(noise);
            there(job, station, Level { sigma, ..last })
        })
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
    /// they hold back is then the same each time (thesis 2.4).
    pub(crate) fn arrive(
        &self,
        station: &mut Station,
        side: Side,
        to: Point<Macro>,
    ) -> Result<(), Halt> {
        station.line(side, to.shifted(0.0, -self.recipe.coarse.run_up, 0.0), None)?;
        station.line(side, to, None)
    }

    /// Moves a holder straight back until its fiber, by design, is clear of the chip.
    pub(crate) fn withdraw(&self, station: &mut Station, side: Side) -> Result<(), Halt> {
        let gap = outward(side) * self.recipe.coarse.clearance;
        let here = station.wanted(side);
        let [x, y, z] = match side {
            Side::Left => self.recipe.ports.input,
            Side::Right => self.recipe.ports.outputs[0],
        };
        let clear = station
            .kinematics(side)
            .macro_from_chip(Point::new(x, y, z + gap));
        station.line(side, Point::new(here.x, here.y, here.z.min(clear.z)), None)
    }

    /// Brings a tip to `wanted` (chip's frame) at `gap` from its facet, as well as vision can see
    /// and the fixture holds.
    pub(crate) fn place(
        &self,
        station: &mut Station,
        side: Side,
        tip: Tip,
        wanted: Point<Chip>,
        gap: f64,
    ) -> Result<(), Halt> {
        let coarse = &self.recipe.coarse;
        let holder_from_tip = match tip {
            Tip::Fiber => [0.0; 3],
            Tip::Sensing => station.spec().sensing_fiber.offset.map(|d| -d),
        };
        let at_gap = |station: &Station, gap: f64| {
            let [x, y, z] = holder_from_tip;
            let p = wanted.shifted(0.0, 0.0, outward(side) * gap);
            station.kinematics(side).macro_from_chip(p).shifted(x, y, z)
        };
        // Back before sideways: the holder may still stand at the chip.
        self.withdraw(station, side)?;
        station.move_micro(side, Displacement::ZERO);
        let clear = at_gap(station, coarse.clearance);
        self.arrive(station, side, clear)?;
        let far = at_gap(station, coarse.first_look(station.spec()));
        station.line(side, far, None)?;
        for _ in 0..4 {
            let (x, z) = look(station, side, tip, coarse.frames)?;
            let kinematics = station.kinematics(side);
            let seen = kinematics.macro_from_chip(Point::new(x, wanted.y, wanted.z));
            let aim = kinematics.macro_from_chip(wanted);
            let error = aim.x - seen.x;
            let way = outward(side) * (z - wanted.z) - gap;
            let here = station.wanted(side);
            if error.abs() > coarse.tolerance {
                self.arrive(station, side, here.shifted(error, 0.0, 0.0))?;
            } else {
                return station.line(side, here.shifted(0.0, 0.0, way), None);
            }
        }
        Err(Outcome::TipAstray {
            side,
            tolerance: coarse.tolerance,
        }
        .into())
    }

    /// Places the sensing fiber before the first output (thesis 3.2.2): aligned by vision in x
    /// and z, it rises from below until it has passed the chip's top. Returns where it stands.
    pub(crate) fn find_top(
        &self,
        station: &mut Station,
        output: [f64; 3],
    ) -> Result<Point<Macro>, Halt> {
        let recipe = self.recipe;
        let side = Side::Right;
        station.laser(false);
        // The photodiode forgets the laser.
        station.run(0.01)?;
        let dark = station.level(Channel::Sensing, 0.1)?;
        station.laser(true);
        let [x, y, z] = output;
        let start = Point::new(x + self.walk(), y - recipe.sensing.below, z);
        self.place(station, side, Tip::Sensing, start, recipe.raster.gap)?;
        let core = station.spec().sensing_fiber.core;
        let height = recipe.sensing.below + recipe.raster.y + recipe.raster.overscan + core;
        edge_from_below(
            station,
            &recipe.sensing,
            &dark,
            recipe.raster.significance,
            height,
        )?;
        Ok(station.wanted(side))
    }

    /// The raster from where the fiber stands, with the macro brought to what it found. A hit
    /// that does not bear a second look was a fluctuation of the scattered light, and the raster
    /// goes on above it.
    fn find_light(&self, station: &mut Station) -> Result<Found, Halt> {
        let raster = &self.recipe.raster;
        let searcher =
            Searcher::measure(station, self.side, self.channel, raster.significance, 0.5)?;
        let start = station.wanted(self.side);
        let top = start.y + raster.height();
        let mut evidence = None;
        loop {
            let sweep = searcher.raster(station, raster, top)?;
            let seen = sweep.evidence.following(evidence);
            let hit = match sweep.hit {
                Some(hit) if seen.dismissed < MOST_DISMISSED => hit,
                _ => return Err(no_light(Some(seen))),
            };
            if let Some(found) = self.confirm(station, &searcher, &hit)? {
                return Ok(found);
            }
            evidence = Some(SearchEvidence {
                dismissed: seen.dismissed + 1,
                ..seen
            });
            station.move_micro(self.side, Displacement::ZERO);
            let here = Point::new(start.x, hit.endpoint.y, start.z);
            self.arrive(station, self.side, here)?;
        }
    }

    /// Brings the macro to a hit and looks again: `None` where nothing bears that second look.
    pub(crate) fn confirm(
        &self,
        station: &mut Station,
        searcher: &Searcher,
        hit: &Hit,
    ) -> Result<Option<Found>, Halt> {
        // The light may have slipped away farther than is looked around for at first.
        for around in AROUND {
            self.recentre(station, searcher, hit, around)?;
            let level = searcher.contrast(station, self.recipe.raster.mesh)?;
            if level > 0.5 * hit.level {
                // The look aside and back has left the piezos elsewhere.
                self.regain(station, searcher, level, AROUND[0])?;
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
    pub(crate) fn recentre(
        &self,
        station: &mut Station,
        searcher: &Searcher,
        hit: &Hit,
        around: f64,
    ) -> Result<(), Halt> {
        station.move_micro(self.side, Displacement::ZERO);
        self.arrive(station, self.side, hit.endpoint.moved(hit.micro))?;
        self.regain(station, searcher, hit.level, around)
    }

    /// Looks around with the micro where lags, counts, friction or the piezos' hysteresis have let
    /// light of a level slip away: it cannot be far.
    fn regain(
        &self,
        station: &mut Station,
        searcher: &Searcher,
        level: f64,
        around: f64,
    ) -> Result<(), Halt> {
        let mesh = self.recipe.raster.mesh;
        let now = station.level(self.channel, 0.02)?.mean - searcher.background.mean;
        if now < 0.5 * level
            && let Some(again) = searcher
                .micro_raster(station, around * mesh, 0.4 * mesh)?
                .hit
        {
            station.move_micro(self.side, again.micro);
            station.run(0.02)?;
        }
        Ok(())
    }
}

/// Averages `frames` vision frames of a tip: its x and z in the chip's frame.
pub(crate) fn look(
    station: &mut Station,
    side: Side,
    tip: Tip,
    frames: u32,
) -> Result<(f64, f64), Halt> {
    let (mut x, mut z) = (0.0, 0.0);
    for _ in 0..frames {
        let frame = station.next_frame()?;
        let fix = match tip {
            Tip::Fiber => frame.fiber[side.index()],
            Tip::Sensing => Some(frame.sensing),
        };
        let Some(fix) = fix else {
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
    match side {
        Side::Left => -1.0,
        Side::Right => 1.0,
    }
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

//! The ways to the chip, and where the tips are seen to be on them.

use super::seen::{Dark, Top, top_below};
use super::{Look, Shared};
use crate::conical_scan::{Gap, Walk};
use crate::outcome::{Halt, Outcome, SearchEvidence};
use crate::procedure::outward;
use crate::station::{Station, coarse};
use crate::sweep::reach;
use crate::tip_estimator::{Seen, Tip};
use pigtail_hal::spec::Channel;
use pigtail_hal::{FiberHandling, Side};
use pigtail_model::frames::{Chip, Displacement, Macro, Point};

/// Longest wait for vision to see a tip well, seconds.
const PATIENCE: f64 = 1.0;

/// A tip on its way to a port.
#[derive(Debug, Clone, Copy)]
pub(super) struct Aim {
    pub(super) side: Side,
    pub(super) tip: Tip,
    /// The port by design.
    pub(super) port: Point<Chip>,
}

impl Aim {
    /// Where the tip stands from the holder in x and z (chip's frame): by vision, or by design.
    fn offset(&self, station: &Station) -> (f64, f64) {
        if let Some(Seen { x, z, .. }) = station.seen(self.side, self.tip) {
            return (x, z);
        }
        match self.tip {
            Tip::Fiber => (0.0, 0.0),
            Tip::Sensing => {
                let [x, y, z] = station.spec().sensing_fiber.offset;
                let k = station.kinematics(self.side);
                let at = |p: Point<Macro>| k.chip_from_macro(p);
                let (a, b) = (at(Point::ORIGIN), at(Point::new(x, y, z)));
                (b.x - a.x, b.z - a.z)
            }
        }
    }

    /// Where the holder must go for the tip to be `up` from the port's light at a gap (metres).
    pub(super) fn holder(&self, station: &Station, exit: f64, up: f64, gap: f64) -> Point<Macro> {
        let (x, z) = self.offset(station);
        let tip = self
            .port
            .shifted(gap * exit.tan(), up, outward(self.side) * gap);
        let dy = match self.tip {
            Tip::Fiber => 0.0,
            Tip::Sensing => station.spec().sensing_fiber.offset[1],
        };
        station
            .kinematics(self.side)
            .macro_from_chip(tip.shifted(-x, -dy, -z))
    }

    /// The gap by vision and encoders, metres.
    pub(super) fn gap(&self, station: &Station) -> f64 {
        let (_, z) = self.offset(station);
        self.gap_by_encoders(station) + outward(self.side) * z
    }

    /// The gap if the tip stood where the holder is, metres.
    pub(super) fn gap_by_encoders(&self, station: &Station) -> f64 {
        let holder = station
            .kinematics(self.side)
            .chip_from_macro(station.endpoint(self.side));
        outward(self.side) * (holder.z - self.port.z)
    }

    /// The same for circles: how it follows the macro.
    pub(super) fn led(&self, station: &Station) -> Gap {
        Gap::Led {
            by: coarse(self.side),
            contact: station.endpoint(self.side).z + self.gap(station),
        }
    }

    /// The walk of the peak in the manipulator's frame.
    pub(super) fn walk(&self, station: &Station, exit: f64) -> Walk {
        let k = station.kinematics(self.side);
        let a = k.macro_from_chip(self.port);
        let b = k.macro_from_chip(self.port.shifted(exit.tan(), 0.0, 0.0));
        b.across() - a.across()
    }
}

/// Starts lines of one or both manipulators and cycles until they have ended.
pub(super) fn lines(
    station: &mut Station,
    goals: &[(Side, Point<Macro>)],
    mut each: impl FnMut(&mut Station),
) -> Result<(), Halt> {
    for (side, to) in goals {
        station.start_line(*side, *to, None)?;
    }
    while goals.iter().any(|(side, _)| station.moving(*side)) {
        station.cycle()?;
        each(station);
    }
    Ok(())
}

/// Sends the micro to where its lines begin.
pub(super) fn cock(station: &mut Station, side: Side, width: f64) {
    let start = -reach(station, side, width);
    station.move_micro(side, Displacement::new(start, 0.0));
}

/// Waits until a tip is seen as well as `sure` metres across; goes on without where that takes too
/// long.
fn until_seen(station: &mut Station, aim: &Aim, sure: f64) -> Result<(), Halt> {
    let begin = station.time();
    loop {
        let seen = station.seen(aim.side, aim.tip);
        match seen {
            Some(seen) if seen.sigma[0] <= sure => return Ok(()),
            Some(_) if station.time() > begin + PATIENCE => return Ok(()),
            None if station.time() > begin + PATIENCE => {
                return Err(Outcome::FiberUnseen { side: aim.side }.into());
            }
            _ => station.cycle()?,
        }
    }
}

impl Shared<'_> {
    /// Both manipulators from wherever they are to the chip, the input fiber to the start of its
    /// search and the sensing fiber below the chip's top; on the way the dark is measured.
    pub(super) fn come_near(
        &mut self,
        station: &mut Station,
        aim: &Aim,
        sensing: &Aim,
    ) -> Result<(), Halt> {
        let (recipe, fast) = (self.recipe, self.fast);
        let run_up = recipe.coarse.run_up;
        let far = recipe.coarse.first_look(station.spec());
        let s = &fast.sensing;
        station.laser(false);
        let first = [
            (
                aim.side,
                aim.holder(station, self.exit(), -self.below() - run_up, far),
            ),
            (
                sensing.side,
                sensing.holder(station, self.exit(), -s.below - run_up, s.gap + far),
            ),
        ];
        let mut dark = Dark::default();
        let begin = station.time();
        lines(station, &first, |station| {
            // The photodiodes forget the laser in a moment.
            let since = station.time() - begin;
            if (0.02..0.02 + fast.dark).contains(&since) {
                dark.note(station);
            } else if since > 0.02 + fast.dark {
                station.laser(true);
            }
        })?;
        while !dark.is_enough() {
            station.cycle()?;
            dark.note(station);
        }
        self.dark = dark.levels(station.spec().photodiode.step());
        station.laser(true);
        cock(station, aim.side, recipe.raster.x);
        let second = [
            (
                aim.side,
                aim.holder(station, self.exit(), -self.below(), fast.input_gap),
            ),
            (
                sensing.side,
                sensing.holder(station, self.exit(), -s.below, s.gap),
            ),
        ];
        lines(station, &second, |_| {})
    }

    /// The sensing fiber rises over the chip's top.
    pub(super) fn over_the_top(&mut self, station: &mut Station, aim: &Aim) -> Result<(), Halt> {
        let s = &self.fast.sensing;
        let core = 0.5 * station.spec().sensing_fiber.core;
        let dark = self.dark[Channel::Sensing.index()].level;
        let start = station.wanted(aim.side);
        let height = s.below + self.recipe.raster.y + s.height;
        let brake = 0.5 * s.speed * s.speed / station.spec().five_bar.acceleration;
        // On the way it comes to stand right across.
        let x = aim.holder(station, self.exit(), 0.0, s.gap).x;
        let end = Point::new(x, start.y + height, start.z);
        station.start_line(aim.side, end, Some(s.speed))?;
        let mut seen: Vec<(f64, f64)> = Vec::with_capacity(256);
        let mut brightest = 0.0_f64;
        let mut top: Option<Top> = None;
        while station.moving(aim.side) {
            station.cycle()?;
            let y = station.endpoint(aim.side).y;
            // Light that fluctuates may look like an edge; above one there is none.
            if let Some(top) = &top
                && y + brake >= top.y + s.height
                && top.is_below(&seen, dark.sigma)
            {
                station.brake(aim.side);
                while station.moving(aim.side) {
                    station.cycle()?;
                }
                return Ok(());
            }
            let Some(volts) = station.light(Channel::Sensing) else {
                continue;
            };
            seen.push((y, volts - dark.mean));
            brightest = brightest.max(volts - dark.mean);
            match &mut top {
                None if brightest > self.fast.significance * dark.sigma => {
                    top = top_below(&seen, core);
                    self.fluctuation = top.map_or(self.fluctuation, |top| top.fluctuation);
                }
                None => {}
                Some(top) => top.rise(&seen),
            }
        }
        if top.is_some() {
            return Ok(());
        }
        let samples = seen.len();
        Err(Outcome::NoLight(SearchEvidence {
            phase: "search for the chip's top",
            samples,
            width: 0.0,
            height,
            brightest: brightest + dark.mean,
            dismissed: 0,
            threshold: dark.mean + self.fast.significance * dark.sigma,
        })
        .into())
    }

    /// How much larger z is on the outputs' facet so far in x from any place of it, by design, metres.
    fn facet(&self, x: f64) -> f64 {
        let [[ax, _, az], [bx, _, bz]] = self.recipe.ports.outputs;
        if ax == bx {
            return 0.0;
        }
        x * (az - bz) / (ax - bx)
    }

    /// Takes the next output fiber from the tray and brings it to the start of its search.
    pub(super) fn change_fiber(
        &mut self,
        station: &mut Station,
        aim: &Aim,
        index: usize,
    ) -> Result<(), Halt> {
        let recipe = self.recipe;
        let far = recipe.coarse.first_look(station.spec());
        let run_up = recipe.coarse.run_up;
        let here = station.wanted(aim.side);
        // The next fiber's place in the holder is not known yet: as far away as for any, from the
        // inclined facet where the holder stands now too.
        let k = station.kinematics(aim.side);
        let stands_out = outward(aim.side) * self.facet(k.chip_from_macro(here).x - aim.port.x);
        let away = far + stands_out.max(0.0);
        let clear = k.macro_from_chip(aim.port.shifted(0.0, 0.0, outward(aim.side) * away));
        let back = Point::new(here.x, here.y, here.z.min(clear.z));
        lines(station, &[(aim.side, back)], |_| {})?;
        if !station.carries(aim.side) {
            station.handle_fiber(aim.side, FiberHandling::Load(index as u8))?;
        }
        cock(station, aim.side, recipe.raster.x);
        let below = aim.holder(station, self.exit(), -self.below() - run_up, far);
        let below = Point::new(below.x, below.y, back.z);
        lines(station, &[(aim.side, below)], |_| {})?;
        // Not nearer before its tip was seen.
        until_seen(station, aim, f64::INFINITY)?;
        self.to_start(station, aim, self.fast.output_gap)
    }

    /// The last way to the start of a search, upward; there the tip is seen to stand right across.
    fn to_start(&self, station: &mut Station, aim: &Aim, gap: f64) -> Result<(), Halt> {
        let goal = aim.holder(station, self.exit(), -self.below(), gap);
        lines(station, &[(aim.side, goal)], |_| {})?;
        until_seen(station, aim, self.fast.straight)?;
        self.straighten(station, aim, gap)?;
        while station.moving(aim.side) {
            station.cycle()?;
        }
        Ok(())
    }

    /// Sets out for where the tip is now seen to stand right in x and z.
    pub(super) fn straighten(
        &self,
        station: &mut Station,
        aim: &Aim,
        gap: f64,
    ) -> Result<(), Halt> {
        let here = station.wanted(aim.side);
        let goal = aim.holder(station, self.exit(), 0.0, gap);
        let goal = Point::new(goal.x, here.y, goal.z);
        if here.distance(goal) > self.fast.straight {
            station.start_line(aim.side, goal, None)?;
        }
        Ok(())
    }

    /// Back to where a search starts, or beside it.
    pub(super) fn back_to_start(
        &self,
        station: &mut Station,
        aim: &Aim,
        look: &Look,
    ) -> Result<(), Halt> {
        let recipe = self.recipe;
        let here = station.wanted(aim.side);
        let first_look = recipe.coarse.first_look(station.spec());
        let far = aim.holder(station, self.exit(), 0.0, first_look);
        let back = Point::new(here.x, here.y, here.z.min(far.z));
        lines(station, &[(aim.side, back)], |_| {})?;
        cock(station, aim.side, look.width);
        let below = -self.below() - recipe.coarse.run_up;
        let below = aim.holder(station, self.exit(), below, first_look);
        lines(
            station,
            &[(aim.side, below.shifted(look.aside, 0.0, 0.0))],
            |_| {},
        )?;
        let start = aim.holder(station, self.exit(), -self.below(), look.gap);
        lines(
            station,
            &[(aim.side, start.shifted(look.aside, 0.0, 0.0))],
            |_| {},
        )
    }
}

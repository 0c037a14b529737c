//! The ways to the chip, and where the tips are seen to be on them.

use super::gap::least_gap;
use super::seen::{Top, dark, top_below};
use super::{Look, Shared};
use crate::cell::{AlignmentCell, eased};
use crate::conical_scan::{Gap, Walk};
use crate::job::Job;
use crate::outcome::{Halt, Outcome, SearchEvidence};
use crate::procedure::outward;
use crate::reactor::both_well;
use crate::recipe::{Recipe, Sweep};
use crate::station::{coarse, fine};
use crate::sweep::{calm, reach};
use crate::tip_estimator::{Seen, Tip};
use crate::tuning::TUNING;
use crate::upward::Facet;
use pigtail_hal::Side;
use pigtail_hal::spec::Channel;
use pigtail_model::frames::{Chip, Displacement, Macro, Point};
use std::cell::Cell;
use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::pin::Pin;

/// A tip on its way to a port.
#[derive(Debug, Clone, Copy)]
pub(super) struct Aim {
    pub(super) side: Side,
    pub(super) tip: Tip,
    /// The port by design.
    pub(super) port: Point<Chip>,
}

impl Aim {
    /// That of the fiber of a job.
    pub(super) fn at_fiber(job: &Job<'_>) -> Self {
        Self {
            side: job.side,
            tip: Tip::Fiber,
            port: job.port,
        }
    }

    /// Where the tip stands from the holder in x and z (chip's frame): by vision, or by design.
    fn offset(&self, cell: &AlignmentCell<'_>) -> (f64, f64) {
        if let Some(Seen { x, z, .. }) = cell.seen(self.side, self.tip) {
            return (x, z);
        }
        match self.tip {
            Tip::Fiber => (0.0, 0.0),
            Tip::Sensing => {
                let [x, y, z] = cell.spec().sensing_fiber.offset;
                let k = cell.frame(self.side);
                let at = |p: Point<Macro>| k.chip_from_macro(p);
                let (a, b) = (at(Point::ORIGIN), at(Point::new(x, y, z)));
                (b.x - a.x, b.z - a.z)
            }
        }
    }

    /// Where the holder must go for the tip to be `up` from the port's light at a gap (metres).
    pub(super) fn holder(
        &self,
        cell: &AlignmentCell<'_>,
        exit: f64,
        up: f64,
        gap: f64,
    ) -> Point<Macro> {
        let (x, z) = self.offset(cell);
        let tip = self
            .port
            .shifted(gap * exit.tan(), up, outward(self.side) * gap);
        let dy = match self.tip {
            Tip::Fiber => 0.0,
            Tip::Sensing => cell.spec().sensing_fiber.offset[1],
        };
        cell.frame(self.side)
            .macro_from_chip(tip.shifted(-x, -dy, -z))
    }

    /// The gap by vision and encoders, metres.
    pub(super) fn gap(&self, cell: &AlignmentCell<'_>) -> f64 {
        let (_, z) = self.offset(cell);
        self.gap_by_encoders(cell) + outward(self.side) * z
    }

    /// The same once the holder is where it is wanted at this moment: right after a way it is some way from there.
    pub(super) fn gap_at_rest(&self, cell: &AlignmentCell<'_>) -> f64 {
        let (_, z) = self.offset(cell);
        self.off_the_port(cell, cell.wanted(self.side)) + outward(self.side) * z
    }

    /// The gap if the tip stood where the holder is, metres.
    pub(super) fn gap_by_encoders(&self, cell: &AlignmentCell<'_>) -> f64 {
        self.off_the_port(cell, cell.endpoint(self.side))
    }

    /// How far a holder is from the port, outward, metres.
    fn off_the_port(&self, cell: &AlignmentCell<'_>, holder: Point<Macro>) -> f64 {
        let holder = cell.frame(self.side).chip_from_macro(holder);
        outward(self.side) * (holder.z - self.port.z)
    }

    /// How far beside the port the tip is on the chip's x, metres.
    pub(super) fn beside(&self, cell: &AlignmentCell<'_>) -> f64 {
        let (x, _) = self.offset(cell);
        let holder = cell.endpoint(self.side).moved(cell.micro(self.side));
        cell.frame(self.side).chip_from_macro(holder).x + x - self.port.x
    }

    /// The facet before which it is.
    pub(super) fn facet(&self, recipe: &Recipe) -> Facet {
        Facet {
            port: self.port,
            slope: recipe.ports.slope(),
        }
    }

    /// In from afar, to where a search starts as vision has that by then, and no nearer than the facet lets a tip come that is aside there. Where what
    /// transmissions let out has brought the tip so far aside that it would be too near on its way, it goes sideways first.
    pub(super) async fn come_in(
        &self,
        cell: &AlignmentCell<'_>,
        recipe: &Recipe,
        start: impl Fn() -> Point<Macro>,
    ) -> Result<(), Halt> {
        for _ in 0..TUNING.gap.sideways {
            let (here, there) = (cell.wanted(self.side), start());
            if self.too_near(cell, recipe, there, self.beside(cell)) == 0.0 {
                break;
            }
            cell.go(self.side, Point::new(there.x, here.y, here.z))
                .await?;
            cell.next_frame().await?;
        }
        for _ in 0..TUNING.gap.sideways {
            // What is still aside then stays farther off until it is in front of its port.
            let start = start();
            let there = self.off_the_facet(cell, recipe, start);
            let nearer = self.too_near(cell, recipe, there, self.beside(cell));
            let there = there.shifted(0.0, 0.0, -nearer);
            cell.go(self.side, there).await?;
            if there == start {
                break;
            }
            // Near to the chip who guards the machine comes to know it better.
            cell.next_frame().await?;
        }
        Ok(())
    }

    /// A place of the holder, or one farther from the chip where the inclined facet may stand out as far before the tip there.
    fn off_the_facet(
        &self,
        cell: &AlignmentCell<'_>,
        recipe: &Recipe,
        there: Point<Macro>,
    ) -> Point<Macro> {
        let [x, then] =
            [cell.wanted(self.side), there].map(|at| cell.frame(self.side).chip_from_macro(at).x);
        let beside = self.beside(cell) + then - x;
        there.shifted(0.0, 0.0, -self.too_near(cell, recipe, there, beside))
    }

    /// How much too near the facet a tip would be with its holder at a place, so far `beside` its port, metres; nothing where it would not.
    fn too_near(
        &self,
        cell: &AlignmentCell<'_>,
        recipe: &Recipe,
        there: Point<Macro>,
        beside: f64,
    ) -> f64 {
        let [bound, _] = cell.spec().vision.believed();
        let then = self.off_the_port(cell, there);
        let gap = then + outward(self.side) * self.offset(cell).1;
        let room = self.room_at(cell, then).unwrap_or(f64::INFINITY);
        let out = self.facet(recipe).stands_out(cell.spec(), beside, bound);
        (out + 2.0 * TUNING.gap.upward - gap)
            .max(out - room)
            .max(0.0)
    }

    /// How far from its port who guards the machine would have a fiber whose holder comes to be so `far` from that, before it sees it there; metres.
    fn room_at(&self, cell: &AlignmentCell<'_>, far: f64) -> Option<f64> {
        let way = self.off_the_port(cell, cell.endpoint(self.side)) - far;
        let room = cell.room_before(self.side, self.port.z, way)? - way;
        (self.tip == Tip::Fiber).then_some(room)
    }

    /// The gap for circles: how it follows the macro.
    pub(super) fn led(&self, cell: &AlignmentCell<'_>) -> Gap {
        Gap::Led {
            by: coarse(self.side),
            contact: cell.endpoint(self.side).z + self.gap(cell),
        }
    }

    /// The walk of the peak in the manipulator's frame.
    pub(super) fn walk(&self, cell: &AlignmentCell<'_>, exit: f64) -> Walk {
        let k = cell.frame(self.side);
        let a = k.macro_from_chip(self.port);
        let b = k.macro_from_chip(self.port.shifted(exit.tan(), 0.0, 0.0));
        b.across() - a.across()
    }
}

/// Lets something be done while the tip of a fiber stays where it is, before its port: as chip and holders warm they come nearer to each other, and what
/// is done may take minutes where light is dim. Where vision has it nearer than light does, who guards the machine stops it before it has come that near.
///
/// # Errors
///
/// As what is done; the fiber cannot be taken back.
pub(super) async fn kept_off<T>(
    cell: &AlignmentCell<'_>,
    aim: &Aim,
    work: Pin<Box<impl Future<Output = Result<T, Halt>>>>,
) -> Result<T, Halt> {
    let done = Cell::new(false);
    let first = aim.gap(cell);
    let work = async {
        let result = work.await;
        done.set(true);
        result
    };
    let keep = async {
        while !done.get() {
            let by = cell.now() + TUNING.gap.kept_every;
            while !done.get() && !cell.is_past(by) {
                cell.next(by).await?;
            }
            let gap = aim.gap(cell);
            let (nearer, short) = (first - gap, least_gap(cell, aim, gap) - gap);
            let spent = short > (1.0 - TUNING.gap.left) * TUNING.gap.stop;
            if (spent || nearer > TUNING.gap.kept_off) && !done.get() {
                let away = cell.wanted(aim.side).shifted(0.0, 0.0, -nearer.max(short));
                cell.start_line(aim.side, away, None)?;
            }
        }
        Ok(())
    };
    Ok(both_well(work, keep).await?.0)
}

/// Sends the micro to where its lines begin.
pub(super) fn cock(cell: &AlignmentCell<'_>, side: Side, width: f64) -> Result<(), Outcome> {
    let start = reach(cell, side, width).low;
    cell.glide_micro(side, Displacement::new(start, 0.0))
}

/// Whether the camera has seen a tip of a side swing, and it can be answered by going more slowly.
pub(super) fn swings(cell: &AlignmentCell<'_>, side: Side) -> bool {
    cell.is_seen_to_swing(side) && cell.settling(side) < slowest()
}

/// By when a micro has come to rest that takes as long as any, seconds.
fn slowest() -> f64 {
    TUNING.dynamics.constants * TUNING.ring_down.constants[1]
}

/// Goes to and fro a little at the rates of the lines by which light will be searched, and of the circles that follow it, far from all and where nobody has
/// measured how the micro swings: so that the camera sees whether it does by these. It ends at a place along x, metres.
async fn rehearse(
    cell: &AlignmentCell<'_>,
    side: Side,
    recipe: &Recipe,
    end: f64,
) -> Result<(), Halt> {
    if cell.settles(side) {
        return Ok(cell.glide_micro(side, Displacement::new(end, 0.0))?);
    }
    let tuned = &TUNING.ring_down;
    cell.wait(tuned.after).await?;
    let (sweep, from) = (&recipe.fast.sweep, cell.micro(side).x);
    let line = reach(cell, side, recipe.raster.x).width() / sweep.speed + sweep.flyback;
    let periods = [line, 0.5 * line, recipe.fast.conical_scan.period];
    let seconds = tuned.turns * periods.iter().sum::<f64>();
    let glide = TUNING.search.glide * cell.spec().micro.settling;
    let swung = |time: f64| {
        let mut begin = 0.0;
        for period in periods {
            let turns = (time - begin) / period;
            if turns < tuned.turns {
                return (TAU * turns).sin();
            }
            begin += tuned.turns * period;
        }
        0.0
    };
    let step = periods.into_iter().fold(line, f64::min) / TUNING.search.knots;
    cell.micro_path(side, (seconds, step), |time| {
        let middle = from + (end - from) * eased(time / glide);
        Displacement::new(middle + tuned.radius * swung(time), 0.0)
    })?;
    Ok(())
}

/// The lines of a search over a width at a gap, metres, so many times as slow as usual, or slower where the micro would swing so far that it comes near to an
/// inclined facet, or that who guards the machine believes that its tip is not where it should be.
pub(super) fn lines(
    cell: &AlignmentCell<'_>,
    side: Side,
    recipe: &Recipe,
    (width, gap): (f64, f64),
    slow: f64,
) -> Sweep {
    let slope = recipe.ports.slope().abs();
    let tuned = &TUNING.search;
    let most = (tuned.nearer * gap / slope).min(tuned.swings * cell.spec().guard.placement);
    // Narrower lines come as often as wide ones, by which the micro was seen not to swing.
    let [width_of, whole] = [width, recipe.raster.x].map(|width| reach(cell, side, width).width());
    let slow = slow * (whole / width_of).max(1.0);
    calm(cell, side, &recipe.fast.sweep.slower(slow), width, most)
}

/// Waits until a tip is seen as well as `sure` metres across; goes on without where that takes too
/// long.
async fn until_seen(cell: &AlignmentCell<'_>, aim: &Aim, sure: f64) -> Result<(), Halt> {
    let begin = cell.now();
    loop {
        let seen = cell.seen(aim.side, aim.tip);
        match seen {
            Some(seen) if seen.sigma[0] <= sure => return Ok(()),
            Some(_) if cell.is_past(begin + TUNING.dark.patience) => return Ok(()),
            None if cell.is_past(begin + TUNING.dark.patience) => {
                return Err(Outcome::FiberUnseen { side: aim.side }.into());
            }
            _ => drop(cell.next(begin + TUNING.dark.patience).await?),
        }
    }
}

/// Where the camera has seen a tip swing it is taken away from the chip and waited for, and all that its micro does from now on is done more slowly.
pub(super) async fn calm_down(
    cell: &AlignmentCell<'_>,
    aim: &Aim,
    recipe: &Recipe,
) -> Result<(), Halt> {
    let side = aim.side;
    if !swings(cell, side) {
        return Ok(());
    }
    cell.move_micro(side, cell.micro(side))?;
    let begin = cell.now();
    let far = aim.holder(
        cell,
        recipe.ports.exit_angle,
        0.0,
        recipe.first_look(cell.spec()),
    );
    let here = cell.wanted(side);
    let away = Point::new(here.x, here.y, here.z.min(far.z));
    cell.go(side, away).await?;
    cell.wait(TUNING.ring_down.watched).await?;
    let longer = TUNING.ring_down.longer * cell.settling(side);
    let settling = cell.rests_after_swing(side).unwrap_or(0.0).max(longer);
    // Micros of a machine are of a kind.
    for each in Side::ALL {
        cell.has_swung(fine(each), settling.min(slowest()));
    }
    cell.wait(cell.settling(side) - (cell.now() - begin))
        .await?;
    cell.forget_seen(side);
    until_seen(cell, aim, recipe.fast.straight).await
}

impl Shared<'_> {
    /// Both manipulators from wherever they are to the chip, the input fiber to the start of its
    /// search and the sensing fiber below the chip's top; on the way the dark is measured.
    pub(super) async fn come_near(
        &mut self,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        sensing: &Aim,
    ) -> Result<(), Halt> {
        let (recipe, fast) = (self.recipe, self.fast);
        let run_up = recipe.coarse.run_up;
        let far = recipe.first_look(cell.spec());
        let s = &fast.sensing;
        let exit = self.exit();
        let below = self.below();
        let fiber = async {
            let first = aim.holder(cell, exit, -below - run_up, far);
            let low = reach(cell, aim.side, recipe.raster.x).low;
            cell.start_line(aim.side, first, None)?;
            rehearse(cell, aim.side, recipe, low).await?;
            cell.stands(aim.side).await?;
            calm_down(cell, aim, recipe).await?;
            let start = || aim.holder(cell, exit, -below, fast.input_gap);
            Box::pin(aim.come_in(cell, recipe, start)).await
        };
        let eye = async {
            let first = sensing.holder(cell, exit, -s.below - run_up, s.gap + far);
            cell.start_line(sensing.side, first, None)?;
            rehearse(cell, sensing.side, recipe, 0.0).await?;
            cell.stands(sensing.side).await?;
            calm_down(cell, sensing, recipe).await?;
            let start = || sensing.holder(cell, exit, -s.below, s.gap);
            Box::pin(sensing.come_in(cell, recipe, start)).await
        };
        let there = Cell::new(false);
        let arms = async {
            let arrived = both_well(fiber, eye).await;
            there.set(true);
            arrived
        };
        let light = async {
            let dark = dark(cell, fast.dark).await?;
            // Below the chip the sensing fiber sees all that is scattered, which may be more than its photodiode does.
            while !there.get() {
                let volts = cell.light(Channel::Sensing, f64::INFINITY).await?;
                self.dimmed(cell, Channel::Sensing, volts.unwrap_or(0.0))?;
            }
            Ok(dark)
        };
        let (_, dark) = both_well(arms, light).await?;
        self.dark = dark.levels(cell.spec().photodiode.step());
        Ok(())
    }

    /// The sensing fiber rises over the chip's top.
    pub(super) async fn over_the_top(
        &mut self,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
    ) -> Result<(), Halt> {
        let s = &self.fast.sensing;
        let core = 0.5 * cell.spec().sensing_fiber.core;
        let dark = self.dark[Channel::Sensing.index()].level;
        let start = cell.wanted(aim.side);
        let height = s.below + self.recipe.raster.y + s.height;
        let brake = 0.5 * s.speed * s.speed / cell.spec().five_bar.acceleration;
        // On the way it comes to stand right across.
        let x = aim.holder(cell, self.exit(), 0.0, s.gap).x;
        let end = Point::new(x, start.y + height, start.z);
        cell.start_line(aim.side, end, Some(s.speed))?;
        let mut seen: Vec<(f64, f64)> = Vec::with_capacity(256);
        let mut brightest = 0.0_f64;
        let mut top: Option<Top> = None;
        while cell.is_moving(aim.side) {
            // It goes by some micrometres from sample to sample.
            let soon = cell.now() + cell.caps().cycle;
            let seen_now = cell.light(Channel::Sensing, soon).await?;
            let y = cell.endpoint(aim.side).y;
            // Light that fluctuates may look like an edge; above one there is none.
            if let Some(top) = &top
                && y + brake >= top.y + s.height
                && top.is_below(&seen, dark.sigma)
            {
                cell.brake(aim.side)?;
                cell.stands(aim.side).await?;
                break;
            }
            let Some(volts) = seen_now else {
                continue;
            };
            if self.remembers(cell) {
                continue;
            }
            seen.push((y, volts - dark.mean));
            brightest = brightest.max(volts - dark.mean);
            if let Some(share) = self.dimmed(cell, Channel::Sensing, volts)? {
                // As it would have been by this power.
                for (_, light) in &mut seen {
                    *light *= share;
                }
                brightest *= share;
            }
            match &mut top {
                None if brightest > self.fast.significance * dark.sigma => {
                    top = top_below(&seen, core);
                    self.fluctuation = top.map_or(self.fluctuation, |top| top.fluctuation);
                }
                None => {}
                Some(top) => top.rise(&seen),
            }
        }
        self.top = top;
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

    /// Takes the sensing fiber down until it sees scattered light, and says how much lower it is to stand yet: a transmission that lets out what it
    /// hid when the fiber stops has it higher over the chip's top than its encoders know, where it sees less of a guide's light.
    pub(super) async fn down_to_the_top(&mut self, cell: &AlignmentCell<'_>) -> Result<(), Halt> {
        let Some(top) = self.top else {
            return Ok(());
        };
        let (side, channel) = (Side::Right, Channel::Sensing);
        let core = 0.5 * cell.spec().sensing_fiber.core;
        let dark = self.dark[channel.index()].level;
        let together = TUNING.search.centring_window;
        let least = self.fast.significance * dark.sigma / (together as f64).sqrt();
        let wanted = self.fast.sensing.height;
        let lowest = cell.wanted(side).shifted(0.0, -wanted - core, 0.0);
        cell.start_line(side, lowest, Some(TUNING.dark.down))?;
        let mut seen = VecDeque::with_capacity(together + 1);
        while cell.is_moving(side) {
            let volts = cell.next_light(channel.index()).await?;
            seen.push_back(volts - dark.mean);
            if seen.len() > together {
                seen.pop_front();
                if seen.iter().sum::<f64>() > together as f64 * least {
                    cell.brake(side)?;
                    break;
                }
            }
        }
        cell.stands(side).await?;
        let level = cell.level(channel, TUNING.search.contrast).await?.mean - dark.mean;
        self.too_high = top.height_of(level.max(least), core) - wanted;
        Ok(())
    }

    /// Takes the next output fiber from the tray and brings it to the start of its search.
    pub(super) async fn change_fiber(
        &mut self,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        index: usize,
    ) -> Result<(), Halt> {
        let recipe = self.recipe;
        let far = recipe.first_look(cell.spec());
        let run_up = recipe.coarse.run_up;
        let here = cell.wanted(aim.side);
        // The next fiber's place in the holder is not known yet: as far away as for any, from the
        // inclined facet where the holder stands now too.
        let stood = cell.frame(aim.side).chip_from_macro(here);
        let beside = outward(aim.side) * (stood.x - aim.port.x);
        let stands_out = aim.facet(recipe).stands_out(cell.spec(), beside, 0.0);
        let off = outward(aim.side) * (stood.z - aim.port.z);
        let nearer = far + stands_out - off;
        let back = here.shifted(0.0, 0.0, -nearer.max(0.0));
        cell.go(aim.side, back).await?;
        if !cell.carries(aim.side) {
            cell.load(aim.side, index).await?;
        }
        cock(cell, aim.side, recipe.raster.x)?;
        let below = aim.holder(cell, self.exit(), -self.below() - run_up, far);
        // Of a stage that stands askew the one or the other is nearer to the chip.
        let below = Point::new(below.x, below.y, below.z.min(back.z));
        cell.go(aim.side, below).await?;
        // Not nearer before its tip was seen.
        until_seen(cell, aim, f64::INFINITY).await?;
        self.to_start(cell, aim, self.fast.output_gap).await
    }

    /// The last way to the start of a search, upward; there the tip is seen to stand right across.
    async fn to_start(&self, cell: &AlignmentCell<'_>, aim: &Aim, gap: f64) -> Result<(), Halt> {
        let goal = || aim.holder(cell, self.exit(), -self.below(), gap);
        Box::pin(aim.come_in(cell, self.recipe, goal)).await?;
        until_seen(cell, aim, self.fast.straight).await?;
        self.straighten(cell, aim, (gap, 0.0))?;
        Ok(cell.stands(aim.side).await?)
    }

    /// Sets out for where the tip is now seen to stand right in z at a gap and in x, or so far `aside`, metres.
    pub(super) fn straighten(
        &self,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        (gap, aside): (f64, f64),
    ) -> Result<(), Halt> {
        let here = cell.wanted(aim.side);
        let goal = aim.holder(cell, self.exit(), 0.0, gap);
        let goal = Point::new(goal.x + aside, here.y, goal.z);
        let goal = aim.off_the_facet(cell, self.recipe, goal);
        if here.distance(goal) > self.fast.straight {
            cell.start_line(aim.side, goal, None)?;
        }
        Ok(())
    }

    /// Back to where a search starts, or beside it.
    pub(super) async fn back_to_start(
        &self,
        cell: &AlignmentCell<'_>,
        aim: &Aim,
        look: &Look,
    ) -> Result<(), Halt> {
        let recipe = self.recipe;
        let here = cell.wanted(aim.side);
        let first_look = recipe.first_look(cell.spec());
        let far = aim.holder(cell, self.exit(), 0.0, first_look);
        let back = Point::new(here.x, here.y, here.z.min(far.z));
        cell.go(aim.side, back).await?;
        cock(cell, aim.side, look.width)?;
        let below = -look.below - recipe.coarse.run_up;
        let below = aim.holder(cell, self.exit(), below, first_look);
        cell.go(aim.side, below.shifted(look.aside, 0.0, 0.0))
            .await?;
        let start = || {
            let start = aim.holder(cell, self.exit(), -look.below, look.gap);
            start.shifted(look.aside, 0.0, 0.0)
        };
        // What transmissions may let out aside where joints turn back is to come out where the facet is far.
        let windup = cell.spec().guard.windup;
        if aim.too_near(cell, recipe, start(), windup) > 0.0 {
            let (far, there) = (cell.wanted(aim.side), start());
            cell.go(aim.side, Point::new(there.x, there.y, far.z))
                .await?;
            cell.next_frame().await?;
        }
        Box::pin(aim.come_in(cell, recipe, start)).await?;
        // What came out aside where joints turned back is seen by now, and who guards the machine knows the tip better at rest.
        until_seen(cell, aim, self.fast.straight).await?;
        self.straighten(cell, aim, (look.gap, look.aside))?;
        Ok(cell.stands(aim.side).await?)
    }
}

//! A bench with a camera and a sensing fiber in the hands of an alignment: what is known of where its arms stand, and what
//! the camera has seen so far.

use crate::beam::{Askew, Beam, SpotSize};
use crate::flicker::Flicker;
use crate::gap_by_light::{Rounds, Spread};
use crate::outcome::{Halt, Outcome};
use crate::procedure::outward;
use crate::reactor::{Gate, Go, LONGEST, Listener, Reactor, Watched, across, refused};
use crate::recipe::Recipe;
use crate::shaking::Measured;
use crate::station::{Level, Station, coarse, fine};
use crate::still_there::attached;
use crate::tip_estimator::{Held, Seen, Tip, TipEstimator};
use crate::tuning::TUNING;
use pigtail_hal::bench::{Event, Frame, Knot, Law, Pose, Request};
use pigtail_hal::spec::{GuardSpec, SIDES};
use pigtail_hal::{Bench, Channel, Fault, Side, Spec};
use pigtail_model::frames::{Chip, Displacement, Macro, Placement, Point};
use std::cell::{Cell, RefCell};
use std::future::Future;
use std::ops::Deref;

/// What is known of a bench before anything is measured on it: its datasheet, and what its calibration believes.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    /// The datasheet.
    pub spec: Spec,
    /// How the frame of each arm lies in that of the chip.
    pub frames: [Placement; SIDES],
    /// What was measured of how tips shake.
    pub shaking: [Option<Measured>; SIDES],
    /// How light spreads over a gap in the scale of the micros, where it was measured.
    pub spread: [Option<Spread>; SIDES],
    /// How wide the spot of light at the chip is in the scale of the micros, where it was measured.
    pub spot: [Option<SpotSize>; SIDES],
    /// By what angles ways across go along the light, too.
    pub askew: [Askew; SIDES],
    /// How far beside a circle's middle the micros come to rest, of its radius, by the models of their piezos.
    pub hides: [f64; SIDES],
    /// Whether it was measured by when the micros come to rest.
    pub settles: [bool; SIDES],
    /// Whether the micros go where they are told: whether their piezos have a model that is believed.
    pub follows: [bool; SIDES],
}

/// From where to where something gets along x, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reach {
    /// Where it begins.
    pub low: f64,
    /// Where it ends.
    pub high: f64,
}

impl Reach {
    /// The part of it that is so wide at most, around zero, and the share of it that one can be sure of.
    #[must_use]
    pub fn within(self, width: f64, sure: f64) -> Self {
        Self {
            low: (sure * self.low).max(-0.5 * width),
            high: (sure * self.high).min(0.5 * width),
        }
    }

    /// How wide it is, metres.
    pub fn width(&self) -> f64 {
        self.high - self.low
    }

    /// Where it is, from -1 at its beginning to 1 at its end.
    pub fn at(&self, share: f64) -> f64 {
        0.5 * (self.low + self.high) + 0.5 * share * self.width()
    }
}

/// A bench with a camera, at work. All that a [`Reactor`] does, and what needs the camera or the chip's frame.
pub struct AlignmentCell<'b> {
    reactor: Reactor<'b>,
    layout: Layout,
    tips: RefCell<TipEstimator>,
    loaded: Cell<[bool; SIDES]>,
    /// By how much the light of the laser differs from one turn of a circle to the next.
    flicker: Cell<Flicker>,
    /// By how much widths of spots differ from round to round.
    rounds: Cell<Rounds>,
}

impl<'b> Deref for AlignmentCell<'b> {
    type Target = Reactor<'b>;

    fn deref(&self) -> &Self::Target {
        &self.reactor
    }
}

/// Frames are taken in when they arrive, whoever waits for what.
impl Listener for AlignmentCell<'_> {
    fn hear(&self, bench: &dyn Bench, event: &Event) {
        let Event::Frame(frame) = event else {
            return;
        };
        let micro_at = |side, time| {
            let at = bench.pose(fine(side), time)?.pose;
            Some(Displacement::new(at.x(), at.y()))
        };
        let held = |side, time| {
            let at = bench.pose(coarse(side), time)?.pose;
            let holder = Point::new(at.x(), at.y(), at.z());
            let tip = holder.moved(micro_at(side, time)?);
            let [holder, tip] = [holder, tip].map(|at| self.frame(side).chip_from_macro(at));
            Some(Held { holder, tip })
        };
        let aside = |side, time| {
            let Displacement { x, y } = micro_at(side, time)?;
            let [aside, ..] = self.frame(side).chip_direction(x, y, 0.0);
            Some(aside)
        };
        self.tips.borrow_mut().see(frame, held, aside);
    }
}

impl<'b> AlignmentCell<'b> {
    /// Takes a bench in hand of which so much is known. No arm carries a fiber.
    pub fn new(bench: &'b mut dyn Watched, layout: Layout) -> Self {
        Self {
            tips: RefCell::new(TipEstimator::new(&layout.spec.vision, &layout.spec.guard)),
            reactor: Reactor::new(bench),
            layout,
            loaded: Cell::default(),
            flicker: Cell::default(),
            rounds: Cell::default(),
        }
    }

    /// Takes a station in hand.
    pub fn over(station: &'b mut Station) -> Self {
        let layout = station.layout();
        let loaded = Side::ALL.map(|side| station.carries(side));
        Self::carrying(station, layout, loaded)
    }

    /// Takes a bench in hand of which so much is known, some of whose arms carry a fiber.
    pub fn carrying(bench: &'b mut dyn Watched, layout: Layout, loaded: [bool; SIDES]) -> Self {
        let cell = Self::new(bench, layout);
        cell.loaded.set(loaded);
        cell
    }

    /// Lets a line run to its end.
    pub fn run<T>(&self, line: impl Future<Output = T>) -> T {
        self.run_gated(line, &mut |_| Go::On)
    }

    /// The same, paused or step by step as a [`Gate`] decides.
    pub fn run_gated<T>(&self, line: impl Future<Output = T>, gate: &mut Gate) -> T {
        self.reactor.run_heard(line, self, gate)
    }

    /// By when the micro of an arm has come to rest where it was told to be, as believed, seconds.
    pub fn settling(&self, side: Side) -> f64 {
        self.deref().settling(fine(side))
    }

    /// The datasheet.
    pub fn spec(&self) -> &Spec {
        &self.layout.spec
    }

    /// How the frame of an arm lies in that of the chip.
    pub fn frame(&self, side: Side) -> &Placement {
        &self.layout.frames[side.index()]
    }

    /// What was measured of how the tips of an arm shake, if anything was.
    pub fn measured_shaking(&self, side: Side) -> Option<Measured> {
        self.layout.shaking[side.index()]
    }

    /// How light spreads over a gap in the scale of an arm's micro, if it was measured.
    pub fn measured_spread(&self, side: Side) -> Option<Spread> {
        self.layout.spread[side.index()]
    }

    /// The light between the fiber of an arm and its guide: of the modes of a recipe, or as wide as it was measured and spreading as it was.
    pub fn beam(&self, side: Side, recipe: &Recipe) -> Beam {
        let beam = Beam::new(&recipe.mode, recipe.ports.exit_angle)
            .on_stages(self.layout.askew[side.index()]);
        let beam = match &self.layout.spot[side.index()] {
            None => beam,
            Some(size) => beam.as_measured(size),
        };
        match self.measured_spread(side) {
            None => beam,
            Some(spread) => beam.spreading(spread.middle()),
        }
    }

    /// How far beside a circle's middle the micro of an arm comes to rest, of the circle's radius, one standard deviation.
    pub fn hides(&self, side: Side) -> f64 {
        self.layout.hides[side.index()]
    }

    /// Whether it is known by when a micro comes to rest: measured, or seen to take longer than its datasheet says.
    pub fn settles(&self, side: Side) -> bool {
        self.layout.settles[side.index()] || self.swings(fine(side))
    }

    /// By how much the light of the laser has been seen to differ from one turn to the next.
    pub fn flicker(&self) -> Flicker {
        self.flicker.get()
    }

    /// It was seen to differ so, by now.
    pub fn has_flickered(&self, flicker: Flicker) {
        self.flicker.set(flicker);
    }

    /// By how much the widths of spots have differed from one round of circles to the next.
    pub fn rounds(&self) -> Rounds {
        self.rounds.get()
    }

    /// Others have differed by so much.
    pub fn add_rounds(&self, others: Rounds) {
        let mut rounds = self.rounds.get();
        rounds.add(others);
        self.rounds.set(rounds);
    }

    /// Whether the micro of an arm goes where it is told.
    pub fn follows(&self, side: Side) -> bool {
        self.layout.follows[side.index()]
    }

    /// Where a holder is by its encoders.
    pub fn endpoint(&self, side: Side) -> Point<Macro> {
        let now = self.now();
        let pose = self.pose(coarse(side), now).map(|estimate| estimate.pose);
        pose.map_or_else(|| self.wanted(side), point)
    }

    /// Where a holder is wanted at this moment.
    pub fn wanted(&self, side: Side) -> Point<Macro> {
        self.reference(coarse(side)).map_or(Point::ORIGIN, point)
    }

    /// Whether a holder has not yet been brought to the end of its way.
    pub fn is_moving(&self, side: Side) -> bool {
        self.moving(coarse(side))
    }

    /// Sends a holder along a straight line, no faster than `speed` m/s.
    ///
    /// # Errors
    ///
    /// [`Outcome::BenchFailed`] when it would break a limit; the holder goes on as it did.
    pub fn start_line(
        &self,
        side: Side,
        to: Point<Macro>,
        speed: Option<f64>,
    ) -> Result<(), Outcome> {
        self.send_to(coarse(side), pose(to), speed).map(drop)
    }

    /// Calls a motion off: the holder slows down as fast as it may.
    ///
    /// # Errors
    ///
    /// [`Outcome::BenchFailed`].
    pub fn brake(&self, side: Side) -> Result<(), Outcome> {
        self.send(coarse(side), Law::Brake).map(drop)
    }

    /// Lets time pass until a holder has been brought to the end of its way.
    ///
    /// # Errors
    ///
    /// The bench's fault.
    pub async fn stands(&self, side: Side) -> Result<(), Fault> {
        self.played(coarse(side)).await
    }

    /// Sends a holder along a straight line to its end, where it need not have come to rest.
    ///
    /// # Errors
    ///
    /// A fault; as [`Self::start_line`].
    pub async fn go(&self, side: Side, to: Point<Macro>) -> Result<(), Halt> {
        self.start_line(side, to, None)?;
        Ok(self.stands(side).await?)
    }

    /// Sends a holder along a straight line, and waits until it has come to rest.
    ///
    /// # Errors
    ///
    /// A fault; [`Outcome::BenchFailed`] where it may not go there, or does not arrive.
    pub async fn line(&self, side: Side, to: Point<Macro>, speed: Option<f64>) -> Result<(), Halt> {
        self.deref().line(coarse(side), pose(to), speed).await
    }

    /// Where a micro is told to be.
    pub fn micro(&self, side: Side) -> Displacement {
        across(&self.reference(fine(side)).unwrap_or(Pose::ZERO))
    }

    /// Whether a micro gets to a displacement.
    pub fn micro_reaches(&self, side: Side, by: Displacement) -> bool {
        self.reaches(fine(side), &Pose::at(by.x, by.y, 0.0))
    }

    /// The largest share of a displacement that a micro gets to, zero to one.
    fn reached(&self, side: Side, by: Displacement) -> f64 {
        /// To a millionth of it.
        const STEPS: u32 = 20;
        if self.micro_reaches(side, by) {
            return 1.0;
        }
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..STEPS {
            let share = 0.5 * (low + high);
            if self.micro_reaches(side, by * share) {
                low = share;
            } else {
                high = share;
            }
        }
        low
    }

    /// From where to where a micro gets along x alone, metres.
    pub fn micro_reach_x(&self, side: Side) -> Reach {
        let axis = self.caps().groups[fine(side).0].axes[0];
        let (low, high) = axis.map_or((0.0, 0.0), |axis| axis.range);
        let [low, high] = [low, high].map(|x| x * self.reached(side, Displacement::new(x, 0.0)));
        Reach { low, high }
    }

    /// Sends a micro to a displacement, or as far there as it gets.
    ///
    /// # Errors
    ///
    /// [`Outcome::BenchFailed`].
    pub fn move_micro(&self, side: Side, to: Displacement) -> Result<(), Outcome> {
        let to = to * self.reached(side, to);
        let to = Pose::at(to.x, to.y, 0.0);
        self.send_to(fine(side), to, None).map(drop)
    }

    /// The same smoothly, while something else goes on.
    ///
    /// # Errors
    ///
    /// [`Outcome::BenchFailed`].
    pub fn glide_micro(&self, side: Side, to: Displacement) -> Result<(), Outcome> {
        let seconds = TUNING.search.glide * self.spec().micro.settling;
        let from = self.micro(side);
        self.micro_path(side, (seconds, seconds / TUNING.search.glides), |time| {
            from + (to - from) * eased(time / seconds)
        })
    }

    /// The lowest resonance of a micro, hertz, where it was measured how it swings.
    pub fn least_resonance(&self, side: Side) -> Option<f64> {
        let measured = self.layout.settles[side.index()] && !self.swings(fine(side));
        measured.then(|| self.caps().groups[fine(side).0].bandwidth / TUNING.dynamics.turns)
    }

    /// Whether the camera has seen a tip of a side swing farther than it was told to, by a micro of which nobody has measured how it swings: what a
    /// transmission lets out aside in jerks may look like it, and where that was measured it is known better.
    pub fn is_seen_to_swing(&self, side: Side) -> bool {
        !self.layout.settles[side.index()] && self.tips.borrow().swing(side).by().is_some()
    }

    /// By when the micro of a side has come to rest, seconds, as far as the camera has seen it swing and come to rest; how it swings is seen anew from now on.
    pub fn rests_after_swing(&self, side: Side) -> Option<f64> {
        let constant = self.tips.borrow().swing(side).time_constant();
        self.tips.borrow_mut().forget_swing(side);
        constant.map(|constant| TUNING.dynamics.constants * constant)
    }

    /// What the camera has seen of the fiber of a side is to be seen anew.
    pub fn forget_seen(&self, side: Side) {
        self.tips.borrow_mut().forget(side, self.now());
    }

    /// Has a micro play a law.
    ///
    /// # Errors
    ///
    /// [`Outcome::BenchFailed`].
    pub fn play_micro(&self, side: Side, law: Law) -> Result<(), Outcome> {
        self.send(fine(side), law).map(drop)
    }

    /// Has a micro go along a path, a function of the time since now, for so many seconds, straight from one place of it to
    /// the next, `step` seconds later; where it does not reach a place, as far there as it gets.
    ///
    /// # Errors
    ///
    /// [`Outcome::BenchFailed`].
    pub fn micro_path(
        &self,
        side: Side,
        (seconds, step): (f64, f64),
        path: impl Fn(f64) -> Displacement,
    ) -> Result<(), Outcome> {
        let steps = (seconds / step).ceil().max(1.0) as u32;
        let knots = (1..=steps).map(|k| {
            let time = seconds * f64::from(k) / f64::from(steps);
            let to = path(time);
            let Displacement { x, y } = to * self.reached(side, to);
            let at = Pose::at(x, y, 0.0);
            Knot { time, at }
        });
        self.play_micro(side, Law::Scan(knots.collect()))
    }

    /// Where a micro was told to be at a time that is not long past.
    pub fn micro_at(&self, side: Side, time: f64) -> Displacement {
        let pose = self.pose(fine(side), time).map(|estimate| estimate.pose);
        pose.map_or_else(|| self.micro(side), |pose| across(&pose))
    }

    /// The next light of a photodiode, volts; `None` for any other event, and at the time `by`.
    ///
    /// # Errors
    ///
    /// The bench's fault.
    pub async fn light(&self, channel: Channel, by: f64) -> Result<Option<f64>, Fault> {
        let seen = self.sample(channel.index(), by).await?;
        Ok(seen.map(|(_, volts)| volts))
    }

    /// The last light of a photodiode within so many seconds, or the next where there is none.
    ///
    /// # Errors
    ///
    /// The bench's fault.
    pub async fn last_light(&self, channel: Channel, seconds: f64) -> Result<f64, Fault> {
        let end = self.now() + seconds;
        let mut last = None;
        loop {
            match self.next(end).await? {
                Event::Light(light) => {
                    self.note_reading(light.time);
                    last = Some(light.volts[channel.index()]).filter(|volts| !volts.is_nan());
                }
                Event::Time => break,
                _ => {}
            }
        }
        match last {
            Some(volts) => Ok(volts),
            None => self.next_light(channel.index()).await,
        }
    }

    /// Switches the laser.
    ///
    /// # Errors
    ///
    /// [`Outcome::BenchFailed`].
    pub fn laser(&self, on: bool) -> Result<(), Outcome> {
        let asked = self.request(Request::Laser(on));
        asked.map(drop).map_err(|why| refused(&why))
    }

    /// Sets the laser's power, percent of its full power.
    ///
    /// # Errors
    ///
    /// [`Outcome::BenchFailed`].
    pub fn laser_power(&self, percent: u8) -> Result<(), Outcome> {
        let asked = self.request(Request::LaserPower { percent });
        asked.map(drop).map_err(|why| refused(&why))
    }

    /// Whether an arm carries a fiber, as far as it was given one since the bench was taken in hand.
    pub fn carries(&self, side: Side) -> bool {
        self.loaded.get()[side.index()]
    }

    fn another_fiber(&self, side: Side, loaded: bool) {
        self.tips.borrow_mut().forget(side, self.now());
        let mut all = self.loaded.get();
        all[side.index()] = loaded;
        self.loaded.set(all);
    }

    /// An arm takes the fiber for a port of its side.
    ///
    /// # Errors
    ///
    /// A fault; [`Outcome::BenchFailed`].
    pub async fn load(&self, side: Side, port: usize) -> Result<(), Halt> {
        let arm = side.index();
        self.ask(Request::Load { arm, port }, LONGEST).await?;
        // Once it is there: a frame of the very cycle in which it came says nothing of it, and who guards the machine does not believe
        // that either.
        self.another_fiber(side, true);
        Ok(())
    }

    /// The fiber of an arm goes back into the tray, if it carries one.
    ///
    /// # Errors
    ///
    /// A fault; [`Outcome::BenchFailed`].
    pub async fn unload(&self, side: Side) -> Result<(), Halt> {
        if !self.carries(side) {
            return Ok(());
        }
        self.gives_away(side);
        let arm = side.index();
        self.ask(Request::Unload { arm }, LONGEST).await
    }

    /// Attaches the fiber of an arm, and holds it until its bond has set. Returns the least light of a photodiode meanwhile,
    /// volts; infinity where that has taken no sample.
    ///
    /// # Errors
    ///
    /// A fault; [`Outcome::BenchFailed`].
    pub async fn attach(&self, side: Side, channel: Channel) -> Result<f64, Halt> {
        self.gives_away(side);
        attached(self, side.index(), channel.index()).await
    }

    /// The fiber of an arm is the arm's no more.
    pub(crate) fn gives_away(&self, side: Side) {
        self.another_fiber(side, false);
    }

    /// Mean and spread of a photodiode over `seconds`.
    ///
    /// # Errors
    ///
    /// The bench's fault.
    pub async fn level(&self, channel: Channel, seconds: f64) -> Result<Level, Fault> {
        let meter = channel.index();
        let n = (seconds * self.caps().channels[meter].rate)
            .round()
            .max(2.0);
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..n as u64 {
            let volts = self.next_light(meter).await?;
            sum += volts;
            squares += volts * volts;
        }
        Ok(Level::of_sums(n, sum, squares))
    }

    /// Waits for a frame that was exposed after this call.
    ///
    /// # Errors
    ///
    /// The bench's fault.
    pub async fn next_frame(&self) -> Result<Frame, Fault> {
        let since = self.now();
        loop {
            if let Event::Frame(frame) = self.next(f64::INFINITY).await?
                && frame.time > since
            {
                return Ok(frame);
            }
        }
    }

    /// Where a tip stands from its holder, by all frames so far; `None` before the first.
    pub fn seen(&self, side: Side, tip: Tip) -> Option<Seen> {
        self.tips.borrow().seen(side, tip)
    }

    /// How much nearer to the facet at `port` (chip's z, metres) who guards the machine would let the fiber of a side come, which asks vision
    /// alone, on a `way` to there of which it sees no frame, metres; `None` before the first one.
    pub fn room_before(&self, side: Side, port: f64, way: f64) -> Option<f64> {
        let (out, holder) = (outward(side), self.holder(side).z);
        let (z, sigma) = self.tips.borrow().by_guard(side, holder - out * way)?;
        // Its own frames are not quite the same.
        let sigmas = GuardSpec::SIGMAS + TUNING.gap.more_than_guard;
        Some(out * (holder + z - port) - self.spec().guard.clearance - sigmas * sigma)
    }

    /// Where the tip would stand that is where its holder is, in the chip's frame.
    pub fn holder(&self, side: Side) -> Point<Chip> {
        self.frame(side).chip_from_macro(self.endpoint(side))
    }

    /// The light says by how much farther along the chip's z the fiber of a side stands than vision alone has it,
    /// metres, known to a standard deviation. Until the fiber is another, it is believed before vision.
    pub fn tell_z(&self, side: Side, farther: f64, deviation: f64) {
        let holder = self.holder(side);
        self.tips
            .borrow_mut()
            .tell(side, farther, deviation, holder);
    }

    /// What the light has told of the fiber of a side is to be told anew.
    pub fn forget_told(&self, side: Side) {
        self.tips.borrow_mut().forget_told(side);
    }
}

/// How far along a smooth way something is after a share of its time: at rest at either end.
pub(crate) fn eased(share: f64) -> f64 {
    let share = share.min(1.0);
    share * share * (3.0 - 2.0 * share)
}

fn pose(at: Point<Macro>) -> Pose {
    Pose::at(at.x, at.y, at.z)
}

fn point(pose: Pose) -> Point<Macro> {
    Point::new(pose.x(), pose.y(), pose.z())
}

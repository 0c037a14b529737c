//! Following a peak by circling it: the fast way to its maximum, and of staying there while the
//! gap closes.
//!
//! Every turn goes around the place where the peak is believed to be; the light on it, which is
//! brighter on the peak's side, says where the peak is, by a fit of a Gaussian of known width.
//! What the micro lags behind is the same all around the circle.

mod ahead;
mod answer;
mod around;
mod centring;
mod closing;
mod drift;
mod follows;
mod known;
mod last;
mod piezos;
mod steps;
mod told;
mod unsteady;
mod wander;

use self::answer::Turn;
pub(crate) use self::closing::Closing;
pub use self::last::Ready;
use crate::beam::{Beam, Oblong, Peak, Reading, SpotSize};
use crate::flicker::Flicker;
use crate::outcome::{Halt, Outcome};
use crate::reactor::Reactor;
use crate::recipe::ConicalScan as Shape;
use crate::rise::Rise;
use crate::shaking::{Measured, Shaking};
use crate::tuning::TUNING;
use pigtail_hal::bench::{
    Dither, Event, Glide, Group, GroupCaps, Law, Lead, Light, Meter, Pose, Refused, Ticket, Widens,
};
use pigtail_hal::{Fault, Side};
use pigtail_model::frames::Displacement;
use std::collections::VecDeque;

/// Where a fiber is to look, and with what.
#[derive(Debug, Clone, Copy)]
pub struct Watch {
    /// The group that circles.
    pub group: Group,
    /// What measures its light.
    pub meter: Meter,
    /// Its level without the fiber's light, volts.
    pub background: f64,
    /// Standard deviation of a sample, volts.
    pub noise: f64,
    /// The same in the dark, volts: without what fluctuates slowly.
    pub still: f64,
    /// By how many degrees of freedom that is known.
    pub still_degrees: f64,
}

/// How the peak walks as the gap closes: metres in the manipulator's x and y for a metre of gap.
pub type Walk = Displacement;

/// What the gap is while circles are played.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Gap {
    /// It stands, metres.
    Steady(f64),
    /// It follows a group that moves along z and would touch the chip at a place, metres.
    Led {
        /// The group.
        by: Group,
        /// Its z where the fiber would touch.
        contact: f64,
    },
    /// It stands, metres, while a group goes aside that the circles stay behind.
    Aside(f64, Group),
}

impl Gap {
    /// What it is when the group that leads is at a pose, metres.
    fn at(&self, leader: Option<Pose>) -> f64 {
        match (self, leader) {
            (Self::Steady(gap) | Self::Aside(gap, _), _) => *gap,
            (Self::Led { contact, .. }, at) => contact - at.map_or(0.0, |at| at.z()),
        }
    }

    /// The group that leads.
    const fn leader(&self) -> Option<Group> {
        match self {
            Self::Steady(_) => None,
            Self::Led { by, .. } | Self::Aside(_, by) => Some(*by),
        }
    }
}

/// A micro on its circle.
#[derive(Debug)]
pub struct ConicalScan<'r> {
    watch: Watch,
    beam: Beam,
    shape: &'r Shape,
    /// Time of a turn, seconds.
    period: f64,
    /// How many times as long as at first that is.
    slower: f64,
    /// By how much light is later than its place, seconds.
    lag: f64,
    /// Where the peak is believed to be at no gap: the micro's displacement, metres.
    centre: Displacement,
    walk: Walk,
    /// Radius of the circle in widths of the peak.
    radius: f64,
    /// What is played, if anything.
    played: Option<(Ticket, Dither)>,
    /// From where the group counts that circles stay behind.
    aside: Option<Pose>,
    /// The readings of the last turn, without the walk.
    readings: VecDeque<Reading>,
    /// How many these are at most.
    most: usize,
    /// How oblong the spot is at the chip.
    oblong: Oblong,
    /// By how much the squares of the spot's widths are more than those of a round one that is as wide as believed, as two
    /// circles at the chip have told.
    wider: Option<[f64; 2]>,
    /// How wide the spot is at the chip, as two circles have told at last.
    spot: Option<SpotSize>,
    /// Whether it is so much wider than believed that turns about it said too little.
    misjudged: bool,
    /// How the tip shakes.
    shaking: Shaking,
    /// What was seen of that while it was watched, if it was.
    looks: Option<told::Looks>,
    /// How far the middle went at last, metres.
    moved: f64,
    /// How the peak moves, metres a turn, as the last turns have seen it.
    drift: Displacement,
    /// How well that is known in x and in y, one standard deviation.
    drifts: [f64; 2],
    /// The part of it that chance has not made.
    surely: Displacement,
    /// Variance of a turn's peak beyond what the photodiode's noise makes of it, in x and in y, square metres: a tip that shakes
    /// moves it on a circle of any radius alike.
    unrest: [f64; 2],
    /// The same as the last turns have shown it, which chance may make less than none; and by how many degrees of freedom.
    scatter: ([f64; 2], f64),
    /// By how much the light itself differs from one turn to the next, of its own.
    flicker: Flicker,
    /// How well the peak is to be known, metres.
    wanted: f64,
    /// ...and so many times as many turns as usual may be made for that.
    more: f64,
    /// How steeply light rises along the chip's z where the tip is, where that was measured.
    rise: Option<Rise>,
    /// How far beside a circle's middle the group comes to rest, of the circle's radius, one standard deviation.
    hides: f64,
    /// So many times longer than it is believed to settle the group may still swing.
    forgets: f64,
    /// Whether it is a group of which nobody has measured how it follows circles, and a spot that nobody has measured.
    wary: bool,
    /// The last turns that have found the peak.
    turns: Vec<Turn>,
    /// Light of the last turn that found the peak, from the circle's middle.
    around: Vec<(Displacement, f64)>,
}

impl<'r> ConicalScan<'r> {
    /// Begins a circle around the micro's displacement `at` at a `gap`, both in metres. `before` is what was measured of
    /// how the tip shakes.
    pub fn new(
        watch: Watch,
        beam: Beam,
        shape: &'r Shape,
        bench: &Reactor<'_>,
        (at, gap): (Displacement, f64),
        walk: Walk,
        before: Option<Measured>,
    ) -> Self {
        let caps = bench.caps();
        let rate = caps.channels[watch.meter.0].rate;
        let group = &caps.groups[watch.group.0];
        let slowest = (TUNING.circle.samples / rate).max(bench.bandwidth(watch.group).recip());
        let period = shape.period.max(slowest);
        Self {
            watch,
            beam,
            shape,
            period,
            slower: 1.0,
            lag: group.lag.0,
            centre: at - walk * gap,
            walk,
            radius: shape.radius,
            played: None,
            aside: None,
            readings: VecDeque::with_capacity(64),
            most: ((period * rate).round() as usize).max(4),
            oblong: beam.known_oblong(),
            wider: None,
            spot: None,
            misjudged: false,
            shaking: Shaking::new(before),
            looks: None,
            moved: f64::INFINITY,
            drift: Displacement::ZERO,
            drifts: [0.0; 2],
            surely: Displacement::ZERO,
            unrest: [0.0; 2],
            scatter: ([0.0; 2], 0.0),
            flicker: Flicker::default(),
            wanted: f64::INFINITY,
            more: 1.0,
            rise: None,
            hides: TUNING.last.hidden,
            forgets: TUNING.watch.forgets,
            wary: false,
            turns: Vec::new(),
            around: Vec::with_capacity(64),
        }
    }

    /// How the tip shakes, by all turns near the peak.
    pub fn shaking(&self) -> Shaking {
        self.shaking
    }

    /// The same on a bench that says itself how it follows: ways from one circle to another are waited for before anything counts, and
    /// what was seen from aside counts little.
    #[must_use]
    pub fn wary(self) -> Self {
        Self { wary: true, ..self }
    }

    /// The same with a group that comes to rest so far beside a circle's middle, of the circle's radius, one standard deviation.
    #[must_use]
    pub fn hiding(self, hides: f64) -> Self {
        Self { hides, ..self }
    }

    /// The same with a group of which it was measured by when it comes to rest, or was not.
    #[must_use]
    pub fn settling(self, measured: bool) -> Self {
        let forgets = if measured { 1.0 } else { TUNING.watch.forgets };
        Self { forgets, ..self }
    }

    /// Turns in which what a way to the circle had swing comes to rest.
    pub(crate) fn turns_to_settle(&self, bench: &Reactor<'_>) -> u32 {
        (self.forgets * bench.settling(self.watch.group) / self.period).ceil() as u32
    }

    /// The same with light whose laser was seen to flicker so.
    #[must_use]
    pub fn flickering(self, flicker: Flicker) -> Self {
        Self { flicker, ..self }
    }

    /// Light rises so along the chip's z where the tip is, or nobody has measured it there.
    pub fn believe_rise(&mut self, rise: Option<Rise>) {
        self.rise = rise;
    }

    /// What measures the light.
    pub fn meter(&self) -> Meter {
        self.watch.meter
    }

    /// Time of a turn, seconds.
    pub fn period(&self) -> f64 {
        self.period
    }

    /// Samples of a turn.
    pub fn samples(&self) -> usize {
        self.most
    }

    /// Standard deviation of its samples, volts.
    pub fn noise(&self) -> f64 {
        self.watch.noise
    }

    /// The noise of its samples from now on, volts, known by so many degrees of freedom.
    pub fn set_noise(&mut self, noise: f64, degrees: f64) {
        self.watch.noise = noise;
        self.watch.still = noise;
        self.watch.still_degrees = degrees;
    }

    /// The laser gives `share` of the light that it gave, of which none is in what is `dark` (volts). A turn that begins now is the first without
    /// what was.
    pub fn dim(&mut self, share: f64, dark: f64) {
        let Watch { noise, still, .. } = self.watch;
        let slow = (noise * noise - still * still).max(0.0).sqrt();
        self.watch.noise = still.hypot(share * slow);
        self.watch.background = dark + share * (self.watch.background - dark);
        self.readings.clear();
    }

    /// The level without the fiber's light is so many volts.
    pub fn set_background(&mut self, background: f64) {
        self.watch.background = background;
        self.readings.clear();
    }

    /// Its level without the fiber's light, volts.
    pub fn background(&self) -> f64 {
        self.watch.background
    }

    /// The micro's displacement at the peak at a gap, as believed, metres.
    pub fn place(&self, gap: f64) -> Displacement {
        self.centre + self.walk * gap
    }

    /// Whether the spot is so much wider than believed that the last turns said too little of where the peak is.
    pub fn misjudges_width(&self) -> bool {
        self.misjudged
    }

    /// How wide the spot is at the chip, as the last turns have told.
    pub fn spot(&self) -> Option<SpotSize> {
        self.spot
    }

    /// Believes from now on what the last two circles at the chip have told of how wide the spot is.
    pub fn believe_width(&mut self) {
        if let Some(times) = self.wider.take() {
            self.oblong = self.beam.widen(times);
        }
    }

    /// Width of the spot at a gap, metres, as believed.
    pub fn beam_width(&self, gap: f64) -> f64 {
        self.beam.width(gap)
    }

    /// The same in x and in y.
    pub(crate) fn beam_widths(&self, gap: f64) -> [f64; 2] {
        self.beam.squared_widths(gap).map(f64::sqrt)
    }

    /// Turns take longer from now on, as the recipe has it: a micro that swings along with them at one rate does not at another. Returns whether
    /// they do.
    pub fn slow_down(&mut self) -> bool {
        let longer = self.shape.slower;
        let may = self.slower * longer <= self.shape.slowest;
        if may {
            self.slower *= longer;
            self.period *= longer;
            self.most = (self.most as f64 * longer).round() as usize;
            self.readings.clear();
        }
        may
    }

    /// Whether turns take longer than at first.
    pub fn is_slower(&self) -> bool {
        self.slower > 1.0
    }

    /// The radius of its circles, in widths of the peak.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Circles of another radius from now on, in widths of the peak.
    pub fn set_radius(&mut self, radius: f64) {
        self.radius = radius;
    }

    /// Moves the circle's middle by so much, metres.
    fn shift(&mut self, by: Displacement) {
        self.centre += by;
        self.moved = by.norm();
    }

    /// The peak is expected where the micro is displaced so far at a gap, metres, be it within its reach or not.
    pub fn expect_at(&mut self, at: Displacement, gap: f64) {
        self.centre = at - self.walk * gap;
    }

    /// The macro has gone aside, and the micro the other way.
    pub fn hand_over(&mut self, by: Displacement) {
        self.centre -= by;
        for reading in &mut self.readings {
            reading.at -= by;
        }
    }

    /// From here on the circles stay behind a group that goes aside, by [`Gap::Aside`]...
    pub fn begin_aside(&mut self, bench: &Reactor<'_>, group: Group) {
        self.aside = bench.pose(group, bench.now()).map(|estimate| estimate.pose);
    }

    /// ...until here.
    pub fn end_aside(&mut self) {
        self.aside = None;
    }

    fn group<'b>(&self, bench: &'b Reactor<'_>) -> &'b GroupCaps {
        &bench.caps().groups[self.watch.group.0]
    }

    fn arm(&self, bench: &Reactor<'_>) -> Side {
        Side::ALL[self.group(bench).arm]
    }

    /// What is to be played now: the middle goes over within so many seconds, the radius within so many.
    fn law(&self, gap: Gap, within: (f64, f64)) -> Dither {
        let (x, y) = (self.walk.x, self.walk.y);
        let from = self.aside.unwrap_or(Pose::ZERO);
        let (at, radius) = match gap {
            Gap::Led { .. } => (self.centre, self.radius * self.beam.width(0.0)),
            Gap::Steady(gap) | Gap::Aside(gap, _) => {
                (self.place(gap), self.radius * self.beam.width(gap))
            }
        };
        let gain = match gap {
            Gap::Led { .. } => [[0.0, 0.0, -x], [0.0, 0.0, -y]],
            _ => [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]],
        };
        let from = match gap {
            Gap::Led { contact, .. } => Pose::at(0.0, 0.0, contact),
            _ => from,
        };
        Dither {
            centre: Glide {
                to: [at.x, at.y],
                within: within.0,
            },
            radius: Glide {
                to: radius,
                within: within.1,
            },
            rate: self.period.recip(),
            lead: gap.leader().map(|group| Lead { group, from, gain }),
            widens: match gap {
                Gap::Led { contact, .. } => Some(Widens {
                    contact,
                    doubles: self.beam.gap_of(1.0),
                }),
                _ => None,
            },
        }
    }

    /// Has it played, where it is not yet.
    ///
    /// # Errors
    ///
    /// Why the bench does not play it.
    fn play(&mut self, bench: &Reactor<'_>, gap: Gap, radius: f64) -> Result<(), Halt> {
        let law = self.law(gap, (TUNING.circle.glide * self.period, radius));
        let same = |played: &Dither| {
            let (was, is) = (played, &law);
            let leads = match (was.lead, is.lead) {
                (Some(was), Some(is)) => {
                    (was.from - is.from).distance() < TUNING.circle.same
                        && (was.group, was.gain) == (is.group, is.gain)
                }
                (was, is) => was == is,
            };
            leads
                && was.rate == is.rate
                && (was.centre.to, was.radius.to) == (is.centre.to, is.radius.to)
                && was.widens.is_some() == is.widens.is_some()
        };
        let ticket = match &self.played {
            Some((_, played)) if same(played) => return Ok(()),
            Some((ticket, _)) => match bench.bend(*ticket, Law::Dither(law)) {
                // Somebody else has moved the group meanwhile.
                Err(Refused::Ticket(_)) => bench.play(self.watch.group, Law::Dither(law)),
                bent => bent.map(|_| *ticket),
            },
            None => bench.play(self.watch.group, Law::Dither(law)),
        };
        let ticket = ticket.map_err(|_| Outcome::MicroRange {
            side: self.arm(bench),
            x: law.centre.to[0],
            y: law.centre.to[1],
        })?;
        self.played = Some((ticket, law));
        Ok(())
    }

    /// Lets time pass on the circle until something happens, or until a time; returns whether that is reached.
    ///
    /// # Errors
    ///
    /// The bench's fault; [`Outcome::MicroRange`].
    pub async fn step(&mut self, bench: &Reactor<'_>, gap: Gap, by: f64) -> Result<bool, Halt> {
        Ok(self.follow(bench, gap, by).await? == Event::Time)
    }

    /// The same; returns what has happened.
    async fn follow(&mut self, bench: &Reactor<'_>, gap: Gap, by: f64) -> Result<Event, Halt> {
        self.play(bench, gap, TUNING.circle.glide * self.period)?;
        Ok(self.hear(bench, gap, by).await?)
    }

    /// What happens next while that is played which is: light is paired with where the tip was.
    async fn hear(&mut self, bench: &Reactor<'_>, gap: Gap, by: f64) -> Result<Event, Fault> {
        let event = bench.next(by).await?;
        if let Event::Light(light) = &event {
            self.note(bench, gap, light);
        }
        Ok(event)
    }

    /// Pairs light with where the tip was.
    fn note(&mut self, bench: &Reactor<'_>, gap: Gap, light: &Light) {
        let volts = light.volts[self.watch.meter.0];
        let then = light.time - self.lag;
        let Some(stood) = bench.pose(self.watch.group, then) else {
            return;
        };
        if volts.is_nan() {
            return;
        }
        bench.note_reading(light.time);
        let leader = gap.leader().and_then(|group| bench.pose(group, then));
        let leader = leader.map(|leader| leader.pose);
        let gap_then = gap.at(leader);
        let mut at = Displacement::new(stood.pose.x(), stood.pose.y()) - self.walk * gap_then;
        if let (Gap::Aside(..), Some(leader), Some(from)) = (gap, leader, self.aside) {
            at += Displacement::new(leader.x() - from.x(), leader.y() - from.y());
        }
        self.readings.push_back(Reading {
            at,
            gap: gap_then,
            volts: volts - self.watch.background,
        });
        if self.readings.len() > self.most {
            self.readings.pop_front();
        }
    }

    /// A whole turn at a gap, metres.
    ///
    /// # Errors
    ///
    /// As [`Self::step`].
    pub async fn turn(&mut self, bench: &Reactor<'_>, gap: f64) -> Result<(), Halt> {
        self.run(bench, Gap::Steady(gap), self.period).await
    }

    /// So many seconds on the circle.
    ///
    /// # Errors
    ///
    /// As [`Self::step`].
    pub async fn run(&mut self, bench: &Reactor<'_>, gap: Gap, seconds: f64) -> Result<(), Halt> {
        self.play(bench, gap, TUNING.circle.glide * self.period)?;
        Ok(self.last_for(bench, gap, seconds).await?)
    }

    /// Goes on with what is played for so many seconds.
    async fn last_for(&mut self, bench: &Reactor<'_>, gap: Gap, seconds: f64) -> Result<(), Fault> {
        let end = bench.now() + seconds;
        while self.hear(bench, gap, end).await? != Event::Time {}
        Ok(())
    }

    /// The peak by the last turn, at no gap; `None` where there is no light.
    pub fn peak(&mut self) -> Option<Peak> {
        let readings: &[Reading] = self.readings.make_contiguous();
        self.beam.fit(readings, self.watch.noise)
    }

    /// The same, where it stands out of the noise.
    pub fn clear_peak(&mut self) -> Option<Peak> {
        self.peak().filter(|peak| is_clear(*peak))
    }

    /// Leaves the circle for its middle.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub async fn rest(&mut self, bench: &Reactor<'_>, gap: f64) -> Result<(), Halt> {
        self.shrink(bench, gap, 0.0, TUNING.circle.shrink).await
    }

    /// Goes on the circle to another radius, in widths of the peak, within so many turns, and with nought to
    /// rest.
    ///
    /// # Errors
    ///
    /// As [`Self::step`].
    async fn shrink(
        &mut self,
        bench: &Reactor<'_>,
        gap: f64,
        to: f64,
        turns: f64,
    ) -> Result<(), Halt> {
        self.radius = to;
        let (gap, seconds) = (Gap::Steady(gap), turns * self.period);
        self.play(bench, gap, seconds)?;
        Ok(self.last_for(bench, gap, seconds).await?)
    }
}

/// Whether a peak stands out of the noise.
fn is_clear(peak: Peak) -> bool {
    stands_out(peak, TUNING.circle.significant)
}

/// Whether a peak stands out of the noise by so many of its standard deviations.
fn stands_out(peak: Peak, deviations: f64) -> bool {
    peak.full > deviations * peak.full_deviation
}

//! Following a peak by circling it: the fast way to its maximum, and of staying there while the
//! gap closes.
//!
//! Every turn goes around the place where the peak is believed to be; the light on it, which is
//! brighter on the peak's side, says where the peak is, by a fit of a Gaussian of known width.
//! What the micro lags behind is the same all around the circle.

mod last;
mod told;

use crate::beam::{Beam, Oblong, Peak, Reading};
use crate::outcome::{Halt, Outcome};
use crate::recipe::ConicalScan as Shape;
use crate::shaking::Shaking;
use crate::station::Station;
use pigtail_hal::{Channel, Fault, Side};
use pigtail_model::frames::Displacement;
use std::collections::VecDeque;
use std::f64::consts::{PI, TAU};

/// Where a fiber is to look, and with what.
#[derive(Debug, Clone, Copy)]
pub struct Watch {
    /// The manipulator that moves.
    pub side: Side,
    /// The photodiode that watches.
    pub channel: Channel,
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

/// A micro on its circle.
#[derive(Debug)]
pub struct ConicalScan<'r> {
    watch: Watch,
    beam: Beam,
    shape: &'r Shape,
    /// Where the peak is believed to be at no gap: the micro's displacement, metres.
    centre: Displacement,
    /// Where the circle's middle is on its way from, and since when.
    from: (Displacement, f64),
    walk: Walk,
    /// Radius of the circle in widths of the peak.
    radius: f64,
    phase: f64,
    /// What the micro was told of late, without the walk, oldest first: position and gap.
    commanded: VecDeque<(Displacement, f64)>,
    /// The readings of the last turn, without the walk.
    readings: VecDeque<Reading>,
    /// How oblong the spot is at the chip.
    oblong: Oblong,
    /// By how much the squares of the spot's widths are more than those of a round one that is as wide as believed, as two
    /// circles at the chip have told.
    wider: Option<[f64; 2]>,
    /// Whether it is so much more that turns about it said too little.
    misjudged: bool,
    /// How the tip shakes.
    shaking: Shaking,
    /// How far the middle went at last, metres.
    moved: f64,
    /// How the peak moves, metres a turn, as the last turns have seen it.
    drift: Displacement,
    /// Light of the last turn that found the peak, from the circle's middle.
    around: Vec<(Displacement, f64)>,
}

/// Standard deviations by which a peak must stand out of the noise.
const SIGNIFICANT: f64 = 5.0;

/// How far a peak may be from where it was first believed to be, in widths...
const FAR: f64 = 4.0;

/// ...and at the chip, which a fiber that strays would touch.
const NEARBY: f64 = 1.2;

/// How near the peak the turns that count must be, in widths.
const NEAR: f64 = 0.15;

/// Share of a turn in which a circle becomes smaller...
const SHRINK: f64 = 0.3;

/// Seconds in which the circle's middle goes over to a new place.
const GLIDE: f64 = 6e-3;

impl<'r> ConicalScan<'r> {
    /// Begins a circle around the micro's displacement `at` at a `gap`, both in metres.
    pub fn new(
        watch: Watch,
        beam: Beam,
        shape: &'r Shape,
        station: &Station,
        at: Displacement,
        gap: f64,
        walk: Walk,
    ) -> Self {
        let origin = |at: Displacement| at - walk * gap;
        Self {
            watch,
            beam,
            shape,
            centre: origin(at),
            from: (origin(station.micro(watch.side)), station.time()),
            walk,
            radius: shape.radius,
            phase: 0.0,
            commanded: VecDeque::with_capacity(64),
            readings: VecDeque::with_capacity(64),
            oblong: Oblong::default(),
            wider: None,
            misjudged: false,
            shaking: Shaking::new(station.measured_shaking(watch.side)),
            moved: f64::INFINITY,
            drift: Displacement::ZERO,
            around: Vec::with_capacity(64),
        }
    }

    /// How the tip shakes, by all turns near the peak.
    pub fn shaking(&self) -> Shaking {
        self.shaking
    }

    /// The photodiode that watches.
    pub fn channel(&self) -> Channel {
        self.watch.channel
    }

    /// Standard deviation of its samples, volts.
    pub fn noise(&self) -> f64 {
        self.watch.noise
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

    /// Circles of another radius from now on, in widths of the peak.
    pub fn set_radius(&mut self, radius: f64) {
        self.radius = radius;
    }

    /// Moves the circle's middle by so much, metres.
    fn shift(&mut self, station: &Station, by: Displacement) {
        self.from = (self.middle(station.time()), station.time());
        self.centre += by;
        self.moved = by.norm();
    }

    /// The macro goes aside, and the micro the other way.
    pub fn hand_over(&mut self, by: Displacement) {
        self.centre -= by;
        self.from.0 -= by;
        for reading in &mut self.readings {
            reading.at -= by;
        }
        for (at, _) in &mut self.commanded {
            *at -= by;
        }
    }

    /// The circle's middle at a time, without the walk.
    fn middle(&self, time: f64) -> Displacement {
        let (from, since) = self.from;
        let share = ((time - since) / GLIDE).clamp(0.0, 1.0);
        // Without a jump of the speed, for the micro's resonance.
        let share = 0.5 - 0.5 * (PI * share).cos();
        from + (self.centre - from) * share
    }

    /// One servo cycle on the circle, at a gap.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub fn cycle(&mut self, station: &mut Station, gap: f64) -> Result<(), Fault> {
        let period = station.spec().period();
        self.phase = (self.phase + TAU * period / self.shape.period) % TAU;
        let radius = self.radius * self.beam.width(gap);
        let at = self.middle(station.time()) + Displacement::polar(radius, self.phase);
        let micro = at + self.walk * gap;
        station.move_micro(self.watch.side, micro);
        station.cycle()?;
        // What the light of this cycle answers was told a lag ago.
        let lag = (self.shape.lag / period).round() as usize;
        self.commanded.push_back((at, gap));
        while self.commanded.len() > lag + 1 {
            self.commanded.pop_front();
        }
        if let Some(volts) = station.light(self.watch.channel)
            && let Some((at, gap)) = self.commanded.front()
        {
            self.readings.push_back(Reading {
                at: *at,
                gap: *gap,
                volts: volts - self.watch.background,
            });
            let turn = (self.shape.period * station.spec().photodiode.rate).round() as usize;
            if self.readings.len() > turn.max(4) {
                self.readings.pop_front();
            }
        }
        Ok(())
    }

    /// A whole turn at the gap that `gap` tells.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub fn turn(&mut self, station: &mut Station, gap: f64) -> Result<(), Fault> {
        self.cycles(station, gap, self.shape.period)
    }

    /// So many seconds on the circle.
    fn cycles(&mut self, station: &mut Station, gap: f64, seconds: f64) -> Result<(), Fault> {
        let cycles = (seconds / station.spec().period()).round() as u64;
        for _ in 0..cycles {
            self.cycle(station, gap)?;
        }
        Ok(())
    }

    /// So many seconds on the circle, the middle of which moves as the peak did.
    fn follow_drift(&mut self, station: &mut Station, gap: f64, seconds: f64) -> Result<(), Fault> {
        let period = station.spec().period();
        let step = self.drift * (period / self.shape.period);
        for _ in 0..(seconds / period).round() as u64 {
            self.centre += step;
            self.from.0 += step;
            self.cycle(station, gap)?;
        }
        Ok(())
    }

    /// The peak by the last turn, at no gap; `None` where there is no light.
    pub fn peak(&mut self) -> Option<Peak> {
        let readings: &[Reading] = self.readings.make_contiguous();
        self.beam.fit(readings, self.watch.noise)
    }

    /// Goes to a peak, at most its width at `gap` away. Returns how far it was away, metres.
    ///
    /// # Errors
    ///
    /// [`Outcome::MicroRange`] where the micro does not reach it.
    pub fn go_to(&mut self, station: &Station, peak: &Peak, gap: f64) -> Result<f64, Outcome> {
        let by = peak.at - self.centre;
        let way = by.norm();
        let by = by * (1.2 * self.beam.width(gap) / way).min(1.0);
        let to = self.place(gap) + by;
        let kinematics = station.kinematics(self.watch.side);
        if !kinematics.micro_reaches(to) {
            return Err(Outcome::MicroRange {
                side: self.watch.side,
                x: to.x,
                y: to.y,
            });
        }
        self.shift(station, by);
        Ok(way)
    }

    /// Turns until the peak is where the circle's middle is, to `accuracy` metres, at a steady gap;
    /// at least `least` times.
    ///
    /// # Errors
    ///
    /// A fault; [`Outcome::LightLost`] where there is no peak near where it was believed to be,
    /// [`Outcome::Unsure`] after too many turns.
    pub fn centre(
        &mut self,
        station: &mut Station,
        gap: f64,
        accuracy: f64,
        phase: &'static str,
        least: u32,
    ) -> Result<Peak, Halt> {
        let expected = SIGNIFICANT * self.watch.noise;
        let start = self.centre;
        let lost = |level: f64| Outcome::LightLost {
            phase,
            level,
            expected,
        };
        let mut dark = 0;
        let mut last = f64::INFINITY;
        for turn in 1..=self.shape.turns {
            self.turn(station, gap)?;
            let peak = self.peak();
            let Some(peak) = peak.filter(|p| p.full > SIGNIFICANT * p.full_deviation) else {
                dark += 1;
                if dark > 1 {
                    let level = peak.map_or(0.0, |peak| peak.full * self.beam.share(gap));
                    return Err(lost(level).into());
                }
                continue;
            };
            last = self.go_to(station, &peak, gap)?;
            if turn >= least && last < accuracy && peak.deviation < accuracy {
                return Ok(peak);
            }
            let far = (self.centre - start).norm();
            if far > FAR * self.beam.width(gap) {
                return Err(lost(peak.full * self.beam.share(gap)).into());
            }
        }
        Err(Outcome::Unsure {
            deviation: last,
            accuracy,
        }
        .into())
    }

    /// Leaves the circle for its middle.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub fn rest(&mut self, station: &mut Station, gap: f64) -> Result<(), Fault> {
        self.shrink(station, gap, 0.0, SHRINK)
    }

    /// Goes on the circle to another radius, in widths of the peak, within so many turns, and with nought to
    /// rest.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    fn shrink(
        &mut self,
        station: &mut Station,
        gap: f64,
        to: f64,
        turns: f64,
    ) -> Result<(), Fault> {
        let from = self.radius;
        let cycles = (turns * self.shape.period / station.spec().period()).round();
        for k in 0..cycles as u64 {
            // Without a jump of the speed, for the micro's resonance.
            let left = 0.5 + 0.5 * (PI * (k as f64 + 1.0) / cycles).cos();
            self.radius = to + left * (from - to);
            self.cycle(station, gap)?;
        }
        self.radius = to;
        Ok(())
    }
}

//! Following a peak by circling it: the fast way to its maximum, and of staying there while the
//! gap closes.
//!
//! Every turn goes around the place where the peak is believed to be; the light on it, which is
//! brighter on the peak's side, says where the peak is, by a fit of a Gaussian of known width.
//! What the micro lags behind is the same all around the circle.

use crate::beam::{Beam, Peak, Reading};
use crate::gap_by_light::{Circles, Width};
use crate::outcome::{Halt, Outcome};
use crate::recipe::ConicalScan as Shape;
use crate::shaking::{Scatter, Shaking};
use crate::station::Station;
use pigtail_hal::{Channel, Fault, Side};
use pigtail_model::frames::Displacement;
use pigtail_numerics::line::Line;
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
    /// How the tip shakes.
    shaking: Shaking,
    /// How far the middle went at last, metres.
    moved: f64,
    /// Light of the last turn that found the peak, from the circle's middle.
    around: Vec<(Displacement, f64)>,
}

/// How far a circle's middle may have gone at the beginning of a turn that tells how a tip shakes, metres: a tip that
/// shakes by 40 nm sends it there, and what a micro does on so short a way is nothing beside it.
const SENT: f64 = 100e-9;

/// Standard deviations by which a peak must stand out of the noise.
const SIGNIFICANT: f64 = 5.0;

/// How far a peak may be from where it was first believed to be, in widths...
const FAR: f64 = 4.0;

/// ...and at the chip, which a fiber that strays would touch.
const NEARBY: f64 = 1.2;

/// How near the peak the turns that count must be, in widths.
const NEAR: f64 = 0.15;

/// From the middle of the last wide turn to that of the small one, turns. Foreseeing as far as the fiber's
/// attaching makes offsets in x twice as large, and those in y larger by a third.
const AHEAD: f64 = 1.3;

/// Radius of the small turn in widths, of which the least is enough for light without noise: the
/// smaller, the better the light on it tells that at its middle...
const SMALL: (f64, f64) = (0.15, 0.3);

/// ...and the more it must stand out of the noise: square of the radius for a reading's noise, of its
/// light.
const NOISY: f64 = 10.0;

/// How well the wide turns and the small one together must know the peak, of what the wide ones must;
/// but for light so dim that it takes very many.
const TOGETHER: f64 = 0.8;

/// Share of a turn in which a circle becomes smaller...
const SHRINK: f64 = 0.3;

/// ...and in which the micro comes from it to rest: twice as slowly it rings a quarter as much.
const COME_TO_REST: f64 = 0.6;

/// Turns in which it does where the micro rings: so slow a change excites it little.
const GENTLE: f64 = 2.0;

/// How far a micro that rings may swing where the fiber is attached, metres.
const QUIET: f64 = 20e-9;

/// How far it may swing, at most, before it comes to rest, where that does not die away: then it may be noise.
const SWINGS: f64 = 60e-9;

/// Small turns, at most, until it no longer rings.
const RINGING: u32 = 10;

/// A swing that is more than this share of that of the turn before does not die away.
const LASTING: f64 = 0.8;

/// How far the small turn may find the peak from where the wide ones foresaw it, metres and standard
/// deviations: what is farther has been moved meanwhile. Rather once too often: it costs some turns.
const MOVED: (f64, f64) = (40e-9, 3.0);

/// As [`MISFIT`], for the small turn, times its radius squared: a peak that was moved in the middle of
/// it, or a piezo that does not move, which makes `1 / sqrt(8)`.
const SMALL_MISFIT: f64 = 0.2;

/// How fast a peak moves when all is done, metres a turn: as piezos creep.
const CREEP: f64 = 15e-9;

/// Fastest that it may.
const FASTEST: f64 = 5.0 * CREEP;

/// By how much the light on the circle may differ from that of a peak, of its own: one whose modes
/// are not as designed does by 3 % at most, a piezo that goes half of its way makes it 5 %.
const MISFIT: f64 = 0.04;

/// Radii of the circles by which the width of the spot is seen, in its width at the chip.
const WIDTHS: [f64; 2] = [0.35, 1.2];

/// Turns on either before the other has its turn...
const TURNS_A_ROUND: u32 = 4;

/// ...and how often that is repeated, at most, until the square of the width is known to this share of it.
const MOST_ROUNDS: u32 = 16;
const KNOWN: f64 = 4e-3;

/// How far beside the peak light is watched, in its widths: there it is steepest.
const STEEP: f64 = 0.7;

/// Seconds for which a piezo creeps as good as steadily: what is slower, circles follow.
const STRAIGHT: f64 = 0.2;

/// The light at the peak is looked at for so long, seconds; beside it, it is less by this share at least.
const TOP: f64 = 0.04;
const LEAST_FALL: f64 = 0.02;

/// So many times longer than it is believed to settle a micro may still swing.
const FORGETS: f64 = 8.0;

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
            shaking: Shaking::new(station.measured_shaking(watch.side)),
            moved: f64::INFINITY,
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
        if self.commanded.len() > lag + 1 {
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

    /// How wide the spot is at a gap, by turns on two circles; `at` is the gap by encoders. Turns until it is
    /// known well or after some seconds; `None` where there is too little light. All gaps are looked at on the
    /// same circles, so that it does not matter how far a piezo goes on them.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub fn width(
        &mut self,
        station: &mut Station,
        gap: f64,
        at: f64,
    ) -> Result<Option<Width>, Fault> {
        let mut spot = Circles::default();
        let mut width = None;
        for _ in 0..MOST_ROUNDS {
            // To and fro, so that light which rises or falls steadily counts on both alike.
            for of_contact in [0, 1, 1, 0].map(|i| WIDTHS[i]) {
                let radius = of_contact * self.beam.width(0.0) / self.beam.width(gap);
                self.shrink(station, gap, radius, SHRINK)?;
                for _ in 0..TURNS_A_ROUND {
                    self.turn(station, gap)?;
                    for reading in &self.readings {
                        spot.add(reading.at - self.centre, reading.volts);
                    }
                }
            }
            width = spot.width(at, self.watch.noise);
            if width.is_none_or(|width| width.is_known_to(KNOWN)) {
                break;
            }
        }
        self.shrink(station, gap, self.shape.radius, SHRINK)?;
        self.turn(station, gap)?;
        Ok(width)
    }

    /// The peak by the last turn, at no gap; `None` where there is no light.
    pub fn peak(&mut self) -> Option<Peak> {
        let readings: &[Reading] = self.readings.make_contiguous();
        self.beam.fit(readings, self.watch.noise)
    }

    /// By how much the light of the last `share` of a turn differs from that of `peak`, rms, beside its
    /// noise; of its light at `gap`.
    fn misfit(&mut self, peak: &Peak, gap: f64, share: f64) -> f64 {
        let readings: &[Reading] = self.readings.make_contiguous();
        let n = (share * readings.len() as f64).round().max(2.0);
        let readings = &readings[readings.len().saturating_sub(n as usize)..];
        let noise = self.watch.noise * self.watch.noise * (1.0 + 4.0 * (2.0 / n).sqrt());
        let rest = (self.beam.misfit(readings, peak) / n - noise).max(0.0);
        rest.sqrt() / (peak.full * self.beam.share(gap))
    }

    /// Variance of the last turn beside the harmonics that a circle makes of something of its readings, its square,
    /// and its degrees of freedom; none for readings too few.
    fn left(&self, of: impl Fn(&Reading) -> f64) -> Option<(f64, f64)> {
        let n = self.readings.len();
        let volts = || self.readings.iter().map(&of).enumerate();
        let part = |harmonic: usize, of: fn(f64) -> f64| {
            let angle = |k: usize| TAU * (harmonic * k) as f64 / n as f64;
            let sum: f64 = volts().map(|(k, v)| v * of(angle(k))).sum();
            sum * sum * 2.0 / n as f64
        };
        let whole: f64 = volts().map(|(_, v)| v * v).sum();
        let mean: f64 = volts().map(|(_, v)| v).sum();
        let circle = part(1, f64::sin) + part(1, f64::cos) + part(2, f64::sin) + part(2, f64::cos);
        let free = n as f64 - 5.0;
        (free >= 1.0).then(|| ((whole - mean * mean / n as f64 - circle) / free, free))
    }

    /// By how much the micro swings beside its circle around a `peak`, metres: what the light of the last
    /// turn holds beside the harmonics that a circle makes, where that is two standard deviations more than its
    /// noise, or zero. On a circle of `r` widths `w` a swing `a` makes `r a/w` of the light, rms.
    fn swing(&self, peak: &Peak, gap: f64) -> f64 {
        let Some((left, free)) = self.left(|reading| reading.volts) else {
            return f64::INFINITY;
        };
        let noise = self.watch.noise * self.watch.noise;
        if left < noise * (1.0 + 2.0 * (2.0 / free).sqrt()) {
            return 0.0;
        }
        let light = peak.full * self.beam.share(gap);
        (left - noise).sqrt() * self.beam.width(gap) / (self.radius * light)
    }

    /// How the tip shakes by the last turn around a `peak`: on a circle of `r` widths `w` a place that scatters by
    /// `s` along every direction makes `2 r s/w` of the light there, rms. `None` where the circle's middle was on its way, and farther than
    /// a tip that shakes sends it by itself.
    fn shakes(&self, peak: &Peak, gap: f64) -> Option<Scatter> {
        if self.moved > SENT {
            return None;
        }
        let (left, free) = self.left(|reading| self.beam.left(reading, peak))?;
        let r = self.radius;
        let light = peak.full * self.beam.share(gap) * (-r * r).exp();
        let scale = self.beam.width(gap) / (2.0 * r * light);
        Some(Scatter {
            variance: left * scale * scale,
            still: (self.watch.still * scale).powi(2),
            still_degrees: self.watch.still_degrees,
            degrees: free,
        })
    }

    /// How much wider, squared, the spot is than believed, by the last turn of the wide circle and that of the small
    /// one: as believed where they do not tell.
    fn wider_by(&self, gap: f64) -> f64 {
        /// Widths that are known worse tell nothing.
        const KNOWN_ROUGHLY: f64 = 0.3;
        let mut spot = Circles::default();
        for (at, volts) in &self.around {
            spot.add(*at, *volts);
        }
        for reading in &self.readings {
            spot.add(reading.at - self.centre, reading.volts);
        }
        let width = spot.width(gap, self.watch.still);
        let Some(width) = width.filter(|width| width.is_known_to(KNOWN_ROUGHLY)) else {
            return 1.0;
        };
        // How steep the light is in x and in y, of how steep it is believed to be.
        let believed = self.beam.width(gap).powi(2);
        let [x, y] = width.squared.map(|squared| (believed / squared).powi(2));
        (0.5 * (x + y)).sqrt().recip().max(1.0)
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

    /// Turns at a steady gap until it is known to `accuracy` metres (one standard deviation, by
    /// how the turns' peaks scatter about a straight line in time) where the peak will be in
    /// [`Self::confirm`], and goes there. For piezos creep. The first turns only lead there.
    ///
    /// # Errors
    ///
    /// As [`Self::centre`]; [`Outcome::Misshapen`] where the light is not that of a peak.
    pub fn settle(
        &mut self,
        station: &mut Station,
        gap: f64,
        accuracy: f64,
        phase: &'static str,
    ) -> Result<Peak, Halt> {
        let start = self.centre;
        let expected = SIGNIFICANT * self.watch.noise;
        let lost = |level: f64| Outcome::LightLost {
            phase,
            level,
            expected,
        };
        let (mut dark, mut deviation, mut off) = (0, f64::INFINITY, 0.0);
        let mut seen: Vec<Peak> = Vec::with_capacity(self.shape.turns as usize);
        for _ in 0..6 * self.shape.turns {
            self.turn(station, gap)?;
            let peak = self.peak();
            let Some(mut peak) = peak.filter(|p| p.full > SIGNIFICANT * p.full_deviation) else {
                dark += 1;
                if dark > 1 {
                    let level = peak.map_or(0.0, |peak| peak.full * self.beam.share(gap));
                    return Err(lost(level).into());
                }
                continue;
            };
            let way = (peak.at - self.centre).norm();
            if way > NEAR * self.beam.width(gap) {
                // Not there yet: what was seen from there does not count.
                seen.clear();
                self.go_to(station, &peak, gap)?;
                let far = (self.centre - start).norm();
                if far > NEARBY * self.beam.width(gap) {
                    return Err(lost(peak.full * self.beam.share(gap)).into());
                }
                continue;
            }
            seen.push(peak);
            if let Some(seen) = self.shakes(&peak, gap)
                && !self.shaking.is_watched()
            {
                self.shaking.add_wide(&seen);
            }
            if seen.len() < 3 {
                self.go_to(station, &peak, gap)?;
                continue;
            }
            // A peak is that of the middle of its turn; the circle is left a turn later.
            let noise = peak.deviation;
            let last = peak;
            let x = Ahead::of(&seen, |peak| peak.at.x, noise);
            let y = Ahead::of(&seen, |peak| peak.at.y, noise);
            peak.at = Displacement::new(x.at, y.at);
            peak.deviation = x.deviation.max(y.deviation);
            let slope = x.slope.hypot(y.slope);
            if !self.shaking.is_watched() {
                let scatter = x.scatter.max(y.scatter);
                let free = seen.len() as f64 - 2.0;
                self.shaking.set_slow(scatter, noise * noise, free);
            }
            self.go_to(station, &peak, gap)?;
            deviation = peak.deviation;
            // A peak that a circle's middle runs after, or that is no peak's shape, is that of a micro
            // which does not go where it is told.
            off = self.misfit(&last, gap, 1.0);
            if slope > FASTEST + SIGNIFICANT * noise || off > MISFIT {
                seen.clear();
                continue;
            }
            // The small turn to come knows the less the smaller it is.
            let small = last.deviation * self.shape.radius / self.small(&last, gap);
            let together = deviation * small / deviation.hypot(small);
            self.around.clear();
            self.around
                .extend(self.readings.iter().map(|r| (r.at - self.centre, r.volts)));
            let long = seen.len() >= 2 * self.shape.turns as usize;
            if deviation < accuracy && (together < TOGETHER * accuracy || long) {
                return Ok(peak);
            }
        }
        if off > MISFIT {
            return Err(Outcome::Misshapen {
                misfit: off,
                accepted: MISFIT,
            }
            .into());
        }
        Err(Outcome::Unsure {
            deviation,
            accuracy,
        }
        .into())
    }

    /// Watches how the tip shakes: it is held beside the peak, in x and in y, where light is steep, for so many light
    /// samples each. What a micro does that is sent about is none of it. Ends at the peak.
    ///
    /// # Errors
    ///
    /// The machine's fault.
    pub fn watch_shaking(
        &mut self,
        station: &mut Station,
        gap: f64,
        samples: usize,
    ) -> Result<(), Fault> {
        let mut shaking = if self.shaking.is_watched() {
            self.shaking
        } else {
            self.shaking.to_watch()
        };
        let (width, peak) = (self.beam.width(gap), self.place(gap));
        let rest = FORGETS * station.micro_settling();
        let top = station.level(self.watch.channel, TOP)?.mean - self.watch.background;
        for direction in [Displacement::new(1.0, 0.0), Displacement::new(0.0, 1.0)] {
            self.glide_to(station, peak + direction * (STEEP * width))?;
            station.run(rest)?;
            let mut seen = Vec::with_capacity(samples);
            while seen.len() < samples {
                station.cycle()?;
                let volts = station.light(self.watch.channel);
                seen.extend(volts.map(|volts| (seen.len() as f64, volts - self.watch.background)));
            }
            // Piezos creep meanwhile, ever more slowly.
            let straight = (STRAIGHT * station.spec().photodiode.rate).round() as usize;
            for seen in seen.chunks(straight.max(4)).filter(|seen| seen.len() > 2) {
                let line = Line::through(seen.iter().copied());
                if line.y < SIGNIFICANT * self.watch.noise {
                    continue;
                }
                let squares: f64 = seen.iter().map(|(k, v)| line.left(*k, *v).powi(2)).sum();
                let degrees = seen.len() as f64 - 2.0;
                // How wide the spot is in this direction the light tells by itself; it is not much narrower than
                // believed.
                let aside = STEEP * width;
                let fallen = (top / line.y).ln().clamp(LEAST_FALL, 2.0 * STEEP * STEEP);
                let scale = aside / (2.0 * fallen * line.y);
                shaking.add_wide(&Scatter {
                    variance: squares / degrees * scale * scale,
                    still: (self.watch.still * scale).powi(2),
                    still_degrees: self.watch.still_degrees,
                    degrees,
                });
                // What is slower than a turn is in it.
                shaking.set_slow(0.0, 0.0, degrees);
            }
        }
        self.glide_to(station, peak)?;
        if shaking.is_known() {
            self.shaking = shaking;
        }
        Ok(())
    }

    /// The micro goes straight to a displacement, without a jump of its speed.
    fn glide_to(&self, station: &mut Station, to: Displacement) -> Result<(), Fault> {
        let from = station.micro(self.watch.side);
        let cycles = (SHRINK * self.shape.period / station.spec().period()).round();
        for k in 0..cycles as u64 {
            let share = 0.5 - 0.5 * (PI * (k as f64 + 1.0) / cycles).cos();
            station.move_micro(self.watch.side, from + (to - from) * share);
            station.cycle()?;
        }
        Ok(())
    }

    /// Radius of the small turn around a peak, in its widths.
    fn small(&self, peak: &Peak, gap: f64) -> f64 {
        let noise = self.watch.noise / (peak.full * self.beam.share(gap));
        (NOISY * noise).sqrt().clamp(SMALL.0, SMALL.1)
    }

    /// Goes around a small circle, from which the light at its middle can be told: whether the peak is
    /// where it was `foreseen`, which a piezo that has given way meanwhile would not be at. Then
    /// goes to the peak by both, each as far as it is sure, and comes to rest there. Returns the light
    /// that must be there, volts, at `gap`, and how well the place is known, metres.
    ///
    /// # Errors
    ///
    /// The machine's fault; [`Outcome::MicroRange`] where the micro does not reach the peak;
    /// [`Outcome::LightLost`], [`Outcome::Unsure`] or [`Outcome::Misshapen`] where the peak is not
    /// believed to be there.
    pub fn confirm(
        &mut self,
        station: &mut Station,
        gap: f64,
        foreseen: &Peak,
        phase: &'static str,
    ) -> Result<(f64, f64), Halt> {
        let radius = self.small(foreseen, gap);
        let small = radius * radius;
        self.shrink(station, gap, radius, SHRINK)?;
        // The way to rest makes the micro ring as the way to this circle did, and is this much shorter.
        let shorter = radius / (self.shape.radius - radius);
        let (mut turns, mut before, mut rings) = (0, f64::INFINITY, false);
        let seen = loop {
            self.turn(station, gap)?;
            let Some(seen) = self.peak() else {
                return Err(Outcome::LightLost {
                    phase,
                    level: 0.0,
                    expected: foreseen.full * self.beam.share(gap),
                }
                .into());
            };
            let swing = self.swing(&seen, gap);
            rings |= swing * shorter > QUIET;
            if swing < QUIET || !rings {
                break seen;
            }
            if swing > LASTING * before || turns == RINGING {
                if swing > SWINGS {
                    return Err(Outcome::Unsure {
                        deviation: swing,
                        accuracy: SWINGS,
                    }
                    .into());
                }
                break seen;
            }
            (before, turns) = (swing, turns + 1);
            self.go_to(station, &seen, gap)?;
        };
        // On the way to this circle and on it nothing has moved.
        self.moved = if turns > 0 { self.moved } else { 0.0 };
        if let Some(shakes) = self.shakes(&seen, gap)
            && !self.shaking.is_watched()
        {
            self.shaking.add_small(&shakes);
        }
        let wider = self.wider_by(gap);
        self.shaking.set_wider(wider);
        // What was foreseen was so for one turn.
        let late = CREEP * f64::from(turns);
        let foreseen = &Peak {
            deviation: foreseen.deviation.hypot(late),
            ..*foreseen
        };
        let by = seen.at - foreseen.at;
        let deviation = seen.deviation.hypot(foreseen.deviation);
        let (way, near) = (by.norm(), MOVED.0 + MOVED.1 * deviation);
        if way > near {
            return Err(Outcome::Unsure {
                deviation: way,
                accuracy: near,
            }
            .into());
        }
        let accepted = SMALL_MISFIT * small;
        let misfit = self.misfit(&seen, gap, 1.0);
        if misfit > accepted {
            return Err(Outcome::Misshapen { misfit, accepted }.into());
        }
        let share = (foreseen.deviation / deviation).powi(2);
        let last = if rings { GENTLE } else { COME_TO_REST };
        let peak = Peak {
            at: foreseen.at + by * share,
            ..seen
        };
        self.go_to(station, &peak, gap)?;
        self.shrink(station, gap, 0.0, last)?;
        // It comes to rest, and not a moment longer: piezos creep.
        self.cycles(station, gap, station.micro_settling())?;
        // Fiber and guide are not quite as designed: by how much the peak is wider than believed, two
        // circles tell.
        let wide = self.shape.radius * self.shape.radius;
        let wider = (seen.full / foreseen.full).powf(small / (wide - small));
        let full = seen.full * wider;
        let misfit = self.misfit(&Peak { full, ..seen }, gap, SHRINK);
        if misfit > accepted {
            return Err(Outcome::Misshapen { misfit, accepted }.into());
        }
        let known = foreseen.deviation * seen.deviation / deviation;
        Ok((full * self.beam.share(gap), known))
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

/// A coordinate of the peak as it will be.
struct Ahead {
    /// [`AHEAD`] of the last turn, metres.
    at: f64,
    /// Its standard deviation, metres.
    deviation: f64,
    /// How it moves, metres a turn.
    slope: f64,
    /// Variance of a turn's peak about that, square metres.
    scatter: f64,
}

impl Ahead {
    /// By the straight line through a coordinate of peaks that are a turn apart. A few peaks may
    /// happen to lie well: they scatter by `noise` (metres) at least.
    fn of(peaks: &[Peak], coordinate: impl Fn(&Peak) -> f64 + Clone, noise: f64) -> Self {
        let n = peaks.len() as f64;
        let turns = peaks.iter().map(coordinate).enumerate();
        let points = turns.map(|(k, at)| (k as f64, at));
        let line = Line::through(points.clone());
        let squares: f64 = points.map(|(k, at)| line.left(k, at).powi(2)).sum();
        let lever = line.x + AHEAD;
        let scatter = squares / (n - 2.0);
        let each = scatter.max(noise * noise);
        let variance = each * (1.0 / n + lever * lever / line.spread);
        Self {
            at: line.y + line.slope * lever,
            deviation: variance.sqrt(),
            slope: line.slope,
            scatter,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn peak(x: f64) -> Peak {
        Peak {
            at: Displacement::new(x, 0.0),
            full: 1.0,
            full_deviation: 0.0,
            deviation: 0.0,
        }
    }

    #[test]
    fn a_steady_creep_is_foreseen() {
        let peaks = [0.0, 10e-9, 20e-9, 30e-9].map(peak);
        let ahead = Ahead::of(&peaks, |peak| peak.at.x, 0.0);
        let expected = 30e-9 + AHEAD * 10e-9;
        assert!((ahead.at - expected).abs() < 1e-15, "{}", ahead.at);
        assert!(ahead.deviation < 1e-15, "{}", ahead.deviation);
        assert!((ahead.slope - 10e-9).abs() < 1e-15, "{}", ahead.slope);
    }

    #[test]
    fn three_peaks_that_happen_to_lie_well_are_not_believed_more_than_their_noise() {
        let Ahead { deviation, .. } = Ahead::of(&[0.0; 3].map(peak), |peak| peak.at.x, 10e-9);
        assert!(deviation > 10e-9, "{deviation}");
    }
}

//! Clocks, sensors and piezos: what is late, frozen or running away.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use super::Broken;
use pigtail_hal::quantity::Volts;
use pigtail_hal::spec::{AXES, CHANNELS, MICRO_AXES, SIDES};
use pigtail_hal::{Axis, AxisName, Channel, Measurement, Rule, Side, Spec, VisionFrame};
use pigtail_model::each::Each;

/// A sensor is late after so many of its own periods.
const LATE: f64 = 4.0;
/// Frames that are alike to the last digit, in a row: a camera that repeats itself.
const ALIKE: u32 = 5;

/// When each sensor was heard of.
#[derive(Debug, Clone)]
pub(super) struct Sensors {
    period: f64,
    light: f64,
    frame: f64,
    /// Longest silence of photodiodes and of vision, seconds.
    patience: [f64; 2],
    last_frame: Option<VisionFrame>,
    alike: u32,
    /// Light at which a photodiode is at the end of its range, volts, and for how many samples.
    full: f64,
    most_full: u32,
    fulls: [u32; CHANNELS],
}

impl Sensors {
    pub(super) fn new(spec: &Spec) -> Self {
        Self {
            period: spec.period(),
            light: 0.0,
            frame: 0.0,
            patience: [
                LATE / spec.photodiode.rate,
                LATE / spec.vision.rate + spec.vision.latency,
            ],
            last_frame: None,
            alike: 0,
            full: spec.photodiode.range - 1.5 * spec.photodiode.step(),
            most_full: (spec.guard.saturated * spec.photodiode.rate).ceil() as u32,
            fulls: [0; CHANNELS],
        }
    }

    /// Watching begins: what came before has not been heard of.
    pub(super) fn begin(&mut self, time: f64) {
        (self.light, self.frame) = (time, time);
    }

    /// Time (the cycle before was at `before`, seconds), and the photodiodes.
    #[inline(always)]
    pub(super) fn check(&mut self, before: f64, now: &Measurement) -> Result<(), Broken> {
        let step = now.time - before;
        let in_time = (step - self.period).abs() <= 0.5 * self.period;
        // A time that is no number is not in time.
        if !in_time {
            return Err(Broken::new(
                Rule::ServoTiming,
                "machine",
                format!("{:.3} ms since the last cycle", step * 1e3),
                format!("{:.3} ms", self.period * 1e3),
            ));
        }
        if let Some(light) = &now.light {
            self.light = now.time;
            for channel in Channel::ALL {
                let (i, Volts(volts)) = (channel.index(), light.volts[channel.index()]);
                if volts < self.full {
                    self.fulls[i] = 0;
                    continue;
                }
                self.fulls[i] += 1;
                if self.fulls[i] > self.most_full {
                    return Err(Broken::new(
                        Rule::PhotodiodeRange,
                        channel.name(),
                        format!("{volts:.3} V"),
                        format!("less than {:.3} V", self.full),
                    ));
                }
            }
        }
        for (what, heard, patience) in [
            ("photodiodes", self.light, self.patience[0]),
            ("vision", self.frame, self.patience[1]),
        ] {
            if now.time - heard > patience {
                return Err(Broken::new(
                    Rule::SensorSilence,
                    what,
                    format!("nothing for {:.1} ms", (now.time - heard) * 1e3),
                    format!("at most {:.1} ms", patience * 1e3),
                ));
            }
        }
        Ok(())
    }

    /// A new frame of vision.
    pub(super) fn frame(&mut self, frame: &VisionFrame, now: f64) -> Result<(), Broken> {
        self.frame = now;
        let same = self
            .last_frame
            .is_some_and(|last| (last.fiber, last.sensing) == (frame.fiber, frame.sensing));
        self.alike = if same { self.alike + 1 } else { 0 };
        self.last_frame = Some(*frame);
        if self.alike >= ALIKE {
            return Err(Broken::new(
                Rule::VisionFrozen,
                "vision",
                format!("{} frames alike to the last digit", self.alike + 1),
                "frames that differ by their noise".to_owned(),
            ));
        }
        Ok(())
    }
}

/// A motor that is given its starting voltage and as much again, one way, may stand still for so long,
/// seconds; the less, the more it is given. After a hard reversal a load that still swings holds one for
/// 6 ms where no probe sees it swing.
const STALLED: f64 = 10e-3;
/// An output that goes by so many counts in a cycle moves: one is the least that an encoder would see. One that goes against the
/// voltage still swings.
const MOVES: f64 = 1.0;
/// An output has come to rest once it has not moved for so long, seconds: no swing is as slow for as long.
const RESTED: f64 = 10e-3;
/// One that was at rest and has gone so many counts with the voltage is turned by its motor. A choice: what an encoder may not have
/// seen yet, eight times.
const SET_OFF: f64 = 8.0;

/// Motors that are given voltage and do not turn, or whose encoders do not say so.
///
/// Voltage beyond what friction takes, over time, is momentum. While a motor stands, what is given forward
/// and then back leaves it none; and while its output still goes the other way, what it is given stops
/// the load. Neither is a motor that should have turned. One that is dead, or whose encoder is, is given
/// more and more one way, and its output does not go the other way for long.
///
/// Where an output is at rest nothing but its motor sets it off: an encoder that sees none of that is stuck, and nobody waits until
/// it has gone on for as long as that.
#[derive(Debug, Clone)]
pub(super) struct Stalls {
    start: [f64; AXES],
    period: f64,
    each: [[Stall; AXES]; SIDES],
}

/// Of one motor since it last turned.
#[derive(Debug, Clone, Copy, Default)]
struct Stall {
    /// What it was given beyond its starting voltage, forward less back, volt seconds.
    given: f64,
    /// For how long its output has not moved, seconds...
    rests: f64,
    /// ...and how far it has gone with the voltage since then, counts.
    gone: f64,
}

impl Stalls {
    pub(super) fn new(spec: &Spec) -> Self {
        Self {
            start: Axis::ALL.map(|axis| spec.drive(axis).start()),
            period: spec.period(),
            each: Default::default(),
        }
    }

    /// A cycle in which the motor of a side and an axis was given so much and turned or not, by its encoder, and its output went
    /// so many counts, by its probe; none on a rig without.
    #[inline(always)]
    pub(super) fn check(
        &mut self,
        (i, k): (usize, usize),
        Volts(volts): Volts,
        turned: bool,
        output: f64,
    ) -> Result<(), Broken> {
        let (stall, start) = (&mut self.each[i][k], self.start[k]);
        if turned {
            *stall = Stall::default();
            return Ok(());
        }
        let more = volts.abs() - start;
        let went = output * volts.signum();
        let sets_off = more > 0.0 && went >= MOVES && stall.rests >= RESTED;
        if sets_off {
            stall.gone += went;
        } else if went.abs() < MOVES {
            stall.rests += self.period;
        } else {
            (stall.rests, stall.gone) = (0.0, 0.0);
        }
        if more <= 0.0 {
            stall.given = 0.0;
            return Ok(());
        }
        if went <= -MOVES {
            return Ok(());
        }
        // What it had been given when the cycle began, this cycle would show: a motor that turns round within
        // one stands where it stood.
        let had = stall.given.abs();
        stall.given += more.copysign(volts) * self.period;
        if had.min(stall.given.abs()) <= STALLED * start && stall.gone < SET_OFF {
            return Ok(());
        }
        let though = if stall.gone < SET_OFF {
            ""
        } else {
            ", though its output is set off"
        };
        Err(Broken::new(
            Rule::MotorStall,
            AxisName::new(Side::ALL[i], Axis::ALL[k]).to_string(),
            format!("no count, at {volts:.1} V{though}"),
            format!("counts above {start} V"),
        ))
    }
}

/// How fast what a probe and an encoder differ by may change, as a time: that of a filter, seconds.
const SLOW: f64 = 0.1;
/// By how much of a way lead and links may be wrong: so much of a motion comes out only when it has ended.
const SCALE: f64 = 0.01;

/// A joint since its encoder last counted.
#[derive(Debug, Clone, Copy)]
struct Stood {
    /// Where the encoder has it, metres.
    encoder: f64,
    /// Where its output was when it came there, metres.
    output: f64,
    /// How fast the endpoint was then, m/s.
    speed: f64,
}

/// How far an output may go beyond what it still owes its motor while that stands to the last count, as a share of what
/// transmissions may hide: what they have hidden they keep until the motor turns, but one that sticks as it turns round has its output swing
/// meanwhile. A choice: near a chip 8 um were seen; far from any 24, of a drawn machine on slow triangles, which is not looked at.
const RELAXES: f64 = 0.1;
/// The axes that go across.
const JOINTS: [Axis; 2] = [Axis::A, Axis::B];

/// A number of each axis of a manipulator, and one more: four of them are worked on at once.
pub(super) type OfAxes = Each<4>;

/// The numbers of a manipulator's axes.
#[inline(always)]
pub(super) fn of_axes([a, b, z]: [f64; AXES]) -> OfAxes {
    Each([a, b, z, 0.0])
}

/// Outputs that do not do what their motors' encoders say.
#[derive(Debug, Clone)]
pub(super) struct Outputs {
    share: f64,
    apart: OfAxes,
    /// By what time of a motion an output follows its motor, usually, and how much more or less it may
    /// be, seconds.
    lag: f64,
    /// What each probe and its encoder have differed by of late, metres.
    usual: Option<[OfAxes; SIDES]>,
    /// How fast each has been of late, m/s: what a motion made of the usual stays for as long after it.
    fast: [OfAxes; SIDES],
    /// Where the motors of joints stand.
    stood: [[Option<Stood>; JOINTS.len()]; SIDES],
}

impl Outputs {
    pub(super) fn new(spec: &Spec) -> Self {
        let xy = spec.guard.windup;
        Self {
            share: spec.period() / SLOW,
            apart: of_axes([xy, xy, spec.guard.windup_z]),
            lag: spec.guard.lag,
            usual: None,
            fast: [Each([0.0; 4]); SIDES],
            stood: Default::default(),
        }
    }

    /// The probes of a side's joints, and where their encoders have them (metres), at a speed of its endpoint across (m/s): an output that goes
    /// farther than it can without its motor says that the encoder is stuck. Of a joint that goes on at its speed nothing else says so until it has
    /// gone as far as transmissions may hide. Where a tip is near (`near`) that is too late: its servo drives it on faster than it could be
    /// stopped. A z-stage swings by as much as that about a screw that has come to its end: of it the distance from the chip tells.
    #[inline(always)]
    pub(super) fn check_stuck(
        &mut self,
        side: Side,
        probes: OfAxes,
        encoders: OfAxes,
        across: f64,
        near: bool,
    ) -> Result<(), Broken> {
        for axis in JOINTS {
            let k = axis.index();
            let (output, encoder) = (probes[k], encoders[k]);
            let stood = &mut self.stood[side.index()][k];
            let before = stood.filter(|stood| near && stood.encoder == encoder);
            let Some(before) = before else {
                *stood = Some(Stood {
                    encoder,
                    output,
                    speed: across,
                });
                continue;
            };
            let by = output - before.output;
            let accepted = RELAXES * self.apart[k] + 2.0 * self.lag * before.speed;
            // A comparison that a NaN fails too.
            if by.abs() <= accepted {
                continue;
            }
            return Err(Broken::new(
                Rule::OutputFollowing,
                AxisName { side, axis }.to_string(),
                format!("{:.1} um while its motor stood, by its encoder", by * 1e6),
                format!(
                    "at most {:.1} um after this speed, near the chip",
                    accepted * 1e6
                ),
            ));
        }
        Ok(())
    }

    /// Probes, beside what the encoders would have them read (metres), and the speeds of the axes (m/s).
    #[inline(always)]
    pub(super) fn check(
        &mut self,
        probes: &[OfAxes; SIDES],
        encoders: &[OfAxes; SIDES],
        speeds: &[OfAxes; SIDES],
    ) -> Result<(), Broken> {
        let apart = |i: usize| probes[i] - encoders[i];
        let usual = self.usual.get_or_insert([apart(0), apart(1)]);
        for side in Side::ALL {
            let i = side.index();
            let by = probes[i] - encoders[i] + self.lag * speeds[i] - usual[i];
            usual[i] = usual[i] + self.share * by;
            let speed = speeds[i].abs();
            let fast = self.fast[i] + self.share * (speed - self.fast[i]);
            self.fast[i] = fast;
            let accepted = self.apart + (self.lag * speed).max(SCALE * SLOW * fast);
            // A comparison that a NaN fails too, without a short cut: all of them at once.
            if !(0..4).fold(true, |well, k| well & (by[k].abs() <= accepted[k])) {
                return Err(apart_by(side, by, accepted));
            }
        }
        Ok(())
    }
}

/// What is said of the first axis of a side that is farther from where its motor has it than is accepted, metres.
#[cold]
fn apart_by(side: Side, by: OfAxes, accepted: OfAxes) -> Broken {
    let well = |axis: &&Axis| by[axis.index()].abs() <= accepted[axis.index()];
    let axis = *Axis::ALL
        .iter()
        .find(|axis| !well(axis))
        .unwrap_or(&Axis::Z);
    let k = axis.index();
    Broken::new(
        Rule::OutputFollowing,
        AxisName { side, axis }.to_string(),
        format!("{:.1} um from where its motor has it", by[k] * 1e6),
        format!("at most {:.1} um at this speed", accepted[k] * 1e6),
    )
}

/// A swing of a piezo counts from this share of its range on.
const SWING: f64 = 0.2;
/// So many of them...
const SWINGS: usize = 8;
/// ...within this time are no work that anyone gives a piezo, seconds.
const WITHIN: f64 = 0.035;

/// All piezos.
const PIEZOS: usize = SIDES * MICRO_AXES;

/// Piezos that swing to and fro: a loop around them has run away.
#[derive(Debug, Clone)]
pub(super) struct Piezos {
    swing: f64,
    within: u64,
    cycle: u64,
    /// Where the present swing of each began and how far it has gone, volts.
    from: Each<PIEZOS>,
    to: Each<PIEZOS>,
    /// The cycles of its last ones, the oldest first.
    ends: [[u64; SWINGS]; PIEZOS],
}

impl Piezos {
    pub(super) fn new(spec: &Spec) -> Self {
        let middle = Each([0.5 * spec.micro.voltage; PIEZOS]);
        Self {
            swing: SWING * spec.micro.voltage,
            within: (WITHIN * spec.servo.rate) as u64,
            // So that no swing of the beginning was within any time.
            cycle: 1 << 32,
            from: middle,
            to: middle,
            ends: [[0; SWINGS]; PIEZOS],
        }
    }

    #[inline(always)]
    pub(super) fn check(&mut self, volts: &[[Volts; MICRO_AXES]; SIDES]) -> Result<(), Broken> {
        self.cycle += 1;
        let [[Volts(p), Volts(q)], [Volts(r), Volts(s)]] = *volts;
        let (told, to) = (Each([p, q, r, s]), self.to);
        let away = (told - to).abs();
        let goes_on = |k: usize| (told[k] >= to[k]) == (to[k] >= self.from[k]);
        let small = |k: usize| away[k] < self.swing;
        // Without a short cut: all of them at once.
        let none_turned = (0..PIEZOS).fold(true, |none, k| none & (goes_on(k) | small(k)));
        self.to = told.select(to, goes_on);
        if none_turned {
            return Ok(());
        }
        let turned: [bool; PIEZOS] = std::array::from_fn(|k| !goes_on(k) && !small(k));
        self.turn_round(turned, (to, told))
    }

    /// Some have turned round, that had gone `to` a voltage and are told another.
    #[cold]
    fn turn_round(
        &mut self,
        turned: [bool; PIEZOS],
        (to, told): (Each<PIEZOS>, Each<PIEZOS>),
    ) -> Result<(), Broken> {
        for k in (0..PIEZOS).filter(|k| turned[*k]) {
            (self.from[k], self.to[k]) = (to[k], told[k]);
            let ends = &mut self.ends[k];
            ends.rotate_left(1);
            ends[SWINGS - 1] = self.cycle;
            if self.cycle - ends[0] <= self.within {
                let side = Side::ALL[k / MICRO_AXES];
                return Err(Broken::new(
                    Rule::PiezoRunaway,
                    format!("{}.micro{}", side.name(), k % MICRO_AXES + 1),
                    format!("{SWINGS} swings within {:.0} ms", WITHIN * 1e3),
                    format!("fewer, of {:.1} V or more", self.swing),
                ));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Watches one motor whose starting voltage is 1.2 V, in 2500 cycles a second: of each cycle its voltage,
    /// whether it turned, and how far its output went, counts. The cycle in which it is stopped, from 1.
    fn stopped(cycles: impl IntoIterator<Item = (f64, bool, Option<f64>)>) -> Option<usize> {
        let mut stalls = Stalls {
            start: [1.2; AXES],
            period: 0.4e-3,
            each: Default::default(),
        };
        let at = (Side::Left.index(), Axis::Z.index());
        let mut cycles = cycles.into_iter().enumerate();
        cycles.find_map(|(i, (volts, turned, output))| {
            let checked = stalls.check(at, Volts(volts), turned, output.unwrap_or(0.0));
            checked.is_err().then_some(i + 1)
        })
    }

    #[test]
    fn a_motor_that_is_given_voltage_one_way_and_stands_is_stopped() {
        for output in [None, Some(0.0), Some(5.0)] {
            // All that there is, and three times what starts it.
            assert_eq!(stopped([(24.0, false, output); 9]), Some(3));
            assert_eq!(stopped([(3.6, false, output); 99]), Some(14));
            assert_eq!(
                stopped([(-24.0, false, output.map(|went| -went)); 9]),
                Some(3)
            );
            assert_eq!(stopped([(1.2, false, output); 99]), None);
        }
    }

    #[test]
    fn one_that_is_braked_and_driven_to_and_fro_where_it_stands_is_not() {
        // As much forward as back.
        let to_and_fro = [-24.0, -9.7, 24.0, 18.5, -10.0].repeat(9);
        assert_eq!(
            stopped(to_and_fro.into_iter().map(|volts| (volts, false, None))),
            None
        );
        // A count that comes a cycle after the impulse.
        assert_eq!(
            stopped([17.5, 16.8, 20.0].map(|volts| (volts, volts == 20.0, Some(8.0)))),
            None
        );
    }

    #[test]
    fn an_output_at_rest_that_goes_with_the_voltage_tells_that_an_encoder_is_stuck() {
        let rests = [(0.5, false, Some(0.1)); 30];
        let rises = [2.0, 2.5, 3.0, 3.5, 4.0, 4.5].map(|volts| (volts, false, Some(2.0)));
        assert_eq!(stopped(rests.into_iter().chain(rises)), Some(34));
        // Not one that swings, nor one that has hardly come to rest.
        let swings = [-3.0, 3.0].repeat(15).into_iter();
        let swings = swings.map(|went| (0.5, false, Some(went)));
        assert_eq!(stopped(swings.clone().chain(rises)), None);
        assert_eq!(stopped(rests[..20].iter().copied().chain(rises)), None);
        // Nor by what its noise makes of a probe, until it is given too much.
        let noise = rises.map(|(volts, turned, _)| (volts, turned, Some(0.9)));
        assert_eq!(stopped(rests.into_iter().chain(noise)), None);
    }

    #[test]
    fn one_that_stops_the_swing_of_its_load_is_not_and_is_once_that_has_ended() {
        let swings = [(15.0, false, Some(-4.0)); 20];
        assert_eq!(stopped(swings), None);
        // Not by the noise of a probe.
        assert_eq!(stopped([(15.0, false, Some(-0.5)); 20]), Some(4));
        let ends = swings.into_iter().chain([(15.0, false, Some(0.0)); 20]);
        assert_eq!(stopped(ends), Some(24));
    }
}

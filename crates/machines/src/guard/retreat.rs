//! What a guard does about a broken rule: slow down, draw z back, hold.

use super::{Guard, ROUNDING};
use pigtail_hal::quantity::{Counts, Volts};
use pigtail_hal::spec::SIDES;
use pigtail_hal::{Axis, Command, Fault, Machine, Side};

/// Gain of the speed's loop: share of the voltage for a share of the speed.
const GAIN: f64 = 0.3;
/// Time of its integral, seconds.
const INTEGRAL: f64 = 0.01;
/// It never gives more than this share of the voltage.
const MOST: f64 = 0.6;
/// Speed backward, as a share of the datasheet's.
const BACK: f64 = 0.5;
/// Braking, as a multiple of the datasheet's acceleration: an emergency.
const BRAKE: f64 = 2.0;
/// An axis whose encoder cannot be trusted may be on its way to the chip: it is driven back with most of its voltage for so
/// long, seconds, as one that is seen to go there...
const STOP: f64 = 4e-3;
/// ...and pushed back by this share of its voltage for a while, seconds.
const PUSH: (f64, f64) = (0.25, 0.03);
/// A way back has come to its end when so little of it is left, metres.
const ARRIVED: f64 = 2e-6;
/// Cycles over which a speed is seen.
const SEEN: usize = 4;

/// A z-stage on its way back.
struct Way {
    trusted: bool,
    /// Encoder of late, metres; the oldest first.
    places: [f64; SEEN + 1],
    /// How far ahead of that its output was by its probe, metres.
    ahead: [f64; SEEN + 1],
    /// A count of the encoder, metres.
    count: f64,
    /// Speed that is wanted now, metres a second, forward is towards the chip.
    wanted: f64,
    integral: f64,
    /// Where it began, metres.
    from: f64,
}

impl<M: Machine> Guard<M> {
    /// Slows every axis down, draws both z-stages back, and leaves the motors without voltage, which
    /// friction holds. The joints brake by themselves: they are geared down so far.
    pub(super) fn retreat(&mut self, fault: &Fault) {
        let Some(last) = self.last else {
            self.machine.stop();
            return;
        };
        let spec = self.machine.spec();
        let (z, volts) = (&spec.z_stage, spec.drive(Axis::Z).voltage);
        let (speed, acceleration, period) = (z.speed, z.acceleration, spec.period());
        let scale = self.limits.metres_per_count[Axis::Z.index()];
        let mut ways: [Way; SIDES] = std::array::from_fn(|i| {
            let Counts(at) = last.encoders[i][Axis::Z.index()];
            let at = at as f64 * scale;
            // A cycle that came late was longer than a period.
            let seconds = self.keepout.stand(i, 0).time - self.keepout.stand(i, SEEN).time;
            let way = if seconds > 0.0 {
                self.keepout.moved_along(i, SEEN) * (SEEN as f64 * period / seconds)
            } else {
                0.0
            };
            let now = way / (SEEN as f64 * period);
            Way {
                trusted: fault.axis != format!("{}.z", Side::ALL[i].name()),
                places: std::array::from_fn(|k| at - way + way * k as f64 / SEEN as f64),
                ahead: std::array::from_fn(|k| self.keepout.stand(i, SEEN - k).ahead),
                count: scale,
                wanted: now.clamp(-speed, speed),
                integral: 0.0,
                from: at,
            }
        });
        let back = self.limits.retract;
        let mut command = Command {
            micro: last.micro,
            laser: last.laser.0,
            laser_percent: last.laser.1,
            ..Command::IDLE
        };
        // Twice what it takes by plan, and never for ever.
        let longest = 2.0 * (back / (BACK * speed) + 2.0 * speed / acceleration);
        for cycle in 0..(longest / period) as u64 {
            let mut going = false;
            for (i, way) in ways.iter_mut().enumerate() {
                let share = if way.trusted {
                    way.next(speed, acceleration, period, back)
                } else {
                    match cycle as f64 * period {
                        since if since < STOP => Some(-MOST),
                        since if since < PUSH.1 => Some(-PUSH.0),
                        _ => None,
                    }
                };
                going |= share.is_some();
                let share = share.unwrap_or(0.0).clamp(-MOST, MOST);
                command.motors[i][Axis::Z.index()] = Volts(share * volts * (1.0 - ROUNDING));
            }
            if !going {
                break;
            }
            match self.machine.exchange(&command) {
                Ok(measured) => {
                    for (i, way) in ways.iter_mut().enumerate() {
                        let z = Axis::Z.index();
                        let Counts(at) = measured.encoders[i][z];
                        let at = at as f64 * scale;
                        way.places.rotate_left(1);
                        way.places[SEEN] = at;
                        way.ahead.rotate_left(1);
                        way.ahead[SEEN] = measured.probes.map_or(0.0, |probes| probes[i][z] - at);
                    }
                }
                Err(_) => return,
            }
        }
        self.machine.stop();
    }
}

impl Way {
    /// The voltage for this cycle as a share of the greatest; `None` at the end of the way.
    fn next(&mut self, speed: f64, acceleration: f64, period: f64, back: f64) -> Option<f64> {
        let now = (self.places[SEEN] - self.places[0]) / (SEEN as f64 * period);
        let left = back - (self.from - self.places[SEEN]);
        if left <= ARRIVED {
            return None;
        }
        // Backward no faster than it can stop where it is to stand.
        let goal = -(2.0 * acceleration * left.max(0.0))
            .sqrt()
            .min(BACK * speed);
        let step = if goal < self.wanted { BRAKE } else { 1.0 } * acceleration * period;
        self.wanted += (goal - self.wanted).clamp(-step, step);
        // One that slows down by friction faster than it is asked to is not pushed on.
        self.wanted = self.wanted.min(now.max(0.0));
        let error = (self.wanted - now) / speed;
        self.integral = (self.integral + error * period / INTEGRAL).clamp(-1.0, 1.0);
        let share = GAIN * (error + self.integral);
        // One whose encoder is stuck goes on though by that it stands.
        let output = self.places[SEEN] - self.places[0] + self.ahead[SEEN] - self.ahead[0];
        Some(if now > 0.0 || output > self.count {
            // Towards the chip nothing is to be gentle with: it is driven back until it no longer goes there.
            -MOST
        } else if now < 0.0 {
            share
        } else {
            // Nor driven there, whatever a speed of a few counts seems to be.
            share.min(0.0)
        })
    }
}

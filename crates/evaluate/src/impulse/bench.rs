//! An axis on the bench: the single experiments by which pulses are characterized.

use super::response::{DeadZone, Map, REST, Row, Spread, Trace, joint_plant};
use pigtail_control::impulse::experiment::{unevenness, ways_to_relax};
use pigtail_control::impulse::{Impulses, Moved, Relax, Shape};
use pigtail_control::station::Unobserved;
use pigtail_hal::pulse::HARMONICS;
use pigtail_hal::{AxisName, Command, Error, Machine, Pulse};
use pigtail_numerics::bisection::onset;
use pigtail_numerics::rounded;
use pigtail_session::job::{Ended, Job, Labelled};
use pigtail_session::pulses::{Amplitude, LeastPulse, PlayPulses};
use pigtail_session::setup::{Setup, unfit};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

/// Readings of the probe that make a measurement: its noise falls tenfold.
pub(super) const READINGS: u32 = 100;
/// The map's extent in `a_1` and `a_2` (Fig. 4.17), in units of the motor's static friction.
pub(super) const MAP: [f64; 2] = [5.0, 20.0];
/// Its cells along either.
const CELLS: [usize; 2] = [40, 40];
/// Points of the curve over `a_1`.
const POINTS: usize = 51;
/// Pulses that are averaged at each.
const PULSES: u32 = 4;
/// Pulses in a row, each way to relax between them.
const ROW: u32 = 12;
/// Points of `a_1` at which the spread over machines is taken.
const SPREAD_POINTS: usize = 11;
/// Relative standard deviation of the load's friction among them.
const FRICTION: f64 = 0.1;
/// The share of an encoder count by which the motor's place is uncertain.
const STATE: f64 = 0.1;
/// Servo rate at which a single pulse is looked at, hertz.
const FINE_RATE: f64 = 50e3;
/// For how long, seconds.
const LOOK: f64 = 0.02;

type Experiment<T> = Result<T, Ended>;

/// Whether a pulse with this number, of those played back and forth in turn, goes forward.
fn is_forward(number: u32) -> bool {
    number.is_multiple_of(2)
}

/// How far the pulse with this number went its way, metres.
fn ahead(number: u32, moved: &Moved) -> f64 {
    if is_forward(number) {
        moved.displacement
    } else {
        -moved.displacement
    }
}

/// One point of a curve.
pub(super) struct Point {
    /// Amplitude, volts.
    pub(super) a1: f64,
    /// Displacement at the end of the measurement, metres.
    pub(super) displacement: f64,
    /// What is left of it once the transmission is relaxed, metres.
    pub(super) net: f64,
}

/// An axis on the bench: fresh twins of the same specimen, so that experiments do not depend on what
/// was done before, and several can run at once.
pub(super) struct Bench<'s> {
    pub(super) setup: &'s Setup,
    pub(super) at: AxisName,
    pub(super) seed: u64,
    /// The unit of amplitudes, volts.
    pub(super) unit: f64,
    /// Proportions of the fixed harmonics.
    pub(super) form: Shape,
}

impl Bench<'_> {
    /// Runs an experiment on a twin afresh.
    pub(super) fn on<J: Job>(&self, label: String, job: J) -> Experiment<J::Output> {
        let job = Labelled { label, job };
        self.setup.run(&job, self.seed, &mut Unobserved)
    }

    /// Plays pulses, which are numbered through: those with even numbers forward, the others backward.
    fn in_turn(
        &self,
        label: String,
        impulses: &Impulses,
        pulses: u32,
        pulse: impl Fn(bool) -> Pulse,
    ) -> Experiment<Vec<Moved>> {
        let job = PlayPulses {
            impulses: *impulses,
            pulses: (0..pulses).map(|k| pulse(is_forward(k))).collect(),
        };
        self.on(label, job)
    }

    /// That the amplifier plays fixed harmonics, in units, with all of the curve's `a_1`.
    pub(super) fn check(&self, fixed: Option<[f64; HARMONICS - 1]>) -> Result<(), Error> {
        let Some([a2, ..]) = fixed else {
            return Ok(());
        };
        let highest = self
            .form
            .scaled(a2 * self.unit)
            .pulse(MAP[0] * self.unit, true);
        highest
            .check(self.setup.rig.spec.drive(self.at.axis))
            .map_err(|why| Error::new("--a2", "", format!("with a1 of {} fsm: {why}", MAP[0])))
    }

    /// Greatest voltage of a pulse's harmonic that leaves room for another of the map's `a_1`.
    pub(super) fn limit(&self) -> f64 {
        let drive = self.setup.rig.spec.drive(self.at.axis);
        let volts = drive.pulse.map_or(0.0, |pulse| pulse.voltage);
        let beyond = |harmonic: f64| {
            let pulse = self.form.scaled(harmonic).pulse(MAP[0] * self.unit, true);
            pulse.peak() > volts
        };
        onset((0.0, volts), 30, beyond).0
    }

    pub(super) fn impulses(&self, relax: Relax, readings: u32) -> Impulses {
        Impulses {
            at: self.at,
            relax,
            rest: REST,
            readings,
        }
    }

    /// The same pulse in a row, with each way to relax.
    fn rows(&self, label: &str, ways: &[Relax], pulse: Pulse) -> Experiment<Vec<Vec<Moved>>> {
        ways.par_iter()
            .map(|relax| {
                let job = PlayPulses {
                    impulses: self.impulses(*relax, READINGS),
                    pulses: vec![pulse; ROW as usize],
                };
                self.on(format!("{label}-{}", relax.name()), job)
            })
            .collect()
    }

    /// The way to relax that leaves pulses in a row most even, and what each way leaves.
    pub(super) fn relaxations(&self, label: &str, pulse: Pulse) -> Experiment<(Relax, Vec<Row>)> {
        let ways = ways_to_relax(self.unit);
        let all = self.rows(label, &ways, pulse)?;
        let best =
            (0..ways.len()).min_by(|&a, &b| unevenness(&all[a]).total_cmp(&unevenness(&all[b])));
        let rows = ways.iter().zip(&all).map(|(relax, row)| Row {
            relax: relax.name(),
            nm: row.iter().map(|m| rounded(m.net * 1e9, 1e-2)).collect(),
            unevenness: Some(unevenness(row))
                .filter(|u| u.is_finite())
                .map(|u| rounded(u, 1e-4)),
        });
        Ok((best.map_or(Relax::Start, |i| ways[i]), rows.collect()))
    }

    /// Pulses with the least second harmonic, of up to `most` volts, that leaves no dead zone.
    pub(super) fn without_dead_zone(
        &self,
        relax: Relax,
        most: f64,
    ) -> Experiment<(Impulses, Shape)> {
        let impulses = self.impulses(relax, READINGS);
        let job = LeastPulse {
            impulses,
            shape: self.form,
            of: Amplitude::Second,
            most,
        };
        let a2 = self.on(format!("second-harmonic-{}", relax.name()), job)?;
        let a2 = a2.ok_or_else(|| {
            let message = format!(
                "no second harmonic of up to {most:.2} V removes the dead zone of {}; accepted is an \
                 amplifier that plays higher pulses",
                self.at
            );
            let file = format!("{}/machine.toml", self.setup.rig.name);
            Error::new(file, "drive.pulse.voltage", message)
        })?;
        Ok((impulses, self.form.scaled(a2)))
    }

    pub(super) fn dead_zones(&self, impulses: &Impulses, a2: f64) -> Experiment<Vec<DeadZone>> {
        [0.0, 0.25, 0.5, 0.75, 1.0]
            .par_iter()
            .map(|share| {
                let job = LeastPulse {
                    impulses: *impulses,
                    shape: self.form.scaled(share * a2),
                    of: Amplitude::First,
                    most: MAP[0] * self.unit,
                };
                let found = self.on(format!("dead-zone-{}", 100.0 * share), job)?;
                Ok(DeadZone {
                    a2_fsm: rounded(share * a2 / self.unit, 1e-3),
                    dead_zone_fsm: found.map(|a1| rounded(a1 / self.unit, 1e-3)),
                })
            })
            .collect()
    }

    /// Displacements over `a_1` from zero to `most` volts, and the scatter of repeated ones, metres rms.
    pub(super) fn curve(
        &self,
        impulses: &Impulses,
        shape: &Shape,
        most: f64,
    ) -> Experiment<(Vec<Point>, f64)> {
        let points = (0..POINTS)
            .into_par_iter()
            .map(|k| {
                let a1 = most * k as f64 / (POINTS - 1) as f64;
                let label = format!("curve-{}", k + 1);
                let moved = self.in_turn(label, impulses, PULSES, |f| shape.pulse(a1, f))?;
                let (mut displacement, mut net, mut squares) = (0.0, 0.0, 0.0);
                for (k, moved) in (0..).zip(moved) {
                    let sign = if is_forward(k) { 1.0 } else { -1.0 };
                    displacement += sign * moved.displacement / f64::from(PULSES);
                    net += sign * moved.net / f64::from(PULSES);
                    squares += moved.net.powi(2) / f64::from(PULSES);
                }
                let variance = (squares - net * net).max(0.0);
                let point = Point {
                    a1,
                    displacement,
                    net,
                };
                Ok((point, variance))
            })
            .collect::<Experiment<Vec<(Point, f64)>>>()?;
        let variance = points.iter().map(|(_, v)| v).sum::<f64>() / POINTS as f64;
        Ok((
            points.into_iter().map(|(point, _)| point).collect(),
            variance.sqrt(),
        ))
    }

    pub(super) fn displacement(
        &self,
        impulses: &Impulses,
        shape: &Shape,
        a1: f64,
    ) -> Experiment<f64> {
        let label = "displacement".to_owned();
        let moved = self.in_turn(label, impulses, PULSES, |f| shape.pulse(a1, f))?;
        let sum = (0..)
            .zip(moved)
            .fold(0.0, |sum, (k, moved)| sum + ahead(k, &moved));
        Ok(sum / f64::from(PULSES))
    }

    /// Displacement over both amplitudes.
    pub(super) fn map(&self, relax: Relax) -> Experiment<Map> {
        let impulses = self.impulses(relax, READINGS / 4);
        let grid = |most: f64, cells: usize| -> Vec<f64> {
            (1..=cells)
                .map(|k| rounded(most * k as f64 / cells as f64, 1e-6))
                .collect()
        };
        let (columns, rows) = (grid(MAP[0], CELLS[0]), grid(MAP[1], CELLS[1]));
        let drive = self.setup.rig.spec.drive(self.at.axis);
        let nm = rows
            .par_iter()
            .enumerate()
            .map(|(row, a2)| {
                let shape = self.form.scaled(a2 * self.unit);
                let pulses = columns.iter().zip(0..);
                let pulses = pulses.map(|(a1, k)| shape.pulse(a1 * self.unit, is_forward(k)));
                let playable: Vec<_> = pulses
                    .map(|p| p.check(drive).is_ok().then_some(p))
                    .collect();
                let job = PlayPulses {
                    impulses,
                    pulses: playable.iter().flatten().copied().collect(),
                };
                let mut moved = self.on(format!("map-{}", row + 1), job)?.into_iter();
                let nm = |(pulse, k): (&Option<Pulse>, u32)| {
                    pulse
                        .as_ref()
                        .and_then(|_| moved.next())
                        .map(|m| rounded(ahead(k, &m) * 1e9, 1e-2))
                };
                Ok(playable.iter().zip(0..).map(nm).collect())
            })
            .collect::<Experiment<Vec<_>>>()?;
        Ok(Map {
            a1_fsm: columns,
            a2_fsm: rows,
            nm,
        })
    }

    /// Displacements over so many machines that differ in what no one knows.
    pub(super) fn spread(
        &self,
        impulses: &Impulses,
        shape: &Shape,
        machines: usize,
    ) -> Experiment<Vec<Spread>> {
        let steps: Vec<f64> = (0..SPREAD_POINTS)
            .map(|k| MAP[0] * k as f64 / (SPREAD_POINTS - 1) as f64)
            .collect();
        let count = self.setup.rig.spec.drive(self.at.axis).count();
        let all = (0..machines)
            .into_par_iter()
            .map(|k| {
                let mut rng = Pcg64Mcg::seed_from_u64(self.seed.wrapping_add(k as u64));
                let draw: f64 = StandardNormal.sample(&mut rng);
                let mut setup = self.setup.clone();
                let joint = joint_plant(&mut setup, self.at.axis);
                joint.load_friction = joint
                    .load_friction
                    .times((1.0 + FRICTION * draw).max(0.1))
                    .map_err(unfit)?;
                joint.unrest.jolt = STATE * count;
                joint.unrest.history = k as u64 + 1;
                let machine = Bench {
                    setup: &setup,
                    form: self.form,
                    ..*self
                };
                let pulses = steps.iter().map(|a1| shape.pulse(a1 * self.unit, true));
                let job = PlayPulses {
                    impulses: *impulses,
                    pulses: pulses.collect(),
                };
                let moved = machine.on(format!("spread-{}", k + 1), job)?;
                Ok(moved.iter().map(|m| m.displacement).collect())
            })
            .collect::<Experiment<Vec<Vec<f64>>>>()?;
        Ok(steps
            .iter()
            .enumerate()
            .map(|(i, a1)| {
                let mut column: Vec<f64> = all.iter().map(|row| row[i]).collect();
                column.sort_by(f64::total_cmp);
                let at = |share: f64| {
                    rounded(
                        1e9 * column[(share * (machines - 1) as f64).round() as usize],
                        1e-3,
                    )
                };
                Spread {
                    a1: *a1,
                    p10: at(0.1),
                    p50: at(0.5),
                    p90: at(0.9),
                }
            })
            .collect())
    }

    /// The truth about one pulse, looked at in far shorter cycles.
    pub(super) fn trace(&self, pulse: &Pulse) -> Experiment<Trace> {
        let mut spec = self.setup.rig.spec.clone();
        let factor = (FINE_RATE / spec.servo.rate).ceil().max(1.0);
        spec.servo.rate *= factor;
        let ratio = 1.0 / spec.drive(self.at.axis).gear_ratio;
        let mut fine = self.setup.clone();
        fine.rig.spec = spec;
        let mut twin = fine.twin(self.seed)?;
        let mut command = Command::IDLE;
        command.pulses[self.at.side.index()][self.at.axis.index()] = Some(*pulse);
        let home = twin.output(self.at).unwrap_or(0.0);
        let (motor_home, output_home) = twin.angles(self.at);
        let period = twin.spec().period();
        let mut trace = Trace::default();
        for k in 0..(LOOK / period) as usize {
            let time = k as f64 * period;
            let (motor, output) = twin.angles(self.at);
            trace.time.push(time);
            trace.voltage.push(if time <= pulse.period {
                pulse.at(time)
            } else {
                0.0
            });
            trace
                .angles
                .push((ratio * (motor - motor_home), output - output_home));
            trace
                .output
                .push(twin.output(self.at).unwrap_or(home) - home);
            twin.exchange(&command)?;
            command.pulses = Command::NO_PULSES;
        }
        Ok(trace)
    }
}

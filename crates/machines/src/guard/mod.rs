//! The guard: stands around any machine and stops it before something breaks.
//!
//! It sees what crosses the boundary and nothing else: commands, measurements, the datasheet, and what
//! is believed of the geometry. It does not know what control is about to do, and believes none of
//! control's estimates. What it does about a broken rule is always the same (`retreat.rs`): slow down
//! within the limits, draw z back, let the motors hold by friction; from then on it answers every
//! command with the same [`Fault`], until a person clears it.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

mod across;
mod geometry;
mod keepout;
mod light;
mod retreat;
mod watch;

pub use geometry::{Arm, Facet, Geometry};
use keepout::{Keepout, Surprise, WHILE, Way};
use light::LightWatch;
use pigtail_hal::quantity::{Counts, Volts};
use pigtail_hal::spec::{AXES, MICRO_AXES, SIDES};
use pigtail_hal::{
    Axis, AxisName, Command, Fault, FiberHandling, Handled, Machine, Measurement, Rule, Side, Spec,
};
use pigtail_model::each::Each;
use pigtail_model::instructions::{Instructions, Work};
use watch::{OfAxes, Outputs, Piezos, Sensors, Stalls, of_axes};

/// A machine that is watched.
#[derive(Debug)]
pub struct Guard<M> {
    machine: M,
    limits: Limits,
    keepout: Keepout,
    light: LightWatch,
    sensors: Sensors,
    piezos: Piezos,
    stalls: Stalls,
    outputs: Outputs,
    /// How far out of its workspace an endpoint may be, metres: nowhere, but that one which a fault left out
    /// there has to come back.
    beyond: [f64; SIDES],
    last: Option<Last>,
    fault: Option<Fault>,
    /// Rules that an experiment breaks on purpose.
    exempt: &'static [Rule],
    /// Steps of the fiber handling that go on.
    handling: [Option<FiberHandling>; SIDES],
    /// Whether the conveyor brings another device.
    changing: bool,
}

/// What a guard remembers of a cycle.
#[derive(Debug, Clone, Copy)]
struct Last {
    micro: [[Volts; MICRO_AXES]; SIDES],
    laser: (bool, u8),
    time: f64,
    encoders: [[Counts; AXES]; SIDES],
    probes: Option<[[f64; AXES]; SIDES]>,
}

/// The datasheet's limits as the guard compares with them.
#[derive(Debug, Clone, PartialEq)]
struct Limits {
    period: f64,
    volts: [f64; AXES],
    micro_volts: f64,
    /// Most counts of an encoder in a cycle.
    jump: [i64; AXES],
    /// Most counts between reference and encoder.
    following: [i64; AXES],
    /// Metres for a count, to say it.
    metres_per_count: [f64; AXES],
    /// Metres at the probe for a count; nothing on a rig without probes.
    probe_per_count: OfAxes,
    /// How far from home, metres: x and y, z.
    reach: [f64; 2],
    /// Most metres within [`WHILE`] cycles: x and y together, z.
    way: [f64; 2],
    clearance: f64,
    retract: f64,
}

/// Share by which voltages may exceed their limit: what rounding leaves.
const ROUNDING: f64 = 1e-9;
/// Share of the workspace by which an endpoint may leave it: overshoot.
const OVERSHOOT: f64 = 0.02;
/// By what time an axis that moves may be behind its servo, beside what it may at rest, seconds.
const FOLLOWING: f64 = 5e-3;
/// Holders keep at least this from each other, metres.
const APART: f64 = 1e-3;
/// How far an endpoint may swing on its way back into its workspace, metres.
const SWING: f64 = 0.5e-3;

/// A broken rule; the time is the guard's to say.
struct Broken {
    rule: Rule,
    axis: String,
    value: String,
    limit: String,
}

impl Broken {
    fn new(rule: Rule, axis: impl Into<String>, value: String, limit: String) -> Self {
        Self {
            rule,
            axis: axis.into(),
            value,
            limit,
        }
    }

    fn at(self, time: f64) -> Fault {
        Fault {
            rule: self.rule,
            axis: self.axis,
            value: self.value,
            limit: self.limit,
            time,
        }
    }
}

impl<M> Guard<M> {
    /// A step of the fiber handling begins, or one is over: what is held, or what is there, is another.
    #[cold]
    fn handling(
        &mut self,
        begun: [Option<FiberHandling>; SIDES],
        ended: [Option<Handled>; SIDES],
        time: f64,
    ) {
        self.light.forget();
        for side in Side::ALL {
            let i = side.index();
            match begun[i] {
                Some(FiberHandling::Load(_)) => self.keepout.change_fiber(side, true, time),
                Some(FiberHandling::Attach | FiberHandling::Unload) => {
                    self.keepout.change_fiber(side, false, time);
                }
                // The others take their time.
                Some(what) => {
                    self.handling[i] = Some(what);
                    self.changing |= what == FiberHandling::Index;
                }
                None => {}
            }
            let Some(how) = ended[i] else { continue };
            match (self.handling[i].take(), how) {
                (Some(FiberHandling::Pick(_)), Handled::Done) => {
                    self.keepout.change_fiber(side, true, time);
                }
                (Some(FiberHandling::Release), Handled::Done) => {
                    self.keepout.change_fiber(side, false, time);
                }
                // Where tips stand before a chip is to be seen anew.
                (Some(FiberHandling::Index), Handled::Done) => self.keepout.change_chip(time),
                _ => {}
            }
        }
    }
}

impl<M: Machine> Guard<M> {
    /// Watches a machine that stands at home.
    pub fn new(machine: M, geometry: Geometry) -> Self {
        let spec = machine.spec().clone();
        Self {
            limits: Limits::new(&spec, &geometry),
            keepout: Keepout::new(&spec, geometry),
            light: LightWatch::new(&spec),
            sensors: Sensors::new(&spec),
            piezos: Piezos::new(&spec),
            stalls: Stalls::new(&spec),
            outputs: Outputs::new(&spec),
            machine,
            beyond: [0.0; SIDES],
            last: None,
            fault: None,
            exempt: &[],
            handling: [None; SIDES],
            changing: false,
        }
    }

    /// Leaves rules out from now on: those that an experiment breaks on purpose, and no others. All the rest is
    /// watched as before.
    pub fn leave_out(&mut self, rules: &'static [Rule]) {
        self.exempt = rules;
    }

    fn leaves_out(&self, rule: &Rule) -> bool {
        self.exempt.contains(rule)
    }

    /// The machine that is watched.
    pub fn inner(&self) -> &M {
        &self.machine
    }

    /// The machine that is watched, for whoever knows what it is.
    pub fn inner_mut(&mut self) -> &mut M {
        &mut self.machine
    }

    /// What is wrong with a command.
    fn check_command(&mut self, command: &Command) -> Result<(), Broken> {
        if !self.limits.allow(command) {
            self.check_volts(command)?;
        }
        if command.pulses.as_flattened().iter().any(Option::is_some) {
            self.check_pulses(command)?;
        }
        if self.leaves_out(&Rule::PiezoRunaway) {
            return Ok(());
        }
        self.piezos.check(&command.micro)
    }

    /// Which voltage is none that may be given.
    #[cold]
    fn check_volts(&self, command: &Command) -> Result<(), Broken> {
        for side in Side::ALL {
            for axis in Axis::ALL {
                let limit = self.limits.volts[axis.index()];
                let volts = command.motors[side.index()][axis.index()];
                voltage(volts, -limit, limit, || AxisName { side, axis }.to_string())?;
            }
            let most = self.limits.micro_volts;
            for (i, volts) in command.micro[side.index()].into_iter().enumerate() {
                voltage(volts, 0.0, most, || {
                    format!("{}.micro{}", side.name(), i + 1)
                })?;
            }
        }
        Ok(())
    }

    #[cold]
    fn check_pulses(&self, command: &Command) -> Result<(), Broken> {
        for side in Side::ALL {
            for axis in Axis::ALL {
                if let Some(pulse) = &command.pulses[side.index()][axis.index()]
                    && let Err(why) = pulse.check(self.machine.spec().drive(axis))
                {
                    let axis = AxisName { side, axis }.to_string();
                    return Err(Broken::new(why.rule, axis, why.value, why.limit));
                }
            }
        }
        Ok(())
    }

    /// What is wrong with what was measured.
    #[inline(always)]
    fn check_measurement(
        &mut self,
        command: &Command,
        measured: &Measurement,
    ) -> Result<(), Broken> {
        if measured.stop {
            return Err(Broken::new(
                Rule::StopRequest,
                "machine",
                "stop was pressed".to_owned(),
                "a machine that nobody stops".to_owned(),
            ));
        }
        // Begun first, for it waits for divisions and roots: what is known without it is looked at meanwhile.
        self.keepout.find(measured);
        if let Some(Last { time, .. }) = self.last {
            self.sensors.check(time, measured)?;
            self.check_motors(command, measured)?;
        } else {
            self.sensors.begin(measured.time);
            self.keepout.begin(measured.time);
        }
        let whole = self.keepout.note(measured, &command.micro);
        if self.last.is_some() && !self.leaves_out(&Rule::ServoFollowing) {
            self.check_following(command, measured)?;
        }
        if let Some(probes) = &measured.probes
            && !self.leaves_out(&Rule::OutputFollowing)
        {
            self.check_outputs(probes, measured)?;
        }
        self.check_places(whole)?;
        if let Some(frame) = &measured.vision {
            self.sensors.frame(frame, measured.time)?;
            let seen = self.keepout.see(frame, measured.time);
            if !self.leaves_out(&Rule::VisionAgreement) {
                seen.map_err(surprised)?;
            }
        }
        let near = self.keepout.nearest();
        if near.clearance < self.limits.clearance && !self.leaves_out(&Rule::ChipDistance) {
            return Err(Broken::new(
                Rule::ChipDistance,
                near.what,
                format!(
                    "{:.1} um by vision and encoders, were it stopped now",
                    near.clearance * 1e6
                ),
                format!("at least {:.1} um", self.limits.clearance * 1e6),
            ));
        }
        self.light.check(command, measured, &self.keepout)
    }

    /// Whether encoders go no faster than they can, and motors turn that are given voltage.
    #[inline(always)]
    fn check_motors(&mut self, command: &Command, measured: &Measurement) -> Result<(), Broken> {
        let limits = &self.limits;
        let stalls = !self.exempt.contains(&Rule::MotorStall);
        // Looked at where it lies: what is copied in narrow pieces and read at once in wide ones is waited for.
        let Some(before) = &self.last else {
            return Ok(());
        };
        let outputs = measured.probes.as_ref().zip(before.probes.as_ref());
        // By their numbers: a loop over sides and axes themselves keeps a list of each.
        for i in 0..SIDES {
            let went = outputs.map_or(Each([0.0; 4]), |(now, then)| {
                (of_axes(now[i]) - of_axes(then[i])) / limits.probe_per_count
            });
            for k in 0..AXES {
                let Counts(now) = measured.encoders[i][k];
                let Counts(then) = before.encoders[i][k];
                if (now - then).abs() > limits.jump[k] {
                    return Err(Broken::new(
                        Rule::EncoderSpeed,
                        AxisName::new(Side::ALL[i], Axis::ALL[k]).to_string(),
                        format!("{} counts in a cycle", now - then),
                        format!("at most {}", limits.jump[k]),
                    ));
                }
                if stalls && command.pulses[i][k].is_none() {
                    let volts = command.motors[i][k];
                    self.stalls.check((i, k), volts, now != then, went[k])?;
                }
            }
        }
        Ok(())
    }

    /// Whether axes are where their servos hold them to.
    #[inline(always)]
    fn check_following(&self, command: &Command, measured: &Measurement) -> Result<(), Broken> {
        let limits = &self.limits;
        for i in 0..SIDES {
            for k in 0..AXES {
                let Some(Counts(wanted)) = command.references[i][k] else {
                    continue;
                };
                let Counts(now) = measured.encoders[i][k];
                let away = (wanted - now).abs();
                if away <= limits.following[k] {
                    continue;
                }
                // One that moves is farther behind: speeds are looked at where it may matter.
                let Way { across, along, .. } = *self.keepout.way(i);
                let way = [across, across, along.abs()][k] / limits.metres_per_count[k];
                let most =
                    limits.following[k] + (FOLLOWING / WHILE as f64 / limits.period * way) as i64;
                if away > most {
                    let um = 1e6 * limits.metres_per_count[k];
                    return Err(Broken::new(
                        Rule::ServoFollowing,
                        AxisName::new(Side::ALL[i], Axis::ALL[k]).to_string(),
                        format!("{:.0} um away", away as f64 * um),
                        format!("at most {:.0} um at this speed", most as f64 * um),
                    ));
                }
            }
        }
        Ok(())
    }

    /// What the probes at the outputs say, where the rig has them.
    #[inline(always)]
    fn check_outputs(
        &mut self,
        probes: &[[f64; AXES]; SIDES],
        measured: &Measurement,
    ) -> Result<(), Broken> {
        let scale = self.limits.probe_per_count;
        let probes = [of_axes(probes[0]), of_axes(probes[1])];
        let (mut encoders, mut speeds) = ([Each([0.0; 4]); SIDES], [Each([0.0; 4]); SIDES]);
        for i in 0..SIDES {
            encoders[i] = of_axes(measured.encoders[i].map(|Counts(at)| at as f64)) * scale;
            let z = self.keepout.way(i).along;
            speeds[i][AXES - 1] = z / (WHILE as f64 * self.limits.period);
        }
        for side in Side::ALL {
            let i = side.index();
            let across = self.keepout.way(i).across / (WHILE as f64 * self.limits.period);
            let near = self.keepout.is_near(i);
            self.outputs
                .check_stuck(side, probes[i], encoders[i], across, near)?;
        }
        self.outputs.check(&probes, &encoders, &speeds)
    }

    #[inline(always)]
    fn check_places(&mut self, whole: [bool; SIDES]) -> Result<(), Broken> {
        let limits = &self.limits;
        for side in Side::ALL {
            let i = side.index();
            let at = self.keepout.stand(i, 0).endpoint;
            let [across, along] = limits.reach;
            let out = (at.x.abs() - across)
                .max(at.y.abs() - across)
                .max(at.z.abs() - along)
                .max(0.0);
            // What came back a little may not go out again.
            let beyond = self.beyond[i].min(if out > 0.0 { out + SWING } else { 0.0 });
            self.beyond[i] = beyond;
            let known = whole[i] && (at.x + at.y + at.z).is_finite();
            if !(known && out <= beyond) {
                return Err(Broken::new(
                    Rule::Workspace,
                    side.name(),
                    format!(
                        "x {:.2}, y {:.2}, z {:.2} mm from home",
                        at.x * 1e3,
                        at.y * 1e3,
                        at.z * 1e3
                    ),
                    format!(
                        "at most {:.2} mm in x and y, {:.2} mm in z",
                        across * 1e3,
                        along * 1e3
                    ),
                ));
            }
            let Way { across, along, .. } = *self.keepout.way(i);
            for (what, way, most) in [
                ("x-y", across, limits.way[0]),
                ("z", along.abs(), limits.way[1]),
            ] {
                if way > most && !self.leaves_out(&Rule::EndpointSpeed) {
                    let speed = |way: f64| way / (WHILE as f64 * limits.period) * 1e3;
                    return Err(Broken::new(
                        Rule::EndpointSpeed,
                        format!("{}, {what}", side.name()),
                        format!("{:.1} mm/s", speed(way)),
                        format!("at most {:.1} mm/s", speed(most)),
                    ));
                }
            }
        }
        let apart = self.keepout.between_holders();
        if apart < APART {
            return Err(Broken::new(
                Rule::HolderDistance,
                "left and right",
                format!("{:.2} mm", apart * 1e3),
                format!("at least {:.2} mm", APART * 1e3),
            ));
        }
        Ok(())
    }

    /// Stops the machine for a broken rule.
    #[cold]
    fn trip(&mut self, broken: Broken) -> Fault {
        let time = self.last.as_ref().map_or(0.0, |last| last.time);
        let fault = broken.at(time);
        self.retreat(&fault);
        self.fault = Some(fault.clone());
        fault
    }
}

/// A voltage that is a number from `low` to `high`; `name` is whose it is.
fn voltage(
    Volts(volts): Volts,
    low: f64,
    high: f64,
    name: impl FnOnce() -> String,
) -> Result<(), Broken> {
    let slack = ROUNDING * high;
    // A range that a NaN is outside of too.
    if (low - slack..=high + slack).contains(&volts) {
        return Ok(());
    }
    let rule = if volts.is_finite() {
        Rule::VoltageLimit
    } else {
        Rule::CommandNumber
    };
    let accepted = format!("{low} V to {high} V");
    Err(Broken::new(rule, name(), format!("{volts} V"), accepted))
}

fn surprised(Surprise { what, by, accepted }: Surprise) -> Broken {
    Broken::new(
        Rule::VisionAgreement,
        what,
        format!("{:.1} um from where they have it", by * 1e6),
        format!("at most {:.1} um", accepted * 1e6),
    )
}

impl Limits {
    fn new(spec: &Spec, geometry: &Geometry) -> Self {
        let guard = &spec.guard;
        let period = spec.period();
        let while_ = WHILE as f64 * period * guard.overspeed;
        let metres_per_count = Axis::ALL.map(|axis| {
            let drive = spec.drive(axis);
            let angle = drive.count() / drive.gear_ratio;
            let arm = &geometry.arms[0];
            match axis {
                Axis::A | Axis::B => arm.five_bar.proximal() * angle,
                Axis::Z => arm.screw.position(angle),
            }
        });
        let arm = spec.probe.as_ref().map_or(0.0, |probe| probe.arm);
        let joint = spec.drive(Axis::A);
        let at_joint = arm * joint.count() / joint.gear_ratio;
        let following = [guard.following_xy, guard.following_xy, guard.following_z];
        Self {
            period,
            volts: Axis::ALL.map(|axis| spec.drive(axis).voltage),
            micro_volts: spec.micro.voltage,
            jump: Axis::ALL.map(|axis| {
                let drive = spec.drive(axis);
                (guard.overspeed * drive.speed * period / drive.count()).ceil() as i64 + 1
            }),
            following: std::array::from_fn(|k| (following[k] / metres_per_count[k]).ceil() as i64),
            reach: [spec.five_bar.workspace, spec.z_stage.travel]
                .map(|whole| (0.5 + OVERSHOOT) * whole),
            // A count more than the speed allows is how an encoder counts.
            way: [
                spec.five_bar.speed * while_ + 2.0 * metres_per_count[0],
                spec.z_stage.speed * while_ + 2.0 * metres_per_count[2],
            ],
            probe_per_count: of_axes([at_joint, at_joint, metres_per_count[2]]),
            metres_per_count,
            clearance: guard.clearance,
            retract: guard.retract,
        }
    }

    /// Whether all voltages of a command are numbers in their ranges.
    #[inline(always)]
    fn allow(&self, command: &Command) -> bool {
        let (mut well, slack) = (true, ROUNDING * self.micro_volts);
        for (motors, micro) in command.motors.iter().zip(&command.micro) {
            for (Volts(volts), limit) in motors.iter().zip(self.volts) {
                well &= volts.abs() <= limit + ROUNDING * limit;
            }
            for Volts(volts) in micro {
                well &= (-slack..=self.micro_volts + slack).contains(volts);
            }
        }
        well
    }
}

/// What a guard checks of a measurement.
struct Check<'a, M> {
    guard: &'a mut Guard<M>,
    command: &'a Command,
    measured: &'a Measurement,
}

impl<M: Machine> Work for Check<'_, M> {
    type Output = Result<(), Broken>;

    #[inline(always)]
    fn work(self) -> Self::Output {
        self.guard.check_measurement(self.command, self.measured)
    }
}

impl<M: Machine> Guard<M> {
    /// A cycle under a command that was found good, and what is measured then. That stays where it is until it is handed on: it is large,
    /// and is the only thing that is given back here.
    fn watched(&mut self, command: &Command) -> Result<Measurement, Fault> {
        let mut answer = self.machine.exchange(command);
        if let Err(why) = self.watch(command, &answer) {
            answer = Err(why);
        }
        answer
    }

    /// What is wrong with what was answered; the machine is stopped then.
    fn watch(
        &mut self,
        command: &Command,
        answer: &Result<Measurement, Fault>,
    ) -> Result<(), Fault> {
        let measured = match answer {
            Ok(measured) => measured,
            Err(fault) => {
                self.fault = Some(fault.clone());
                return Err(fault.clone());
            }
        };
        if command.fiber != [None; SIDES] || measured.handled != [None; SIDES] {
            self.handling(command.fiber, measured.handled, measured.time);
        }
        if self.changing {
            self.light.change_device();
            self.changing = self.handling.contains(&Some(FiberHandling::Index));
        }
        let checked = Instructions::run_work(Check {
            guard: self,
            command,
            measured,
        });
        self.last = Some(Last {
            micro: command.micro,
            laser: (command.laser, command.laser_percent),
            time: measured.time,
            encoders: measured.encoders,
            probes: measured.probes,
        });
        checked.map_err(|broken| self.trip(broken))
    }
}

impl<M: Machine> Machine for Guard<M> {
    fn spec(&self) -> &Spec {
        self.machine.spec()
    }

    fn exchange(&mut self, command: &Command) -> Result<Measurement, Fault> {
        if let Some(fault) = &self.fault {
            return Err(fault.clone());
        }
        if let Err(broken) = self.check_command(command) {
            return Err(self.trip(broken));
        }
        self.watched(command)
    }

    fn stop(&mut self) {
        self.machine.stop();
        // It has gone on meanwhile, unwatched.
        self.last = None;
        self.keepout.forget();
    }

    /// What was believed of the tips goes with the fault: they are seen anew.
    fn clear(&mut self) -> Option<Fault> {
        let fault = self.fault.take()?;
        self.machine.clear();
        self.keepout.forget();
        self.light.forget();
        self.piezos = Piezos::new(self.machine.spec());
        self.stalls = Stalls::new(self.machine.spec());
        self.outputs = Outputs::new(self.machine.spec());
        self.beyond = [f64::INFINITY; SIDES];
        self.last = None;
        Some(fault)
    }
}

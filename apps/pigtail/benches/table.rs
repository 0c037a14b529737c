//! What everything costs beside one joint: `cargo bench -p pigtail --bench table`.
//!
//! Each line is worked out once a round, one after the other, and divided by what a joint alone took in the same
//! round: a machine that is busy slows all of them down alike. What is counted is the time of a core, not that of a
//! clock, so that waiting for a core is none of it. What is printed is the median of the rounds.
//! `-- --rounds N` makes more of them, `-- --csv` prints lines that `.ci/compare` reads.

use comfy_table::{ContentArrangement, Table, presets};
use cpu_time::ProcessTime;
use pigtail_control::servo::{Pid, PidState};
use pigtail_control::station::{Station, Unobserved};
use pigtail_control::trajectory::Arc;
use pigtail_evaluate::align::align;
use pigtail_evaluate::campaign::{self, Plan, Store};
use pigtail_hal::quantity::{Counts, Volts};
use pigtail_hal::spec::{AXES, CHANNELS, SIDES};
use pigtail_hal::{Axis, Command, Fault, LightSample, Machine, Measurement, Side, Spec};
use pigtail_model::batch::{Batch, LANES};
use pigtail_model::frames::Displacement;
use pigtail_model::group::{Group, States};
use pigtail_model::instructions::Instructions;
use pigtail_model::joint::{Joint, JointParameters, JointState};
use pigtail_session::guarded::guarded;
use pigtail_session::procedure::Procedure;
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME};
use pigtail_session::setup::Setup;
use pigtail_twin::Twin;
use std::f64::consts::TAU;
use std::hint::black_box;
use std::io::Write;
use std::sync::atomic::AtomicBool;

/// Cycles of joints and of machines in a round.
const CYCLES: usize = 5000;
/// Devices in a round, and the seed of the first.
const DEVICES: u64 = 32;
const SEED: u64 = 9000;
/// Devices of the campaign of which the time is taken off that of a larger one: what it takes to begin and to end.
const FIRST: u64 = 8;
/// Joints side by side: as many as one vector holds, and so many that those whose modes change fill some.
const TOGETHER: [(&str, usize); 2] = [("eight", LANES), ("sixty-four", MANY)];
const MANY: usize = 64;
/// Steps a cycle in the twin, of a five-bar's joint and of a z-stage's.
const STEPS: [f64; 2] = [2.0, 1.0];

/// Something that is timed.
struct Line<'a> {
    name: String,
    /// Of what a unit is counted.
    unit: &'static str,
    /// Works it out once; how many units that was.
    work: Box<dyn FnMut() -> f64 + 'a>,
    /// What of that is none of a unit, and taken off.
    less: Option<Box<dyn FnMut() + 'a>>,
    /// So many times another line, at most.
    bound: Option<(usize, f64)>,
    /// Seconds of a core for a unit, and beside a joint alone, of each round.
    seconds: Vec<f64>,
    ratios: Vec<f64>,
}

impl<'a> Line<'a> {
    fn new(name: impl Into<String>, unit: &'static str, work: impl FnMut() -> f64 + 'a) -> Self {
        Self {
            name: name.into(),
            unit,
            work: Box::new(work),
            less: None,
            bound: None,
            seconds: vec![],
            ratios: vec![],
        }
    }

    /// At most so many times what another line takes.
    fn at_most(self, times: f64, line: usize) -> Self {
        Self {
            bound: Some((line, times)),
            ..self
        }
    }

    /// Without the time that this takes.
    fn less(self, work: impl FnMut() + 'a) -> Self {
        Self {
            less: Some(Box::new(work)),
            ..self
        }
    }

    fn time(&mut self) -> f64 {
        // Of all threads: a campaign has one of its own for its rows.
        let begun = ProcessTime::now();
        let units = (self.work)();
        let all = begun.elapsed().as_secs_f64();
        let Some(less) = &mut self.less else {
            return all / units;
        };
        let begun = ProcessTime::now();
        less();
        (all - begun.elapsed().as_secs_f64()) / units
    }
}

fn median(values: &[f64]) -> f64 {
    let mut values = values.to_vec();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Joints of one kind in a slow triangle, in which they stick and slip all the time.
struct Kind {
    name: &'static str,
    joint: Joint,
    /// The same in the steps that the twin takes.
    fine: Joint,
    /// Of as many as fill one vector, and of many: each lies by itself, so that few are not timed by how long the voltages of many
    /// take to come from memory.
    few: Vec<[f64; LANES]>,
    many: Vec<[f64; MANY]>,
}

impl Kind {
    fn new(setup: &Setup, axis: Axis) -> Self {
        let spec = &setup.rig.spec;
        let (period, drive) = (spec.period(), spec.drive(axis));
        let gains = &setup.rig.calibration.gains;
        let (name, plant, gains, steps) = match axis {
            Axis::Z => ("z-stage", &setup.plant.z_stage.joint, &gains.z, STEPS[1]),
            _ => (
                "five-bar",
                &setup.plant.five_bar.joint,
                &gains.five_bar,
                STEPS[0],
            ),
        };
        let parameters: JointParameters =
            plant.nominal(1.0 / drive.gear_ratio).expect("a good plant");
        let joint = |steps: f64| Joint::new(parameters, period / steps).expect("a good plant");
        let (joint, fine) = (joint(1.0), joint(steps));
        let pid = Pid::new(gains, drive.voltage, period);
        let mut pids = [PidState::default(); MANY];
        let mut states = [JointState::default(); MANY];
        let voltages = (0..CYCLES).map(|k| {
            std::array::from_fn(|i| {
                // Each at its own point of the path, or their events would coincide.
                let phase = ((k + 613 * i) as f64 / CYCLES as f64).fract();
                let reference = Counts((200.0 * (1.0 - 4.0 * (phase - 0.5).abs())).round() as i64);
                let counts = Counts((states[i].motor_angle / drive.count()).round() as i64);
                let Volts(volts) = pid.voltage(&mut pids[i], reference, counts);
                joint.advance(&mut states[i], volts, period);
                volts
            })
        });
        let many: Vec<[f64; MANY]> = voltages.collect();
        let first = |of: &[f64; MANY]| std::array::from_fn(|i| of[i]);
        Self {
            few: many.iter().map(first).collect(),
            many,
            name,
            joint,
            fine,
        }
    }

    /// Eight of them, one by one; some times, for all else is divided by this.
    fn alone(&self, period: f64) -> f64 {
        const TIMES: usize = 4;
        for _ in 0..TIMES {
            let mut states = [JointState::default(); LANES];
            for voltages in &self.few {
                for (state, volts) in states.iter_mut().zip(voltages) {
                    self.joint.advance(state, *volts, period);
                }
            }
            black_box(states);
        }
        (TIMES * CYCLES * LANES) as f64
    }

    /// So many of them at once, as many joint-cycles of few as of many: a line that is over in a millisecond is one of noise.
    fn together(&self, joints: usize, period: f64, instructions: Instructions) -> f64 {
        for _ in 0..MANY / joints {
            let mut batch = Batch::new(&vec![self.joint; joints], period);
            for k in 0..CYCLES {
                let voltages = if joints == LANES {
                    &self.few[k][..]
                } else {
                    &self.many[k][..]
                };
                batch.advance_by(instructions, voltages);
            }
            black_box(batch.motor_angle(0));
        }
        (CYCLES * MANY) as f64
    }
}

/// The six joints of a machine, as the twin steps them.
fn six(five_bar: &Kind, z: &Kind, period: f64) -> f64 {
    let (joints, stages) = (
        Group::new([five_bar.fine; 4], period),
        Group::new([z.fine; 2], period),
    );
    let mut states = States::new([JointState::default(); 4]);
    let mut z_states = States::new([JointState::default(); 2]);
    for (a, b) in five_bar.few.iter().zip(&z.few) {
        joints.advance(&mut states, [a[0], a[1], a[2], a[3]]);
        stages.advance(&mut z_states, [b[0], b[1]]);
    }
    black_box((states, z_states));
    CYCLES as f64
}

/// Motors whose speed is their voltage, and light that never changes: nothing of a machine is in it.
struct Obedient {
    spec: Spec,
    cycles: u64,
    encoders: [[f64; AXES]; SIDES],
}

impl Machine for Obedient {
    fn spec(&self) -> &Spec {
        &self.spec
    }

    fn exchange(&mut self, command: &Command) -> Result<Measurement, Fault> {
        for (encoder, Volts(volts)) in self
            .encoders
            .as_flattened_mut()
            .iter_mut()
            .zip(command.motors.as_flattened())
        {
            *encoder += 0.2 * volts;
        }
        self.cycles += 1;
        let time = self.cycles as f64 * self.spec.period();
        let light = LightSample {
            time,
            volts: [Volts(1.0); CHANNELS],
        };
        Ok(Measurement {
            time,
            encoders: self.encoders.map(|axes| axes.map(|at| Counts(at as i64))),
            light: self.cycles.is_multiple_of(5).then_some(light),
            vision: None,
            probes: None,
            handled: [None; 2],
            stop: false,
        })
    }

    fn stop(&mut self) {}
}

/// A station whose manipulators go round and whose micros are never still.
fn drive(machine: &mut dyn Machine, setup: &Setup) -> f64 {
    let mut unobserved = Unobserved;
    let mut station =
        Station::new(machine, &setup.rig.calibration, &mut unobserved).expect("no fault");
    for side in Side::ALL {
        let arc = Arc::about(station.wanted(side), [5e-3, 0.0], TAU, 0.0);
        station.start_arc(side, arc, Some(5e-3)).expect("it fits");
    }
    for k in 0..CYCLES {
        let (sin, cos) = (0.05 * k as f64).sin_cos();
        for side in Side::ALL {
            station.move_micro(side, Displacement::new(1e-6 * cos, 1e-6 * sin));
        }
        station.cycle().expect("no fault");
    }
    CYCLES as f64
}

/// Machine time of a device, in cycles.
fn device(setup: &Setup, seed: u64) -> f64 {
    let document = align(setup, Procedure::Fast, seed, &mut Unobserved)
        .unwrap_or_else(|why| panic!("a good plant: {why}"));
    document.seconds_per_fiber * document.fibers.len() as f64 * setup.rig.spec.servo.rate
}

/// A campaign with its statistics and its report.
fn whole_campaign(setup: &Setup, devices: u64) {
    let folder = tempfile::tempdir().expect("a folder");
    let plan = Plan::new(setup, Procedure::Fast, SEED - FIRST, devices);
    let mut store = Store::begin(folder.path(), plan).expect("a campaign");
    campaign::run(&mut store, setup, 1, &AtomicBool::new(false), |_| {}).expect("a campaign");
    store.collect().expect("rows");
    let document = campaign::summarize(&store, 0.0).expect("rows");
    black_box(pigtail_report::campaign(&store, &document).expect("a report"));
}

fn lines(setup: &Setup) -> Vec<Line<'_>> {
    let period = setup.rig.spec.period();
    let kinds = || [Axis::A, Axis::Z].map(|axis| Kind::new(setup, axis));
    let twin = |seed| Twin::new(setup.rig.spec.clone(), &setup.plant, seed).expect("a good plant");
    let mut lines = vec![];
    for kind in kinds() {
        let kind = std::rc::Rc::new(kind);
        let alone = lines.len();
        let of = kind.clone();
        let name = format!("{} joint, alone", kind.name);
        lines.push(Line::new(name, "joint-cycle", move || of.alone(period)));
        for (joints, instructions) in TOGETHER
            .into_iter()
            .flat_map(|joints| Instructions::all().into_iter().map(move |by| (joints, by)))
        {
            let of = kind.clone();
            let (word, joints) = joints;
            let name = format!("{} joint, {word} by {}", kind.name, instructions.name());
            let line = Line::new(name, "joint-cycle", move || {
                of.together(joints, period, instructions)
            });
            lines.push(match instructions.name() {
                "AVX-512" => line.at_most(0.2, alone),
                "AVX2" => line.at_most(1.0 / 3.0, alone),
                _ => line,
            });
        }
    }
    let six_joints = lines.len();
    let [five_bar, z] = kinds();
    lines.push(Line::new("six joints", "cycle", move || {
        six(&five_bar, &z, period)
    }));
    lines.push(Line::new("servo cycle, no machine", "cycle", || {
        let mut machine = Obedient {
            spec: setup.rig.spec.clone(),
            cycles: 0,
            encoders: [[0.0; AXES]; SIDES],
        };
        drive(&mut machine, setup)
    }));
    lines.push(Line::new("station cycle, twin", "cycle", move || {
        drive(&mut twin(1), setup)
    }));
    lines.push(Line::new(
        "station cycle, guarded twin",
        "cycle",
        move || drive(&mut guarded(twin(1), &setup.rig), setup),
    ));
    let device_line = lines.len();
    let devices = || (SEED..SEED + DEVICES).map(|seed| device(setup, seed)).sum();
    lines.push(Line::new("device", "cycle", devices).at_most(2.5, six_joints));
    let cycles: f64 = devices();
    let name = format!("{DEVICES} devices more of a campaign");
    let campaign = Line::new(name, "cycle", move || {
        whole_campaign(setup, FIRST + DEVICES);
        cycles
    })
    .less(|| whole_campaign(setup, FIRST));
    lines.push(campaign.at_most(1.05, device_line));
    lines
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let rounds = arguments
        .iter()
        .position(|argument| argument == "--rounds")
        .and_then(|i| arguments.get(i + 1)?.parse().ok())
        .unwrap_or(15);
    let setup = Setup::load(DEFAULT_RIG_NAME, DEFAULT_RECIPE_NAME).expect("the rig is well");
    let mut lines = lines(&setup);
    for _ in 0..rounds {
        let mut joint = 0.0;
        for (i, line) in lines.iter_mut().enumerate() {
            let seconds = line.time();
            if i == 0 {
                joint = seconds;
            }
            line.seconds.push(seconds);
            line.ratios.push(seconds / joint);
        }
    }
    let mut out = std::io::stdout();
    let csv = arguments.iter().any(|argument| argument == "--csv");
    let mut table = Table::new();
    table
        .load_style(presets::ASCII_MARKDOWN)
        .set_content_arrangement(ContentArrangement::Disabled)
        .set_header(["", "ns of a core", "of a", "beside a joint", "bound"]);
    for line in &lines {
        let (ns, ratio) = (1e9 * median(&line.seconds), median(&line.ratios));
        if csv {
            writeln!(out, "{},{ns},{ratio}", line.name.replace(',', ";")).expect("it is printed");
            continue;
        }
        let bound = line.bound.map_or(String::new(), |(other, times)| {
            let other = &lines[other];
            let pairs = line.seconds.iter().zip(&other.seconds);
            let is = median(&pairs.map(|(a, b)| a / b).collect::<Vec<_>>());
            let verdict = if is <= times { "holds" } else { "FAILS" };
            format!("{is:.3} of {}, at most {times:.3}: {verdict}", other.name)
        });
        table.add_row([
            line.name.clone(),
            format!("{ns:.1}"),
            line.unit.to_owned(),
            format!("{ratio:.2}"),
            bound,
        ]);
    }
    if !csv {
        writeln!(out, "{table}").expect("it is printed");
    }
}

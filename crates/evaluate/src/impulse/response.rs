//! What pulses do to an axis: Figs. 4.13 to 4.19 and 4.21 of the thesis, measured on a twin.
//!
//! All but two of them are experiments through the boundary, which a machine could be asked as well.
//! The trajectory of a single pulse is the truth, for no encoder sees it; and the spread is that over
//! machines which differ in what no one knows, drawn around the rig's plant.

use super::bench::{Bench, MAP, Point, READINGS};
use pigtail_control::impulse::belief::ImpulseBelief;
use pigtail_control::impulse::experiment::parabola;
use pigtail_control::impulse::{Impulses, Relax, Shape};
use pigtail_control::station::Unobserved;
use pigtail_hal::pulse::HARMONICS;
use pigtail_hal::{Axis, AxisName, Error, Pulse};
use pigtail_numerics::rounded;
use pigtail_session::characterize::no_probe;
use pigtail_session::job::{Ended, Labelled};
use pigtail_session::pulses::BreakAway;
use pigtail_session::setup::Setup;
use pigtail_twin::plant::JointPlant;
use serde::Serialize;

/// Length of the pulses, seconds (thesis 4.3.1).
pub const PERIOD: f64 = 1e-3;
/// Time in which an axis comes to rest after one, seconds.
pub const REST: f64 = 0.04;
/// Machines that are usually drawn for the spread.
pub const MACHINES: usize = 200;
/// Where a single displacement is quoted, Fig. 4.16: `a_1` in units of the motor's static friction.
const QUOTED: f64 = 1.5;

/// What `characterize AXIS impulse` prints. Amplitudes are in units of the voltage at which the
/// motor breaks away, which the thesis calls fsm. Keys are a contract.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ResponseDocument {
    /// The axis.
    pub axis: String,
    /// The seed of the specimen.
    pub seed: u64,
    /// The unit of amplitudes, volts: measured by raising the voltage until the encoder moves.
    pub fsm_v: f64,
    /// Length of the pulses, milliseconds.
    pub period_ms: f64,
    /// How the transmission is brought back between pulses: what was found to be most even.
    pub relax: &'static str,
    /// The second harmonic that leaves no dead zone, by search.
    pub a2_fsm: f64,
    /// The third harmonic beside it.
    pub a3_fsm: f64,
    /// The fourth.
    pub a4_fsm: f64,
    /// The dead zone in `a_1` that is left with it.
    pub dead_zone_fsm: f64,
    /// The dead zone at other second harmonics.
    pub dead_zones: Vec<DeadZone>,
    /// `b` of the parabola (4.8), nanometres for `a_1 = 1`.
    pub b_nm: f64,
    /// Its `R^2` over the curve.
    pub r2: f64,
    /// A single displacement (Fig. 4.16).
    pub displacement_nm: Quoted,
    /// Displacements over machines whose load friction differs by 10 % and whose motor is displaced
    /// by a tenth of a count (Fig. 4.19), at the same `a_1`.
    pub spread: Spread,
    /// The curve over `a_1` with this second harmonic (Figs. 4.18, 4.21), and its spread.
    pub curve: Vec<CurveRow>,
    /// The same pulse in a row with each way to relax.
    pub rows: Vec<Row>,
    /// The map (Fig. 4.17).
    pub map: Map,
}

/// A dead zone.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct DeadZone {
    /// Second harmonic.
    pub a2_fsm: f64,
    /// Least `a_1` that moves the output; `null` above 5.
    pub dead_zone_fsm: Option<f64>,
}

/// One displacement.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Quoted {
    /// Amplitude.
    pub a1: f64,
    /// Displacement, nanometres.
    pub value: f64,
}

/// Percentiles, nanometres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// Amplitude.
    pub a1: f64,
    /// A tenth of the displacements lies below.
    pub p10: f64,
    /// Half of them do.
    pub p50: f64,
    /// A tenth lies above.
    pub p90: f64,
}

/// A point of the curve.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CurveRow {
    /// Amplitude.
    pub a1_fsm: f64,
    /// Mean displacement forward and backward, nanometres.
    pub nm: f64,
}

/// Pulses in a row.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// How the transmission is relaxed between them; `start` is not at all.
    pub relax: &'static str,
    /// Each displacement, nanometres.
    pub nm: Vec<f64>,
    /// Their spread over their mean; `null` where they get nowhere.
    pub unevenness: Option<f64>,
}

/// Displacement over both amplitudes, nanometres; `null` beyond the amplifier's voltage.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Map {
    /// The columns' amplitudes.
    pub a1_fsm: Vec<f64>,
    /// The rows' amplitudes.
    pub a2_fsm: Vec<f64>,
    /// A row for each second harmonic.
    pub nm: Vec<Vec<Option<f64>>>,
}

/// What the report shows beside the document.
#[derive(Debug, Clone, PartialEq)]
pub struct Figures {
    /// A single pulse, the truth.
    pub trace: Trace,
    /// The spread at each of its points.
    pub spread: Vec<Spread>,
}

/// The truth about a single pulse.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trace {
    /// Seconds.
    pub time: Vec<f64>,
    /// Volts.
    pub voltage: Vec<f64>,
    /// Motor angle times the gear's ratio, and output, radians.
    pub angles: Vec<(f64, f64)>,
    /// Displacement of the output, metres.
    pub output: Vec<f64>,
}

/// What was found of an axis, for whoever believes it from now on.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// The unit of amplitudes, volts.
    pub unit: f64,
    /// How to play pulses.
    pub impulses: Impulses,
    /// Their shape.
    pub shape: Shape,
    /// The curve: volts of `a_1`, metres once relaxed.
    pub curve: Vec<[f64; 2]>,
    /// Of a five-bar joint, how far from it that was measured, metres.
    pub arm: Option<f64>,
    /// Spread of repeated displacements, rms, metres.
    pub scatter: f64,
}

/// Points of the curve that a calibration keeps.
const KEPT: usize = 26;

impl Found {
    /// As a table of a calibration, found on a `date` by an `origin`.
    pub fn table(&self, date: &str, origin: &str) -> Vec<(&'static str, toml_edit::Item)> {
        use toml_edit::{Array, value};
        let dither = match self.impulses.relax {
            Relax::Dither { amplitude } => amplitude,
            Relax::Start | Relax::Servo => 0.0,
        };
        let volts = |volts: f64| rounded(volts, 1e-6);
        let fixed: Array = self.shape.fixed.iter().map(|a| volts(*a)).collect();
        let every = (self.curve.len() - 1).div_ceil(KEPT - 1).max(1);
        let mut highest = 0.0;
        let curve: Array = self
            .curve
            .iter()
            .step_by(every)
            .map(|[a1, metres]| {
                // A curve rises; what noise says else it does not say.
                highest = f64::max(highest, *metres);
                [volts(*a1), rounded(highest, 1e-12)]
                    .into_iter()
                    .collect::<Array>()
            })
            .collect();
        let mut table = vec![
            ("unit", value(format!("{:.6} V", self.unit))),
            ("fixed", value(fixed)),
            (
                "period",
                value(format!("{:.6} ms", 1e3 * self.shape.period)),
            ),
            ("relax", value(self.impulses.relax.name())),
            ("dither", value(format!("{dither:.6} V"))),
            ("rest", value(format!("{:.3} ms", 1e3 * self.impulses.rest))),
            ("curve", value(curve)),
            ("scatter", value(format!("{:.3} nm", 1e9 * self.scatter))),
            ("date", value(date)),
            ("origin", value(origin)),
        ];
        if let Some(arm) = self.arm {
            table.push(("arm", value(format!("{:.6} mm", 1e3 * arm))));
        }
        table
    }
}

type Experiment<T> = Result<T, Ended>;

/// What is fixed of the pulses that an axis is characterized by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Form {
    /// `a_2` to `a_4` in units of the motor's static friction; `None` for the thesis's, a second harmonic
    /// that leaves no dead zone, which is searched for.
    pub fixed: Option<[f64; HARMONICS - 1]>,
    /// Length, seconds.
    pub period: f64,
}

impl Form {
    /// The thesis's.
    pub const THESIS: Self = Self {
        fixed: None,
        period: PERIOD,
    };

    /// Its proportions: the second harmonic is one volt.
    fn proportions(&self) -> Shape {
        let [a2, a3, a4] = self.fixed.unwrap_or([1.0, 0.0, 0.0]);
        Shape {
            fixed: [1.0, a3 / a2, a4 / a2],
            period: self.period,
        }
    }
}

/// Characterizes an axis of the twin that `seed` draws, by pulses of a form whose `a_2` is above zero;
/// the spread is that over so many `machines`, at least one.
///
/// # Errors
///
/// A rig without a probe or whose amplifiers do not play such pulses; a fault.
pub fn response(
    setup: &Setup,
    at: AxisName,
    form: &Form,
    machines: usize,
    seed: u64,
) -> Experiment<(ResponseDocument, Figures, Found)> {
    let wanted = form.fixed;
    let form = form.proportions();
    can_play_form(setup, at.axis, &form)?;
    let job = Labelled {
        label: "break-away".to_owned(),
        job: BreakAway { at, rest: REST },
    };
    let unit = setup.run(&job, seed, &mut Unobserved)?;
    let bench = Bench {
        setup,
        at,
        seed,
        unit,
        form,
    };
    bench.check(wanted)?;
    let limit = bench.limit();
    let most = (MAP[1] * unit).min(limit);
    let search = |relax: Relax| match wanted {
        Some([a2, ..]) => Ok((bench.impulses(relax, READINGS), form.scaled(a2 * unit))),
        None => bench.without_dead_zone(relax, most),
    };
    let quoted = |shape: &Shape| shape.pulse(QUOTED * unit, true);
    // How to relax is first judged by pulses of the first harmonic, which move any axis that pulses
    // can move, and once more by the pulses that are to be played.
    let first = form.scaled(0.0).pulse(MAP[0] * unit, true);
    let mut relax = bench.relaxations("relax-first", first)?.0;
    let (mut impulses, mut shape) = search(relax)?;
    let (better, rows) = bench.relaxations("relax", quoted(&shape))?;
    if better != relax {
        relax = better;
        (impulses, shape) = search(relax)?;
    }
    let a2 = shape.fixed[0];
    let dead_zones = bench.dead_zones(&impulses, a2)?;
    let (curve, scatter) = bench.curve(&impulses, &shape, MAP[0] * unit)?;
    let (b, r2) = through(&curve, unit);
    let spread = bench.spread(&impulses, &shape, machines)?;
    let displacement = bench.displacement(&impulses, &shape, QUOTED * unit)?;
    let map = bench.map(relax)?;
    let nm = |metres: f64| rounded(metres * 1e9, 1e-3);
    let fsm = |volts: f64| rounded(volts / unit, 1e-3);
    let document = ResponseDocument {
        axis: at.to_string(),
        seed,
        fsm_v: rounded(unit, 1e-4),
        period_ms: rounded(form.period * 1e3, 1e-6),
        relax: relax.name(),
        a2_fsm: fsm(a2),
        a3_fsm: fsm(shape.fixed[1]),
        a4_fsm: fsm(shape.fixed[2]),
        dead_zone_fsm: dead_zones
            .last()
            .and_then(|d| d.dead_zone_fsm)
            .unwrap_or(MAP[0]),
        dead_zones,
        b_nm: nm(b),
        r2: rounded(r2, 1e-4),
        displacement_nm: Quoted {
            a1: QUOTED,
            value: nm(displacement),
        },
        spread: spread
            .iter()
            .find(|s| s.a1 >= QUOTED)
            .copied()
            .unwrap_or(spread[0]),
        curve: curve
            .iter()
            .map(|point| CurveRow {
                a1_fsm: fsm(point.a1),
                nm: nm(point.displacement),
            })
            .collect(),
        rows,
        map,
    };
    let figures = Figures {
        trace: bench.trace(&quoted(&shape))?,
        spread,
    };
    let arm = setup.rig.spec.probe.as_ref().map(|probe| probe.arm);
    let found = Found {
        unit,
        arm: arm.filter(|_| at.axis != Axis::Z),
        impulses,
        shape,
        curve: curve.iter().map(|point| [point.a1, point.net]).collect(),
        scatter,
    };
    Ok((document, figures, found))
}

/// The truth about a single pulse on the specimen that `seed` draws.
///
/// # Errors
///
/// A fault, or a rig that cannot play it.
pub fn single(setup: &Setup, at: AxisName, seed: u64, pulse: &Pulse) -> Experiment<Trace> {
    can_play(setup, at.axis)?;
    let bench = Bench {
        setup,
        at,
        seed,
        unit: 1.0,
        form: Form::THESIS.proportions(),
    };
    bench.trace(pulse)
}

/// What is believed of an axis's pulses with the curve of the specimen that `seed` draws in place of
/// its own, over the same amplitudes.
///
/// # Errors
///
/// A fault.
pub fn measured(
    setup: &Setup,
    at: AxisName,
    seed: u64,
    belief: &ImpulseBelief,
) -> Experiment<ImpulseBelief> {
    let bench = Bench {
        setup,
        at,
        seed,
        unit: belief.unit,
        form: belief.shape(),
    };
    let most = belief
        .curve
        .last()
        .map_or(MAP[0] * belief.unit, |last| last[0]);
    let (points, scatter) = bench.curve(&belief.impulses(at, READINGS), &belief.shape(), most)?;
    let mut highest = 0.0;
    let curve = points
        .iter()
        .map(|point| {
            highest = f64::max(highest, point.net);
            [point.a1, highest]
        })
        .collect();
    Ok(ImpulseBelief {
        curve,
        scatter,
        ..belief.clone()
    })
}

/// The map (Fig. 4.17) of the specimen that `seed` draws, with harmonics and relaxing as believed.
///
/// # Errors
///
/// A rig that cannot be asked ([`can_play`]); a fault.
pub fn map(setup: &Setup, at: AxisName, seed: u64, belief: &ImpulseBelief) -> Experiment<Map> {
    can_play(setup, at.axis)?;
    let bench = Bench {
        setup,
        at,
        seed,
        unit: belief.unit,
        form: belief.shape(),
    };
    bench.map(belief.impulses(at, READINGS).relax)
}

/// Whether the rig can be asked at all.
///
/// # Errors
///
/// What its datasheet lacks.
pub fn can_play(setup: &Setup, axis: Axis) -> Result<(), Error> {
    can_play_form(setup, axis, &Form::THESIS.proportions())
}

fn can_play_form(setup: &Setup, axis: Axis, form: &Shape) -> Result<(), Error> {
    if setup.rig.spec.probe.is_none() {
        return Err(no_probe(&setup.rig));
    }
    let key = match axis {
        Axis::A | Axis::B => "five_bar.drive.pulse",
        Axis::Z => "z_stage.drive.pulse",
    };
    if setup.rig.spec.drive(axis).pulse.is_none() {
        return Err(Error::new(
            format!("{}/machine.toml", setup.rig.name),
            key,
            "is not there: the amplifier plays no pulses; accepted is one that does, with `voltage` \
             and `bandwidth`",
        ));
    }
    let shortest = form.scaled(1e-3).pulse(1e-3, true);
    shortest.check(setup.rig.spec.drive(axis)).map_err(|why| {
        Error::new(
            format!("{}/machine.toml", setup.rig.name),
            key,
            why.to_string(),
        )
    })
}

/// The friction of an axis's kind in a plant.
pub(super) fn joint_plant(setup: &mut Setup, axis: Axis) -> &mut JointPlant {
    match axis {
        Axis::A | Axis::B => &mut setup.plant.five_bar.joint,
        Axis::Z => &mut setup.plant.z_stage.joint,
    }
}

/// The parabola (4.8) through a curve: `b` for an `a_1` of one unit, metres, and `R^2`.
fn through(curve: &[Point], unit: f64) -> (f64, f64) {
    let steps: Vec<f64> = curve.iter().map(|point| point.a1 / unit).collect();
    let moved: Vec<f64> = curve.iter().map(|point| point.displacement).collect();
    parabola(&steps, &moved)
}

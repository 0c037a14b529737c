//! Identification on a twin, and what compensation is worth there by the truth.

use pigtail_control::calibration::Calibration;
use pigtail_control::compensation::micro::MicroModel;
use pigtail_control::identify::Path;
use pigtail_control::piezo::Micro;
use pigtail_control::station::Unobserved;
use pigtail_hal::{Command, Fault, Machine, Measurement, Side, Spec};
use pigtail_model::frames::Displacement;
use pigtail_numerics::line::Line;
use pigtail_numerics::rounded;
use pigtail_records::hysteresis::Kind;
use pigtail_session::job::Ended;
use pigtail_session::piezos::IdentifyPiezos;
use pigtail_session::session::Session;
use pigtail_session::setup::Setup;
use pigtail_twin::Twin;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use serde::Serialize;

/// Half the stroke of the scans, metres along one piezo: all specimens reach it.
const HALF: f64 = 30e-6;

/// Speed of the scans, m/s: a way takes a second.
const SPEED: f64 = 2.0 * HALF;

/// A path that a micro was told to follow, and how well it did.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PathRow {
    /// What was followed.
    pub name: &'static str,
    /// Root mean square error without compensation, micrometres.
    pub uncompensated_um: f64,
    /// With the thesis's model.
    pub rbf_um: f64,
    /// With the model that remembers.
    pub memory_um: f64,
    /// How many times better the thesis's is.
    pub rbf_improvement: f64,
    /// How many times better the one that remembers is.
    pub memory_improvement: f64,
}

/// What `identify hysteresis` prints as JSON and keeps as `summary.json`. The keys in common with a
/// record's are those of the forward-and-back scan, by the truth; all errors are those that the
/// best straight line leaves, with compensation as without.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MachineDocument {
    /// The side whose micro it was.
    pub side: &'static str,
    /// The model that was written.
    pub model: &'static str,
    /// Root mean square error of the displacement with it.
    pub rms_um: f64,
    /// Largest.
    pub max_um: f64,
    /// Range of the scan.
    pub range_um: f64,
    /// `rms_um` over `range_um`.
    pub percent_of_range: f64,
    /// The same without compensation.
    pub uncompensated_percent: f64,
    /// How many times better.
    pub improvement: f64,
    /// Number of basis functions or play operators.
    pub functions: usize,
    /// Largest difference between the way back and the way forward, over the range: the thesis's
    /// measure, 15 % without compensation and 0.75 % with.
    pub opening_percent: f64,
    /// The same without compensation.
    pub uncompensated_opening_percent: f64,
    /// By how much the scan's best straight line is too steep.
    pub gain_error_percent: f64,
    /// The same without compensation.
    pub uncompensated_gain_error_percent: f64,
    /// Root mean square that the model left of what was measured of each piezo.
    pub residual_um: [f64; 2],
    /// Displacement in y for one in x.
    pub ratio: f64,
    /// All paths that were followed.
    pub paths: Vec<PathRow>,
    /// The seed of the machine.
    pub seed: u64,
    /// The calibration that was written; empty when none was.
    pub calibration: String,
    /// The weights.
    pub model_file: String,
    /// Path of the report.
    pub report: String,
}

/// What `identify hysteresis` prints of all the micros that were identified: above, the document of
/// the one whose scan forward and back gained least; below it each.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MicrosDocument {
    /// The one that gained least.
    #[serde(flatten)]
    pub least: MachineDocument,
    /// All of them.
    pub sides: Vec<MachineDocument>,
}

impl MicrosDocument {
    /// Of these documents; `None` of none.
    pub fn new(sides: Vec<MachineDocument>) -> Option<Self> {
        let least = sides
            .iter()
            .min_by(|a, b| a.improvement.total_cmp(&b.improvement))?
            .clone();
        Some(Self { least, sides })
    }
}

/// A machine whose truth is noted in every cycle.
struct Watched {
    twin: Twin,
    /// The side of the tip that is watched.
    side: Side,
    /// The tip's displacement in x and y, metres.
    seen: Vec<Displacement>,
}

impl Machine for Watched {
    fn spec(&self) -> &Spec {
        self.twin.spec()
    }

    fn exchange(&mut self, command: &Command) -> Result<Measurement, Fault> {
        let measurement = self.twin.exchange(command)?;
        self.seen.push(self.twin.micro_displacement(self.side));
        Ok(measurement)
    }

    fn stop(&mut self) {
        self.twin.stop();
    }
}

/// What was wanted of a tip along a path, and where it was.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Followed {
    /// Along the first piezo, metres.
    pub wanted: Vec<f64>,
    /// Where it was.
    pub was: Vec<f64>,
}

impl Followed {
    /// What is judged: from a sample on, the last of every so many.
    fn judged(&self, from: usize, every: usize) -> (Vec<f64>, Vec<f64>) {
        let pick = |column: &[f64]| {
            let chosen = column.iter().skip(from + every - 1).step_by(every);
            chosen.copied().collect()
        };
        (pick(&self.wanted), pick(&self.was))
    }

    /// The thesis's measure of hysteresis, of a scan that ends with two full ways: the largest
    /// difference between the way back and the way forward at one wanted displacement, metres.
    pub fn opening(&self) -> f64 {
        let n = self.wanted.len();
        // The path goes from 0 to -1, then six full ways.
        let way = 2 * n / 13;
        (0..way)
            .map(|k| (self.was[n - 1 - k] - self.was[n - 2 * way + k]).abs())
            .fold(0.0, f64::max)
    }

    /// Errors but for the best straight line, and by how much its slope is not one. A path that
    /// rests has no slope.
    pub fn errors(&self, from: usize, every: usize) -> (Vec<f64>, f64) {
        let (wanted, was) = self.judged(from, every);
        let points = wanted.into_iter().zip(was);
        let line = Line::through(points.clone());
        let errors = points.map(|(w, x)| line.left(w, x)).collect();
        let off = if line.spread > 0.0 {
            line.slope - 1.0
        } else {
            0.0
        };
        (errors, off)
    }
}

/// One of the paths that are tried.
struct Trial {
    name: &'static str,
    /// Displacement along each piezo, metres, cycle by cycle.
    path: Vec<Displacement>,
    /// The cycle from which on it is judged.
    from: usize,
    /// Every how many cycles: points at which a tip rests are judged at their end.
    every: usize,
}

fn along(turns: &[f64], period: f64) -> Vec<Displacement> {
    let path = Path {
        turns: turns.iter().map(|t| HALF * t).collect(),
        speed: SPEED,
    };
    let cycles = (path.duration() / period) as usize;
    (0..cycles)
        .map(|k| Displacement::new(path.at(k as f64 * period), 0.0))
        .collect()
}

/// The paths of the comparison. Each begins with two full ways, so that a model of one turning
/// point too knows where it is.
fn trials(period: f64, seed: u64) -> Vec<Trial> {
    let lead = [0.0, -1.0, 1.0, -1.0];
    let from = along(&lead, period).len();
    let with = |turns: &[f64]| along(&[&lead, turns].concat(), period);
    let mut rng = Pcg64Mcg::seed_from_u64(seed.wrapping_add(1000));
    let nested: Vec<f64> = (0..12)
        .flat_map(|k| [1.0 - 0.08 * f64::from(k), -0.96 + 0.08 * f64::from(k)])
        .collect();
    let walk: Vec<f64> = (0..24).map(|_| 2.0 * rng.random::<f64>() - 1.0).collect();
    // The nine points of a climb whose centre moves on by a step each time, up and half way back.
    let mut climb = with(&[0.0]);
    let climb_from = climb.len();
    let step = 0.5e-6;
    let dwell = (4e-3 / period).round() as usize;
    let nine = [
        (0, 0),
        (1, 0),
        (1, 1),
        (0, 1),
        (-1, 1),
        (-1, 0),
        (-1, -1),
        (0, -1),
        (1, -1),
    ];
    let centres = (0..30).chain((15..30).rev());
    for centre in centres {
        for (a, b) in nine {
            let at = |k: i32| step * f64::from(centre + k);
            climb.extend(std::iter::repeat_n(Displacement::new(at(a), at(b)), dwell));
        }
    }
    let mut hold = with(&[0.7]);
    let hold_from = hold.len() + (0.05 / period) as usize;
    let last = hold[hold.len() - 1];
    hold.extend(std::iter::repeat_n(last, (600.0 / period) as usize));
    let trial = |name, path, from| Trial {
        name,
        path,
        from,
        every: 1,
    };
    vec![
        trial("forward and back", with(&[1.0, -1.0, 1.0, -1.0]), from),
        trial(
            "back from other turns",
            with(&[0.6, -1.0, 0.2, -1.0, -0.3, -1.0]),
            from,
        ),
        trial("nested loops", with(&nested), from),
        trial("random turns", with(&walk), from),
        Trial {
            every: dwell,
            ..trial("nine-point climb", climb, climb_from)
        },
        trial("ten minutes of hold", hold, hold_from),
    ]
}

/// Follows a path on a machine as it is switched on.
fn follow(
    setup: &Setup,
    calibration: &Calibration,
    side: Side,
    seed: u64,
    path: &[Displacement],
) -> Result<Followed, Ended> {
    let mut watched = Watched {
        twin: setup.twin(seed)?,
        side,
        seen: Vec::with_capacity(path.len() + 1),
    };
    let mut rig = setup.rig.clone();
    rig.calibration = calibration.clone();
    let (sin, cos) = rig.spec.micro.angle.sin_cos();
    let mut session = Session::open_with(&rig, &mut watched, &setup.options);
    session.experiment(|station| {
        for along in path {
            station.move_micro(side, along.turned(sin, cos));
            station.cycle()?;
        }
        Ok(())
    })?;
    drop(session);
    let seen = &watched.seen;
    Ok(Followed {
        wanted: path.iter().map(|at| at.x).collect(),
        was: seen[1..].iter().map(|at| at.turned(-sin, cos).x).collect(),
    })
}

/// What came of an identification.
#[derive(Debug, Clone)]
pub struct Identified {
    /// What to print.
    pub document: MachineDocument,
    /// What was found.
    pub micro: Micro,
    /// The model that was asked for.
    pub model: MicroModel,
    /// The scan forward and back: without compensation, by the thesis's model, by the other.
    pub scans: [Followed; 3],
    /// Where they are judged from.
    pub from: usize,
}

fn rms(errors: &[f64]) -> f64 {
    (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt()
}

/// Identifies the piezos of a side's micro, and tries both models on them.
///
/// # Errors
///
/// A fault, or what hinders the identification.
pub fn identify(setup: &Setup, kind: Kind, side: Side, seed: u64) -> Result<Identified, Ended> {
    identify_along(setup, kind, side, seed, usize::MAX)
}

/// The same, tried on the first of the paths only, forward and back.
///
/// # Errors
///
/// As [`identify`].
pub fn identify_and_scan(
    setup: &Setup,
    kind: Kind,
    side: Side,
    seed: u64,
) -> Result<Identified, Ended> {
    identify_along(setup, kind, side, seed, 1)
}

fn identify_along(
    setup: &Setup,
    kind: Kind,
    side: Side,
    seed: u64,
    most: usize,
) -> Result<Identified, Ended> {
    let micro = setup.run(&IdentifyPiezos { side }, seed, &mut Unobserved)?;
    let models = [micro.rbf(), micro.memory()];
    let calibrations = [
        with_model(&setup.rig.calibration, side, None),
        with_model(&setup.rig.calibration, side, Some(&models[0])),
        with_model(&setup.rig.calibration, side, Some(&models[1])),
    ];
    let um = |value: f64| rounded(1e6 * value, 1e-5);
    let mut paths = Vec::new();
    let mut scans = None;
    for trial in trials(setup.rig.spec.period(), seed).into_iter().take(most) {
        let ([none, rbf], memory) = rayon::join(
            || [0, 1].map(|k| follow(setup, &calibrations[k], side, seed, &trial.path)),
            || follow(setup, &calibrations[2], side, seed, &trial.path),
        );
        let followed: [Followed; 3] = [none?, rbf?, memory?];
        let errors = followed
            .each_ref()
            .map(|followed| rms(&followed.errors(trial.from, trial.every).0));
        paths.push(PathRow {
            name: trial.name,
            uncompensated_um: um(errors[0]),
            rbf_um: um(errors[1]),
            memory_um: um(errors[2]),
            rbf_improvement: rounded(errors[0] / errors[1], 1e-2),
            memory_improvement: rounded(errors[0] / errors[2], 1e-2),
        });
        if scans.is_none() {
            scans = Some((followed, trial.from));
        }
    }
    let (scans, from) = scans.unwrap_or_default();
    let chosen = match kind {
        Kind::Rbf => 0,
        Kind::Memory => 1,
    };
    let (errors, gain_error) = scans[1 + chosen].errors(from, 1);
    let (plain, plain_gain_error) = scans[0].errors(from, 1);
    let plain = rms(&plain);
    let range = 2.0 * HALF;
    let percent = |value: f64| rounded(100.0 * value / range, 1e-5);
    let model = models[chosen].clone();
    let residual_um = std::array::from_fn(|i| um(micro.piezos[i].residual(&model.piezos[i])));
    let document = MachineDocument {
        side: side.name(),
        model: model.piezos[0].name(),
        rms_um: um(rms(&errors)),
        max_um: um(errors.iter().fold(0.0, |m: f64, e| m.max(e.abs()))),
        range_um: um(range),
        percent_of_range: percent(rms(&errors)),
        uncompensated_percent: percent(plain),
        improvement: rounded(plain / rms(&errors), 1e-2),
        functions: model.piezos[0].functions(),
        opening_percent: percent(scans[1 + chosen].opening()),
        uncompensated_opening_percent: percent(scans[0].opening()),
        gain_error_percent: rounded(100.0 * gain_error, 1e-4),
        uncompensated_gain_error_percent: rounded(100.0 * plain_gain_error, 1e-4),
        residual_um,
        ratio: rounded(micro.ratio, 1e-5),
        paths,
        seed,
        calibration: String::new(),
        model_file: String::new(),
        report: String::new(),
    };
    Ok(Identified {
        document,
        micro,
        model,
        scans,
        from,
    })
}

/// A calibration with another model of a side's piezos, or none.
pub fn with_model(
    calibration: &Calibration,
    side: Side,
    model: Option<&MicroModel>,
) -> Calibration {
    let mut calibration = calibration.clone();
    calibration.hysteresis.set(side, model.cloned());
    calibration
}

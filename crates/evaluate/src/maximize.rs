//! Light throughput maximization (thesis 3.3), measured: how fast a peak may move, what of other
//! motion is rejected, what the way in z takes, and the times of 3.4.

use crate::align::{AlignmentDocument, align};
use pigtail_control::maximization::{Disturbance, Followed, Means, Trial};
use pigtail_control::recipe::Climb;
use pigtail_control::station::{Observer, Sample, Unobserved};
use pigtail_hal::{Channel, Side};
use pigtail_numerics::rounded;
use pigtail_session::follow::Follow;
use pigtail_session::job::{Ended, Labelled};
use pigtail_session::procedure::Procedure;
use pigtail_session::setup::Setup;
use rayon::prelude::*;
use serde::Serialize;
use std::thread;

/// What `pigtail maximize` prints as JSON. Keys are a contract: more may come, none changes its name
/// or meaning. The same seed gives the same values.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MaximizationDocument {
    /// The rig as it was named.
    pub rig: String,
    /// The seed of machine, device, fixture and noise.
    pub seed: u64,
    /// How fast a peak may drift, by each means of following it.
    pub tracking: Vec<Tracking>,
    /// What is left of other motion.
    pub rejection: Vec<Rejection>,
    /// The way in z with the peak walking aside (refraction), by the thesis's procedure.
    pub approach: Option<Approach>,
    /// Seconds a fiber in each part of the work, as in 3.4.
    pub timing: Vec<Timing>,
    /// Devices whose times were averaged.
    pub devices: u64,
    /// The program's version.
    pub version: &'static str,
    /// The report, relative to where the program ran.
    pub report: String,
}

/// One means of following a peak.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Tracking {
    /// `nine-point` or `circles`.
    pub means: &'static str,
    /// The climb's three parameters; `null` for circles.
    pub step_um: Option<f64>,
    /// Time at each point.
    pub dwell_ms: Option<f64>,
    /// Time between patterns.
    pub pause_ms: Option<f64>,
    /// A step a pattern, `step / (9 dwell + pause)`; `null` for circles.
    pub closed_form_um_s: Option<f64>,
    /// The fastest drift that was followed, all slower ones too.
    pub limit_um_s: f64,
    /// The slowest that was not; `null` where all were.
    pub lost_um_s: Option<f64>,
    /// The trials, slowest first.
    pub trials: Vec<Drift>,
}

/// A peak that drifted.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Drift {
    /// Its speed, along x.
    pub speed_um_s: f64,
    /// How long.
    pub seconds: f64,
    /// How far the fiber was from it at the end, in truth; `null` where the peak left the reach.
    pub lag_um: Option<f64>,
    /// Light at the end, of that before.
    pub light_percent: f64,
    /// Whether the fiber trails the peak steadily: the light is more than half of that before, and as
    /// bright at the end as in the middle of the trial.
    pub followed: bool,
}

/// Motion that is not the device's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Rejection {
    /// `macro` or `piezos`.
    pub disturbance: &'static str,
    /// `rest`, `nine-point` or `circles`.
    pub means: &'static str,
    /// How long, seconds.
    pub seconds: f64,
    /// How far the macro went, or how far away the micro had been.
    pub disturbance_um: f64,
    /// How far the fiber was off the peak at the end, in truth; `null` where the micro's reach ended.
    pub offset_um: Option<f64>,
    /// Light at the end, of that before.
    pub light_percent: f64,
    /// Light on average meanwhile, of that before: the macro goes by jerks, which a climb makes up for
    /// one after the other.
    pub mean_light_percent: f64,
}

/// The way in z.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Approach {
    /// How far the gap was closed.
    pub way_um: f64,
    /// How far aside the climb followed the peak meanwhile.
    pub walk_um: f64,
    /// `way tan(exit angle)`, by the recipe.
    pub expected_um: f64,
    /// How long it took.
    pub seconds: f64,
    /// How fast the peak walked: to be followed, less than the climb's limit.
    pub walk_um_s: f64,
}

/// A part of the work.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Timing {
    /// Which.
    pub part: &'static str,
    /// What the thesis says, seconds a fiber.
    pub printed: Option<&'static str>,
    /// The thesis's procedure here.
    pub thesis: f64,
    /// The fast procedure here.
    pub fast: f64,
}

/// What is drawn: light over time.
pub type Curve = (String, Vec<(f64, f64)>);

/// All that was measured.
#[derive(Debug, Clone)]
pub struct Measured {
    /// What is printed.
    pub document: MaximizationDocument,
    /// Light over time while the peak drifts, nine-point patterns following it.
    pub curves: Vec<Curve>,
}

/// What is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Asked {
    /// The climb that is tried.
    pub climb: Climb,
    /// The seed.
    pub seed: u64,
    /// Devices over which times are averaged.
    pub devices: u64,
}

/// When trials begin: both fibers are at their peaks long before.
const BEGIN: f64 = 90.0;
/// How far a peak is to drift.
const WAY: f64 = 15e-6;
/// How long it takes at most.
const LONGEST: f64 = 12.0;
/// The macro's speed and how long it goes.
pub const MACRO: (f64, f64) = (1e-6, 10.0);
/// How far away the micro was before its piezos are watched, and how long.
pub const PIEZOS: (f64, f64) = (25e-6, 20.0);
/// Circles have no closed form: speeds around this are tried.
pub const CIRCLES: f64 = 40e-6;
/// Light that falls by more than this from the middle of a trial to its end is light that is being
/// lost, percent of what it was before.
const STEADY: f64 = 2.0;

/// Samples of light from a time on.
struct Watcher {
    from: f64,
    light: Vec<(f64, f64)>,
}

impl Observer for Watcher {
    fn phase(&mut self, _: &str, _: &'static str, _: f64) {}
    fn sample(&mut self, sample: &Sample) {
        if sample.time >= self.from {
            let volts = sample.light[Channel::Output1.index()];
            self.light.push((sample.time, volts));
        }
    }
}

/// A trial on the twin: what control saw, and in truth how far off the fiber ended.
struct Tried {
    /// `None` where the micro's reach ended.
    seen: Option<Followed>,
    off: Option<f64>,
    light: Vec<(f64, f64)>,
}

impl Tried {
    /// Light at the end, of that before, percent.
    fn percent(&self) -> f64 {
        self.seen
            .map_or(0.0, |seen| 100.0 * (seen.after / seen.before).max(0.0))
    }

    /// Time since the trial began, and the light of that before, percent.
    fn percents(&self) -> Vec<(f64, f64)> {
        let Some(seen) = self.seen else {
            return Vec::new();
        };
        let percent = |volts: f64| 100.0 * (volts - seen.dark) / seen.before;
        self.light
            .iter()
            .map(|(time, volts)| (time - seen.begin, percent(*volts)))
            .collect()
    }
}

/// The mean of a curve between two times.
fn mean(curve: &[(f64, f64)], from: f64, to: f64) -> f64 {
    let within = curve.iter().filter(|p| (from..to).contains(&p.0));
    let (sum, n) = within.fold((0.0, 0.0), |(sum, n), p| (sum + p.1, n + 1.0));
    sum / f64::max(n, 1.0)
}

fn run(setup: &Setup, seed: u64, drift: f64, trial: &Trial, label: String) -> Result<Tried, Ended> {
    let mut drifting = setup.clone();
    drifting.plant.device.drift = drift;
    drifting.plant.device.drift_from = trial.begin;
    let mut watcher = Watcher {
        from: trial.begin,
        light: Vec::new(),
    };
    let job = Labelled {
        label,
        job: Follow { trial: *trial },
    };
    let mut twin = drifting.twin(seed)?;
    let seen = drifting.perform(&mut twin, &job, seed, &mut watcher)?;
    let off = twin.truth().outputs[0].map(|fiber| fiber.x.hypot(fiber.y));
    Ok(Tried {
        seen,
        off: off.filter(|_| seen.is_some()),
        light: watcher.light,
    })
}

fn um(metres: f64, digits: f64) -> f64 {
    rounded(metres * 1e6, digits)
}

fn drift(
    setup: &Setup,
    seed: u64,
    means: Means,
    speed: f64,
    label: String,
) -> Result<(Drift, Vec<(f64, f64)>), Ended> {
    let seconds = (WAY / speed).min(LONGEST);
    let trial = Trial {
        means,
        disturbance: Disturbance::Device,
        begin: BEGIN,
        seconds,
    };
    let tried = run(setup, seed, speed, &trial, label)?;
    let share = tried.percent();
    let light = tried.percents();
    let part = |from: f64, to: f64| mean(&light, from * seconds, to * seconds);
    let steady = part(0.9, 1.0) > part(0.4, 0.6) - STEADY;
    let row = Drift {
        speed_um_s: um(speed, 1e-3),
        seconds: rounded(seconds, 1e-3),
        lag_um: tried.off.map(|off| um(off, 1e-3)),
        light_percent: rounded(share, 0.1),
        followed: share > 50.0 && steady,
    };
    Ok((row, light))
}

/// Tries drifts around what `means` should follow, and then closer around the limit. Records of the trials
/// are called after the `series`.
///
/// # Errors
///
/// As [`rejection`].
pub fn tracking(
    setup: &Setup,
    seed: u64,
    means: Means,
    series: &str,
) -> Result<(Tracking, Vec<Curve>), Ended> {
    const SHARES: [f64; 8] = [0.1, 0.25, 0.5, 0.7, 0.85, 1.0, 1.2, 1.6];
    const CLOSER: u32 = 4;
    const DRAWN: [f64; 4] = [0.25, 0.7, 1.0, 1.2];
    let about = means.limit().unwrap_or(CIRCLES);
    let mut curves = Vec::new();
    let mut trials = Vec::new();
    let label = |trials: &[Drift]| format!("drift-{series}-{}", trials.len() + 1);
    for share in SHARES {
        let (row, light) = drift(setup, seed, means, share * about, label(&trials))?;
        if DRAWN.contains(&share) && matches!(means, Means::NinePoint(_)) {
            curves.push((format!("{} um/s", rounded(row.speed_um_s, 0.01)), light));
        }
        trials.push(row);
    }
    let limit = |trials: &[Drift]| {
        let lost = trials.iter().position(|row| !row.followed);
        let last = lost.unwrap_or(trials.len()).checked_sub(1);
        (
            last.map_or(0.0, |k| trials[k].speed_um_s),
            lost.map(|k| trials[k].speed_um_s),
        )
    };
    for _ in 0..CLOSER {
        let (followed, Some(lost)) = limit(&trials) else {
            break;
        };
        let speed = 0.5e-6 * (followed + lost);
        let (row, _) = drift(setup, seed, means, speed, label(&trials))?;
        trials.push(row);
        trials.sort_by(|a, b| a.speed_um_s.total_cmp(&b.speed_um_s));
    }
    let (limit_um_s, lost_um_s) = limit(&trials);
    let climb = match means {
        Means::NinePoint(climb) => Some(climb),
        Means::Rest | Means::Circles => None,
    };
    let milliseconds = |seconds: f64| rounded(seconds * 1e3, 1e-3);
    let row = Tracking {
        means: name(means),
        step_um: climb.map(|c| um(c.step, 1e-3)),
        dwell_ms: climb.map(|c| milliseconds(c.dwell)),
        pause_ms: climb.map(|c| milliseconds(c.pause)),
        closed_form_um_s: means.limit().map(|speed| um(speed, 1e-3)),
        limit_um_s,
        lost_um_s,
        trials,
    };
    Ok((row, curves))
}

fn name(means: Means) -> &'static str {
    match means {
        Means::Rest => "rest",
        Means::NinePoint(_) => "nine-point",
        Means::Circles => "circles",
    }
}

/// Disturbs a fiber at its peak while `means` follows the light.
///
/// # Errors
///
/// When the plant cannot be built, the machine has a fault, or no fiber could be brought to its peak.
pub fn rejection(
    setup: &Setup,
    seed: u64,
    disturbance: Disturbance,
    means: Means,
) -> Result<Rejection, Ended> {
    let (kind, way, seconds) = match disturbance {
        Disturbance::Device => ("device", 0.0, 0.0),
        Disturbance::Macro(speed) => ("macro", speed * MACRO.1, MACRO.1),
        Disturbance::Piezos(away) => ("piezos", away, PIEZOS.1),
    };
    let trial = Trial {
        means,
        disturbance,
        begin: BEGIN,
        seconds,
    };
    let label = format!("{kind}-{}", name(means));
    let tried = run(setup, seed, 0.0, &trial, label)?;
    Ok(Rejection {
        disturbance: kind,
        means: name(means),
        seconds,
        disturbance_um: um(way, 1e-3),
        offset_um: tried.off.map(|off| um(off, 1e-3)),
        light_percent: rounded(tried.percent(), 0.1),
        mean_light_percent: rounded(mean(&tried.percents(), 0.0, seconds), 0.1),
    })
}

/// Where endpoint and micro were when the approach of the first output began and ended.
#[derive(Default)]
struct Way {
    inside: bool,
    ends: Option<(Sample, Sample)>,
}

impl Observer for Way {
    fn phase(&mut self, port: &str, phase: &'static str, _: f64) {
        self.inside = port == "output1" && phase == "approach";
    }
    fn sample(&mut self, sample: &Sample) {
        if self.inside {
            let first = self.ends.as_ref().map_or(*sample, |(first, _)| *first);
            self.ends = Some((first, *sample));
        }
    }
}

fn approach(setup: &Setup, seed: u64) -> Result<Option<Approach>, Ended> {
    let mut way = Way::default();
    let done = align(setup, Procedure::Thesis, seed, &mut way)?;
    let Some((first, last)) = way.ends else {
        return Ok(None);
    };
    let side = Side::Right.index();
    let closed = (last.endpoints[side].z - first.endpoints[side].z).abs();
    let x = |s: &Sample| s.micro[side].x + s.endpoints[side].x;
    let walk = (x(&last) - x(&first)).abs();
    let output = done.fibers.iter().find(|f| f.port == "output1");
    let seconds = output.and_then(|f| f.seconds_in("approach")).unwrap_or(0.0);
    let moving = closed / setup.rig.recipe.approach.speed;
    Ok(Some(Approach {
        way_um: um(closed, 0.01),
        walk_um: um(walk, 0.01),
        expected_um: um(closed * setup.rig.recipe.ports.exit_angle.tan(), 0.01),
        seconds: rounded(seconds, 1e-3),
        walk_um_s: um(walk / moving, 0.01),
    }))
}

/// Mean seconds a fiber by both procedures, in the parts of 3.4.
fn timing(setup: &Setup, asked: &Asked) -> Result<Vec<Timing>, Ended> {
    const PARTS: [(&str, Option<&str>, &[&str]); 5] = [
        ("placing, sensing fiber", None, &["coarse", "sensing"]),
        ("first light (3.2.2)", Some("6.7"), &["raster", "search"]),
        ("x-y maximization", Some("< 5"), &["climb", "centre"]),
        ("z maximization", Some("< 10"), &["approach"]),
        ("last maximization", None, &["final"]),
    ];
    // Each is what `align` does with its seed, and records.
    let setup = &Setup {
        records: None,
        ..setup.clone()
    };
    let many = |procedure: Procedure| -> Result<Vec<AlignmentDocument>, Ended> {
        (0..asked.devices)
            .map(|k| {
                let seed = asked.seed.wrapping_add(k);
                align(setup, procedure, seed, &mut Unobserved)
            })
            .collect()
    };
    let (thesis, fast) = thread::scope(|scope| {
        let thesis = scope.spawn(|| many(Procedure::Thesis));
        (thesis.join(), many(Procedure::Fast))
    });
    let (thesis, fast) = (
        thesis.unwrap_or_else(|p| std::panic::resume_unwind(p))?,
        fast?,
    );
    let mean = |all: &[AlignmentDocument], phases: &[&str]| {
        let fibers = || all.iter().flat_map(|d| &d.fibers);
        let seconds: f64 = fibers()
            .flat_map(|f| phases.iter().filter_map(|phase| f.seconds_in(phase)))
            .sum();
        rounded(seconds / fibers().count().max(1) as f64, 1e-3)
    };
    let mut rows: Vec<Timing> = PARTS
        .iter()
        .map(|(part, printed, phases)| Timing {
            part,
            printed: *printed,
            thesis: mean(&thesis, phases),
            fast: mean(&fast, phases),
        })
        .collect();
    let sum = |of: fn(&Timing) -> f64| rounded(rows.iter().skip(1).map(of).sum(), 1e-3);
    let all = Timing {
        part: "in all, once placed",
        printed: Some("21.7"),
        thesis: sum(|row| row.thesis),
        fast: sum(|row| row.fast),
    };
    rows.push(all);
    Ok(rows)
}

/// Measures all of it on the twins that the seed draws.
///
/// # Errors
///
/// When the plant cannot be built, the machine has a fault, or no fiber could be brought to its peak.
pub fn maximize(setup: &Setup, asked: &Asked) -> Result<Measured, Ended> {
    let seed = asked.seed;
    let climb = Means::NinePoint(asked.climb);
    let of_recipe = Means::NinePoint(setup.rig.recipe.climb);
    let mut means = vec![(climb, name(climb))];
    if of_recipe != climb {
        means.push((of_recipe, "recipe"));
    }
    means.push((Means::Circles, name(Means::Circles)));
    let tracked: Vec<_> = thread::scope(|scope| {
        let begun: Vec<_> = means
            .iter()
            .map(|(means, series)| scope.spawn(|| tracking(setup, seed, *means, series)))
            .collect();
        begun
            .into_iter()
            .map(|t| t.join().unwrap_or_else(|p| std::panic::resume_unwind(p)))
            .collect()
    });
    let (mut rows, mut curves) = (Vec::new(), Vec::new());
    for tracked in tracked {
        let (row, of_row) = tracked?;
        rows.push(row);
        if curves.is_empty() {
            curves = of_row;
        }
    }
    let cases: Vec<_> = [Disturbance::Macro(MACRO.0), Disturbance::Piezos(PIEZOS.0)]
        .into_iter()
        .flat_map(|disturbance| {
            [Means::Rest, climb, Means::Circles].map(|means| (disturbance, means))
        })
        .collect();
    let rejected: Vec<_> = cases
        .into_par_iter()
        .map(|(disturbance, means)| rejection(setup, seed, disturbance, means))
        .collect();
    let document = MaximizationDocument {
        rig: setup.rig.name.clone(),
        seed,
        tracking: rows,
        rejection: rejected.into_iter().collect::<Result<_, _>>()?,
        approach: approach(setup, seed)?,
        timing: timing(setup, asked)?,
        devices: asked.devices,
        version: env!("CARGO_PKG_VERSION"),
        report: String::new(),
    };
    Ok(Measured { document, curves })
}

//! Figs. 2.16 to 2.23: compensation of windup.

use super::super::picture::{Picture, Points, thin};
use super::super::{Bench, Figure};
use super::FIVE_BAR;
use pigtail_control::contour::{Contour, ContourSample};
use pigtail_control::identify::{Path, WindupRecord, backlash, scan};
use pigtail_control::station::Unobserved;
use pigtail_control::trajectory::Shape;
use pigtail_evaluate::contour::{Plan, trace};
use pigtail_hal::{Error, Side};
use pigtail_model::fivebar::FiveBar;
use pigtail_model::windup::{ReversalState, Windup};
use pigtail_session::identify::{Models, ScanWindup, range, scale};
use pigtail_session::job::Ended;
use pigtail_session::setup::Setup;

/// The preload of the thesis's preloaded figures, relative to the output's static friction: greater than
/// that, as it found to be most effective (2.4.2).
const PRELOAD: f64 = 1.2;

/// Friction in each bearing between the links of the squares, N m. The thesis holds that there is some,
/// and prints none; the rig's plant has none. This much brings Fig. 2.21 about, which is therefore no
/// prediction.
const COUPLING: f64 = 0.03;

/// Turns of Fig. 2.16, in ways: two full ways, then reversals long before the transmission is wound.
const PARTIAL: [f64; 8] = [0.0, 1.0, 0.0, 0.6, 0.53, 0.58, 0.3, 0.7];

/// Fig. 2.16: the estimate through partial reversals, as the station of a run adds it to its reference.
fn figure_2_16(joint: &Joint, bench: &Bench) -> Result<Figure, Ended> {
    let model = joint.models.reversal.model;
    let path = path(joint.range, &PARTIAL);
    let scale = scale(&bench.machine.rig, FIVE_BAR.axis)?;
    let record = bench.machine.experiment(bench.seed, |station| {
        Ok(scan(
            station,
            FIVE_BAR,
            &scale,
            &path,
            &Windup::Reversal(model),
        )?)
    })?;
    let skip = (2.0 * joint.range / path.speed / record.period) as usize;
    // What the servo follows is the wanted output and the estimate: its error is a count or two.
    let added: Vec<f64> = record
        .input
        .iter()
        .zip(&record.wanted)
        .map(|(input, wanted)| input - wanted)
        .collect();
    // The estimate along the same reference, and how far what the run added is from it.
    let mut state = ReversalState::default();
    let estimate: Vec<f64> = record
        .wanted
        .iter()
        .map(|wanted| model.next(&mut state, *wanted))
        .collect();
    let jump = (skip..estimate.len())
        .map(|k| (estimate[k] - estimate[k - 1]).abs())
        .fold(0.0, f64::max);
    let apart = (skip..estimate.len())
        .map(|k| (estimate[k] - added[k]).abs())
        .fold(0.0, f64::max);
    let um = joint.um;
    let curve = |direction: f64, from: f64| -> Points {
        (0..=100)
            .map(|k| {
                let way = 0.7 * joint.range * f64::from(k) / 100.0;
                (
                    um * (from + direction * way),
                    um * model.curve(direction, way),
                )
            })
            .collect()
    };
    Ok(
        Figure::new("2.16", "Estimation of equivalent reversal position")
            .picture(
                Picture::curves(
                    "desired output, um",
                    "windup estimate, um",
                    [
                        (
                            "estimate of the run",
                            thin((skip..added.len()).map(|k| (um * record.wanted[k], um * added[k]))),
                        ),
                        ("forward curve", curve(1.0, 0.0)),
                        ("backward curve", curve(-1.0, 0.6 * joint.range)),
                    ],
                )
                .caption(
                    "What control adds to the reference of a running joint through reversals long before the \
                     transmission is wound: it jumps from curve to curve and stays continuous.",
                ),
            )
            .noted(
                "2.16-continuous",
                jump / model.maximum,
                format!(
                    "What the motor was driven by in the run departs from it by {:.1} um at most, a servo's error.",
                    um * apart
                ),
            ),
    )
}

/// Share by which friction has risen since windup was identified.
const DRIFTED: f64 = 0.2;

/// The gap that is left where friction has changed since identification, micrometres.
fn drifted(joint: &Joint) -> Result<f64, Ended> {
    let mut setup = joint.setup.clone();
    let unrest = &mut setup.plant.five_bar.joint.unrest;
    (unrest.drift, unrest.drift_time) = (DRIFTED, 1e-3);
    let later = Joint {
        setup: &setup,
        models: joint.models.clone(),
        ..*joint
    };
    let model = Windup::Reversal(joint.models.reversal.model);
    Ok(later.scan(&FULL, &model)?.gap)
}

/// Turns of a scan over a range, from a place a little inside, after two full ways.
fn path(range: f64, turns: &[f64]) -> Path {
    Path {
        turns: turns.iter().map(|t| t * range).collect(),
        speed: 0.25 * range,
    }
}

/// A compensated joint: its models, and gaps over ranges.
struct Joint<'s> {
    setup: &'s Setup,
    seed: u64,
    models: Models,
    um: f64,
    range: f64,
}

impl<'s> Joint<'s> {
    fn identify(setup: &'s Setup, seed: u64) -> Result<Self, Ended> {
        let scale = scale(&setup.rig, FIVE_BAR.axis)?;
        let range = range(FIVE_BAR.axis) / scale.metres_per_radian;
        let speed = 0.25 * range;
        let job = ScanWindup {
            at: FIVE_BAR,
            path: Path::identification(range, speed),
        };
        let record = setup.run(&job, seed, &mut Unobserved)?;
        let models = Models::fit(record, range, speed);
        Ok(Self {
            setup,
            seed,
            models,
            um: 1e6 * scale.metres_per_radian,
            range,
        })
    }

    /// A scan through turns of which the first three are two full ways, and the gap over the rest,
    /// micrometres.
    fn scan(&self, turns: &[f64], model: &Windup) -> Result<Scanned, Ended> {
        let scale = scale(&self.setup.rig, FIVE_BAR.axis)?;
        let path = path(self.range, turns);
        let lead = turns[..3].windows(2).map(|w| (w[1] - w[0]).abs());
        let record = self.setup.experiment(self.seed, |station| {
            Ok(scan(station, FIVE_BAR, &scale, &path, model)?)
        })?;
        let skip = (lead.sum::<f64>() * self.range / path.speed / record.period) as usize;
        let gap = self.um * backlash(&record, skip);
        Ok(Scanned {
            points: points(&record, skip, self.um),
            gap,
        })
    }

    fn both(&self, turns: &[f64]) -> Result<[Scanned; 2], Ended> {
        Ok([
            self.scan(turns, &Windup::None)?,
            self.scan(turns, &Windup::Reversal(self.models.reversal.model))?,
        ])
    }
}

/// A scan: output against wanted output, micrometres, and the gap between its ways.
struct Scanned {
    points: Points,
    gap: f64,
}

fn points(record: &WindupRecord, skip: usize, um: f64) -> Points {
    thin((skip..record.input.len()).map(|k| (um * record.wanted[k], um * record.output[k])))
}

const FULL: [f64; 5] = [0.0, 1.0, 0.0, 1.0, 0.0];
const SMALL: [f64; 5] = [0.0, 1.0, 0.375, 0.625, 0.375];
const REPEATED: [f64; 9] = [0.0, 1.0, 0.375, 0.625, 0.375, 0.625, 0.375, 0.625, 0.375];

pub(super) fn scans(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    let plain = Joint::identify(&bench.machine, bench.seed)?;
    let mut setup = bench.machine.clone();
    let joint = &mut setup.plant.five_bar.joint;
    joint.preload = PRELOAD * joint.load_friction.static_level();
    let preloaded = Joint::identify(&setup, bench.seed)?;
    let (full, small, repeated) = (
        plain.both(&FULL)?,
        plain.both(&SMALL)?,
        plain.both(&REPEATED)?,
    );
    let loaded = preloaded.both(&FULL)?;
    let figure = |id, title, [before, after]: &[Scanned; 2], text: &str| {
        Figure::new(id, title).picture(
            Picture::curves(
                "desired output, um",
                "output, um",
                [
                    ("without compensation", before.points.clone()),
                    ("with (2.20)-(2.26)", after.points.clone()),
                ],
            )
            .caption(format!(
                "{text} The ways part by {:.1} um without compensation and by {:.1} um with it.",
                before.gap, after.gap
            )),
        )
    };
    let factor = |pair: &[Scanned; 2]| pair[0].gap / pair[1].gap;
    // The thesis shows no scan of 175 um without compensation: what it compares with is the windup of a
    // transmission that is wound up fully.
    let effect = |pair: &[Scanned; 2]| full[0].gap / pair[1].gap;
    let mean = (effect(&full) + effect(&small) + effect(&repeated)) / 3.0;
    let memory = plain.scan(&FULL, &Windup::Memory(plain.models.memory.model))?;
    let drifted = drifted(&plain)?;
    Ok(vec![
        figure_2_16(&plain, bench)?,
        figure("2.17", "Windup compensation over 700 um range", &full, "")
            .noted(
                "2.17-left",
                full[1].gap,
                format!("{:.1} um with the model that remembers.", memory.gap),
            )
            .noted(
                "2.17-drift",
                drifted / full[1].gap,
                format!("{:.1} um and {drifted:.1} um.", full[1].gap),
            )
            .result("2.17-factor", factor(&full))
            .result("2.17-abstract", factor(&full)),
        figure(
            "2.18",
            "Windup compensation with preloading",
            &loaded,
            "A preload of 1.2 times the static friction.",
        )
        .noted(
            "2.18-little",
            loaded[1].gap / full[1].gap,
            format!("{:.1} um and {:.1} um.", loaded[1].gap, full[1].gap),
        ),
        figure("2.19", "Windup compensation over 175 um range", &small, "").noted(
            "2.19-small",
            small[1].gap / full[1].gap,
            format!("{:.1} um and {:.1} um.", small[1].gap, full[1].gap),
        ),
        figure(
            "2.20",
            "Repeated scanning over 175 um range",
            &repeated,
            "Three times forward and back.",
        )
        .noted(
            "2.20-repeated",
            repeated[1].gap / small[1].gap,
            format!("{:.1} um and {:.1} um.", repeated[1].gap, small[1].gap),
        )
        .noted(
            "2.20-factor",
            mean,
            format!(
                "{:.1}, {:.1} and {:.1}. Beside scans of 175 um that are not compensated, which leave the \
                 transmission half wound and the paths {:.0} um apart, {:.1} and {:.1}.",
                effect(&full),
                effect(&small),
                effect(&repeated),
                small[0].gap,
                factor(&small),
                factor(&repeated)
            ),
        ),
    ])
}

/// The output's friction with links that rub on each other, relative to the load's alone: of each bearing
/// what it comes to at the joint, by virtual work, at home.
fn output_friction(setup: &Setup) -> Result<f64, Ended> {
    let geometry = &setup.rig.calibration.geometry.five_bar;
    let [x, y] = geometry.home;
    let at_joint = FiveBar::new(geometry.base, geometry.proximal, geometry.distal)
        .ok()
        .and_then(|links| links.bearings(links.inverse(x, y).ok()?).ok())
        .map(|(_, rates)| rates.iter().map(|of| of[0].abs()).sum::<f64>())
        .ok_or_else(|| Error::new("geometry.five_bar", "home", "is out of reach of the links"))?;
    let load = setup.plant.five_bar.joint.load_friction.static_level();
    Ok(1.0 + COUPLING * at_joint / load)
}

pub(super) fn squares(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    // The output's friction is what a preload has to be greater than, and that between the links is
    // part of it.
    let preload = PRELOAD * output_friction(&bench.machine)?;
    let plan = Plan {
        contour: Contour::Square,
        side: Side::Left,
        size: 300e-6,
        speed: 0.2e-3,
        shape: Shape::Trapezoid,
        coupling: Some(COUPLING),
        preload,
    };
    let others = [
        Plan {
            coupling: None,
            preload: PRELOAD,
            ..plan
        },
        Plan {
            preload: 2.0 * preload,
            ..plan
        },
    ];
    let follow = |plan: &Plan| Squares::trace(bench, plan);
    let coupled = follow(&plan)?;
    // What the others show is known; a quick run has no time for them.
    let (alone, strong) = if bench.quick {
        (None, None)
    } else {
        let (alone, strong) = rayon::join(|| follow(&others[0]), || follow(&others[1]));
        (Some(alone?), Some(strong?))
    };
    let without = |k: usize| {
        alone.as_ref().map_or_else(String::new, |alone| {
            format!(
                "Without friction between the links {:.1} um.",
                alone.most[k]
            )
        })
    };
    let twice = strong.as_ref().map_or_else(String::new, |strong| {
        format!(" With twice the preload {:.1} um.", strong.most[2])
    });
    let size = 1e6 * plan.size;
    let figure = |id, title, samples: &[ContourSample]| {
        let um = |metres: f64| 1e6 * metres;
        let measured = thin(samples.iter().map(|s| (um(s.measured.x), um(s.measured.y))));
        let wanted = thin(samples.iter().map(|s| (um(s.wanted.x), um(s.wanted.y))));
        Figure::new(id, title).picture(
            Picture::curves(
                "x, um",
                "y, um",
                [("measured", measured), ("desired", wanted)],
            )
            .x(-200.0, 200.0)
            .y(-200.0, 200.0)
            .equal()
            .caption("A square of 300 um, both joints together."),
        )
    };
    let [none, reversal, both] = coupled.most;
    Ok(vec![
        figure(
            "2.21",
            "Square trajectory without windup compensation",
            &coupled.samples[0],
        )
        .noted(
            "2.21-error",
            none,
            without(0),
        )
        .result("2.21-share", 100.0 * none / size)
        .remark(format!(
            "With a friction of {COUPLING} N m in each bearing between the links, chosen for this figure."
        )),
        figure(
            "2.22",
            "Square trajectory with windup compensation",
            &coupled.samples[1],
        )
        .noted(
            "2.22-error",
            reversal,
            without(1),
        )
        .result("2.22-factor", none / reversal)
        .remark(
            "That the coupling which brings Fig. 2.21 about leaves here what the thesis found bears out \
             its guess: it is friction between the links that compensation of each joint does not know.",
        ),
        figure(
            "2.23",
            "Square trajectory with preloading and windup compensation",
            &coupled.samples[2],
        )
        .noted("2.23-error", both, format!("{}{twice}", without(2)))
        .result("2.23-factor", none / both),
    ])
}

/// Squares without compensation, with (2.20)-(2.26), and with it and a preload.
struct Squares {
    /// Greatest errors, micrometres.
    most: [f64; 3],
    samples: [Vec<ContourSample>; 3],
}

impl Squares {
    fn trace(bench: &Bench, plan: &Plan) -> Result<Self, Ended> {
        let (_, traced) = trace(&bench.machine, plan, bench.seed)?;
        let mut all = Self {
            most: [f64::NAN; 3],
            samples: Default::default(),
        };
        for (row, samples) in traced {
            let k = match (row.compensation, row.preload > 0.0) {
                ("none", false) => 0,
                ("reversal", false) => 1,
                ("reversal", true) => 2,
                _ => continue,
            };
            all.most[k] = row.max_um;
            all.samples[k] = samples;
        }
        Ok(all)
    }
}

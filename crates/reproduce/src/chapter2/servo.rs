//! Figs. 2.3 to 2.7: gains, steps and sines.

use super::super::picture::{Picture, Points, thin};
use super::super::{Bench, Figure};
use super::{FIVE_BAR, Z};
use pigtail_control::characterize::Trace;
use pigtail_control::tune::{Experiment, Gains, Search};
use pigtail_hal::{Axis, AxisName};
use pigtail_session::characterize::{follow_sine, frequency, metres_per_count, step};
use pigtail_session::job::Ended;

use pigtail_control::station::Unobserved;
use pigtail_session::tune::{Method, Tune, Tuned, usual_step};

/// Trials of each start: half as many again as the thesis ever needed, so that they can be too few. A quick run takes as many:
/// by fewer than a hundred no search would be slower than a hundred, and one that has not come to its end says nothing of gains.
const TRIALS: u32 = 150;

/// A cost as good as any: the valley is flat.
const NEAR: f64 = 1.1;

/// Searches by either cost, of three starts each: one alone tells little of how fast it converges.
const SEARCHES: u32 = 8;

/// How long a response is watched while tuning, as `pigtail tune` does, seconds.
const WINDOW: f64 = 0.15;

/// Gains of an axis by the thesis's search.
fn tuned(bench: &Bench, at: AxisName) -> Result<Tuned, Ended> {
    searched(bench, at, false, bench.seed)
}

/// The same by the cost of one size of a step, or averaged over two; random trials drawn by a seed.
fn searched(bench: &Bench, at: AxisName, one_size: bool, seed: u64) -> Result<Tuned, Ended> {
    let plan = Tune {
        at,
        method: Method::Random,
        trials: TRIALS,
        step: usual_step(at.axis),
        one_size,
        seed,
    };
    // By the thesis's cost alone: what the datasheet asks for is what is printed.
    let mut machine = bench.machine.clone();
    machine.rig.spec.five_bar.drive.step = None;
    machine.rig.spec.z_stage.drive.step = None;
    machine.run(&plan, bench.seed, &mut Unobserved)
}

/// Trials until the cost is within [`NEAR`] of the least that any start has come to, a start each. One that does not come near
/// takes longer than all of its trials.
fn trials_until_near(searches: &[Search]) -> impl Iterator<Item = u32> {
    let least = least(searches);
    searches.iter().map(move |s| {
        let near = s.path.iter().find(|p| p.cost <= NEAR * least);
        near.map_or(s.trials + 1, |p| p.trial)
    })
}

/// Trials of all starts of some searches.
struct Convergence {
    mean: f64,
    most: u32,
}

/// How some searches converge by the cost of one size of a step, and by that averaged over two: both draw their trials alike, and each
/// is judged by its own cost.
fn convergence(bench: &Bench) -> Result<[Convergence; 2], Ended> {
    let converges = |one_size: bool| -> Result<Convergence, Ended> {
        let mut all = Vec::new();
        for k in 0..u64::from(bench.count(SEARCHES, 3)) {
            let found = searched(bench, FIVE_BAR, one_size, bench.seed.wrapping_add(k))?;
            all.extend(trials_until_near(&found.searches));
        }
        Ok(Convergence {
            mean: all.iter().copied().map(f64::from).sum::<f64>() / all.len() as f64,
            most: all.into_iter().max().unwrap_or(0),
        })
    };
    Ok([converges(true)?, converges(false)?])
}

fn least(searches: &[Search]) -> f64 {
    searches
        .iter()
        .map(|s| s.best().cost)
        .fold(f64::INFINITY, f64::min)
}

/// The time that the printed lags of both sines come to, 9.9 degrees at 10 Hz and 9.5 degrees at 8 Hz, seconds.
const PRINTED_LATE: f64 = 3e-3;

/// A response in milliseconds and counts.
fn response(trace: &Trace, series: &[f64], until: f64) -> Points {
    thin(
        series
            .iter()
            .enumerate()
            .map(|(k, v)| ((k + 1) as f64 * trace.period * 1e3, *v))
            .take_while(|p| p.0 <= until),
    )
}

/// The mean cost of the gains that the searches found, that of the same with one gain 20 % smaller and
/// without it, and the response of the best with less of it.
fn detuned(
    bench: &Bench,
    at: AxisName,
    tuned: &Tuned,
    which: usize,
) -> Result<([f64; 3], Trace), Ended> {
    let setup = &bench.machine;
    let believed = match at.axis {
        Axis::A | Axis::B => &setup.rig.calibration.gains.five_bar,
        Axis::Z => &setup.rig.calibration.gains.z,
    };
    let experiment = Experiment {
        at,
        step: usual_step(at.axis),
        one_size: false,
        window: WINDOW,
        safe: [believed.kp, believed.ki, believed.kd],
        integral_limit: believed.integral_limit,
        specified: None,
    };
    // The optima themselves: what the document tells is the fastest of what is as good. Each search ends
    // elsewhere in a flat valley.
    let mut optima: Vec<_> = tuned.searches.iter().map(Search::best).collect();
    optima.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let with = |share: f64, gains: Gains| -> Gains {
        std::array::from_fn(|k| gains[k] * if k == which { share } else { 1.0 })
    };
    setup.experiment(bench.seed, |station| {
        let mut costs = [0.0; 3];
        for optimum in &optima {
            for (sum, share) in costs.iter_mut().zip([1.0, 0.8, 0.0]) {
                *sum += experiment.cost(station, with(share, optimum.gains))? / optima.len() as f64;
            }
        }
        let best = optima.first().map_or(experiment.safe, |best| best.gains);
        Ok((costs, experiment.response(station, with(0.8, best))?))
    })
}

/// The step under the gains that are believed: what rise and settling were calibrated to.
fn believed_step(
    bench: &Bench,
    at: AxisName,
) -> Result<(pigtail_session::characterize::StepDocument, Trace), Ended> {
    let size = usual_step(at.axis);
    bench.machine.experiment(bench.seed, |station| {
        step(station, &bench.machine.rig, at, size)
    })
}

pub(super) fn five_bar_gains(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    let found = tuned(bench, FIVE_BAR)?;
    Ok(vec![
        figure_2_3(bench, &found, &convergence(bench)?),
        step_figure(bench, FIVE_BAR, &found)?,
    ])
}

fn figure_2_3(bench: &Bench, tuned: &Tuned, [one, two]: &[Convergence; 2]) -> Figure {
    let searches = &tuned.searches;
    let least = least(searches);
    let slowest = trials_until_near(searches).max().unwrap_or(0);
    let trials: u32 = searches.iter().map(|s| s.trials).sum();
    let seconds = tuned.document.seconds_machine / f64::from(trials);
    let worst = searches.iter().map(|s| s.best().cost).fold(0.0, f64::max);
    let path = |a: usize, b: usize| {
        searches.iter().enumerate().map(move |(k, search)| {
            let points: Points = search
                .path
                .iter()
                .filter(|p| p.cost.is_finite())
                .map(|p| (p.gains[a], p.gains[b]))
                .collect();
            (format!("start {}", k + 1), points)
        })
    };
    let costs = searches.iter().enumerate().map(|(k, search)| {
        let points: Points = search
            .path
            .iter()
            .filter(|p| p.cost.is_finite())
            .map(|p| (f64::from(p.trial), p.cost))
            .collect();
        (format!("start {}", k + 1), points)
    });
    Figure::new(
        "2.3",
        "Successful parameter steps during optimal controller search",
    )
    .picture(
        Picture::curves("kp, V/count", "kd, V s/count", path(0, 2))
            .caption("The successful steps of three searches, seen along ki."),
    )
    .picture(
        Picture::curves("kp, V/count", "ki, V/(count s)", path(0, 1))
            .caption("The same, seen along kd."),
    )
    .picture(Picture::curves("trial", "cost, ms^2", costs).caption("What the steps are worth."))
    .noted(
        "2.3-iterations",
        f64::from(slowest),
        format!("Of {TRIALS} trials of each start."),
    )
    .result("2.3-minutes", f64::from(slowest) * seconds / 60.0)
    .result("2.3-starts", worst / least)
    .noted(
        "2.3-averaged",
        one.mean / two.mean,
        format!(
            "{:.1} and {:.1} trials on average, {} and {} at most, of {} searches from three starts each.",
            one.mean,
            two.mean,
            one.most,
            two.most,
            bench.count(SEARCHES, 3)
        ),
    )
    .remark(
        "The three searches end at different gains of the same cost: the valley is flat, and costs \
             can be compared, gains cannot.",
    )
}

/// Fig. 2.4 or 2.5.
fn step_figure(bench: &Bench, at: AxisName, tuned: &Tuned) -> Result<Figure, Ended> {
    let (id, title, names, which, gain) = match at.axis {
        Axis::A | Axis::B => (
            "2.4",
            "Five-bar step response",
            ["2.4-rise", "2.4-settling", "2.4-detuned"],
            2,
            "kd",
        ),
        Axis::Z => (
            "2.5",
            "Z-stage step response",
            ["2.5-rise", "2.5-settling", "2.5-detuned"],
            1,
            "ki",
        ),
    };
    let (believed, trace) = believed_step(bench, at)?;
    let ([best, worse, none], less) = detuned(bench, at, tuned, which)?;
    let d = &tuned.document;
    let until = 100.0;
    Ok(Figure::new(id, title)
        .picture(
            Picture::curves(
                "time, ms",
                "position, counts",
                [
                    ("gains of the calibration", response(&trace, &trace.encoder, until)),
                    ("tuned here", response(&tuned.after, &tuned.after.encoder, until)),
                    (
                        if which == 2 { "kd 20 % smaller" } else { "ki 20 % smaller" },
                        response(&less, &less.encoder, until),
                    ),
                ],
            )
            .x(0.0, until)
            .caption(format!(
                "A step of {} counts at the motor's encoder.",
                usual_step(at.axis)
            )),
        )
        .noted(
            names[0],
            believed.rise_ms,
            format!("Tuned here: {:.1} ms.", d.rise_ms),
        )
        .noted(
            names[1],
            believed.settling_ms,
            format!("Tuned here: {:.1} ms.", d.settling_ms),
        )
        .noted(
            names[2],
            worse / best,
            if which == 1 {
                format!(
                    "{best:.1} ms^2, {worse:.1} ms^2 with {gain} 20 % smaller, {none:.1} ms^2 without it."
                )
            } else {
                format!("{best:.1} ms^2, and {worse:.1} ms^2 with {gain} 20 % smaller.")
            },
        )
        .remark(format!(
            "At the optimum of the ITAE this machine rises in {:.1} ms and settles in {:.1} ms, sooner \
             than the thesis's; rise and settling above are those of the gains in the calibration.",
            d.rise_ms, d.settling_ms
        )))
}

pub(super) fn z_gains(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    let found = tuned(bench, Z)?;
    Ok(vec![step_figure(bench, Z, &found)?])
}

/// A sine as `pigtail characterize AXIS sine` follows it, and its picture.
fn sine_figure(
    bench: &Bench,
    at: AxisName,
    hertz: f64,
    figure: Figure,
    [gain, lag]: [&'static str; 2],
) -> Result<Figure, Ended> {
    let setup = &bench.machine;
    let amplitude = (usual_step(at.axis) / 4) as f64;
    let (d, trace) = setup.experiment(bench.seed, |station| {
        follow_sine(station, &setup.rig, at, hertz, amplitude)
    })?;
    let until = 2e3 / hertz;
    let mut curves = vec![
        ("desired", response(&trace, &trace.reference, until)),
        ("actual", response(&trace, &trace.encoder, until)),
    ];
    if let Ok(scale) = metres_per_count(&setup.rig, at.axis) {
        let counts: Vec<f64> = trace.output.iter().map(|m| m / scale).collect();
        curves.push(("output", response(&trace, &counts, until)));
    }
    let output = d.output_phase_deg.map_or_else(String::new, |deg| {
        format!("{:.1} degrees at the output.", -deg)
    });
    // The printed lags of both axes are nearly one time, which is no axis's own: their servos differ.
    let late = PRINTED_LATE * hertz * 360.0;
    let output = format!(
        "{output} With a reference that comes {:.0} ms late, as one that a host hands on would, {:.1} degrees.",
        1e3 * PRINTED_LATE,
        late - d.encoder_phase_deg
    );
    Ok(figure
        .picture(
            Picture::curves("time, ms", "position, counts", curves)
                .x(0.0, until)
                .caption(format!(
                    "A sine of {hertz} Hz and {amplitude} counts at the motor's encoder, and at the output \
                     by the probe."
                )),
        )
        .result(gain, d.encoder_gain)
        .noted(lag, -d.encoder_phase_deg, output))
}

/// The frequency at which the gain at the encoder has fallen by 3 dB, for sines of an amplitude,
/// hertz.
fn bandwidth(bench: &Bench, at: AxisName, amplitude: f64) -> Result<f64, Ended> {
    const STEP: f64 = 5.0;
    const HIGHEST: u32 = 60;
    let setup = &bench.machine;
    let mut last = 1.0;
    for k in 2..HIGHEST {
        let hertz = STEP * f64::from(k);
        let (d, _) = setup.experiment(bench.seed, |station| {
            follow_sine(station, &setup.rig, at, hertz, amplitude)
        })?;
        let down = std::f64::consts::FRAC_1_SQRT_2;
        if d.encoder_gain < down {
            return Ok(hertz - STEP * (down - d.encoder_gain) / (last - d.encoder_gain));
        }
        last = d.encoder_gain;
    }
    Ok(f64::INFINITY)
}

pub(super) fn five_bar_sine(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    let setup = &bench.machine;
    let amplitude = (usual_step(FIVE_BAR.axis) / 4) as f64;
    let noise = 0.2 * amplitude;
    let (small, ..) = setup.experiment(bench.seed, |station| {
        frequency(station, &setup.rig, FIVE_BAR, noise, bench.seed)
    })?;
    let small = small.bandwidth_hz.unwrap_or(f64::INFINITY);
    let bandwidth = bandwidth(bench, FIVE_BAR, amplitude)?;
    let figure = Figure::new("2.6", "Sinusoidal response of five-bar");
    let figure = sine_figure(bench, FIVE_BAR, 10.0, figure, ["2.6-gain", "2.6-lag"])?;
    Ok(vec![figure.noted(
        "2.6-sampling",
        setup.rig.spec.servo.rate / bandwidth,
        format!(
            "Bandwidth {bandwidth:.0} Hz for sines as large as this one; for {noise:.0} counts, where the \
             motor's voltage is no limit, it is {small:.0} Hz, 1/{:.0} of the servo's.",
            setup.rig.spec.servo.rate / small
        ),
    )])
}

pub(super) fn z_sine(bench: &Bench) -> Result<Vec<Figure>, Ended> {
    let figure = Figure::new("2.7", "Sinusoidal response of z-stage");
    Ok(vec![sine_figure(
        bench,
        Z,
        8.0,
        figure,
        ["2.7-gain", "2.7-lag"],
    )?])
}

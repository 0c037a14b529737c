//! The micro manipulators: piezos behind their amplifiers.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use super::plant::{Plant, TemperaturePlant};
use super::sensors::{nearest, normal};
use pigtail_hal::Spec;
use pigtail_hal::quantity::Volts;
use pigtail_hal::spec::MICRO_AXES;
use pigtail_model::Invalid;
use pigtail_model::each::{Each, held};
use pigtail_model::frames::Displacement;
use pigtail_model::hysteresis::{Creep, CreepState, Hysteresis, HysteresisState};
use pigtail_model::piezo::{Resonance, ResonanceStates, Resonances};
use rand::{Rng, RngExt};

/// No specimen is damped more.
const MOST_DAMPING: f64 = 0.99;

/// A response of which so small a share has been left for so many cycles is over; none of its periods is longer.
const GONE: f64 = 1e-3;
const QUIET: u32 = 200;
/// Nobody waits longer than so many cycles, some ten seconds, for one that is hardly damped.
const LONGEST: u32 = 50_000;

/// How often a piezo turned before it came to rest, and for how many cycles it was on its way to each place
/// and stayed there.
const TURNS: u32 = 8;
const RAMP: u32 = 50;
const HOLD: u32 = 250;

/// A micro manipulator: two piezo axes in their own frame.
#[derive(Debug, Clone)]
pub(super) struct Micro {
    piezos: [Piezo; MICRO_AXES],
    flexure: Flexure,
    swing: Swing,
    /// White noise before the flexure, metres.
    kick: [f64; MICRO_AXES],
    /// Metres a volt of full stroke, with the coupling of the axes.
    gain: [[f64; MICRO_AXES]; MICRO_AXES],
    /// The same as cold as it was commissioned.
    cold: [[f64; MICRO_AXES]; MICRO_AXES],
    centre: f64,
    limit: f64,
    step: f64,
    sin: f64,
    cos: f64,
}

/// What a flexure is moved by: along each axis where the piezos bring it, and then what the noise of their amplifiers adds. All of them
/// are worked out at once.
const MOVED: usize = 2 * MICRO_AXES;

/// What carries a tip: a resonance of each axis and, if there is one, a second behind it with the share of the
/// displacement that goes by it.
#[derive(Debug, Clone)]
struct Flexure {
    first: Resonances<MOVED>,
    second: Option<(Resonances<MOVED>, f64)>,
}

/// Where a flexure is, and how fast.
#[derive(Debug, Clone, Copy, Default)]
struct Swing {
    first: ResonanceStates<MOVED>,
    second: ResonanceStates<MOVED>,
}

impl Flexure {
    fn new([x, y]: [Resonance; MICRO_AXES], second: Option<(Resonance, f64)>) -> Self {
        Self {
            first: Resonances::new([x, y, x, y]),
            second: second.map(|(mode, share)| (Resonances::new([mode; MOVED]), share)),
        }
    }

    /// One cycle under inputs in metres.
    #[inline(always)]
    fn advance(&self, swing: &mut Swing, input: Each<MOVED>) {
        self.first.advance(&mut swing.first, input);
        if let Some((second, _)) = &self.second {
            second.advance(&mut swing.second, input);
        }
    }

    /// What each brings, metres.
    #[inline(always)]
    fn positions(&self, swing: &Swing) -> Each<MOVED> {
        let first = swing.first.position;
        match &self.second {
            None => first,
            Some((_, share)) => first + *share * (swing.second.position - first),
        }
    }

    /// Standard deviations that white noise of one, a new value each cycle, brings the axes to in time: the roots of
    /// the sums of squares of their responses to a single cycle.
    fn of_white_noise(&self) -> [f64; MICRO_AXES] {
        let mut swing = Swing::default();
        let mut responses = [(0.0, 0.0_f64, 0); MICRO_AXES];
        self.advance(&mut swing, Each([1.0; MOVED]));
        // Until a while of nothing but the last of the tail: what rings passes through zero on its way.
        for _ in 0..LONGEST {
            let at = self.positions(&swing);
            for (axis, (sum, largest, quiet)) in responses.iter_mut().enumerate() {
                if *quiet == QUIET {
                    continue;
                }
                let at = at[axis].abs();
                *largest = largest.max(at);
                *quiet = if at > GONE * *largest { 0 } else { *quiet + 1 };
                *sum += at * at;
            }
            if responses.iter().all(|(.., quiet)| *quiet == QUIET) {
                break;
            }
            self.advance(&mut swing, Each([0.0; MOVED]));
        }
        responses.map(|(sum, ..)| f64::sqrt(sum))
    }
}

/// A piezo by itself: from its voltage to what it would do were it alone. At switch-on it rests in
/// the middle of its range, where the amplifiers leave it after a few cycles of falling amplitude.
#[derive(Debug, Clone)]
struct Piezo {
    hysteresis: Hysteresis,
    /// The same as cold as it was commissioned, where warmth changes it.
    cold: Option<Box<Hysteresis>>,
    creep: Creep,
    state: (HysteresisState, CreepState),
}

impl Piezo {
    /// One cycle; voltage and result are from the middle of the range, as shares of its half.
    #[inline(always)]
    fn advance(&mut self, input: f64) -> f64 {
        let (hysteresis, creep) = &mut self.state;
        let applied = self.hysteresis.advance(hysteresis, input);
        self.creep.advance(creep, applied)
    }
}

impl Micro {
    pub(super) fn new(
        plant: &Plant,
        spec: &Spec,
        rng: &mut impl rand::RngExt,
    ) -> Result<Self, Invalid> {
        let m = &plant.micro;
        let v = &plant.variation;
        let mut gain = || m.gain * v.factor(rng, v.micro_gain);
        let (p, q) = (gain(), gain());
        let (sin, cos) = spec.micro.angle.sin_cos();
        let mut piezo = || -> Result<Piezo, Invalid> {
            let (hysteresis, creep) = m.draw(v, spec.period(), rng)?;
            Ok(Piezo {
                hysteresis,
                cold: None,
                creep,
                state: Default::default(),
            })
        };
        let piezos = [piezo()?, piezo()?];
        let mut resonance = || {
            let (at, damping) = (
                m.resonance * v.factor(rng, v.resonance),
                m.damping * v.factor(rng, v.damping),
            );
            Resonance::new(at, damping.min(MOST_DAMPING), spec.period())
        };
        let first = [resonance()?, resonance()?];
        let second = match m.second {
            Some(mode) => Some((
                Resonance::new(mode.resonance, mode.damping, spec.period())?,
                mode.share,
            )),
            None => None,
        };
        let flexure = Flexure::new(first, second);
        let gain = [[p, m.coupling * q], [m.coupling * p, q]];
        Ok(Self {
            piezos,
            kick: flexure
                .of_white_noise()
                .map(|deviation| m.noise / deviation),
            flexure,
            swing: Swing::default(),
            gain,
            cold: gain,
            centre: 0.5 * spec.micro.voltage,
            limit: spec.micro.voltage,
            step: spec.micro.resolution * spec.micro.voltage / spec.micro.range,
            sin,
            cos,
        })
    }

    /// One cycle under these inputs; the displacement in the manipulator's x and y, metres.
    #[inline(always)]
    pub(super) fn advance(
        &mut self,
        volts: [Volts; MICRO_AXES],
        rng: &mut impl Rng,
    ) -> Displacement {
        let [first, second] = volts;
        let (u, v) = (self.alone(0, first), self.alone(1, second));
        let mut input = Each([0.0; MOVED]);
        for i in 0..MICRO_AXES {
            input[i] = self.gain[i][0] * u + self.gain[i][1] * v;
            input[MICRO_AXES + i] = self.kick[i] * normal(rng);
        }
        self.flexure.advance(&mut self.swing, input);
        let Each([p, q, shaken_p, shaken_q]) = self.flexure.positions(&self.swing);
        Displacement::new(p + shaken_p, q + shaken_q).turned(self.sin, self.cos)
    }

    /// What a piezo would do by itself, volts of full stroke.
    #[inline(always)]
    fn alone(&mut self, piezo: usize, Volts(volts): Volts) -> f64 {
        let given = nearest(held(volts, 0.0, self.limit) / self.step) * self.step;
        self.centre * self.piezos[piezo].advance((given - self.centre) / self.centre)
    }

    /// A piezo gives no more than a share of its stroke.
    pub(super) fn weaken(&mut self, piezo: usize, share: f64) {
        for row in self.gain.iter_mut().chain(&mut self.cold) {
            row[piezo] *= share;
        }
    }

    /// It is so many kelvin warmer than when it was commissioned.
    pub(super) fn warm(&mut self, by: &TemperaturePlant, warmer: f64) {
        for (row, cold) in self.gain.iter_mut().zip(&self.cold) {
            for ((gain, cold), grows) in row.iter_mut().zip(cold).zip(by.strokes) {
                *gain = cold * (1.0 + grows * warmer);
            }
        }
        if by.hysteresis != 0.0 {
            for piezo in &mut self.piezos {
                let cold = piezo
                    .cold
                    .get_or_insert_with(|| Box::new(piezo.hysteresis.clone()));
                piezo.hysteresis =
                    cold.with_plays(1.0 + by.hysteresis * warmer, &mut piezo.state.0);
            }
        }
    }

    /// The displacement in the manipulator's x and y without noise, metres.
    pub(super) fn displacement(&self) -> Displacement {
        let Each([p, q, ..]) = self.flexure.positions(&self.swing);
        Displacement::new(p, q).turned(self.sin, self.cos)
    }

    /// What the piezos did before they came to rest in the middle of their range: as far as `most` of its
    /// half, to and fro.
    pub(super) fn wear_in(&mut self, most: f64, rng: &mut impl RngExt) {
        for piezo in &mut self.piezos {
            let mut from = 0.0;
            for turn in 0..=TURNS {
                let to = match turn {
                    TURNS => 0.0,
                    _ => most * (2.0 * rng.random::<f64>() - 1.0),
                };
                for step in 1..=RAMP {
                    piezo.advance(from + (to - from) * f64::from(step) / f64::from(RAMP));
                }
                for _ in 0..HOLD {
                    piezo.advance(to);
                }
                from = to;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Standard deviation of a flexure under white noise that is to bring it to one, and how alike two moments are a
    /// millisecond apart.
    fn shaken(flexure: &Flexure, period: f64) -> (f64, f64) {
        let kick = flexure.of_white_noise()[0].recip();
        let mut rng = rand_pcg::Pcg64Mcg::new(1);
        let mut swing = Swing::default();
        let at: Vec<f64> = (0..400_000)
            .map(|_| {
                flexure.advance(&mut swing, Each([kick * normal(&mut rng), 0.0, 0.0, 0.0]));
                flexure.positions(&swing)[0]
            })
            .collect();
        let apart = (1e-3 / period).round() as usize;
        let n = at.len() as f64;
        let variance = at.iter().map(|x| x * x).sum::<f64>() / n;
        let together = at.iter().zip(&at[apart..]).map(|(x, y)| x * y);
        (
            variance.sqrt(),
            together.sum::<f64>() / (n - apart as f64) / variance,
        )
    }

    #[test]
    fn a_warm_piezo_goes_farther_and_a_cold_one_as_before() {
        let rig = concat!(env!("CARGO_MANIFEST_DIR"), "/../../rigs/afpm/");
        let read = |file: &str| std::fs::read_to_string(format!("{rig}{file}")).unwrap();
        let spec = Spec::parse("machine.toml", &read("machine.toml")).unwrap();
        let mut plant = Plant::parse("plant.toml", &read("plant.toml")).unwrap();
        plant.micro.noise = 0.0;
        plant.micro.coupling = 0.0;
        let by = TemperaturePlant {
            swing: 5.0,
            strokes: [0.004, 0.002],
            hysteresis: 0.005,
            ..TemperaturePlant::default()
        };
        let mut rng = rand_pcg::Pcg64Mcg::new(3);
        let mut cold = Micro::new(&plant, &spec, &mut rng).unwrap();
        let mut warm = cold.clone();
        warm.warm(&by, 5.0);
        // To the end of its stroke, where loops of any width close.
        let end = |micro: &mut Micro, rng: &mut rand_pcg::Pcg64Mcg| {
            for k in 0..=2000 {
                let volts = Volts(micro.centre + micro.centre * (f64::from(k) / 1000.0).min(1.0));
                micro.advance([volts; MICRO_AXES], rng);
            }
            let Each([p, q, ..]) = micro.flexure.positions(&micro.swing);
            [p, q]
        };
        let (before, now) = (end(&mut cold, &mut rng), end(&mut warm, &mut rng));
        for (i, grows) in by.strokes.into_iter().enumerate() {
            let by = now[i] / before[i];
            assert!((by - (1.0 + 5.0 * grows)).abs() < 1e-3, "{i}: {by}");
        }
        warm.warm(&by, 0.0);
        let (before, now) = (end(&mut cold, &mut rng), end(&mut warm, &mut rng));
        // But for how it has crept on the way there.
        assert!(
            (now[0] / before[0] - 1.0).abs() < 1e-4,
            "{now:?} {before:?}"
        );
    }

    #[test]
    fn amplifiers_shake_a_tip_by_what_is_stated_and_no_faster_than_it_can_move() {
        let period = 2e-4;
        for second in [None, Some((700.0, 0.05, 0.1))] {
            for (frequency, damping) in [(200.0, 0.5), (91.0, 0.05), (440.0, 0.85)] {
                let resonance =
                    |(at, damping): (f64, f64)| Resonance::new(at, damping, period).unwrap();
                let behind = second.map(|(at, damping, share)| (resonance((at, damping)), share));
                let flexure = Flexure::new([resonance((frequency, damping)); MICRO_AXES], behind);
                let (deviation, alike) = shaken(&flexure, period);
                assert!((deviation - 1.0).abs() < 0.05, "{frequency}: {deviation}");
                // What a resonance under white noise is a while later, in closed form.
                let decay = damping * std::f64::consts::TAU * frequency;
                let damped = std::f64::consts::TAU * frequency * (1.0 - damping * damping).sqrt();
                let (sin, cos) = (damped * 1e-3).sin_cos();
                let expected = (-decay * 1e-3).exp() * (cos + decay / damped * sin);
                // A second one swings faster and takes its share.
                let most = if second.is_some() { 0.3 } else { 0.05 };
                assert!((alike - expected).abs() < most, "{alike} {expected}");
            }
        }
    }
}

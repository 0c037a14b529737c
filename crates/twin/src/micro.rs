//! The micro manipulators: piezos behind their amplifiers.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use super::plant::Plant;
use super::sensors::{nearest, normal};
use pigtail_hal::Spec;
use pigtail_hal::quantity::Volts;
use pigtail_hal::spec::MICRO_AXES;
use pigtail_model::Invalid;
use pigtail_model::frames::Displacement;
use pigtail_model::hysteresis::{Creep, CreepState, Hysteresis, HysteresisState};
use pigtail_model::piezo::{Resonance, ResonanceState};
use rand::{Rng, RngExt};

/// No specimen is damped more.
const MOST_DAMPING: f64 = 0.99;

/// How often a piezo turned before it came to rest, and for how many cycles it was on its way to each place
/// and stayed there.
const TURNS: u32 = 8;
const RAMP: u32 = 50;
const HOLD: u32 = 250;

/// A micro manipulator: two piezo axes in their own frame.
#[derive(Debug, Clone)]
pub(super) struct Micro {
    piezos: [Piezo; MICRO_AXES],
    resonances: [Resonance; MICRO_AXES],
    states: [ResonanceState; MICRO_AXES],
    /// A second resonance, and the share of the displacement that goes by it.
    second: Option<(Resonance, [ResonanceState; MICRO_AXES], f64)>,
    /// Metres a volt of full stroke, with the coupling of the axes.
    gain: [[f64; MICRO_AXES]; MICRO_AXES],
    centre: f64,
    limit: f64,
    step: f64,
    noise: f64,
    sin: f64,
    cos: f64,
}

/// A piezo by itself: from its voltage to what it would do were it alone. At switch-on it rests in
/// the middle of its range, where the amplifiers leave it after a few cycles of falling amplitude.
#[derive(Debug, Clone)]
struct Piezo {
    hysteresis: Hysteresis,
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
        let second = match m.second {
            Some(mode) => Some((
                Resonance::new(mode.resonance, mode.damping, spec.period())?,
                Default::default(),
                mode.share,
            )),
            None => None,
        };
        Ok(Self {
            piezos,
            resonances: [resonance()?, resonance()?],
            second,
            states: [ResonanceState::default(); MICRO_AXES],
            gain: [[p, m.coupling * q], [m.coupling * p, q]],
            centre: 0.5 * spec.micro.voltage,
            limit: spec.micro.voltage,
            step: spec.micro.resolution * spec.micro.voltage / spec.micro.range,
            noise: m.noise,
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
        let mut at = [0.0; MICRO_AXES];
        for (i, at) in at.iter_mut().enumerate() {
            let input = self.gain[i][0] * u + self.gain[i][1] * v;
            self.resonances[i].advance(&mut self.states[i], input);
            if let Some((resonance, states, _)) = &mut self.second {
                resonance.advance(&mut states[i], input);
            }
            *at = self.position(i) + self.noise * normal(rng);
        }
        let [p, q] = at;
        Displacement::new(p, q).turned(self.sin, self.cos)
    }

    /// What a piezo would do by itself, volts of full stroke.
    #[inline(always)]
    fn alone(&mut self, piezo: usize, Volts(volts): Volts) -> f64 {
        let held = nearest(volts.clamp(0.0, self.limit) / self.step) * self.step;
        self.centre * self.piezos[piezo].advance((held - self.centre) / self.centre)
    }

    /// A piezo gives no more than a share of its stroke.
    pub(super) fn weaken(&mut self, piezo: usize, share: f64) {
        for row in &mut self.gain {
            row[piezo] *= share;
        }
    }

    /// The displacement in the manipulator's x and y without noise, metres.
    pub(super) fn displacement(&self) -> Displacement {
        Displacement::new(self.position(0), self.position(1)).turned(self.sin, self.cos)
    }

    /// Of an axis, metres.
    #[inline]
    fn position(&self, axis: usize) -> f64 {
        let first = self.states[axis].position;
        match &self.second {
            None => first,
            Some((_, states, share)) => first + share * (states[axis].position - first),
        }
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

//! The micro manipulators: piezos behind their amplifiers.

use super::plant::{Plant, factor};
use super::sensors::normal;
use pigtail_hal::Spec;
use pigtail_hal::quantity::Volts;
use pigtail_hal::spec::MICRO_AXES;
use pigtail_model::Invalid;
use pigtail_model::frames::Displacement;
use pigtail_model::hysteresis::{Creep, CreepState, Hysteresis, HysteresisState};
use pigtail_model::piezo::{Resonance, ResonanceState};
use rand::Rng;

/// A micro manipulator: two piezo axes in their own frame.
#[derive(Debug, Clone)]
pub(super) struct Micro {
    piezos: [Piezo; MICRO_AXES],
    resonance: Resonance,
    states: [ResonanceState; MICRO_AXES],
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
        let mut gain = || m.gain * factor(rng, plant.variation.micro_gain);
        let (p, q) = (gain(), gain());
        let (sin, cos) = spec.micro.angle.sin_cos();
        let mut piezo = || -> Result<Piezo, Invalid> {
            let (hysteresis, creep) = m.draw(&plant.variation, spec.period(), rng)?;
            Ok(Piezo {
                hysteresis,
                creep,
                state: Default::default(),
            })
        };
        Ok(Self {
            piezos: [piezo()?, piezo()?],
            resonance: Resonance::new(m.resonance, m.damping, spec.period())?,
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
    pub(super) fn advance(
        &mut self,
        volts: [Volts; MICRO_AXES],
        rng: &mut impl Rng,
    ) -> Displacement {
        let [u, v] = std::array::from_fn(|i| {
            let Volts(volts) = volts[i];
            let held = (volts.clamp(0.0, self.limit) / self.step).round() * self.step;
            self.centre * self.piezos[i].advance((held - self.centre) / self.centre)
        });
        let [p, q] = std::array::from_fn(|i| {
            let input = self.gain[i][0] * u + self.gain[i][1] * v;
            self.resonance.advance(&mut self.states[i], input);
            self.states[i].position + self.noise * normal(rng)
        });
        Displacement::new(p, q).turned(self.sin, self.cos)
    }

    /// A piezo gives no more than a share of its stroke.
    pub(super) fn weaken(&mut self, piezo: usize, share: f64) {
        for row in &mut self.gain {
            row[piezo] *= share;
        }
    }

    /// The displacement in the manipulator's x and y without noise, metres.
    pub(super) fn displacement(&self) -> Displacement {
        let [p, q] = self.states.map(|state| state.position);
        Displacement::new(p, q).turned(self.sin, self.cos)
    }
}

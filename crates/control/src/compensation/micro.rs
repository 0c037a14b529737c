//! A micro manipulator with its piezos' hysteresis taken out: from a wanted displacement of the
//! tip to the voltages that bring it about.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use super::hysteresis::{Invalid, Model, Range, State};
use pigtail_hal::Spec;
use pigtail_hal::quantity::Volts;
use pigtail_hal::spec::MICRO_AXES;
use pigtail_model::each::held;
use pigtail_model::frames::Displacement;
use serde::{Deserialize, Serialize};

/// What is believed of a micro manipulator's piezos.
///
/// A piezo's displacement is counted along its own axis, such that its share in x is what the
/// axis's angle says; what the flexure's joints make of it in y is then `ratio` times what the
/// angle says (the static coupling of thesis 4.2, a linear map).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MicroModel {
    /// Volts to metres, one model for each piezo.
    pub piezos: [Model; MICRO_AXES],
    /// Displacement in y for one in x.
    pub ratio: f64,
}

impl MicroModel {
    /// Checks what was read from a file.
    ///
    /// # Errors
    ///
    /// When a model is none, or the ratio is not positive.
    pub fn check(&self) -> Result<(), Invalid> {
        if !(self.ratio > 0.5 && self.ratio < 2.0) {
            return Err(Invalid {
                what: "ratio",
                value: self.ratio.to_string(),
                accepted: "0.5 to 2".to_owned(),
            });
        }
        self.piezos.iter().try_for_each(Model::check)
    }

    /// How far each piezo goes to either side of where it rests in the middle of its voltage, metres: to
    /// where it is after a tenth of a second at either end of the voltage.
    pub fn ranges(&self, spec: &Spec) -> [Range; MICRO_AXES] {
        const AFTER: f64 = 0.1;
        self.piezos.each_ref().map(|piezo| {
            let at = |volts: f64| piezo.displacement(&mut piezo.switched_on(), volts, AFTER);
            let middle = at(0.5 * spec.micro.voltage);
            Range {
                low: at(0.0) - middle,
                high: at(spec.micro.voltage) - middle,
            }
        })
    }
}

/// A [`MicroModel`] at work.
#[derive(Debug, Clone)]
pub struct MicroCompensation {
    model: MicroModel,
    states: [State; MICRO_AXES],
    /// What each model says of a piezo switched on and in the middle of its voltage, metres: where
    /// displacements are counted from.
    zeros: [f64; MICRO_AXES],
    limits: Range,
    sin: f64,
    cos: f64,
    half_range: f64,
    period: f64,
}

impl MicroCompensation {
    /// Whether a network stands for a piezo: it knows less of small loops than what remembers.
    pub fn is_network(&self) -> bool {
        self.model
            .piezos
            .iter()
            .any(|model| matches!(model, Model::Rbf(_)))
    }

    /// Begins with piezos that rest in the middle of their range, as they do at switch-on.
    pub fn new(model: &MicroModel, spec: &Spec) -> Self {
        let period = spec.period();
        let middle = 0.5 * spec.micro.voltage;
        let (sin, cos) = spec.micro.angle.sin_cos();
        let states = std::array::from_fn(|i| model.piezos[i].switched_on());
        let zeros = std::array::from_fn(|i| {
            let piezo = &model.piezos[i];
            piezo.displacement(&mut piezo.switched_on(), middle, period)
        });
        Self {
            model: model.clone(),
            states,
            zeros,
            limits: Range {
                low: 0.0,
                high: spec.micro.voltage,
            },
            sin,
            cos,
            half_range: 0.5 * spec.micro.range,
            period,
        }
    }

    /// Displacement in y for one in x.
    pub fn ratio(&self) -> f64 {
        self.model.ratio
    }

    /// Another one, from now on.
    pub fn set_ratio(&mut self, ratio: f64) {
        self.model.ratio = ratio;
    }

    /// The voltages of the next cycle for a tip that is wanted so far from its centre in the
    /// manipulator's frame, held within the range.
    pub fn next(&mut self, to: Displacement) -> [Volts; MICRO_AXES] {
        self.next_along(self.along(to))
    }

    /// How far each piezo has to go, metres, for a tip that is wanted so far from its centre.
    #[inline(always)]
    pub fn along(&self, to: Displacement) -> [f64; MICRO_AXES] {
        let uncoupled = Displacement::new(to.x, to.y / self.model.ratio);
        let along = uncoupled.turned(-self.sin, self.cos);
        [along.x, along.y]
    }

    /// The voltages of the next cycle for piezos that are to go so far, metres.
    #[inline(always)]
    pub fn next_along(&mut self, wanted: [f64; MICRO_AXES]) -> [Volts; MICRO_AXES] {
        let (half, period, limits) = (self.half_range, self.period, &self.limits);
        let [first, second] = [0, 1].map(|i: usize| held(wanted[i], -half, half) + self.zeros[i]);
        let [p, q] = &self.model.piezos;
        let [of_p, of_q] = &mut self.states;
        if let (Model::Memory(p), Model::Memory(q)) = (p, q)
            && let (State::Memory(of_p), State::Memory(of_q)) = (&mut *of_p, &mut *of_q)
        {
            // Both are asked before one answers: what an answer is depends on where the voltage goes, and nobody waits for that twice.
            let first = p.asked(of_p, first, period);
            let second = q.asked(of_q, second, period);
            let first = p.answer(of_p, first, limits);
            return [Volts(first), Volts(q.answer(of_q, second, limits))];
        }
        [
            Volts(p.voltage(of_p, first, period, limits)),
            Volts(q.voltage(of_q, second, period, limits)),
        ]
    }

    /// Takes note of voltages that somebody else has set for the next cycle.
    pub fn follow(&mut self, volts: [Volts; MICRO_AXES]) {
        for (i, Volts(volts)) in volts.into_iter().enumerate() {
            let state = &mut self.states[i];
            self.model.piezos[i].displacement(state, volts, self.period);
        }
    }
}

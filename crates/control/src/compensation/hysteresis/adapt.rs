//! A model that goes on learning while there is light to learn from, and never does worse than a
//! straight line.
//!
//! A piezo's gain drifts with temperature and age; the shape of its loops hardly does. So what is
//! learned on line is a line from what the model tells to what is measured, by recursive least
//! squares with forgetting. Beside it a line from the voltage is learned in the same way: that is
//! what one would do without a model. Whichever of the two told the measured displacements better
//! of late, before it saw them, gives the voltage.

use super::{Invalid, Model, Range, State};

/// A straight line `y = a + b u`, by recursive least squares with forgetting. It forgets nothing
/// that it is not told anew.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Line {
    /// `a` and `b`.
    coefficients: [f64; 2],
    covariance: [[f64; 2]; 2],
    forgetting: f64,
    /// Bounds of `b`: no piezo changes more.
    slopes: [f64; 2],
}

/// What a line's covariance may grow to.
const UNSURE: f64 = 1e3;

impl Line {
    fn at(&self, u: f64) -> f64 {
        self.coefficients[0] + self.coefficients[1] * u
    }

    fn learn(&mut self, u: f64, y: f64) {
        let [[p, q], [_, r]] = self.covariance;
        let gain = [p + q * u, q + r * u];
        let scale = 1.0 / (self.forgetting + gain[0] + u * gain[1]);
        let error = y - self.at(u);
        for (c, g) in self.coefficients.iter_mut().zip(gain) {
            *c += scale * g * error;
        }
        let [low, high] = self.slopes;
        self.coefficients[1] = self.coefficients[1].clamp(low, high);
        let mut next = [
            [p - scale * gain[0] * gain[0], q - scale * gain[0] * gain[1]],
            [q - scale * gain[0] * gain[1], r - scale * gain[1] * gain[1]],
        ];
        if (next[0][0] + next[1][1]) / self.forgetting < UNSURE {
            next = next.map(|row| row.map(|v| v / self.forgetting));
        }
        self.covariance = next;
    }
}

/// A [`Model`] that goes on learning.
#[derive(Debug, Clone)]
pub struct Adaptive {
    model: Model,
    state: State,
    input: Range,
    output: Range,
    /// From what the model tells to what is measured, both shares of the range.
    corrected: Line,
    /// From the voltage.
    straight: Line,
    /// Mean squares of late of both lines' errors, before they learned from them.
    squares: [f64; 2],
    forgetting: f64,
    /// What the model told last, a share of the range.
    prediction: f64,
}

/// Bounds of the gain that is learned, beside the model's.
const GAINS: [f64; 2] = [0.7, 1.4];

impl Adaptive {
    /// A model that counts each sample `forgetting` times as much as the one after it, from a piezo
    /// as it is switched on.
    ///
    /// # Errors
    ///
    /// When the forgetting is not above 0.9 and below 1.
    pub fn new(model: Model, forgetting: f64) -> Result<Self, Invalid> {
        if !(forgetting > 0.9 && forgetting < 1.0) {
            let accepted = "above 0.9 and below 1";
            return Err(Invalid::new("forgetting", forgetting, accepted));
        }
        let (input, output) = match &model {
            Model::Rbf(model) => (model.input, model.output),
            Model::Memory(model) => (model.input, model.output),
        };
        let line = Line {
            coefficients: [0.0, 1.0],
            covariance: [[1.0, 0.0], [0.0, 1.0]],
            forgetting,
            slopes: GAINS,
        };
        Ok(Self {
            state: model.switched_on(),
            model,
            input,
            output,
            corrected: line,
            straight: line,
            squares: [0.0; 2],
            forgetting,
            prediction: 0.0,
        })
    }

    /// Whether the model is in use, and not the straight line.
    pub fn trusts_model(&self) -> bool {
        self.squares[0] <= self.squares[1]
    }

    /// The gain that was learned, beside the model's.
    pub fn gain(&self) -> f64 {
        self.corrected.coefficients[1]
    }

    /// The voltage for the next wanted displacement, `period` seconds later and within `limits`.
    pub fn voltage(&mut self, wanted: f64, period: f64, limits: &Range) -> f64 {
        let share = self.output.to_share(wanted);
        if self.trusts_model() {
            let [offset, gain] = self.corrected.coefficients;
            self.prediction = (share - offset) / gain;
            let asked = self.output.of_share(self.prediction);
            let mut before = self.state;
            let volts = self.model.voltage(&mut self.state, asked, period, limits);
            // At the end of the voltages the model tells less than it was asked for.
            self.prediction =
                self.output
                    .to_share(self.model.displacement(&mut before, volts, period));
            volts
        } else {
            let [offset, gain] = self.straight.coefficients;
            let volts = self
                .input
                .of_share((share - offset) / gain)
                .clamp(limits.low, limits.high);
            let prediction = self.model.displacement(&mut self.state, volts, period);
            self.prediction = self.output.to_share(prediction);
            volts
        }
    }

    /// Takes in where the piezo was seen to be under the last voltage.
    pub fn learn(&mut self, volts: f64, measured: f64) {
        let (u, x) = (self.input.to_share(volts), self.output.to_share(measured));
        let errors = [
            x - self.corrected.at(self.prediction),
            x - self.straight.at(u),
        ];
        for (square, error) in self.squares.iter_mut().zip(errors) {
            *square = self.forgetting * *square + (1.0 - self.forgetting) * error * error;
        }
        self.corrected.learn(self.prediction, x);
        self.straight.learn(u, x);
    }
}

#[cfg(test)]
mod tests {
    use super::super::Memory;
    use super::super::tests::memory;
    use super::*;

    const LIMITS: Range = Range {
        low: 0.0,
        high: 10.0,
    };

    /// Follows random turns for an hour on a piezo whose gain grows by a tenth meanwhile. In each
    /// of so many parts of that time: root mean square errors of the adaptive model, of the same
    /// model left alone, and of a straight line that is learned too.
    fn an_hour(believed: &Memory) -> Vec<[f64; 3]> {
        const PERIOD: f64 = 0.02;
        const PARTS: usize = 24;
        let truth = memory();
        let mut adaptive = Adaptive::new(Model::Memory(*believed), 0.999).unwrap();
        // What one would do without a model: the same learner, whose model is never trusted.
        let mut plain = Adaptive::new(Model::Memory(*believed), 0.999).unwrap();
        let mut fixed = believed.switched_on();
        let mut piezos = [truth.switched_on(); 3];
        let cycles = (3600.0 / PERIOD) as usize;
        let mut parts = vec![[0.0; 3]; PARTS];
        let mut state = 9_u64;
        let mut uniform = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 33) as f64 / f64::from(1_u32 << 31) - 0.5
        };
        let (mut wanted, mut to) = (0.0_f64, 20e-6);
        for k in 0..cycles {
            let gain = 1.0 + 0.1 * k as f64 / cycles as f64;
            if (to - wanted).abs() < 0.5e-6 {
                to = 50e-6 * uniform();
            }
            wanted += 0.4e-6 * (to - wanted).signum();
            plain.squares = [1.0, 0.0];
            let volts = [
                adaptive.voltage(wanted, PERIOD, &LIMITS),
                believed.voltage(&mut fixed, wanted, PERIOD, &LIMITS),
                plain.voltage(wanted, PERIOD, &LIMITS),
            ];
            let x: Vec<f64> = piezos
                .iter_mut()
                .zip(volts)
                .map(|(piezo, v)| gain * truth.displacement(piezo, v, PERIOD))
                .collect();
            adaptive.learn(volts[0], x[0] + 0.2e-6 * uniform());
            plain.learn(volts[2], x[2] + 0.2e-6 * uniform());
            let n = (cycles / PARTS) as f64;
            for (sum, x) in parts[(k * PARTS / cycles).min(PARTS - 1)].iter_mut().zip(x) {
                *sum += (x - wanted).powi(2) / n;
            }
        }
        parts.into_iter().map(|part| part.map(f64::sqrt)).collect()
    }

    #[test]
    fn a_gain_that_drifts_by_a_tenth_in_an_hour_is_followed() {
        let parts = an_hour(&memory());
        for (k, [adaptive, fixed, plain]) in parts.iter().enumerate() {
            assert!(adaptive < plain, "{k}: {adaptive} {plain}");
            if k > 12 {
                assert!(adaptive < &(0.2 * fixed), "{k}: {adaptive} {fixed}");
            }
        }
        let [adaptive, _, plain] = parts[parts.len() - 1];
        assert!(adaptive < 0.05 * plain, "{adaptive} beside {plain}");
    }

    /// A model of something else: loops twice as wide, turned the other way. It is worse than
    /// none, and is found out.
    #[test]
    fn a_wrong_model_does_no_more_harm_than_none() {
        let mut wrong = memory();
        for (i, weight) in wrong.weights.iter_mut().enumerate() {
            *weight = if i == 0 { 0.2 } else { 0.04 };
        }
        wrong.curve = [-0.2, 0.0];
        let parts = an_hour(&wrong);
        // The first part is the time in which it is found out.
        for [adaptive, fixed, plain] in &parts[1..] {
            assert!(fixed > plain, "the model is bad: {fixed} {plain}");
            assert!(adaptive < &(1.05 * plain), "{adaptive} {plain}");
        }
    }

    #[test]
    fn what_forgets_nothing_or_all_is_refused() {
        for forgetting in [0.5, 1.0, f64::NAN] {
            assert!(Adaptive::new(Model::Memory(memory()), forgetting).is_err());
        }
    }
}

//! How a UV adhesive cures: conversion under the lamp's dose, heat, and the gel point.
//!
//! Autocatalytic kinetics with the square root of the irradiance, as radical photopolymerisation has it (Kamal and Sourour;
//! Decker):
//!
//! ```text
//! da/dt = k (I/I0)^(1/2) exp(E/R (1/T0 - 1/T)) (a + a0)^m (1 - a)^n
//! dT/dt = -(T - T0)/tau + W I/(I0 tau) + H da/dt
//! ```
//!
//! Below the conversion of the gel point the adhesive flows, above it is a solid. How much of its shrinkage has happened goes
//! with conversion.

/// The gas constant, J/(mol K).
const GAS: f64 = 8.314_462_618;

/// What adhesives begin at, kelvin.
const ROOM: f64 = 295.0;

/// The law of an adhesive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cure {
    /// Rate `k` at the nominal irradiance, 1/s.
    rate: f64,
    /// Conversion at the gel point, 0 to 1.
    gel: f64,
    orders: (f64, f64),
    seed: f64,
    heat: Heat,
}

/// How an adhesive warms up.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Heat {
    /// `W`, what the lamp warms the bond by in the end, kelvin.
    pub lamp: f64,
    /// `H`, what its own reaction would if no heat left it, kelvin.
    pub reaction: f64,
    /// Activation energy `E`, J/mol.
    pub activation: f64,
    /// `tau`, within which it cools, seconds.
    pub cools: f64,
}

/// How far an adhesive is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Cured {
    /// Conversion, 0 to 1.
    pub conversion: f64,
    /// By how much it is warmer than the room, kelvin.
    pub warmer: f64,
}

impl Cure {
    /// Orders `(m, n)`: with a gel point at half of the conversion after 10 s they give 97 % after 30 s.
    pub const ORDERS: (f64, f64) = (0.5, 1.0);
    /// What starts the reaction, `a0`.
    pub const SEED: f64 = 0.015;

    /// An adhesive that at the nominal irradiance, kept at room temperature, gels after so many seconds at such a conversion.
    ///
    /// # Panics
    ///
    /// When the time is not above zero, or the conversion not between 0 and 1.
    pub fn gelling(after: f64, gel: f64, orders: (f64, f64), seed: f64, heat: Heat) -> Self {
        /// Steps of the integral of 1/((a + a0)^m (1 - a)^n) up to the gel point, by the midpoint rule.
        const STEPS: u32 = 2000;
        assert!(after > 0.0 && gel > 0.0 && gel < 1.0, "{after} s, {gel}");
        let step = gel / f64::from(STEPS);
        let (m, n) = orders;
        let inverse = |a: f64| ((a + seed).powf(m) * (1.0 - a).powf(n)).recip();
        let whole: f64 = (0..STEPS)
            .map(|i| step * inverse((f64::from(i) + 0.5) * step))
            .sum();
        Self {
            rate: whole / after,
            gel,
            orders,
            seed,
            heat,
        }
    }

    /// Conversion at the gel point.
    pub fn gel(&self) -> f64 {
        self.gel
    }

    /// Whether it is a solid.
    pub fn has_gelled(&self, cured: &Cured) -> bool {
        cured.conversion >= self.gel
    }

    /// A step of so many seconds at so many times the nominal irradiance.
    #[must_use]
    pub fn step(&self, cured: Cured, irradiance: f64, seconds: f64) -> Cured {
        let (m, n) = self.orders;
        let Cured { conversion, warmer } = cured;
        let arrhenius = if self.heat.activation > 0.0 {
            let temperature = ROOM + warmer;
            (self.heat.activation / GAS * (ROOM.recip() - temperature.recip())).exp()
        } else {
            1.0
        };
        let left = (1.0 - conversion).max(0.0);
        let speed = self.rate
            * irradiance.max(0.0).sqrt()
            * arrhenius
            * (conversion + self.seed).powf(m)
            * left.powf(n);
        let by = (speed * seconds).min(left);
        let cooling = if self.heat.cools > 0.0 {
            (self.heat.lamp * irradiance - warmer) / self.heat.cools
        } else {
            0.0
        };
        Cured {
            conversion: conversion + by,
            warmer: warmer + seconds * cooling + self.heat.reaction * by,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(cure: &Cure, seconds: f64, irradiance: f64) -> Cured {
        let step = 1e-3;
        (0..(seconds / step).round() as u32).fold(Cured::default(), |cured, _| {
            cure.step(cured, irradiance, step)
        })
    }

    #[test]
    fn first_and_second_factor_of_order_one_are_a_logistic_curve() {
        let cure = Cure::gelling(10.0, 0.5, (1.0, 1.0), 0.02, Heat::default());
        // ln((a + a0)/(1 - a)) = ln a0 + k (1 + a0) t.
        for t in [3.0, 10.0, 17.0_f64] {
            let k = ((0.52_f64 / 0.5).ln() - 0.02_f64.ln()) / (1.02 * 10.0);
            let odds = (0.02_f64.ln() + k * 1.02 * t).exp();
            let expected = (odds - 0.02) / (1.0 + odds);
            let a = after(&cure, t, 1.0).conversion;
            assert!((a - expected).abs() < 2e-4, "{t}: {a} and {expected}");
        }
    }

    #[test]
    fn it_gels_at_ten_seconds_and_is_cured_at_thirty() {
        let cure = Cure::gelling(10.0, 0.5, Cure::ORDERS, Cure::SEED, Heat::default());
        assert!(!cure.has_gelled(&after(&cure, 9.98, 1.0)));
        assert!(cure.has_gelled(&after(&cure, 10.02, 1.0)));
        let a = after(&cure, 30.0, 1.0).conversion;
        assert!((0.96..0.98).contains(&a), "{a}");
        assert_eq!(after(&cure, 30.0, 0.0), Cured::default());
    }

    #[test]
    fn four_times_the_light_is_twice_as_fast() {
        let cure = Cure::gelling(10.0, 0.5, Cure::ORDERS, Cure::SEED, Heat::default());
        let (slow, fast) = (after(&cure, 8.0, 1.0), after(&cure, 4.0, 4.0));
        assert!((slow.conversion - fast.conversion).abs() < 1e-3);
    }

    #[test]
    fn warmth_hastens_it_and_goes_with_the_lamp() {
        let heat = Heat {
            lamp: 5.0,
            reaction: 10.0,
            activation: 30e3,
            cools: 2.0,
        };
        let cold = Cure::gelling(10.0, 0.5, Cure::ORDERS, Cure::SEED, Heat::default());
        let warm = Cure::gelling(10.0, 0.5, Cure::ORDERS, Cure::SEED, heat);
        let (a, b) = (after(&cold, 8.0, 1.0), after(&warm, 8.0, 1.0));
        assert!(b.conversion > a.conversion && b.warmer > 4.0, "{a:?} {b:?}");
        let mut off = b;
        for _ in 0..20_000 {
            off = warm.step(off, 0.0, 1e-3);
        }
        assert!(off.warmer < 0.01 && off.conversion == b.conversion);
    }
}

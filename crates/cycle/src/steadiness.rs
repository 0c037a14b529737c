//! How steady light is from one look to another half a minute later.
//!
//! What a fiber has lost is told by two looks at its light with a cure between them; a laser that wanders meanwhile is taken
//! for a loss, or hides one. Where an output of the same device is fixed already its light tells how the laser has wandered: it
//! is taken out, and remembered for the fibers that have nothing to be held against.

/// Standard deviation of a laser's power over that time beforehand, relative: those without a control loop wander by 0.1 to 2 %,
/// makers say.
const BEFOREHAND: f64 = 0.01;

/// For how many looks that counts.
const COUNTS: f64 = 2.0;

/// What is left where light through a fixed output is held against, relative: two photodiodes whose gains go with temperature
/// by some 0.1 % a kelvin, and a bond that is young.
const HELD_AGAINST: f64 = 0.002;

/// What looks have told of a laser.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Steadiness {
    looks: f64,
    squares: f64,
}

impl Steadiness {
    /// Light that nothing has touched has changed by so much, relative; nothing where that was not seen.
    pub fn learn(&mut self, wander: Option<f64>) {
        if let Some(wander) = wander {
            self.looks += 1.0;
            self.squares += wander * wander;
        }
    }

    /// Relative standard deviation of light from one look to the next; where it is held against a fixed output, of what is
    /// left.
    pub fn of(&self, held_against: bool) -> f64 {
        if held_against {
            return HELD_AGAINST;
        }
        let squares = COUNTS * BEFOREHAND * BEFOREHAND + self.squares;
        (squares / (COUNTS + self.looks)).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_laser_is_as_steady_as_it_has_shown() {
        let mut seen = Steadiness::default();
        assert_eq!((seen.of(false), seen.of(true)), (BEFOREHAND, HELD_AGAINST));
        for _ in 0..200 {
            seen.learn(Some(-0.004));
            seen.learn(None);
        }
        assert!((seen.of(false) - 0.004).abs() < 2e-4, "{}", seen.of(false));
        for _ in 0..200 {
            seen.learn(Some(0.02));
        }
        assert!(seen.of(false) > 0.01);
    }
}

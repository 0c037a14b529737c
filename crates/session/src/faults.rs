//! Which faults are injected into a twin: those that a user said, or one that a device's seed draws.

use pigtail_twin::faults::{Injection, Kind};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::fmt;
use std::str::FromStr;

/// What is injected.
#[derive(Debug, Clone, Default, PartialEq)]
pub enum Faults {
    /// Nothing.
    #[default]
    None,
    /// These, into every device.
    Said(Vec<Injection>),
    /// One of these kinds into each device, of its own size, where and when the seed draws it.
    Drawn(Vec<Kind>),
}

/// No fault is drawn before this time, seconds. What is wrong before vision has seen anything is a
/// fiber that lies elsewhere, for all that a machine can measure.
const EARLIEST: f64 = 0.1;
/// So that the draw is another than those of the twin.
const STREAM: u64 = 7;

impl Faults {
    /// What is injected into the device of a seed whose alignment takes about so many seconds.
    pub fn of(&self, seed: u64, seconds: f64) -> Vec<Injection> {
        match self {
            Self::None => Vec::new(),
            Self::Said(injections) => injections.clone(),
            Self::Drawn(kinds) => {
                let mut rng = Pcg64Mcg::seed_from_u64(seed.wrapping_mul(16).wrapping_add(STREAM));
                let kind = kinds[rng.random_range(0..kinds.len())];
                let fault = kind.draw(&mut rng);
                // To the millisecond, so that what is printed is what was injected.
                let from = rng.random_range(EARLIEST..EARLIEST + seconds);
                vec![Injection {
                    fault,
                    from: (from * 1e3).round() / 1e3,
                }]
            }
        }
    }

    /// Whether nothing is injected.
    pub fn is_none(&self) -> bool {
        *self == Self::None
    }
}

/// `all`, or names with commas between them; `none` as it is in files.
impl FromStr for Faults {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "none" => Ok(Self::None),
            "all" => Ok(Self::Drawn(Kind::all().collect())),
            names => names
                .split(',')
                .map(|name| name.trim().parse())
                .collect::<Result<_, _>>()
                .map(Self::Drawn)
                .map_err(|why: String| format!("{why}, or all")),
        }
    }
}

impl fmt::Display for Faults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let list =
            |f: &mut fmt::Formatter<'_>, texts: Vec<String>| write!(f, "{}", texts.join(","));
        match self {
            Self::None => write!(f, "none"),
            Self::Said(injections) => list(f, injections.iter().map(ToString::to_string).collect()),
            Self::Drawn(kinds) if kinds.len() == Kind::all().count() => write!(f, "all"),
            Self::Drawn(kinds) => {
                list(f, kinds.iter().map(|kind| kind.name().to_owned()).collect())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_drawn_can_be_said() {
        let all: Faults = "all".parse().expect("all");
        for seed in 0..200 {
            let drawn = all.of(seed, 3.0);
            assert_eq!(drawn, all.of(seed, 3.0), "the same for a seed");
            assert_eq!(drawn.len(), 1);
            let said: Injection = drawn[0].to_string().parse().expect("what was printed");
            assert_eq!(said, drawn[0]);
            assert!((EARLIEST..=EARLIEST + 3.0).contains(&said.from));
        }
        for text in ["all", "none", "laser-off,belt-slip"] {
            assert_eq!(text.parse::<Faults>().expect("good").to_string(), text);
        }
        assert!("melt".parse::<Faults>().is_err());
    }
}

//! What a fitted law leaves in doubt.

use super::law::{Law, MOST_RATIO};
use super::{Fitted, Record, Sample, error, fit};
use crate::{Known, Unknown};
use pigtail_numerics::signal::quantile;

/// Steps by which most of a way is gone are jumps from so many times the usual step on: of a sine's they are 1.2 times it.
const JUMPS: f64 = 5.0;

/// What is known to worse than this share of itself is no answer.
const LOOSE: f64 = 1.0 / 3.0;

/// Whether the columns the other way round are friction, and these are not.
pub(super) fn swapped(record: &Record, error_percent: f64) -> bool {
    if error_percent < 15.0 {
        return false;
    }
    let (low, high) = record.range(|s| s.displacement);
    let middle = 0.5 * (low + high);
    let turned = Record {
        samples: record
            .samples
            .iter()
            .map(|s| Sample {
                displacement: s.force,
                force: s.displacement - middle,
                ..*s
            })
            .collect(),
        ..record.clone()
    };
    let fits = |record: &Record| {
        let law = Law::PreslidingTwoSided;
        fit(law, record, &record.samples, None)
            .map_or(f64::INFINITY, |p| error(law, &p, &record.samples, 0))
    };
    let mirrored = Record {
        samples: turned
            .samples
            .iter()
            .map(|s| Sample {
                force: -s.force,
                ..*s
            })
            .collect(),
        ..turned.clone()
    };
    fits(&turned).min(fits(&mirrored)) < 0.5 * error_percent
}

/// Whether a record does not tell LuGre's static friction from its Coulomb friction: it comes to a bound of what is tried,
/// or the speed at which one becomes the other is not known.
pub(super) fn one_level(values: &[f64], known: &[Known]) -> bool {
    let loose = |k: &Known| k.std_correlated.is_nan() || k.std_correlated > 0.5 * k.value.abs();
    (values[2] / values[0]).ln().abs() > 0.99 * MOST_RATIO || known[2..4].iter().any(loose)
}

/// That a contact may be of another law, in words that follow another reason.
fn foreign(chosen: &Fitted) -> String {
    if chosen.misfit_percent <= 0.0 {
        return String::new();
    }
    format!(
        ": the contact may be of another law, which tells {:.3} % of the force more",
        chosen.misfit_percent
    )
}

/// What the chosen law's parameters leave in doubt.
pub(super) fn doubts(record: &Record, chosen: &Fitted) -> Vec<Unknown> {
    let mut unknown = Vec::new();
    let law = chosen.law;
    let way = law.way(&chosen.values);
    let (low, high) = record.range(|s| s.displacement);
    let levels = [
        "static_friction",
        "coulomb_friction",
        "static_friction_forward",
        "static_friction_backward",
    ];
    let ways = [
        "presliding",
        "presliding_forward",
        "presliding_backward",
        "stiffness",
        "first_slip",
        "last_slip",
        "exponent",
    ];
    let of = |names: &[&'static str]| -> Vec<&'static str> {
        let own = law.parameters();
        own.iter().copied().filter(|p| names.contains(p)).collect()
    };
    if 2.0 * way > 0.95 * (high - low) {
        unknown.push(Unknown {
            parameters: [of(&levels), of(&ways)].concat(),
            because: format!(
                "its stroke of {:.3e} is too short to slide: a stiffness is seen, no level",
                high - low
            ),
        });
    }
    let steps: Vec<f64> = record
        .samples
        .windows(2)
        .map(|w| (w[1].displacement - w[0].displacement).abs())
        .filter(|w| *w > 0.0)
        .collect();
    let step = quantile(&steps, 0.5);
    if 2.0 * way < 2.0 * step {
        unknown.push(Unknown {
            parameters: of(&ways),
            because: format!(
                "it moves {step:.3e} from sample to sample, as far as a reversal takes: the transition is not \
                 resolved"
            ),
        });
    }
    // One that stands and jumps gives way within a jump, whatever its noise does meanwhile.
    let mut by_length = steps.clone();
    by_length.sort_by(f64::total_cmp);
    let all: f64 = by_length.iter().sum();
    let mut so_far = 0.0;
    let jump = by_length.iter().copied().find(|step| {
        so_far += step;
        so_far > 0.5 * all
    });
    if let Some(jump) = jump.filter(|j| *j > JUMPS * step && way < 2.0 * j) {
        unknown.push(Unknown {
            parameters: of(&ways),
            because: format!(
                "it stands and jumps, by {jump:.3e} mostly, where it would give way over {way:.3e}: the transition is not \
                 resolved"
            ),
        });
    }
    if let Some(free) = chosen.two_levels {
        unknown.push(Unknown {
            parameters: law.parameters()[2..4].to_vec(),
            because: format!(
                "with a static friction of its own it leaves {free:.3} % of the force, and with one level {:.3} %: the speed \
                 makes no difference that one bristle would make",
                chosen.relative_error_percent
            ),
        });
    }
    for (name, known) in law.parameters().iter().zip(&chosen.known) {
        let offset = *name == "offset" || *name == "viscous_friction";
        // An offset may be none, and is known all the same.
        let open = !known.std_correlated.is_finite();
        let loose = !offset && known.std_correlated > LOOSE * known.value.abs();
        if (open || loose) && !unknown.iter().any(|u: &Unknown| u.covers(name)) {
            unknown.push(Unknown {
                parameters: vec![name],
                because: format!(
                    "what it says of {name} is {:.3e} with a standard deviation of {:.3e}{}",
                    known.value,
                    known.std_correlated,
                    foreign(chosen)
                ),
            });
        }
    }
    unknown
}

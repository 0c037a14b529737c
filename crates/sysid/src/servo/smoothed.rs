//! A position, or a voltage, that was smoothed before it was written, and whatever else tells a motion otherwise the faster it is: a load
//! on a spring, a sensor's own filter.
//!
//! To the second order such a thing adds to the force the inertia's second difference, to the fourth order that one's own: inertia and
//! friction beside these two, and beside a delay, are those of slow motion. Where an axis turns its friction steps, which no order tells:
//! only where it slides is looked at. What is found without them has to be there within its deviation.

use super::bent::NAMES;
use super::other::{OTHER, SURELY, beside};
use super::slides::{ASIDE, Slides};
use super::{Equations, Friction, LATE, Method, Unknown, Variant};
use pigtail_numerics::regression::{Solution, least_squares};
use pigtail_numerics::signal::rms;

/// Second differences of second differences that are taken beside: each reaches an equation farther to either side.
const ORDERS: usize = 3;

/// Share of the inertia that may be open where the motion was smoothed: beyond it more orders would be asked for. A twentieth, until a voltage
/// that was averaged over 81 rows had been 3.1 % off.
const OPEN: f64 = 0.02;

/// So much of what is left may be noise of the acceleration.
const NOISY: f64 = 1.5;

/// What slow motion says.
struct Slow {
    solution: Solution,
    /// By how much values differ from those of lower orders: what the orders that are not there would change.
    open: Vec<f64>,
    /// Whether the inertia's second difference shows, and which column is the smoother one by its sign.
    shows: Option<&'static str>,
}

/// Parameters of which slow motion says otherwise are less sure by as much, and where one is another one by it they are not known.
pub(super) fn smoothed(
    (columns, noise): (&Equations, f64),
    supported: Method,
    variants: &mut [Variant],
    unknown: &mut Vec<Unknown>,
    remarks: &mut Vec<String>,
) {
    let Some(slow) = slow(columns, noise) else {
        return;
    };
    if let Some(what) = slow.shows {
        remarks.push(format!(
            "the {what} is smoother than what moved the axis, as one that was averaged or filtered before it was written: parameters \
             are less sure by what that changes"
        ));
    }
    let inertia = slow.solution.values[0];
    let answer = variants.iter().find(|v| v.method == supported);
    let off = answer.map_or(0.0, |v| v.values[0] - inertia);
    let own = |names: &&[&str]| {
        let all = &answer?.parameters;
        let known = all.iter().find(|p| names.contains(&p.name))?.known?;
        Some((known.value, known.std_correlated))
    };
    let first: Vec<Option<(f64, f64)>> = NAMES.iter().map(own).collect();
    if slow.shows.is_some() && off.hypot(slow.open[0]) > OPEN * inertia {
        unknown.push(Unknown {
            parameters: NAMES.concat(),
            because: format!(
                "position or voltage was smoothed so much before it was written that {:.3e} of the inertia is open",
                off.hypot(slow.open[0])
            ),
        });
    }
    for (j, names) in NAMES.iter().enumerate() {
        let (value, std) = (slow.solution.values[j], slow.solution.std_correlated[j]);
        // Of one that says itself that it may be as far off, no more is to be said than by how much.
        let another = first[j].filter(|(first, known)| {
            let off = (first - value).abs();
            off > OTHER * value.abs() && off > SURELY * std.hypot(*known)
        });
        if let Some((first, _)) = another
            && !unknown.iter().any(|u| u.covers(names[0]))
        {
            unknown.push(Unknown {
                parameters: names.to_vec(),
                because: format!(
                    "slow motion says {value:.4e}, and all of it {first:.4e}: was position or voltage smoothed before it was written?"
                ),
            });
        }
        let all = variants.iter_mut().flat_map(|v| &mut v.parameters);
        let known = all
            .filter(|p| names.contains(&p.name))
            .filter_map(|p| p.known.as_mut());
        for known in known {
            let off = (known.value - value).abs();
            if slow.shows.is_some() {
                known.std_correlated = known.std_correlated.hypot(off).hypot(slow.open[j]);
            } else if off > ASIDE * known.std_correlated.max(std) {
                known.std_correlated = off;
            }
        }
    }
}

fn slow(columns: &Equations, noise: f64) -> Option<Slow> {
    let Slides { rows, mut x, force } = Slides::of(columns, ORDERS)?;
    let own = x.ncols();
    let n = columns.force.len();
    let told = columns.matrix(Friction::Symmetric, Method::Delayed);
    let mut difference: Vec<f64> = told.column(0).iter().copied().collect();
    let mut found = vec![least_squares(&x, &force)?];
    for _ in 0..ORDERS {
        let ends = (difference[0], difference[n - 1]);
        let inside = difference.windows(3).map(|w| w[0] - 2.0 * w[1] + w[2]);
        difference = std::iter::once(ends.0)
            .chain(inside.collect::<Vec<_>>())
            .chain([ends.1])
            .collect();
        x = beside(&x, &[rows.iter().map(|i| difference[*i]).collect()]);
        found.push(least_squares(&x, &force)?);
    }
    let left = |s: &Solution| rms(s.residuals.iter().copied());
    let sign = |s: &Solution| {
        let (value, std) = (s.values[own], s.std_correlated[own]);
        (value.abs() > SURELY * std).then_some(value < 0.0)
    };
    // Of an acceleration that is noise its differences tell the noise.
    let noisy = left(&found[0]) < NOISY * noise * found[0].values[0].abs();
    let better = !noisy && left(&found[ORDERS]) < LATE * left(&found[0]);
    let agree = found[1..]
        .windows(2)
        .find(|two| sign(&two[0]).is_some() && sign(&two[0]) == sign(&two[1]));
    let position = agree.filter(|_| better).and_then(|two| sign(&two[0]));
    let differ = |j: usize| {
        let pairs = found[1..].windows(2);
        pairs
            .map(|two| (two[0].values[j] - two[1].values[j]).abs())
            .fold(0.0, f64::max)
    };
    Some(Slow {
        open: (0..NAMES.len()).map(differ).collect(),
        shows: position.map(|is| if is { "position" } else { "voltage" }),
        solution: found.pop()?,
    })
}

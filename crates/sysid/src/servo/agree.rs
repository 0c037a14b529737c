//! What rows that agree with each other, and those far from turns, say otherwise than all of them.
//!
//! What is left of a motion is told to be noise, which parameters scatter by. Two things are not: readings that were lost, turned or wild in
//! runs that nothing shows, which pull all one way and which a robust fit counts less; and a step of friction that is not one, since
//! position and voltage went through one filter, or friction follows the motion on its way, of which nothing is left long after a turn.
//! Where such a fit is another one, parameters are less sure by what lies between.

use super::bent::NAMES;
use super::other::beside;
use super::slides::{ASIDE, Slides};
use super::{Equations, LEAST_EQUATIONS, Variant};
use pigtail_numerics::regression::{Solution, least_squares, robust, tolerance};

/// Equations from a turn, from which on only what is left of it long after is looked at.
const FAR: [usize; 3] = [6, 12, 24];

/// Least tolerance of a column beside the others where fewer rows are looked at.
const OWN: f64 = 1e-3;

/// Makes parameters less sure by what other rows say, and tells what it was.
pub(super) fn agree(columns: &Equations, variants: &mut [Variant]) -> Option<String> {
    let slides = Slides::of(columns, 0)?;
    // Each direction may have a viscous friction of its own, as it has a Coulomb friction beside an offset.
    let speed = slides.rows.iter().map(|i| columns.velocity[*i].abs());
    let x = beside(&slides.x, &[speed.collect()]);
    let all = least_squares(&x, &slides.force)?;
    let mut said = Vec::new();
    if let Some(others) = robust(&x, &slides.force)
        && apart(&all, &others, variants)
    {
        said.push("equations that agree with each other");
    }
    let away = from_turns(columns);
    let mut far = false;
    for least in FAR {
        let rows: Vec<usize> = (0..slides.rows.len())
            .filter(|i| away[slides.rows[*i]] >= least)
            .collect();
        if rows.len() < LEAST_EQUATIONS {
            break;
        }
        let x = x.select_rows(&rows);
        if (0..x.ncols()).any(|j| tolerance(&x, j) < OWN) {
            break;
        }
        let force: Vec<f64> = rows.iter().map(|i| slides.force[*i]).collect();
        if let Some(others) = least_squares(&x, &force) {
            far |= apart(&all, &others, variants);
        }
    }
    if far {
        said.push("those far from where it turns");
    }
    (!said.is_empty()).then(|| {
        format!(
            "{} say otherwise than all of them: parameters are less sure by what lies between",
            said.join(" and ")
        )
    })
}

/// Makes parameters less sure that another fit has otherwise by more than chance; whether there are such.
fn apart(all: &Solution, others: &Solution, variants: &mut [Variant]) -> bool {
    let mut any = false;
    for (j, names) in NAMES.iter().enumerate() {
        let off = (all.values[j] - others.values[j]).abs();
        if off <= ASIDE * all.std_correlated[j].max(others.std_correlated[j]) {
            continue;
        }
        let parameters = variants.iter_mut().flat_map(|v| &mut v.parameters);
        let known = parameters
            .filter(|p| names.contains(&p.name))
            .filter_map(|p| p.known.as_mut());
        for known in known.filter(|k| k.std_correlated < off) {
            known.std_correlated = off;
            any = true;
        }
    }
    any
}

/// How many equations each is from the nearest one at which the axis turned.
fn from_turns(columns: &Equations) -> Vec<usize> {
    let v = &columns.velocity;
    let n = v.len();
    let turned = |i: usize| i > 0 && v[i].signum() != v[i - 1].signum();
    let mut since = n;
    let mut away: Vec<usize> = (0..n)
        .map(|i| {
            since = if turned(i) { 0 } else { since + 1 };
            since
        })
        .collect();
    let mut until = n;
    for (i, away) in away.iter_mut().enumerate().rev() {
        *away = (*away).min(until);
        until = if turned(i) { 1 } else { until + 1 };
    }
    away
}

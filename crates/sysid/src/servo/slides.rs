//! The equations of an axis that slides: where it turns its friction steps, and where it stands friction is whatever holds it.

use super::bent::{NAMES, less_sure};
use super::other::{beside, moves};
use super::{Equations, Friction, LEAST_EQUATIONS, Method, Parameter, Unknown, Variant};
use crate::steady::between;
use nalgebra::DMatrix;
use pigtail_numerics::regression::{Solution, least_squares, least_squares_alone, tolerance};
use pigtail_numerics::signal::{quantile, rms};

/// Parts of a record that are held against each other, and fewest equations of one.
const PARTS: usize = 8;
const LEAST: usize = 40;

/// What parts differ by so large a share of is not known.
const LOOSE: f64 = 1.0 / 3.0;

/// Least tolerance of a part's columns beside each other.
const OWN: f64 = 1e-4;

/// Deviations beyond which what another fit says is not chance: of 100 that are chance one is.
pub(super) const ASIDE: f64 = 2.576;

/// Column of the offset.
const OFFSET: usize = 3;

/// Equations of symmetric friction with a delay, those around each being there.
pub(super) struct Slides {
    /// Where they stand among all.
    pub(super) rows: Vec<usize>,
    pub(super) x: DMatrix<f64>,
    pub(super) force: Vec<f64>,
}

impl Slides {
    /// Those with so many neighbours to either side; `None` where they are too few.
    pub(super) fn of(columns: &Equations, neighbours: usize) -> Option<Self> {
        if columns.one_way {
            return None;
        }
        let time = &columns.time;
        let steps: Vec<f64> = time.windows(2).map(|w| w[1] - w[0]).collect();
        let longest = (2 * neighbours) as f64 * 1.1 * quantile(&steps, 0.5);
        let slides = moves(columns);
        let rows: Vec<usize> = (neighbours..time.len().saturating_sub(neighbours))
            .filter(|i| slides[*i] && time[i + neighbours] - time[i - neighbours] <= longest)
            .collect();
        (rows.len() >= LEAST_EQUATIONS).then(|| Self {
            x: columns
                .matrix(Friction::Symmetric, Method::Delayed)
                .select_rows(&rows),
            force: rows.iter().map(|i| columns.force[*i]).collect(),
            rows,
        })
    }

    /// By how much less sure each symmetric parameter is for what parts of the record say of it beyond what they know, and for an offset
    /// that is another one in each.
    fn between(&self) -> Option<Vec<f64>> {
        let n = self.rows.len();
        let parts = (n / LEAST).min(PARTS);
        let rows = |part: usize| part * n / parts..(part + 1) * n / parts;
        let found: Vec<Solution> = (0..parts)
            .filter_map(|part| {
                let rows = rows(part);
                let x = self.x.rows(rows.start, rows.len()).into_owned();
                // One that goes one way only tells no direction from a speed.
                let told = (0..x.ncols()).all(|j| tolerance(&x, j) > OWN);
                told.then(|| least_squares(&x, &self.force[rows]))?
            })
            .collect();
        let apart = |j: usize| {
            // A part is too short to say how long what is left is remembered: all of them together do.
            let pairs = found.iter().map(|s| s.std_correlated[j] / s.std[j]);
            let wider = rms(pairs).max(1.0);
            let own: Vec<(f64, f64)> = found
                .iter()
                .map(|s| (s.values[j], wider * s.std[j]))
                .collect();
            between(&own)
        };
        let whole = least_squares_alone(&self.x, &self.force)?;
        let offsets = if apart(OFFSET) > 0.0 {
            let mut own = self.x.clone().remove_column(OFFSET);
            for part in 0..parts {
                let within = rows(part);
                let one =
                    (0..n).map(|i| f64::from(u8::from(within.contains(&i))) * self.x[(i, OFFSET)]);
                own = beside(&own, &[one.collect()]);
            }
            least_squares_alone(&own, &self.force)
        } else {
            None
        };
        // A gain that is another one is that of all forces.
        let share = apart(0) / whole.values[0];
        Some(
            (0..NAMES.len())
                .map(|j| {
                    let by_offset = offsets
                        .as_ref()
                        .map_or(0.0, |o| o.values[j] - whole.values[j]);
                    apart(j)
                        .max((share * whole.values[j]).abs())
                        .hypot(by_offset)
                })
                .collect(),
        )
    }
}

/// Makes parameters less sure by what parts of the record differ by, and says of which. Parts that go one way more than the other are no
/// others for it: each direction may have a viscous friction of its own, as it has a Coulomb friction beside an offset.
pub(super) fn unsteady(
    columns: &Equations,
    variants: &mut [Variant],
    unknown: &mut Vec<Unknown>,
) -> Option<String> {
    let mut slides = Slides::of(columns, 0)?;
    let speed = slides.rows.iter().map(|i| columns.velocity[*i].abs());
    slides.x = beside(&slides.x, &[speed.collect()]);
    let apart = slides.between()?;
    let mut said = Vec::new();
    for (names, apart) in NAMES.iter().zip(apart) {
        if apart > 0.0 {
            let own = |p: &&Parameter| p.name == names[0];
            let known = variants.iter().flat_map(|v| &v.parameters).find(own);
            let loose = known
                .and_then(|p| p.known)
                .is_some_and(|k| apart > LOOSE * k.value.abs());
            if loose {
                unknown.push(Unknown {
                    parameters: names.to_vec(),
                    because: format!(
                        "parts of it differ in {} by {apart:.2e}: did a load, a gain, an offset or the friction change within it?",
                        names[0].replace('_', " ")
                    ),
                });
            }
            less_sure(variants, names, apart);
            said.push(format!("{} by {apart:.2e}", names[0].replace('_', " ")));
        }
    }
    (!said.is_empty()).then(|| {
        format!(
            "parts of it differ by more than they say of themselves, {}: by so much less sure is what is printed",
            said.join(", ")
        )
    })
}

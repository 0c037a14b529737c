//! Light between fibers of which nobody has seen any: back where it has spread, it is there at once, or around.

use super::Dark;
use super::fiber::Fiber;
use crate::outcome::{Halt, Outcome, SearchEvidence};
use crate::reactor::Reactor;
use crate::tuning::TUNING;
use pigtail_model::frames::Displacement;

/// Looks at places of all fibers together, from the likeliest on, until there is light. Each fiber then stands where that
/// was.
pub(super) async fn first_light(
    bench: &Reactor<'_>,
    dark: &Dark,
    fibers: &mut [&mut Fiber<'_>],
) -> Result<(), Halt> {
    let grids: Vec<Vec<Displacement>> = fibers
        .iter()
        .map(|fiber| fiber.places(TUNING.taught.pitch, TUNING.taught.far))
        .collect();
    let mut order = combinations(&grids);
    let far = |at: &[usize]| -> f64 {
        let far = at.iter().zip(&grids).zip(fibers.iter());
        far.map(|((i, grid), fiber)| (grid[*i].norm() / fiber.across()).powi(2))
            .sum()
    };
    order.sort_by(|a, b| far(a).total_cmp(&far(b)));
    let threshold =
        TUNING.taught.significant * dark.sigma / (TUNING.taught.first_look as f64).sqrt();
    let (mut samples, mut brightest) = (0, f64::NEG_INFINITY);
    for at in &order {
        for ((fiber, grid), i) in fibers.iter_mut().zip(&grids).zip(at) {
            fiber.stand_at(bench, grid[*i]).await?;
        }
        let (mean, _) = bench
            .look(fibers[0].meter.0, TUNING.taught.first_look)
            .await?;
        samples += TUNING.taught.first_look;
        brightest = f64::max(brightest, mean);
        if mean - dark.mean > threshold {
            // Once more: what was chance will not be there.
            let (again, _) = bench
                .look(fibers[0].meter.0, TUNING.taught.first_look)
                .await?;
            samples += TUNING.taught.first_look;
            if again - dark.mean > threshold {
                for fiber in fibers {
                    fiber.begin_scan(bench, dark);
                }
                return Ok(());
            }
        }
    }
    let width = 2.0 * TUNING.taught.far * fibers[0].across();
    Err(Outcome::NoLight(SearchEvidence {
        phase: "search",
        samples,
        width,
        height: width,
        brightest,
        dismissed: 0,
        threshold: dark.mean + threshold,
    })
    .into())
}

/// One place of each grid, in all ways.
fn combinations(grids: &[Vec<Displacement>]) -> Vec<Vec<usize>> {
    grids.iter().fold(vec![Vec::new()], |all, grid| {
        let with = |at: &Vec<usize>| {
            let at = at.clone();
            (0..grid.len()).map(move |i| [at.as_slice(), &[i]].concat())
        };
        all.iter().flat_map(with).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_places_of_all_fibers_are_looked_at_together() {
        let grid = |n: usize| vec![Displacement::ZERO; n];
        let all = combinations(&[grid(2), grid(3)]);
        assert_eq!(all.len(), 6);
        assert!(all.contains(&vec![1, 2]) && all.contains(&vec![0, 0]));
    }
}

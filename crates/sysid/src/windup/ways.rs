//! Whether another way winds up as well.
//!
//! How far a transmission has to go until it is wound up is the one number of (2.20) that is searched, and what is left may have several
//! minima over it. Where a model leaves much more than noise, as of a record without the torque that winds a transmission up too, a minimum
//! far off is nearly as low as the best one, and a deviation about that one says nothing of it.

use super::Fitted;
use super::signals::Signals;
use pigtail_numerics::signal::independent;
use pigtail_numerics::statistics::spread_of_mixture;

/// By how much each parameter is less sure than its deviation, by the ways that are tried and how likely each is by what it leaves.
pub(super) fn others(chosen: &Fitted, signals: &Signals) -> Vec<(&'static str, f64)> {
    if !chosen.parts.reversal {
        return Vec::new();
    }
    let columns = signals.columns(chosen.parts, chosen.way);
    let own = signals.residuals(&columns, &chosen.values);
    let own: Vec<f64> = signals.settled.iter().map(|k| own[*k]).collect();
    let points = independent(&own);
    let squares = |left: &[f64]| left.iter().map(|l| l * l).sum::<f64>();
    let least = squares(&own);
    let ways: Vec<(f64, Vec<f64>)> = signals
        .ways()
        .filter_map(|way| {
            let fit = signals.fit(chosen.parts, way)?;
            // Noise whose size nobody knows, by points that are each other's neighbours.
            let likely = -0.5 * points * (squares(&fit.residuals) / least).ln();
            let values = fit.values.iter().zip(&chosen.values).map(|(a, b)| a - b);
            let off = values.chain([way - chosen.way]).collect();
            Some((likely.min(0.0).exp(), off))
        })
        .collect();
    let names = columns.iter().map(|(name, _)| *name).chain(["q"]);
    (0..)
        .zip(names)
        .filter_map(|(j, name)| {
            let known = chosen.parameters.iter().find(|(of, _)| *of == name)?.1;
            let std = known.std_correlated;
            let mut parts = vec![(1.0, 0.0, std)];
            parts.extend(ways.iter().map(|(likely, off)| (*likely, off[j], std)));
            let all = spread_of_mixture(&parts);
            (all > std).then(|| (name, (all * all - std * std).sqrt()))
        })
        .collect()
}

//! The static coupling of the left micro's axes (thesis 4.2), by how wide the beam is straight up.

use super::coupling::{LEAST, SIDE, arrive};
use super::{BLOCK, Flank, Identified, Watch, gaussian, smoothed};
use crate::compensation::micro::{MicroCompensation, MicroModel};
use crate::outcome::{Halt, Outcome};
use crate::station::Station;
use pigtail_hal::spec::MICRO_AXES;
use pigtail_model::frames::{Displacement, Macro, Point};

/// Speed of the macro over the beam, m/s.
const CLIMB: f64 = 100e-6;

/// Ways over the beam: each of the macro's meets the encoders' counts elsewhere.
const CLIMBS: usize = 6;

/// Displacement in y for one in x: how wide the beam is straight up by the macro's encoders, beside
/// how wide it is by the micro with its piezos' models, were there no coupling.
pub(super) fn straight_up(
    station: &mut Station,
    watch: &Watch,
    piezos: &[Identified; MICRO_AXES],
    base: Point<Macro>,
) -> Result<f64, Halt> {
    let model = MicroModel {
        piezos: std::array::from_fn(|i| piezos[i].memory.clone()),
        ratio: 1.0,
    };
    let spec = station.spec().clone();
    let mut micro = MicroCompensation::new(&model, &spec);
    arrive(station, base)?;
    // Where the beam stands: at the last place, from which the macro comes back.
    let reach = 0.9 * station.kinematics(SIDE).micro_range_x();
    let mut sweep = |station: &mut Station, path: &[Displacement]| -> Result<Vec<_>, Halt> {
        let mut seen = Vec::with_capacity(path.len());
        for at in path {
            station.micro_volts(SIDE, micro.next(*at));
            station.cycle()?;
            if let Some(light) = station.light(watch.channel) {
                seen.push((*at, light - watch.dark));
            }
        }
        Ok(seen)
    };
    let line = |from: Displacement, to: Displacement, seconds: f64| -> Vec<Displacement> {
        let n = (seconds / spec.period()) as usize;
        let at = |k: usize| from + (to - from) * (k as f64 / n as f64);
        (0..=n).map(at).collect()
    };
    // A few lines across find its height, and a line up its x.
    let mut best = (Displacement::ZERO, 0.0);
    let mut here = Displacement::ZERO;
    for k in -3..=3 {
        let y = 6e-6 * f64::from(k);
        let [left, right] = [-reach, reach].map(|x| Displacement::new(x, y));
        sweep(station, &line(here, left, 0.2))?;
        let seen = sweep(station, &line(left, right, 1.0))?;
        here = right;
        for window in seen.windows(BLOCK) {
            let light = window.iter().map(|p| p.1).sum::<f64>() / BLOCK as f64;
            if light > best.1 {
                best = (Displacement::new(window[BLOCK / 2].0.x, y), light);
            }
        }
    }
    let (middle, _) = best;
    let over = |points: &[(f64, f64)]| -> Result<Flank, Outcome> {
        let (smooth, top) = smoothed(points);
        let bright: Vec<(f64, f64)> = smooth
            .iter()
            .filter(|p| p.1 > LEAST * top.1)
            .map(|p| (p.0 - top.0, p.1))
            .collect();
        gaussian(&bright, "straight up")
    };
    let high = |y: f64| Displacement::new(middle.x, y.clamp(-reach, reach));
    let (low, top) = (high(middle.y - 25e-6), high(middle.y + 25e-6));
    sweep(station, &line(here, low, 0.2))?;
    let mut by_micro = 0.0;
    for _ in 0..CLIMBS {
        let up = sweep(station, &line(low, top, 0.5))?;
        by_micro +=
            over(&up.iter().map(|p| (p.0.y, p.1)).collect::<Vec<_>>())?.width / CLIMBS as f64;
        sweep(station, &line(top, low, 0.5))?;
    }
    sweep(station, &line(low, middle, 0.2))?;
    // The micro rests; the macro goes over the beam from below.
    let mut by_macro = 0.0;
    for k in 0..CLIMBS {
        let part = 0.3e-6 * k as f64;
        let start = base.shifted(0.0, -40e-6 - part, 0.0);
        arrive(station, start)?;
        station.start_line(SIDE, start.shifted(0.0, 80e-6, 0.0), Some(CLIMB))?;
        let mut seen = Vec::with_capacity(512);
        while station.moving(SIDE) {
            station.cycle()?;
            if let Some(light) = station.light(watch.channel) {
                seen.push((station.endpoint(SIDE).y, light - watch.dark));
            }
        }
        by_macro += over(&seen)?.width / CLIMBS as f64;
    }
    Ok(by_macro / by_micro)
}

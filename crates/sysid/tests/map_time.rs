//! Maps on which something happened while they were scanned: none has a peak elsewhere than it is said to be.

use pigtail_model::frames::Displacement;
use pigtail_sysid::map::{Reading, Scan, examine};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

/// How a map was taken: places in units of the width, and what happened to light and places in time, which goes from 0 to 1.
struct Map {
    /// Rows and columns.
    grid: usize,
    /// Half of the area, in widths.
    half: f64,
    noise: f64,
    background: f64,
    serpentine: bool,
    /// Share of the light at a time and in a row.
    light: Box<dyn Fn(f64, usize) -> f64>,
    /// How far the place is from where it is said to be, of a time and a row.
    place: Box<dyn Fn(f64, usize) -> Displacement>,
    /// Whether the background falls with the light.
    all: bool,
}

impl Default for Map {
    fn default() -> Self {
        Self {
            grid: 25,
            half: 2.5,
            noise: 0.005,
            background: 0.02,
            serpentine: false,
            light: Box::new(|_, _| 1.0),
            place: Box::new(|_, _| Displacement::ZERO),
            all: false,
        }
    }
}

fn normal(rng: &mut Pcg64) -> f64 {
    let (a, b): (f64, f64) = (rng.random::<f64>().max(1e-300), rng.random());
    (-2.0 * a.ln()).sqrt() * (TAU * b).cos()
}

const WIDTH: f64 = 4e-6;

impl Map {
    fn scan(&self, peak: Displacement, rng: &mut Pcg64) -> Scan {
        let n = self.grid;
        let mut readings = Vec::new();
        for row in 0..n {
            for step in 0..n {
                let column = if self.serpentine && row % 2 == 1 {
                    n - 1 - step
                } else {
                    step
                };
                let time = (row * n + step) as f64 / (n * n) as f64;
                let at = |k: usize| (2.0 * k as f64 / (n - 1) as f64 - 1.0) * self.half * WIDTH;
                let at = Displacement::new(at(column), at(row));
                let off = (at + (self.place)(time, row) * WIDTH - peak) / WIDTH;
                let light = (self.light)(time, row);
                let dark = self.background * if self.all { light } else { 1.0 };
                let power = dark + light * (-off.x * off.x - off.y * off.y).exp();
                readings.push(Reading {
                    at,
                    power: power + self.noise * normal(rng),
                });
            }
        }
        Scan::new(readings).expect("a scan")
    }
}

/// The light changed.
fn lights() -> Vec<(&'static str, Map)> {
    let usual = Map::default;
    let light = |of: fn(f64, usize) -> f64| Map {
        light: Box::new(of),
        ..usual()
    };
    vec![
        ("steady", usual()),
        (
            "steady, little noise",
            Map {
                noise: 2e-4,
                ..usual()
            },
        ),
        (
            "steady, much noise",
            Map {
                noise: 0.03,
                ..usual()
            },
        ),
        (
            "steady, serpentine",
            Map {
                serpentine: true,
                ..usual()
            },
        ),
        ("falls by half", light(|t, _| 1.0 - 0.5 * t)),
        (
            "falls by half, serpentine",
            Map {
                serpentine: true,
                ..light(|t, _| 1.0 - 0.5 * t)
            },
        ),
        (
            "falls by half, with all",
            Map {
                all: true,
                ..light(|t, _| 1.0 - 0.5 * t)
            },
        ),
        (
            "falls by half, much noise",
            Map {
                noise: 0.03,
                ..light(|t, _| 1.0 - 0.5 * t)
            },
        ),
        (
            "falls by half, little noise",
            Map {
                noise: 2e-4,
                ..light(|t, _| 1.0 - 0.5 * t)
            },
        ),
        ("rises by half", light(|t, _| 1.0 + 0.5 * t)),
        ("falls by a fifth", light(|t, _| 1.0 - 0.2 * t)),
        ("falls by a twentieth", light(|t, _| 1.0 - 0.05 * t)),
        ("falls to a third as exp", light(|t, _| (-1.1 * t).exp())),
        (
            "falls and rises",
            light(|t, _| 1.0 - 0.4 * (std::f64::consts::PI * t).sin()),
        ),
        (
            "flickers, 2 periods",
            light(|t, _| 1.0 + 0.2 * (TAU * 2.0 * t + 1.0).sin()),
        ),
        (
            "flickers, 5 periods",
            light(|t, _| 1.0 + 0.1 * (TAU * 5.0 * t + 1.0).sin()),
        ),
        (
            "flickers, 40 periods",
            light(|t, _| 1.0 + 0.1 * (TAU * 40.3 * t).sin()),
        ),
        (
            "steps down by a third",
            light(|t, _| if t < 0.5 { 1.0 } else { 0.67 }),
        ),
        (
            "steps up by a tenth",
            light(|t, _| if t < 0.45 { 1.0 } else { 1.1 }),
        ),
        (
            "rows differ by a tenth",
            light(|_, row| 1.0 + 0.1 * ((row * 7919) as f64).sin()),
        ),
    ]
}

/// Places were not reached as they are said to be.
fn places() -> Vec<(&'static str, Map)> {
    let usual = Map::default;
    let place = |of: fn(f64, usize) -> Displacement| Map {
        place: Box::new(of),
        ..usual()
    };
    vec![
        (
            "backlash of 0.2 widths",
            Map {
                serpentine: true,
                ..place(|_, row| Displacement::new(if row % 2 == 1 { 0.2 } else { 0.0 }, 0.0))
            },
        ),
        (
            "sheared by creep",
            place(|t, _| Displacement::new(0.3 * t, 0.0)),
        ),
        (
            "stretched by creep",
            place(|t, _| Displacement::new(0.0, 0.3 * (t + 0.05).ln() / 3.0)),
        ),
        (
            "rows askew by chance",
            place(|_, row| Displacement::new(0.1 * ((row * 104_729) as f64).sin(), 0.0)),
        ),
    ]
}

/// Where the peak is on a map as it was taken: of places that are askew, at the time of the peak's own row; by chance they are askew to no side.
fn truth(name: &str, map: &Map, peak: Displacement) -> Displacement {
    if name.contains("chance") || name.contains("backlash") {
        return peak;
    }
    let row = (peak.y / WIDTH / map.half + 1.0) * 0.5 * (map.grid - 1) as f64;
    peak - (map.place)((row + 0.5) / map.grid as f64, row as usize) * WIDTH
}

#[test]
fn what_changed_during_a_scan_leaves_no_peak_believed_elsewhere() {
    for (name, map) in lights().into_iter().chain(places()) {
        let (mut refused, mut most, mut far, mut said) = (0, 0.0_f64, 0.0_f64, 0.0);
        for seed in 3000..3012 {
            let mut rng = Pcg64::seed_from_u64(seed);
            let mut near = || (rng.random::<f64>() - 0.5) * 2.0 * WIDTH;
            let peak = Displacement::new(near(), near());
            let Ok(found) = examine(&map.scan(peak, &mut rng)) else {
                refused += 1;
                continue;
            };
            let error = found.peak.at - truth(name, &map, peak);
            let off = error.x.abs().max(error.y.abs());
            most = most.max(off / found.known());
            far = far.max(1e6 * off);
            said = 1e6 * found.known();
        }
        println!(
            "{name:28} refused {refused:2}, off by {far:.3} um at most, {most:.1} of what was said ({said:.3} um)"
        );
        // Light that falls by two thirds is more than is allowed for, and so is said in the book.
        let allowed = if name == "falls to a third as exp" {
            5.0
        } else {
            4.0
        };
        assert!(
            most < allowed,
            "{name}: {most} standard deviations, {far} um"
        );
        let steady = name.starts_with("steady") || name.starts_with("falls by");
        assert!(!steady || refused == 0, "{name}: {refused} refused");
    }
}

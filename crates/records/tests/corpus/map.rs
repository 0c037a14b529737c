//! Power maps, good ones and others.

use crate::{Wanted, normal};
use pigtail_records::map::{Columns, PlaceUnit, read, try_on};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::fmt::Write as _;
use std::fs;

/// A map: x and y (micrometres), power.
pub(crate) type Map = Vec<[f64; 3]>;

/// What made it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Spot {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) radii: [f64; 2],
    angle: f64,
    /// 2 is a Gaussian; more has a flat top, less long tails.
    order: f64,
    /// Height of the first ring around it.
    ring: f64,
    pub(crate) background: f64,
    pub(crate) noise: f64,
    /// Noise that goes with the light.
    pub(crate) speckle: f64,
    pub(crate) n: [usize; 2],
    pub(crate) step: f64,
}

impl Spot {
    /// One as a person's optics may make it, in the middle part of a scan.
    pub(crate) fn drawn(rng: &mut Pcg64Mcg) -> Self {
        let radius = rng.random_range(2.5..7.0);
        let step = radius / rng.random_range(2.5..6.0);
        let width = radius * rng.random_range(4.5..9.0);
        let n = [
            (width / step) as usize,
            (width * rng.random_range(0.8..1.2) / step) as usize,
        ];
        let side = |n: usize| n as f64 * step;
        let room = 1.4 * radius;
        Self {
            x: rng.random_range(room..side(n[0]) - room),
            y: rng.random_range(room..side(n[1]) - room),
            radii: [radius, radius * rng.random_range(0.65..1.0)],
            angle: rng.random_range(0.0..3.1),
            order: rng.random_range(1.6..2.6),
            ring: rng.random_range(0.0..0.08),
            background: rng.random_range(0.0..0.2),
            noise: rng.random_range(0.002..0.02),
            speckle: rng.random_range(0.0..0.03),
            n,
            step,
        }
    }

    pub(crate) fn light(&self, x: f64, y: f64) -> f64 {
        let (sin, cos) = self.angle.sin_cos();
        let (dx, dy) = (x - self.x, y - self.y);
        let (u, v) = (
            (cos * dx + sin * dy) / self.radii[0],
            (cos * dy - sin * dx) / self.radii[1],
        );
        let r = u.hypot(v);
        (-r.powf(self.order)).exp() + self.ring * (-((r - 2.1) / 0.4).powi(2)).exp()
    }

    pub(crate) fn side(&self, k: usize) -> f64 {
        (self.n[k] - 1) as f64 * self.step
    }

    fn map(&self, rng: &mut Pcg64Mcg, light: impl Fn(f64, f64) -> f64) -> Map {
        let mut map = Vec::new();
        for j in 0..self.n[1] {
            for i in 0..self.n[0] {
                let (x, y) = (i as f64 * self.step, j as f64 * self.step);
                let power = light(x, y) * (1.0 + self.speckle * normal(rng));
                map.push([x, y, self.background + power + self.noise * normal(rng)]);
            }
        }
        map
    }
}

/// The same along a spiral from the middle outward, each power written some readings late; the peak is where the spiral has gone
/// around it.
fn spiral(spot: &mut Spot, rng: &mut Pcg64Mcg, late: usize) -> Map {
    let reach = 0.5 * spot.side(0).min(spot.side(1));
    let away = rng.random_range(0.0..(reach - 1.5 * spot.radii[0]).max(0.1));
    let (sin, cos) = rng.random_range(0.0..6.3_f64).sin_cos();
    (spot.x, spot.y) = (reach + away * cos, reach + away * sin);
    let mut places = Vec::new();
    let (mut turn, mut radius) = (0.0_f64, 0.0);
    while radius < reach {
        radius = spot.step * turn / std::f64::consts::TAU;
        places.push([reach + radius * turn.cos(), reach + radius * turn.sin()]);
        turn += spot.step / radius.max(spot.step / 3.0);
    }
    let mut map: Map = places
        .iter()
        .map(|[x, y]| {
            let power = spot.light(*x, *y) * (1.0 + spot.speckle * normal(rng));
            [*x, *y, spot.background + power + spot.noise * normal(rng)]
        })
        .collect();
    for k in (late..map.len()).rev() {
        map[k][2] = map[k - late][2];
    }
    map
}

/// Rows to and fro, each power written some readings late.
fn to_and_fro(spot: &Spot, rng: &mut Pcg64Mcg, late: usize) -> Map {
    let mut map = plain(spot, rng);
    for row in map.chunks_mut(spot.n[0]).skip(1).step_by(2) {
        row.reverse();
    }
    for k in (late..map.len()).rev() {
        map[k][2] = map[k - late][2];
    }
    map
}

type Case = (&'static str, Wanted, fn(&mut Spot, &mut Pcg64Mcg) -> Map);

fn plain(spot: &Spot, rng: &mut Pcg64Mcg) -> Map {
    spot.map(rng, |x, y| spot.light(x, y))
}

/// A stage that is elsewhere by so much from a line across the peak on; the peak is where it was before.
fn slipped(spot: &mut Spot, rng: &mut Pcg64Mcg, by: (f64, f64)) -> Map {
    let s = *spot;
    let from = s.y + rng.random_range(-0.4..0.4) * s.radii[0];
    s.map(rng, |x, y| {
        let [dx, dy] = if y > from { [by.0, by.1] } else { [0.0; 2] };
        s.light(x + dx, y + dy)
    })
}

const CASES: &[Case] = &[
    ("a peak", Wanted::Right, |s, rng| plain(s, rng)),
    ("nothing but noise", Wanted::Refused, |s, rng| {
        s.map(rng, |_, _| 0.0)
    }),
    ("nothing but a slope", Wanted::Refused, |s, rng| {
        s.map(rng, |x, y| 0.03 * x + 0.01 * y)
    }),
    ("nothing but a drift", Wanted::Refused, |s, rng| {
        let mut walk = 0.0;
        let mut map = s.map(rng, |_, _| 0.0);
        for row in &mut map {
            walk += 0.02 * normal(rng);
            row[2] += walk;
        }
        map
    }),
    ("one bright reading", Wanted::Refused, |s, rng| {
        let mut map = s.map(rng, |_, _| 0.0);
        let k = map.len() / 2;
        map[k][2] += 1.0;
        map
    }),
    ("brightest at the edge", Wanted::Refused, |s, rng| {
        s.x = -0.1 * s.radii[0];
        plain(s, rng)
    }),
    ("beyond the edge", Wanted::Refused, |s, rng| {
        s.y = s.side(1) + 0.6 * s.radii[0];
        plain(s, rng)
    }),
    ("in a corner", Wanted::Refused, |s, rng| {
        (s.x, s.y) = (0.0, 0.0);
        plain(s, rng)
    }),
    ("just inside the edge", Wanted::Either, |s, rng| {
        s.x = 0.4 * s.radii[0];
        plain(s, rng)
    }),
    ("half of the map missing", Wanted::Either, |s, rng| {
        let x = s.x;
        let mut map = plain(s, rng);
        map.retain(|r| r[0] > x);
        map
    }),
    ("saturated at 0.8", Wanted::Either, |s, rng| {
        let mut map = plain(s, rng);
        map.iter_mut().for_each(|r| r[2] = r[2].min(0.8));
        map
    }),
    ("saturated at 0.4", Wanted::Either, |s, rng| {
        let mut map = plain(s, rng);
        map.iter_mut().for_each(|r| r[2] = r[2].min(0.4));
        map
    }),
    (
        "saturated at 0.5, the plateau with noise",
        Wanted::Either,
        |s, rng| {
            let mut map = plain(s, rng);
            map.iter_mut()
                .for_each(|r| r[2] = r[2].min(0.5) + 0.002 * normal(rng));
            map
        },
    ),
    ("saturated, beside the edge", Wanted::Either, |s, rng| {
        s.x = 0.5 * s.radii[0];
        let mut map = plain(s, rng);
        map.iter_mut()
            .for_each(|r| r[2] = r[2].min(0.3) + 0.002 * normal(rng));
        map
    }),
    ("saturated nearly everywhere", Wanted::Either, |s, rng| {
        let mut map = plain(s, rng);
        map.iter_mut()
            .for_each(|r| r[2] = r[2].min(s.background + 0.02));
        map
    }),
    ("wrapped at 0.6", Wanted::Either, |s, rng| {
        let mut map = plain(s, rng);
        map.iter_mut().for_each(|r| r[2] = r[2].rem_euclid(0.6));
        map
    }),
    (
        "wrapped at 0.45, every second row missing",
        Wanted::Either,
        |s, rng| {
            let step = s.step;
            let mut map = plain(s, rng);
            map.retain(|r| (r[1] / step).round() as i64 % 2 == 0);
            map.iter_mut().for_each(|r| r[2] = r[2].rem_euclid(0.45));
            map
        },
    ),
    (
        "wrapped at 0.5, the upper half missing",
        Wanted::Either,
        |s, rng| {
            let y = s.y + 0.3 * s.radii[1];
            let mut map = plain(s, rng);
            map.retain(|r| r[1] < y);
            map.iter_mut().for_each(|r| r[2] = r[2].rem_euclid(0.5));
            map
        },
    ),
    ("mirrored at 0.7", Wanted::Either, |s, rng| {
        let mut map = plain(s, rng);
        map.iter_mut().for_each(|r| r[2] = 0.7 - (r[2] - 0.7).abs());
        map
    }),
    ("two peaks of one height", Wanted::Refused, |s, rng| {
        let w = s.side(0);
        s.x = 0.29 * w;
        let a = *s;
        let b = Spot { x: 0.71 * w, ..a };
        s.map(rng, |x, y| a.light(x, y) + b.light(x, y))
    }),
    ("two peaks, one of 0.7", Wanted::Either, |s, rng| {
        let (a, w) = (*s, s.side(0));
        let b = Spot {
            x: if a.x < 0.5 * w {
                a.x + 2.8 * a.radii[0]
            } else {
                a.x - 2.8 * a.radii[0]
            },
            ..a
        };
        s.map(rng, |x, y| a.light(x, y) + 0.7 * b.light(x, y))
    }),
    ("three peaks", Wanted::Refused, |s, rng| {
        s.x = 0.5 * s.side(0) - 0.95 * s.radii[0];
        s.y = 0.5 * s.side(1) - 0.85 * s.radii[0];
        let a = *s;
        let at = |dx: f64, dy: f64| Spot {
            x: a.x + dx * a.radii[0],
            y: a.y + dy * a.radii[0],
            ..a
        };
        let (b, c) = (at(1.9, 0.0), at(1.0, 1.7));
        s.map(rng, |x, y| {
            0.9 * a.light(x, y) + 0.95 * b.light(x, y) + 0.9 * c.light(x, y)
        })
    }),
    ("a doughnut", Wanted::Refused, |s, rng| {
        let a = *s;
        s.map(rng, |x, y| {
            let r = ((x - a.x) / a.radii[0]).hypot((y - a.y) / a.radii[0]);
            2.7 * r * r * (-r * r).exp()
        })
    }),
    (
        "a doughnut with light in its middle",
        Wanted::Refused,
        |s, rng| {
            let a = *s;
            s.map(rng, |x, y| {
                let r = ((x - a.x) / a.radii[0]).hypot((y - a.y) / a.radii[0]);
                (0.5 + 2.0 * r * r) * (-r * r).exp()
            })
        },
    ),
    ("light that has a minimum", Wanted::Refused, |s, rng| {
        let a = *s;
        s.map(rng, |x, y| 1.0 - a.light(x, y))
    }),
    ("far too coarse", Wanted::Either, |s, rng| {
        let (step, n) = (s.step, s.n);
        s.step *= 4.0;
        s.n = n.map(|n| (n / 4).max(4));
        let map = plain(s, rng);
        s.step = step;
        map
    }),
    ("spikes", Wanted::Either, |s, rng| {
        let mut map = plain(s, rng);
        for _ in 0..3 {
            let k = rng.random_range(0..map.len());
            map[k][2] = 5.0;
        }
        map
    }),
    ("two wild neighbours", Wanted::Either, |s, rng| {
        let mut map = plain(s, rng);
        let k = rng.random_range(0..map.len() - 1);
        map[k][2] = 3.0;
        map[k + 1][2] = 3.1;
        map
    }),
    ("two peaks that merge", Wanted::Either, |s, rng| {
        let a = *s;
        let away = if a.x < 0.5 * s.side(0) { 1.5 } else { -1.5 };
        let b = Spot {
            x: a.x + away * a.radii[0],
            y: a.y - 0.3 * a.radii[0],
            ..a
        };
        let light = |x: f64, y: f64| a.light(x, y) + 0.9 * b.light(x, y);
        let map = s.map(rng, light);
        // It is brightest somewhere between them.
        let place = |k: i32| {
            let share = f64::from(k) / 200.0;
            (a.x + share * (b.x - a.x), a.y + share * (b.y - a.y))
        };
        let places = (0..=200).map(place);
        let by = |p: &(f64, f64), q: &(f64, f64)| light(p.0, p.1).total_cmp(&light(q.0, q.1));
        (s.x, s.y) = places.max_by(by).unwrap_or((a.x, a.y));
        map
    }),
    (
        "rows of a scan shifted, as by backlash",
        Wanted::Either,
        |s, rng| {
            let a = *s;
            s.map(rng, |x, y| {
                let back = if (y / a.step).round() as i64 % 2 == 1 {
                    0.3 * a.radii[0]
                } else {
                    0.0
                };
                a.light(x + back, y)
            })
        },
    ),
    ("five rows in the dark", Wanted::Either, |s, rng| {
        let (from, step) = ((s.y / s.step).floor() * s.step - 0.1, s.step);
        let dark = s.background;
        let mut map = plain(s, rng);
        for row in map
            .iter_mut()
            .filter(|r| (from..from + 5.0 * step).contains(&r[1]))
        {
            row[2] = dark + 0.004 * normal(rng);
        }
        map
    }),
    ("dark behind the peak", Wanted::Either, |s, rng| {
        let (from, dark) = (s.y + 0.2 * s.radii[1], s.background);
        let mut map = plain(s, rng);
        for row in map.iter_mut().filter(|r| r[1] > from) {
            row[2] = dark + 0.004 * normal(rng);
        }
        map
    }),
    (
        "a detector that dies of bright light",
        Wanted::Either,
        |s, rng| {
            let mut map = plain(s, rng);
            let bright = map.iter().position(|r| r[2] > s.background + 0.8);
            map.iter_mut()
                .skip(bright.unwrap_or(0))
                .for_each(|r| r[2] = s.background);
            map
        },
    ),
    (
        "a stage that slips along the lines",
        Wanted::Either,
        |s, rng| {
            let by = 0.5 * s.radii[0];
            slipped(s, rng, (by, 0.0))
        },
    ),
    (
        "a stage that slips across the lines",
        Wanted::Either,
        |s, rng| {
            let by = 0.5 * s.radii[0];
            slipped(s, rng, (0.0, by))
        },
    ),
    (
        "a stage that slips back across the lines",
        Wanted::Either,
        |s, rng| {
            let by = -0.5 * s.radii[0];
            slipped(s, rng, (0.0, by))
        },
    ),
    (
        "a level that steps within a line",
        Wanted::Either,
        |s, rng| {
            let (x, y, step) = (s.x, s.y + 0.3 * s.radii[0], s.step);
            let mut map = plain(s, rng);
            for row in &mut map {
                if row[1] > y + step || (row[1] > y && row[0] > x) {
                    row[2] += 0.3;
                }
            }
            map
        },
    ),
    ("mostly noise", Wanted::Either, |s, rng| {
        s.noise = 0.3;
        plain(s, rng)
    }),
    ("along a spiral", Wanted::Right, |s, rng| spiral(s, rng, 0)),
    (
        "along a spiral, a reading late",
        Wanted::Either,
        |s, rng| spiral(s, rng, 1),
    ),
    (
        "along a spiral, two readings late",
        Wanted::Either,
        |s, rng| spiral(s, rng, 2),
    ),
    ("to and fro", Wanted::Right, |s, rng| to_and_fro(s, rng, 0)),
    ("to and fro, two readings late", Wanted::Either, |s, rng| {
        to_and_fro(s, rng, 2)
    }),
    ("bright only from the peak on", Wanted::Either, |s, rng| {
        let (to, dark) = (s.x - 0.2 * s.radii[1], s.background);
        let mut map = plain(s, rng);
        for row in map.iter_mut().filter(|r| r[0] < to) {
            row[2] = dark + 0.004 * normal(rng);
        }
        map
    }),
    (
        "a stage that slipped half a radius along its rows, the peak where it is since",
        Wanted::Either,
        |s, rng| {
            let by = 0.5 * s.radii[0];
            let map = slipped(s, rng, (by, 0.0));
            s.x -= by;
            map
        },
    ),
    (
        "two scans in one file, half a radius aside of each other",
        Wanted::Either,
        |s, rng| {
            let mut map = plain(s, rng);
            s.x += 0.5 * s.radii[1];
            map.extend(plain(s, rng));
            map
        },
    ),
];

pub(crate) fn text(map: &Map) -> String {
    let mut text = "x,y,power\n".to_owned();
    for [x, y, p] in map {
        let _ = writeln!(text, "{x:.4},{y:.4},{p:.6}");
    }
    text
}

pub(crate) fn columns() -> Columns {
    Columns {
        names: None,
        place: None,
        power: None,
        inverted: false,
        step: None,
        settled: false,
    }
}

/// Wrong, and how many were answered.
fn over(seeds: std::ops::Range<u64>) -> (Vec<String>, Vec<(usize, usize)>) {
    let folder = tempfile::TempDir::new().expect("a folder");
    let path = folder.path().join("m.csv");
    let mut wrong = Vec::new();
    let mut counts = vec![(0, 0); CASES.len()];
    for seed in seeds {
        for (k, (name, wanted, make)) in CASES.iter().enumerate() {
            let mut rng = Pcg64Mcg::seed_from_u64(1000 * seed + k as u64);
            let mut spot = Spot::drawn(&mut rng);
            let map = make(&mut spot, &mut rng);
            fs::write(&path, text(&map)).expect("a file");
            counts[k].1 += 1;
            let scan = match read(&path, &columns()) {
                Ok(scan) => scan,
                Err(error) => {
                    if *wanted == Wanted::Right {
                        wrong.push(format!("{name} {seed}: {error}"));
                    }
                    continue;
                }
            };
            let found = try_on("m.csv", &scan, None, None).document;
            if found.outcome != "aligned" {
                if *wanted == Wanted::Right {
                    wrong.push(format!("{name} {seed}: {} {}", found.outcome, found.detail));
                }
                continue;
            }
            counts[k].0 += 1;
            let radius = spot.radii[0].min(spot.radii[1]);
            for peak in [found.peak, found.whole_map].into_iter().flatten() {
                let off = (peak.x_um - spot.x).hypot(peak.y_um - spot.y);
                if *wanted == Wanted::Refused || off > (0.15 * radius).max(3.0 * peak.deviation_um)
                {
                    wrong.push(format!(
                        "{name} {seed}: {off:.2} um of {radius:.2} off, said {:.2}; {:?} {:?} {:?}",
                        peak.deviation_um,
                        found.fold,
                        found.explained_percent,
                        found.only_noise_left
                    ));
                    break;
                }
                if peak.deviation_um > radius {
                    wrong.push(format!(
                        "{name} {seed}: known to {:.2} um",
                        peak.deviation_um
                    ));
                }
            }
        }
    }
    (wrong, counts)
}

/// Light has a size: places in another unit than they are read in are asked for, until somebody says that one on purpose.
#[test]
fn places_in_another_unit_are_asked_for() {
    let folder = tempfile::TempDir::new().expect("a folder");
    let path = folder.path().join("m.csv");
    let tried = |names: &str, scale: f64, place: Option<PlaceUnit>| {
        let mut rng = Pcg64Mcg::seed_from_u64(77);
        let mut spot = Spot::drawn(&mut rng);
        spot.noise = 0.005;
        let mut text = names.to_owned() + "\n";
        for [x, y, p] in plain(&spot, &mut rng) {
            let _ = writeln!(text, "{},{},{p:.6}", scale * x, scale * y);
        }
        fs::write(&path, text).expect("a file");
        let columns = Columns { place, ..columns() };
        let scan = read(&path, &columns).map_err(|e| e.to_string())?;
        let found = try_on("m.csv", &scan, None, None).document;
        let off = found
            .peak
            .map(|p| (p.x_um / scale - spot.x).hypot(p.y_um / scale - spot.y));
        if found.outcome == "aligned" {
            Ok(off.expect("a peak"))
        } else {
            Err(found.detail)
        }
    };
    let near = |found: Result<f64, String>| {
        assert!(found.as_ref().is_ok_and(|off| *off < 0.3), "{found:?}");
    };
    near(tried("x,y,power", 1.0, None));
    near(tried("x_um,y_um,power", 1.0, None));
    for (names, scale) in [
        ("x,y,power", 1e-3),
        ("x,y,power", 1e-6),
        ("x,y,power", 1e3),
        ("x_um,y_um,power", 1e-3),
        ("x_m,y_m,power", 1.0),
        ("x [mm],y [mm],power", 1.0),
    ] {
        let asked = tried(names, scale, None).expect_err("no light is of that size");
        assert!(asked.contains("--map-length-unit"), "{asked}");
    }
    near(tried("x,y,power", 1e3, Some(PlaceUnit::Um)));
    for names in [
        "x [counts],y [counts],power",
        "x_%,y_%,power",
        "x_in,y_in,power",
    ] {
        let asked = tried(names, 1.0, None).expect_err("no length");
        assert!(asked.contains("its name says"), "{asked}");
    }
}

/// A loss in decibels, below zero or above it, is light.
#[test]
fn losses_in_decibels_are_light() {
    let folder = tempfile::TempDir::new().expect("a folder");
    let path = folder.path().join("m.csv");
    for inverted in [false, true] {
        let mut rng = Pcg64Mcg::seed_from_u64(78);
        let mut spot = Spot::drawn(&mut rng);
        (spot.noise, spot.background) = (0.0, 0.01);
        let mut text = "x_um,y_um,loss_dB\n".to_owned();
        for [x, y, p] in plain(&spot, &mut rng) {
            let level = 10.0 * p.max(1e-4).log10();
            let _ = writeln!(
                text,
                "{x:.4},{y:.4},{:.4}",
                if inverted { -level } else { level }
            );
        }
        fs::write(&path, text).expect("a file");
        let names = ["x_um", "y_um", "loss_dB"].map(str::to_owned);
        let columns = Columns {
            names: Some(names),
            inverted,
            ..columns()
        };
        let scan = read(&path, &columns).expect("a map");
        let found = try_on("m.csv", &scan, None, None).document;
        let peak = found.whole_map.expect("a peak");
        let off = (peak.x_um - spot.x).hypot(peak.y_um - spot.y);
        assert!(
            found.outcome == "aligned" && off < 0.15 * spot.radii[1],
            "{off}: {}",
            found.detail
        );
    }
}

#[test]
fn no_map_is_wrong_and_called_aligned() {
    let wrong = report(0..2);
    assert!(
        wrong.is_empty(),
        "{} wrong:\n{}",
        wrong.len(),
        wrong.join("\n")
    );
}

/// None is what is wanted. On these seeds, which nothing was tuned on, 7 of 725 maps were wrong when they were first
/// looked at, 5 of several peaks and 2 with spikes. Of 775 with merging peaks and wild neighbours among them one is, since those are
/// told: the bound is of after that.
#[test]
#[ignore = "long: two minutes of maps"]
fn hardly_a_map_of_many_is_wrong_and_called_aligned() {
    // Of maps whose light went in their midst three of 50 were wrong when that was first counted; none is to be, and on 100 fresh
    // ones of each kind none was. What is written a reading late along a spiral does not show where the spiral hardly turns on the
    // peak: the book says how many.
    // A stage that slips on by half a radius across its lines leaves a peak that is narrower that way and between two places: where its shape
    // explains it all nothing shows it. Five of 25 were wrong when they were first counted, none since a place of its own alone is asked of all that
    // comes after some reading, and the bound is of after that.
    let (late, wrong): (Vec<_>, Vec<_>) = report(100..125)
        .into_iter()
        .partition(|wrong| wrong.starts_with("along a spiral, "));
    let (slipped, wrong): (Vec<_>, Vec<_>) = wrong
        .into_iter()
        .partition(|wrong| wrong.starts_with("a stage that slips across"));
    let all = [&wrong[..], &late[..], &slipped[..]].concat().join("\n");
    eprintln!(
        "{} wrong, {} along a spiral and late, and {} of a stage that slipped\n{all}",
        wrong.len(),
        late.len(),
        slipped.len()
    );
    assert!(
        wrong.len() <= 1 && late.len() <= 3 && slipped.len() <= 1,
        "{all}"
    );
}

fn report(seeds: std::ops::Range<u64>) -> Vec<String> {
    let (wrong, counts) = over(seeds);
    for ((name, ..), (aligned, all)) in CASES.iter().zip(counts) {
        eprintln!("{name}: {aligned} of {all} aligned");
    }
    wrong
}

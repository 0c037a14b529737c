//! Power maps whose powers lag the places: by some readings, or as a filter with a time constant makes it.
//!
//! Everything is drawn anew for each map by its number. `LATE_FIRST` is the number of the first, for maps that nobody has seen, and
//! `LATE_MAPS` how many there are of each kind.

use crate::map::{Map, Spot, columns, text};
use crate::normal;
use pigtail_records::map::{read, try_on};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::TAU;
use std::fs;

/// How a scan goes over its area.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Way {
    Forward,
    ColumnsForward,
    ToAndFro,
    ColumnsToAndFro,
    Spiral,
}

/// What a power has to do with its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Lag {
    None,
    /// A whole number of readings.
    Readings,
    /// Any time: the stage goes on between readings.
    Time,
    /// A filter of first order.
    Filter,
}

const WAYS: [Way; 5] = [
    Way::Forward,
    Way::ColumnsForward,
    Way::ToAndFro,
    Way::ColumnsToAndFro,
    Way::Spiral,
];
const LAGS: [Lag; 4] = [Lag::None, Lag::Readings, Lag::Time, Lag::Filter];

fn path(spot: &mut Spot, way: Way, rng: &mut Pcg64Mcg) -> Vec<[f64; 2]> {
    let step = spot.step;
    let mut places = Vec::new();
    if way == Way::Spiral {
        let reach = 0.5 * spot.side(0).min(spot.side(1));
        let away = rng.random_range(0.0..(reach - 1.5 * spot.radii[0]).max(0.1));
        let (sin, cos) = rng.random_range(0.0..TAU).sin_cos();
        (spot.x, spot.y) = (reach + away * cos, reach + away * sin);
        let (mut turn, mut radius) = (0.0_f64, 0.0);
        while radius < reach {
            radius = step * turn / TAU;
            places.push([reach + radius * turn.cos(), reach + radius * turn.sin()]);
            turn += step / radius.max(step / 3.0);
        }
        return places;
    }
    let by_columns = matches!(way, Way::ColumnsForward | Way::ColumnsToAndFro);
    let turns = matches!(way, Way::ToAndFro | Way::ColumnsToAndFro);
    let [across, along] = if by_columns { [0, 1] } else { [1, 0] };
    for j in 0..spot.n[across] {
        for i in 0..spot.n[along] {
            let back = turns && j % 2 == 1;
            let i = if back { spot.n[along] - 1 - i } else { i };
            let (a, b) = (i as f64 * step, j as f64 * step);
            places.push(if by_columns { [b, a] } else { [a, b] });
        }
    }
    places
}

/// A map, by how much its powers are late (readings), and what made it.
fn drawn(number: u64, way: Way, lag: Lag) -> (Map, f64, Spot) {
    let mut rng = Pcg64Mcg::seed_from_u64(number);
    let mut spot = Spot::drawn(&mut rng);
    let places = path(&mut spot, way, &mut rng);
    let late = match lag {
        Lag::None => 0.0,
        Lag::Readings => f64::from(rng.random_range(1..=6)),
        Lag::Time => rng.random_range(0.3..6.0),
        Lag::Filter => 0.3 * 15_f64.powf(rng.random::<f64>()),
    };
    let light = |k: usize| spot.light(places[k][0], places[k][1]);
    let mut filtered = 0.0;
    let mut map = Map::new();
    for (k, [x, y]) in places.iter().enumerate() {
        let power = if lag == Lag::Filter {
            filtered += (1.0 - (-1.0 / late).exp()) * (light(k) - filtered);
            filtered
        } else {
            let from = (k as f64 - late).max(0.0);
            let (whole, part) = (from.floor() as usize, from.fract());
            let [a, b] = [places[whole], places[(whole + 1).min(k)]];
            spot.light(a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1]))
        };
        let power = power * (1.0 + spot.speckle * normal(&mut rng));
        map.push([
            *x,
            *y,
            spot.background + power + spot.noise * normal(&mut rng),
        ]);
    }
    (map, late, spot)
}

/// Right, wrong and refused.
#[derive(Debug, Default)]
struct Counts {
    right: usize,
    wrong: Vec<String>,
    refused: Vec<String>,
}

/// Wrong is what is further off than a seventh of the radius and than three of the deviations said.
fn count(first: u64, maps: u64, way: Way, lag: Lag) -> Counts {
    let folder = tempfile::TempDir::new().expect("a folder");
    let path = folder.path().join("m.csv");
    let mut counts = Counts::default();
    for number in first..first + maps {
        let (map, late, spot) = drawn(number, way, lag);
        fs::write(&path, text(&map)).expect("a file");
        let found = read(&path, &columns()).map(|scan| try_on("m.csv", &scan, None, None).document);
        let found = match found {
            Ok(found) if found.outcome == "aligned" => found,
            Ok(found) => {
                let why = format!("{number} {late:.2}: {} {}", found.outcome, found.detail);
                counts.refused.push(why);
                continue;
            }
            Err(error) => {
                counts.refused.push(format!("{number} {late:.2}: {error}"));
                continue;
            }
        };
        let radius = spot.radii[0].min(spot.radii[1]);
        let far = [found.peak, found.whole_map].into_iter().flatten().find_map(|peak| {
            let off = (peak.x_um - spot.x).hypot(peak.y_um - spot.y);
            let wrong = off > (radius / 7.0).max(3.0 * peak.deviation_um);
            wrong.then(|| {
                format!(
                    "{number}: {late:.2} late; {:.2} of the radius off, said {:.2}, a step is {:.2}",
                    off / radius,
                    peak.deviation_um / radius,
                    spot.step / radius
                )
            })
        });
        match far {
            Some(far) => counts.wrong.push(far),
            None => counts.right += 1,
        }
    }
    counts
}

/// Of each kind how many are right, wrong and refused. Readings that are late along lines of one way leave no mark: these are told, and not asked for.
#[test]
#[ignore = "long: minutes of maps"]
fn powers_that_lag_are_refused_where_it_shows() {
    let from = |name: &str, usual: u64| {
        std::env::var(name).map_or(usual, |n| n.parse().expect("a number"))
    };
    let (first, maps) = (from("LATE_FIRST", 2_000_000), from("LATE_MAPS", 20));
    let (mut wrong, mut late, mut right) = (0, 0, 0);
    let kinds = WAYS.iter().flat_map(|way| LAGS.map(|lag| (*way, lag)));
    for (k, (way, lag)) in kinds.enumerate() {
        let counts = count(first + 1000 * k as u64, maps, way, lag);
        let hidden = matches!(way, Way::Forward | Way::ColumnsForward)
            && matches!(lag, Lag::Readings | Lag::Time);
        eprintln!(
            "{way:?} {lag:?}: {} right, {} wrong, {} refused",
            counts.right,
            counts.wrong.len(),
            counts.refused.len()
        );
        for words in counts.wrong.iter().chain(&counts.refused) {
            eprintln!("    {words}");
        }
        match lag {
            Lag::None => right += counts.right,
            _ if hidden => {}
            _ => (wrong, late) = (wrong + counts.wrong.len(), late + maps as usize),
        }
    }
    let all = maps as usize * WAYS.len();
    assert!(right * 20 >= all * 19, "{right} of {all} that are not late");
    assert!(wrong * 20 <= late, "{wrong} of {late} that are");
}

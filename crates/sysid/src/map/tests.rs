//! Scans made of known peaks.

use super::*;

/// Normal numbers of unit variance, near enough: sums of twelve uniform ones.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        (0..12).fold(-6.0, |sum, _| {
            self.0 = self
                .0
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            sum + (self.0 >> 33) as f64 / f64::from(1_u32 << 31)
        })
    }
}

/// A scan of `n` by `n` readings, `um` micrometres apart, of noisy light that an instrument folds.
fn noisy(
    n: u32,
    um: f64,
    sigma: f64,
    seed: u64,
    light: impl Fn(f64, f64) -> f64,
    fold: impl Fn(f64) -> f64,
) -> Scan {
    let mut noise = Noise(seed);
    let mut readings = Vec::new();
    for j in 0..n {
        for i in 0..n {
            let (x, y) = (f64::from(i) * um, f64::from(j) * um);
            readings.push(Reading {
                at: Displacement::new(x * 1e-6, y * 1e-6),
                power: fold(light(x, y) + sigma * noise.next()),
            });
        }
    }
    Scan::new(readings).unwrap()
}

/// A peak of height 1 on a background of 0.1, places and radii in micrometres.
fn peak(x0: f64, y0: f64, rx: f64, ry: f64) -> impl Fn(f64, f64) -> f64 {
    move |x, y| 0.1 + (-((x - x0) / rx).powi(2) - ((y - y0) / ry).powi(2)).exp()
}

fn plain(power: f64) -> f64 {
    power
}

fn from_middle(scan: &Scan) -> Look {
    Look {
        start: scan.middle(),
        accuracy: None,
    }
}

/// What an instrument makes of a power.
type Instrument = fn(f64) -> f64;

/// Distance of a shape from a place in micrometres, micrometres.
fn off(shape: &Shape, x: f64, y: f64) -> f64 {
    (shape.at * 1e6 - Displacement::new(x, y)).norm()
}

#[test]
fn a_coarse_noisy_scan_has_its_peak_and_widths() {
    for seed in 0..20 {
        let (x, y) = (14.0 + 0.6 * f64::from(seed), 25.0 - 0.9 * f64::from(seed));
        let scan = noisy(
            15,
            2.0,
            0.01,
            100 + u64::from(seed as u32),
            peak(x, y, 5.0, 3.5),
            plain,
        );
        let all = examine(&scan).unwrap();
        assert_eq!(all.fold, Fold::Plain);
        assert!(
            off(&all.peak, x, y) < 0.1,
            "{seed}: {}",
            off(&all.peak, x, y)
        );
        let (rx, ry) = all.peak.radii();
        assert!((rx * 1e6 - 5.0).abs() < 0.2 && (ry * 1e6 - 3.5).abs() < 0.2);
        let looked = look(&scan, &all, &from_middle(&scan));
        let found = looked.peak.unwrap();
        assert!(off(&found, x, y) < 0.3, "{seed}: {}", off(&found, x, y));
        assert!(looked.taken.len() < 80, "{seed}: {}", looked.taken.len());
    }
}

#[test]
fn the_deviation_is_that_of_repeated_scans() {
    let (mut squares, mut prediction) = (0.0, 0.0);
    for seed in 0..200 {
        let scan = noisy(15, 2.0, 0.02, 7 * seed, peak(13.0, 16.0, 4.0, 4.0), plain);
        let all = examine(&scan).unwrap();
        squares += (all.peak.at.x * 1e6 - 13.0).powi(2) / 200.0;
        prediction += (all.deviation * 1e6).powi(2) / 200.0;
    }
    assert!(
        (0.8..1.2).contains(&(squares / prediction).sqrt()),
        "{squares} {prediction}"
    );
}

#[test]
fn what_an_instrument_folded_is_unfolded() {
    let light = |x, y| 2.0 * peak(15.7, 12.4, 6.0, 5.0)(x, y);
    let ways: [(&str, Instrument); 4] = [
        ("clipped", |p| p.min(1.3)),
        ("wrapped", |p| p.rem_euclid(1.3)),
        ("mirrored_down", |p| if p > 1.3 { 2.6 - p } else { p }),
        ("mirrored_up", |p| (p - 0.7).abs()),
    ];
    for (name, way) in ways {
        for sigma in [0.0, 0.01] {
            let scan = noisy(15, 2.0, sigma, 3, light, way);
            let all = examine(&scan).unwrap_or_else(|e| panic!("{name} {sigma}: {e}"));
            assert_eq!(all.fold.name(), name, "{sigma}");
            assert!(
                off(&all.peak, 15.7, 12.4) < 0.15,
                "{name} {sigma} {:?}",
                all.peak
            );
            assert!((all.peak.height - 2.0).abs() < 0.3, "{name} {:?}", all.peak);
            let looked = look(&scan, &all, &from_middle(&scan));
            let found = looked.peak.unwrap();
            assert!(off(&found, 15.7, 12.4) < 0.3, "{name} {sigma}");
        }
    }
}

#[test]
fn what_has_no_peak_is_refused_with_a_reason() {
    let name = |scan: &Scan| examine(scan).unwrap_err().name();
    for seed in 0..20 {
        assert_eq!(
            name(&noisy(15, 2.0, 0.1, seed, |_, _| 1.0, plain)),
            "no_light",
            "{seed}"
        );
    }
    let narrow = noisy(15, 2.0, 0.01, 1, peak(13.1, 14.2, 1.2, 1.2), plain);
    assert_eq!(name(&narrow), "too_coarse");
    let beyond = noisy(15, 2.0, 0.01, 1, peak(32.0, 14.2, 6.0, 6.0), plain);
    assert_eq!(name(&beyond), "at_edge");
    let dark = |x, y| 2.0 - peak(13.1, 14.2, 5.0, 5.0)(x, y);
    assert_eq!(name(&noisy(15, 2.0, 0.01, 1, dark, plain)), "dark");
}

#[test]
fn a_reading_that_stands_apart_is_left_out() {
    let mut scan = noisy(15, 2.0, 0.01, 1, peak(13.1, 14.2, 5.0, 5.0), plain);
    scan.readings[20].power = 5.0;
    let all = examine(&scan).unwrap();
    assert_eq!(all.apart, 1);
    assert!(off(&all.peak, 13.1, 14.2) < 0.1);
}

#[test]
fn a_fine_scan_is_not_read_whole() {
    let scan = noisy(150, 0.5, 0.005, 1, peak(52.3, 21.9, 6.0, 6.0), plain);
    let all = examine(&scan).unwrap();
    let looked = look(&scan, &all, &from_middle(&scan));
    assert!(
        looked.reached && looked.taken.len() < 200,
        "{}",
        looked.taken.len()
    );
    assert!(off(&looked.peak.unwrap(), 52.3, 21.9) < 0.4);
    let sure = Look {
        accuracy: Some(0.01e-6),
        ..from_middle(&scan)
    };
    let sure = look(&scan, &all, &sure);
    assert!(sure.taken.len() > looked.taken.len());
    let (long, short, _) = sure.peak.unwrap().ellipse();
    assert!((long * 1e6 - 6.0).abs() < 0.3 && (short * 1e6 - 6.0).abs() < 0.3);
    assert!(sure.reached && sure.deviation <= 0.01e-6);
    assert!(off(&sure.peak.unwrap(), 52.3, 21.9) < 0.05);
}

#[test]
fn spacing_is_that_of_a_grid() {
    let readings = (0..15 * 9)
        .map(|k| Reading {
            at: Displacement::new(2e-6 * f64::from(k % 15), 2e-6 * f64::from(k / 15)),
            power: f64::from(k),
        })
        .collect();
    let scan = Scan::new(readings).unwrap();
    assert!((scan.spacing() - 2e-6).abs() < 1e-12, "{}", scan.spacing());
}

#[test]
fn what_is_no_scan_is_refused() {
    let reading = |x: f64, y: f64, power: f64| Reading {
        at: Displacement::new(x, y),
        power,
    };
    let made = |of: fn(f64) -> (f64, f64, f64)| {
        let all = (0..20).map(|k| of(f64::from(k)));
        Scan::new(all.map(|(x, y, p)| reading(x, y, p)).collect()).unwrap_err()
    };
    assert_eq!(made(|k| (k, k * k, 1.0)).what, "power");
    assert_eq!(made(|k| (1.0, k, k)).what, "x");
    assert_eq!(made(|k| (k, 1.0, k)).what, "y");
    assert!(made(|k| (k, 2.0 * k, k)).why.contains("line"));
    assert!(made(|k| (k, f64::NAN, k)).why.contains("finite"));
    assert!(Scan::new(vec![reading(0.0, 0.0, 1.0); 3]).is_err());
}

/// A detector of first order that is slow beside the readings, and a light that leans ahead of the way.
#[test]
fn light_that_trails_is_told_from_light_that_leans_ahead() {
    let settled = noisy(41, 1.0, 0.003, 6, peak(18.0, 21.0, 5.0, 5.0), plain);
    let mut seen = 0.1;
    let mut trail = |r: &Reading| {
        seen += (1.0 - (-0.5_f64).exp()) * (r.power - seen);
        Reading { power: seen, ..*r }
    };
    let trailing: Vec<Reading> = settled.readings().iter().map(&mut trail).collect();
    // The same light from its other side: what trailed runs ahead.
    let turned = |r: &Reading| Reading {
        at: Displacement::new(40e-6 - r.at.x, r.at.y),
        ..*r
    };
    let mut ahead: Vec<Reading> = trailing.iter().map(turned).collect();
    for row in ahead.chunks_mut(41) {
        row.reverse();
    }
    let refused = examine(&Scan::new(trailing).unwrap());
    assert!(
        matches!(refused, Err(Refusal::Trails { readings }) if (1.0..4.0).contains(&readings)),
        "{refused:?}"
    );
    let other = examine(&Scan::new(ahead).unwrap());
    assert!(other.is_ok(), "{other:?}");
}

//! The closed form of the coupling against the overlap integral that it is the solution of, and
//! the capture functions against plain quadrature.

use pigtail_model::optics::{
    Coupler, GaussianMode, Misalignment, core_capture, disc_below_edge, exit_angle,
};
use proptest::prelude::*;
use std::f64::consts::PI;

const WAVELENGTH: f64 = 1.3e-6;

/// |overlap|^2 in one plane by quadrature: a Gaussian beam that left its waist `z` ago, against a
/// waist at `x0` whose axis is tilted.
fn overlap(w1: f64, w2: f64, x0: f64, z: f64, tilt: f64) -> f64 {
    let k = 2.0 * PI / WAVELENGTH;
    let rayleigh = PI * w1 * w1 / WAVELENGTH;
    let w = w1 * (1.0 + (z / rayleigh).powi(2)).sqrt();
    let curvature = z / (z * z + rayleigh * rayleigh);
    let (mut re, mut im, mut n1, mut n2) = (0.0, 0.0, 0.0, 0.0);
    let n = 40_000;
    let span = 8.0 * w.max(w2) + x0.abs();
    for i in 0..=n {
        let x = span * (2.0 * f64::from(i) / f64::from(n) - 1.0);
        let a = (-(x / w).powi(2)).exp();
        let b = (-((x - x0) / w2).powi(2)).exp();
        let phase = k * (0.5 * curvature * x * x - tilt * (x - x0));
        re += a * b * phase.cos();
        im += a * b * phase.sin();
        n1 += a * a;
        n2 += b * b;
    }
    (re * re + im * im) / (n1 * n2)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn the_closed_form_is_the_overlap_integral(
        w1 in 1.5e-6..4e-6_f64, w2 in 1.5e-6..4e-6_f64, x in -6e-6..6e-6_f64,
        z in 0.0..60e-6_f64, tilt in -0.05..0.05_f64,
    ) {
        let mode = |w| GaussianMode { radius_x: w, radius_y: w };
        let coupler = Coupler::new(mode(w1), mode(w2), WAVELENGTH).unwrap();
        let closed = coupler.efficiency(&Misalignment { x, z, tilt_x: tilt, ..Misalignment::default() });
        let integral = overlap(w1, w2, x, z, tilt) * overlap(w1, w2, 0.0, z, 0.0);
        prop_assert!((closed - integral).abs() < 1e-6, "{closed} for {integral}");
    }

}

#[test]
fn equal_modes_follow_the_textbook() {
    let mode = GaussianMode {
        radius_x: 2.5e-6,
        radius_y: 2.5e-6,
    };
    let coupler = Coupler::new(mode, mode, WAVELENGTH).unwrap();
    let at = |m: Misalignment| coupler.efficiency(&m);
    assert!((at(Misalignment::default()) - 1.0).abs() < 1e-15);
    let lateral = at(Misalignment {
        x: 2.5e-6,
        ..Misalignment::default()
    });
    assert!(
        (lateral - (-1.0_f64).exp()).abs() < 1e-12,
        "1/e of power at one mode radius"
    );
    let rayleigh = PI * 2.5e-6_f64.powi(2) / WAVELENGTH;
    let axial = at(Misalignment {
        z: 2.0 * rayleigh,
        ..Misalignment::default()
    });
    assert!((axial - 0.5).abs() < 1e-12, "half at two Rayleigh lengths");
    let angle = WAVELENGTH / (PI * 2.5e-6);
    let tilted = at(Misalignment {
        tilt_y: angle,
        ..Misalignment::default()
    });
    assert!(
        (tilted - (-1.0_f64).exp()).abs() < 1e-12,
        "1/e at the divergence angle"
    );
}

#[test]
fn a_core_catches_what_falls_into_it() {
    assert!((core_capture(0.0, 50e-6, 9e-6) - 1.0).abs() < 1e-12);
    assert!(core_capture(80e-6, 50e-6, 9e-6) < 1e-6);
    // Two-dimensional quadrature across the rim of a core three times as large as the beam.
    let (beam, core, n) = (1.0_f64, 3.0, 800);
    for offset in [1.5, 2.0, 2.5, 3.0, 3.5, 4.0] {
        let (mut inside, mut all) = (0.0, 0.0);
        for i in 0..n {
            for j in 0..n {
                let (x, y): (f64, f64) =
                    (f64::from(i - n / 2) * 0.005, f64::from(j - n / 2) * 0.005);
                let power = (-2.0 * (x * x + y * y) / (beam * beam)).exp();
                all += power;
                if (x + offset).hypot(y) < core {
                    inside += power;
                }
            }
        }
        let error = core_capture(offset, core, beam) - inside / all;
        assert!(error.abs() < 3e-3, "{error} at {offset}");
    }
}

#[test]
fn a_disc_across_an_edge() {
    assert_eq!(disc_below_edge(-2.0, 1.0), 1.0);
    assert_eq!(disc_below_edge(2.0, 1.0), 0.0);
    assert!((disc_below_edge(0.0, 3.0) - 0.5).abs() < 1e-15);
    // The slope is the chord over the area.
    let h = 1e-6;
    let slope = (disc_below_edge(0.3 + h, 1.0) - disc_below_edge(0.3 - h, 1.0)) / (2.0 * h);
    let chord = 2.0 * (1.0_f64 - 0.09).sqrt();
    assert!((slope + chord / PI).abs() < 1e-9);
}

#[test]
fn light_leaves_an_angled_facet_by_snells_law() {
    assert_eq!(exit_angle(0.0, 2.2, 1.0), 0.0);
    let facet = 10.0_f64.to_radians();
    let exit = exit_angle(facet, 2.2, 1.0);
    assert!(((facet + exit).sin() - 2.2 * facet.sin()).abs() < 1e-15);
}

/// A beam wider than the core: by brute force over the disc, and the closed form on the axis.
#[test]
fn a_core_in_a_wide_beam_takes_its_share() {
    let core = 50e-6;
    for beam in [20e-6_f64, 60e-6, 120e-6] {
        let on_axis = 1.0 - (-2.0 * core * core / (beam * beam)).exp();
        let captured = core_capture(0.0, core, beam);
        assert!(
            (captured - on_axis).abs() < 1e-5,
            "{captured} for {on_axis}"
        );
        for offset in [10e-6_f64, 50e-6, 110e-6] {
            let (n, mut sum) = (400, 0.0);
            let cell = 2.0 * core / f64::from(n);
            for i in 0..n {
                for j in 0..n {
                    let x = (f64::from(i) + 0.5) * cell - core;
                    let y = (f64::from(j) + 0.5) * cell - core;
                    if x * x + y * y < core * core {
                        let r2: f64 = (x - offset).powi(2) + y * y;
                        sum += (-2.0 * r2 / (beam * beam)).exp() * cell * cell;
                    }
                }
            }
            let brute = sum * 2.0 / (std::f64::consts::PI * beam * beam);
            let captured = core_capture(offset, core, beam);
            assert!((captured - brute).abs() < 3e-4, "{captured} for {brute}");
        }
    }
}

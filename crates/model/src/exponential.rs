//! The exponential and the natural logarithm as a few additions and multiplications: unlike a call into the C library they are
//! inlined, and of several numbers worked out at once.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

/// Below this nothing is left that would count: the result is zero.
const LEAST: f64 = -700.0;

/// Added to a number it leaves the nearest whole one in the last bits: three halves of 2^52.
const WHOLE: f64 = 6_755_399_441_055_744.0;

/// The upper bits of the natural logarithm of two, which times a whole number of ten bits are exact, and what is left of it.
const LN_2: (f64, f64) = (0.693_147_180_369_123_8, 1.908_214_929_270_587_7e-10);

/// `1/n!`.
const TERMS: [f64; 14] = {
    let mut terms = [1.0; 14];
    let mut n = 1;
    while n < 14 {
        terms[n] = terms[n - 1] / n as f64;
        n += 1;
    }
    terms
};

/// `exp(x)` for `x` up to 700, to 4e-16 of it; zero below -700.
///
/// ```
/// # use pigtail_model::exponential::exp;
/// for k in -7000..7000 {
///     let x = 0.1 * f64::from(k);
///     assert!((exp(x) / x.exp() - 1.0).abs() < 4.5e-16, "{x}");
/// }
/// assert!(exp(-701.0) == 0.0 && exp(0.0) == 1.0 && exp(f64::NAN).is_nan());
/// ```
#[inline(always)]
pub fn exp(x: f64) -> f64 {
    // exp(x) = 2^k exp(r).
    let shifted = x * std::f64::consts::LOG2_E + WHOLE;
    let k = shifted - WHOLE;
    let r = (x - k * LN_2.0) - k * LN_2.1;
    // The series in pairs, which do not wait for one another.
    let pair = |n: usize| TERMS[n] + TERMS[n + 1] * r;
    let (square, t) = (r * r, TERMS);
    let fourth = square * square;
    let low = (t[2] + t[3] * r) + square * (pair(4) + square * pair(6));
    let high = pair(8) + square * (pair(10) + square * pair(12));
    let series = 1.0 + (r + square * (low + fourth * square * high));
    // The exponent's bits of a number are those of k and the exponent of one.
    let power = f64::from_bits(shifted.to_bits().wrapping_add(1023) << 52);
    if x < LEAST { 0.0 } else { power * series }
}

/// The bits of the root of one half, from which to its double the series of the logarithm is summed up.
const ROOT_HALF: u64 = std::f64::consts::FRAC_1_SQRT_2.to_bits();

/// The bits of one.
const ONE: u64 = 1.0_f64.to_bits();

/// The natural logarithm of a normal positive number, to 3e-16 of it or, near one, of a unit.
///
/// ```
/// # use pigtail_model::exponential::ln;
/// for k in -7000..7000 {
///     let x = (0.1 * f64::from(k)).exp();
///     assert!((ln(x) - x.ln()).abs() <= 3e-16 * x.ln().abs().max(1.0), "{x}");
/// }
/// assert!(ln(1.0) == 0.0);
/// ```
#[inline(always)]
pub fn ln(x: f64) -> f64 {
    // x = 2^k m, with m from the root of one half to that of two.
    let exponent = (x.to_bits() + (ONE - ROOT_HALF)) >> 52;
    let m = f64::from_bits(x.to_bits().wrapping_sub(exponent << 52).wrapping_add(ONE));
    // A whole number below 2^52 in the last bits of one that is 2^52.
    let k = f64::from_bits(exponent | (1075 << 52)) - (4_503_599_627_370_496.0 + 1023.0);
    // ln m = 2 (s + s^3/3 + s^5/5 ...).
    let s = (m - 1.0) / (m + 1.0);
    let square = s * s;
    let pair = |n: u32| 1.0 / f64::from(n) + square * (1.0 / f64::from(n + 2));
    let (second, t) = (square * square, square);
    let low = pair(3) + second * pair(7);
    let high = pair(11) + second * (pair(15) + second * (1.0 / 19.0));
    let series = low + (second * second) * high;
    let twice = 2.0 * s;
    k * LN_2.0 + (twice + (twice * (t * series) + k * LN_2.1))
}

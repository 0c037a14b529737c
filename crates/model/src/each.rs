//! A number for each of several joints or axes, in arithmetic that a processor does on two or more at once.

#![expect(
    clippy::inline_always,
    clippy::needless_bitwise_bool,
    reason = "what is not inlined does not get the instructions of its caller, and a short cut is a branch"
)]

use std::ops::{Add, Div, Index, IndexMut, Mul, Neg, Sub};

/// A number held between two others: what `f64::clamp` does, which asks each time whether there is anything between them.
#[inline(always)]
pub fn held(number: f64, low: f64, high: f64) -> f64 {
    let number = if number < low { low } else { number };
    if number > high { high } else { number }
}

/// How joints are worked out side by side: what of it is known when the program is compiled.
pub(crate) trait Way {
    /// Products and sums are one operation, and rounded once.
    const FUSED: bool;
    /// There are transmissions that harden...
    const HARDENS: bool;
    /// ...and some of them to a bound.
    const BENDS: bool;
}

/// `N` numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(32))]
pub struct Each<const N: usize>(pub [f64; N]);

impl<const N: usize> Each<N> {
    /// Each by its number.
    #[inline(always)]
    pub fn of(value: impl FnMut(usize) -> f64) -> Self {
        Self(std::array::from_fn(value))
    }

    #[inline(always)]
    fn with(self, other: Self, value: impl Fn(f64, f64) -> f64) -> Self {
        Self::of(|i| value(self.0[i], other.0[i]))
    }

    /// These where it is so, the others elsewhere.
    #[inline(always)]
    #[must_use]
    pub fn select(self, other: Self, here: impl Fn(usize) -> bool) -> Self {
        Self::of(|i| if here(i) { self.0[i] } else { other.0[i] })
    }

    /// Their absolute values.
    #[inline(always)]
    #[must_use]
    pub fn abs(self) -> Self {
        Self(self.0.map(f64::abs))
    }

    /// Their square roots.
    #[inline(always)]
    #[must_use]
    pub fn sqrt(self) -> Self {
        Self(self.0.map(f64::sqrt))
    }

    /// The smaller of two.
    // A comparison and not `f64::min`, which takes more for what none of these is: not a number.
    #[inline(always)]
    #[must_use]
    pub fn min(self, other: Self) -> Self {
        self.with(other, |a, b| if a < b { a } else { b })
    }

    /// The larger of two.
    #[inline(always)]
    #[must_use]
    pub fn max(self, other: Self) -> Self {
        self.with(other, |a, b| if a > b { a } else { b })
    }

    /// These and products: of which each is rounded before it is added where it is worked out [apart](Way::FUSED).
    #[inline(always)]
    pub(crate) fn plus<W: Way>(self, by: Self, of: Self) -> Self {
        Self::of(|i| {
            if W::FUSED {
                by.0[i].mul_add(of.0[i], self.0[i])
            } else {
                self.0[i] + by.0[i] * of.0[i]
            }
        })
    }

    /// These less products.
    #[inline(always)]
    pub(crate) fn less<W: Way>(self, by: Self, of: Self) -> Self {
        self.plus::<W>(-by, of)
    }

    /// Whether any is below zero.
    #[inline(always)]
    pub fn any_negative(self) -> bool {
        // No short cut: all are compared at once.
        self.0.iter().fold(false, |any, a| any | (*a < 0.0))
    }

    /// Whether all are zero.
    #[inline(always)]
    pub fn all_zero(self) -> bool {
        !self.0.iter().fold(false, |any, a| any | (*a != 0.0))
    }
}

impl<const N: usize> Add for Each<N> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.with(other, |a, b| a + b)
    }
}

impl<const N: usize> Sub for Each<N> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.with(other, |a, b| a - b)
    }
}

impl<const N: usize> Mul for Each<N> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.with(other, |a, b| a * b)
    }
}

impl<const N: usize> Div for Each<N> {
    type Output = Self;

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.with(other, |a, b| a / b)
    }
}

impl<const N: usize> Mul<Each<N>> for f64 {
    type Output = Each<N>;

    #[inline(always)]
    fn mul(self, other: Each<N>) -> Each<N> {
        Each(other.0.map(|a| self * a))
    }
}

impl<const N: usize> Neg for Each<N> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.map(|a| -a))
    }
}

impl<const N: usize> Index<usize> for Each<N> {
    type Output = f64;

    #[inline(always)]
    fn index(&self, i: usize) -> &f64 {
        &self.0[i]
    }
}

impl<const N: usize> IndexMut<usize> for Each<N> {
    #[inline(always)]
    fn index_mut(&mut self, i: usize) -> &mut f64 {
        &mut self.0[i]
    }
}

//! Which vector instructions a machine has, found out when the program runs.

use pulp::{Arch, Scalar, Simd, WithSimd};

/// What is worth being compiled once for each set of instructions.
pub trait Work {
    /// What comes of it.
    type Output;

    /// Does it. To be marked as always inlined, like what it calls in turn: what is not inlined does not get the
    /// instructions of its caller.
    fn work(self) -> Self::Output;
}

struct Op<W>(W);

impl<W: Work> WithSimd for Op<W> {
    type Output = W::Output;

    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "or it is a call into what has none of them"
    )]
    fn with_simd<S: Simd>(self, _: S) -> W::Output {
        self.0.work()
    }
}

/// A set of vector instructions that this machine has.
///
/// All of them add and multiply alike, and nothing is fused but in a [`Batch`](crate::batch::Batch): what else is worked out by one
/// is, to the last bit, what is worked out by another.
#[derive(Debug, Clone, Copy)]
pub struct Instructions(Set);

#[derive(Debug, Clone, Copy)]
enum Set {
    /// What every processor of the kind that the program was built for has: SSE2, NEON.
    Every,
    #[cfg(target_arch = "x86_64")]
    Avx2(pulp::x86::V3),
    Widest(Arch),
}

impl Instructions {
    /// Those that do the most at once.
    #[inline]
    pub fn widest() -> Self {
        Self(Set::Widest(Arch::new()))
    }

    /// All that there are here, the widest last.
    pub fn all() -> Vec<Self> {
        let mut all = vec![Self(Set::Every)];
        #[cfg(target_arch = "x86_64")]
        all.extend(pulp::x86::V3::try_new().map(|avx2| Self(Set::Avx2(avx2))));
        if Self::widest().name() != all[all.len() - 1].name() {
            all.push(Self::widest());
        }
        all
    }

    /// Their name.
    pub fn name(self) -> &'static str {
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Set::Every | Set::Widest(Arch::Scalar) => "SSE2",
            #[cfg(target_arch = "x86_64")]
            Set::Avx2(_) | Set::Widest(Arch::V3(_)) => "AVX2",
            #[cfg(target_arch = "x86_64")]
            Set::Widest(Arch::V4(_)) => "AVX-512",
            #[cfg(target_arch = "aarch64")]
            Set::Every => "NEON",
            // What comes later, and other machines.
            _ => "widest",
        }
    }

    /// Does some work by AVX2 where there is it, to the same bits: what is no long row of numbers gains by its three operands and
    /// its wide copies, and nothing by wider vectors.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "a call more in the hot loop")]
    pub fn run_work<W: Work>(work: W) -> W::Output {
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = pulp::x86::V3::try_new() {
            return Self(Set::Avx2(avx2)).run(Op(work));
        }
        work.work()
    }

    /// Works `op` out with them. What it calls gets them where it is inlined.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "a call more in the hot loop")]
    pub(crate) fn run<Op: WithSimd>(self, op: Op) -> Op::Output {
        match self.0 {
            Set::Every => Simd::vectorize(Scalar, op),
            #[cfg(target_arch = "x86_64")]
            Set::Avx2(avx2) => Simd::vectorize(avx2, op),
            Set::Widest(arch) => arch.dispatch(op),
        }
    }
}

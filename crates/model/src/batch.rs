//! Any number of joints stepped side by side: machines by the dozen, trials of gains, the particles of a filter.

use crate::each::Way;
use crate::group::{self, Block, Group, Pools, States};
use crate::instructions::Instructions;
use crate::joint::{Joint, JointState};
use pulp::{Simd, WithSimd};
use std::marker::PhantomData;

/// So many joints make one [`Group`]: as many numbers as the widest vector holds.
pub const LANES: usize = group::LANES;

/// Joints with the same equations and parameters of their own, each under a voltage of its own.
///
/// Each goes its own way: a joint that sticks or breaks away does so at its own instant, and the others do not wait
/// for it. Eight lie side by side, in the order in which they are given; those that do the same kind of work, and need as many
/// steps a cycle, are best given one after the other.
///
/// ```
/// # use pigtail_model::batch::Batch;
/// # use pigtail_model::friction::Friction;
/// # use pigtail_model::joint::{Joint, JointParameters};
/// # use pigtail_model::motor::Motor;
/// # use pigtail_model::transmission::Transmission;
/// let joint = |inertia: f64| {
///     Joint::new(
///         JointParameters {
///             motor_inertia: 1e-6,
///             load_inertia: inertia,
///             ratio: 0.2,
///             motor: Motor::new(0.02, 0.02, 5.53)?,
///             transmission: Transmission::new(3.95, 0.0)?,
///             motor_friction: Friction::new(2.58e-3, 2.09e-3, 1.71e-6)?,
///             load_friction: Friction::new(3.06e-3, 2.94e-3, 5.7e-3)?,
///             presliding: 0.0,
///             load_torque: 0.0,
///         },
///         4e-4,
///     )
/// };
/// let joints: Vec<_> = (0..100)
///     .map(|k| joint(1.7e-5 + 1e-8 * f64::from(k)))
///     .collect::<Result<_, _>>()?;
/// let mut batch = Batch::new(&joints, 4e-4);
/// for _ in 0..50 {
///     batch.advance(&[6.0; 100]);
/// }
/// assert!(batch.motor_angle(0) > batch.motor_angle(99));
/// # Ok::<(), pigtail_model::Invalid>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Batch {
    blocks: Vec<Block>,
    joints: usize,
    spring: Spring,
    /// `None` without a joint.
    pools: Option<Box<Pools>>,
}

impl Batch {
    /// These joints, at rest at zero, to be advanced by cycles of `cycle` seconds. Eight that lie side by side take as
    /// many steps as the one of them that needs most.
    pub fn new(joints: &[Joint], cycle: f64) -> Self {
        let blocks = joints.chunks(LANES).map(|some| {
            // What is left over of the last vector rests.
            let lane = |i: usize| some[i.min(some.len() - 1)];
            Block {
                group: Group::new(std::array::from_fn(lane), cycle),
                states: States::new([JointState::default(); LANES]),
            }
        });
        let blocks: Vec<_> = blocks.collect();
        Self {
            pools: blocks
                .first()
                .map(|some| Box::new(Pools::new(&some.group, cycle))),
            blocks,
            joints: joints.len(),
            spring: joints
                .iter()
                .map(Spring::of)
                .max()
                .unwrap_or(Spring::Linear),
        }
    }

    /// How many joints there are.
    pub fn len(&self) -> usize {
        self.joints
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.joints == 0
    }

    /// Advances every joint by a cycle, each under its held voltage, volts.
    ///
    /// # Panics
    ///
    /// Unless there is a voltage for each joint.
    pub fn advance(&mut self, voltages: &[f64]) {
        self.advance_by(Instructions::widest(), voltages);
    }

    /// The same by instructions of one's choice: to the same bits by all that fuse a product and a sum, and by SSE2, which has nothing
    /// that does, to 1e-3 nm at a tip.
    ///
    /// # Panics
    ///
    /// Unless there is a voltage for each joint.
    pub fn advance_by(&mut self, instructions: Instructions, voltages: &[f64]) {
        assert_eq!(voltages.len(), self.joints, "a voltage for each joint");
        if let Some(pools) = &mut self.pools {
            instructions.run(Cycle {
                pools,
                blocks: &mut self.blocks,
                voltages,
                spring: self.spring,
            });
        }
    }

    fn block(&self, i: usize) -> (&Block, usize) {
        assert!(i < self.joints, "joint {i} of {}", self.joints);
        (&self.blocks[i / LANES], i % LANES)
    }

    /// The state of a joint.
    ///
    /// # Panics
    ///
    /// When there is none of that number.
    pub fn state(&self, i: usize) -> JointState {
        let (block, lane) = self.block(i);
        block.states.get(lane)
    }

    /// Sets the state of a joint, the torque on its load included.
    ///
    /// # Panics
    ///
    /// When there is none of that number.
    pub fn set_state(&mut self, i: usize, state: &JointState) {
        assert!(i < self.joints, "joint {i} of {}", self.joints);
        let block = &mut self.blocks[i / LANES];
        block.states.set(i % LANES, state);
    }

    /// Angle of a motor, radians.
    ///
    /// # Panics
    ///
    /// When there is none of that number.
    pub fn motor_angle(&self, i: usize) -> f64 {
        let (block, lane) = self.block(i);
        block.states.motor_angle(lane)
    }

    /// Positions of all outputs (2.12), radians.
    pub fn outputs(&self) -> impl Iterator<Item = f64> {
        self.blocks
            .iter()
            .flat_map(|block| block.group.outputs(&block.states))
            .take(self.joints)
    }
}

/// A cycle of all of them.
struct Cycle<'a> {
    pools: &'a mut Pools,
    blocks: &'a mut [Block],
    voltages: &'a [f64],
    spring: Spring,
}

impl WithSimd for Cycle<'_> {
    type Output = ();

    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "what is not inlined does not get the instructions of its caller"
    )]
    fn with_simd<S: Simd>(self, _: S) {
        let Self {
            pools,
            blocks,
            voltages,
            spring,
        } = self;
        let wide = S::F64_LANES >= LANES;
        match spring {
            Spring::Linear => pools.advance::<By<S, false, false>>(blocks, voltages, wide),
            Spring::Hardens => pools.advance::<By<S, true, false>>(blocks, voltages, wide),
            Spring::Bends => pools.advance::<By<S, true, true>>(blocks, voltages, wide),
        }
    }
}

/// By the instructions `S`: of those for which programs are built here all but SSE2 fuse.
struct By<S, const HARDENS: bool, const BENDS: bool>(PhantomData<S>);

impl<S: Simd, const HARDENS: bool, const BENDS: bool> Way for By<S, HARDENS, BENDS> {
    const FUSED: bool = S::F64_LANES > 2 || cfg!(target_arch = "aarch64");
    const HARDENS: bool = HARDENS;
    const BENDS: bool = BENDS;
}

/// What the transmissions of a batch have of what one may have: the less, the shorter is the chain of operations from one torque to the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Spring {
    Linear,
    Hardens,
    Bends,
}

impl Spring {
    fn of(joint: &Joint) -> Self {
        let transmission = &joint.parameters().transmission;
        if transmission.bend() < f64::INFINITY {
            Self::Bends
        } else if transmission.cubic() > 0.0 {
            Self::Hardens
        } else {
            Self::Linear
        }
    }
}

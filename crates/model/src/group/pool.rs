//! Joints of many groups whose modes change in a step, finished side by side.
//!
//! In a slow triangle every eighth step of a joint has an event: of eight joints side by side mostly one or two. Were those finished
//! where they are, most of a vector would be idle; so they are gathered until there are enough.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use super::lanes::{Accelerations, Bodies, Course, Ends, Input, Lanes};
use super::{Group, Moving, States};
use crate::each::{Each, Way};
use crate::joint::JointState;
use crate::nystrom::POINTS;

/// So many joints make one group: as many numbers as the widest vector holds.
pub(crate) const LANES: usize = 8;

/// So many are finished together where there are as many. (Twice as many at once take longer: what they need at the same time is more
/// than there are registers.)
const MANY: usize = LANES;

/// And so many where there are no more: as many numbers as the narrowest vector holds.
const FEW: usize = 2;

/// A group with its states.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Block {
    pub(crate) group: Group<LANES>,
    pub(crate) states: States<LANES>,
}

/// Joints that are to be finished: by twos where there are no more.
#[derive(Debug, Clone)]
pub(crate) struct Pools {
    many: Pool<MANY>,
    few: Pool<FEW>,
}

/// Up to `N` joints that are to be finished.
#[derive(Debug, Clone)]
struct Pool<const N: usize> {
    lanes: Lanes<N>,
    states: States<N>,
    input: Input<N>,
    ends: Ends<N>,
    /// Which block, which joint of it, and its voltage.
    from: [(usize, usize, f64); N],
    len: usize,
}

impl Pools {
    /// Empty ones. What they hold for joints that are not there are those of some group, and nobody asks for it.
    pub(crate) fn new(like: &Group<LANES>, cycle: f64) -> Self {
        let joint = like.joints[0];
        Self {
            many: Pool::new(&Group::new([joint; MANY], cycle)),
            few: Pool::new(&Group::new([joint; FEW], cycle)),
        }
    }

    /// Advances all blocks by a cycle, each joint under its voltage, where a vector holds a number of each joint of a block
    /// or is not so `wide`.
    #[inline(always)]
    pub(crate) fn advance<W: Way>(&mut self, blocks: &mut [Block], voltages: &[f64], wide: bool) {
        if let [block] = blocks {
            self.few.advance_alone::<W>(block, voltages, wide);
            return;
        }
        let most = blocks.iter().map(|block| block.group.steps).max();
        for step in 0..most.unwrap_or(0) {
            for b in 0..blocks.len() {
                let Block { group, states } = &mut blocks[b];
                if step >= group.steps {
                    continue;
                }
                let mut here = Each([0.0; LANES]);
                for (lane, volts) in here.0.iter_mut().zip(&voltages[LANES * b..]) {
                    *lane = *volts;
                }
                let input = group.lanes.input(states, here);
                let Some(ends) = group.lanes.step::<W>(states, &input) else {
                    continue;
                };
                if !ends.margin.any_negative() {
                    states.go_to(&ends);
                    continue;
                }
                let start = states.clone();
                states.go_to(&ends);
                for i in 0..LANES {
                    if ends.margin[i] < 0.0 {
                        let lanes = &blocks[b].group.lanes;
                        self.many
                            .put(lanes, &start, (&input, &ends), i, (b, i, here[i]));
                        if self.many.len == MANY {
                            self.many.finish::<W>(blocks);
                        }
                    }
                }
            }
            self.finish::<W>(blocks);
        }
    }

    /// Finishes what is left.
    #[inline(always)]
    fn finish<W: Way>(&mut self, blocks: &mut [Block]) {
        let Self { many, few } = self;
        if many.len > FEW {
            many.finish::<W>(blocks);
        } else if many.len > 0 {
            for i in 0..many.len {
                let to = (&many.input, &many.ends);
                few.put(&many.lanes, &many.states, to, i, many.from[i]);
            }
            many.len = 0;
            few.finish::<W>(blocks);
        }
    }
}

impl<const N: usize> Pool<N> {
    fn new(like: &Group<N>) -> Self {
        let zero = Each([0.0; N]);
        let still = || Accelerations {
            alone: zero,
            by: zero,
        };
        Self {
            lanes: like.lanes.clone(),
            states: States::new([JointState::default(); N]),
            input: Input {
                drive: zero,
                outside: zero,
            },
            ends: Ends {
                margin: zero,
                motor_keeps: zero,
                course: Course {
                    motor: still(),
                    load: still(),
                    torques: [zero; POINTS],
                },
                motor: (zero, zero),
                load: (zero, zero),
                torque: zero,
            },
            from: [(0, 0, 0.0); N],
            len: 0,
        }
    }

    /// Advances a block that nobody lies beside by a cycle: no others are there that a vector could be filled with. Where one holds all of it,
    /// those whose modes change are finished where they lie: to gather them would take longer.
    #[inline(always)]
    fn advance_alone<W: Way>(&mut self, block: &mut Block, voltages: &[f64], wide: bool) {
        let mut here = Each([0.0; LANES]);
        for (lane, volts) in here.0.iter_mut().zip(voltages) {
            *lane = *volts;
        }
        for _ in 0..block.group.steps {
            let Block { group, states } = &mut *block;
            let input = group.lanes.input(states, here);
            let Some(mut ends) = group.lanes.step::<W>(states, &input) else {
                return;
            };
            if !ends.margin.any_negative() {
                states.go_to(&ends);
                continue;
            }
            let count = ends.margin.0.iter().filter(|m| **m < 0.0).count();
            if wide || count > N {
                group.lanes.pass::<W>(states, &input, &mut ends);
                if ends.margin.any_negative() {
                    group.finish(states, &here, &mut ends);
                }
                states.go_to(&ends);
                continue;
            }
            for i in 0..LANES {
                if ends.margin[i] < 0.0 {
                    self.put(&group.lanes, states, (&input, &ends), i, (0, i, here[i]));
                }
            }
            states.go_to(&ends);
            self.finish::<W>(std::slice::from_mut(block));
        }
    }

    /// Takes a joint in.
    #[inline(always)]
    fn put<const M: usize>(
        &mut self,
        lanes: &Lanes<M>,
        states: &States<M>,
        (input, ends): (&Input<M>, &Ends<M>),
        i: usize,
        from: (usize, usize, f64),
    ) {
        let to = self.len;
        self.lanes.take(to, lanes, i);
        self.states.motor.take(to, &states.motor, i);
        self.states.load.take(to, &states.load, i);
        self.states.load_torque[to] = states.load_torque[i];
        self.input.drive[to] = input.drive[i];
        self.input.outside[to] = input.outside[i];
        self.ends.take(to, ends, i);
        self.from[to] = from;
        self.len += 1;
    }

    /// Finishes those that there are, and lets them go.
    #[inline(always)]
    fn finish<W: Way>(&mut self, blocks: &mut [Block]) {
        self.lanes
            .pass::<W>(&mut self.states, &self.input, &mut self.ends);
        for i in 0..self.len {
            let (block, joint, volts) = self.from[i];
            let Block { group, states } = &mut blocks[block];
            if self.ends.margin[i] < 0.0 {
                let (state, length) = (self.states.get(i), self.lanes.length[i]);
                let alone = &group.joints[joint];
                let state = self.ends.finish(i, state, alone, volts, length);
                states.set(joint, &state);
            } else {
                let (motor, load) = (self.ends.motor, self.ends.load);
                states.motor.angle[joint] = motor.0[i];
                states.motor.velocity[joint] = motor.1[i];
                states.motor.sign[joint] = self.states.motor.sign[i];
                states.load.angle[joint] = load.0[i];
                states.load.velocity[joint] = load.1[i];
                states.load.sign[joint] = self.states.load.sign[i];
            }
        }
        self.len = 0;
    }
}

// What it works with is nothing that lasts.
impl PartialEq for Pools {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl<const N: usize> Moving<N> {
    #[inline(always)]
    fn take<const M: usize>(&mut self, to: usize, other: &Moving<M>, from: usize) {
        self.angle[to] = other.angle[from];
        self.velocity[to] = other.velocity[from];
        self.sign[to] = other.sign[from];
    }
}

impl<const N: usize> Ends<N> {
    #[inline(always)]
    fn take<const M: usize>(&mut self, to: usize, other: &Ends<M>, from: usize) {
        self.margin[to] = other.margin[from];
        self.motor_keeps[to] = other.motor_keeps[from];
        self.course.motor.take(to, &other.course.motor, from);
        self.course.load.take(to, &other.course.load, from);
        for k in 0..POINTS {
            self.course.torques[k][to] = other.course.torques[k][from];
        }
        self.motor.0[to] = other.motor.0[from];
        self.motor.1[to] = other.motor.1[from];
        self.load.0[to] = other.load.0[from];
        self.load.1[to] = other.load.1[from];
        self.torque[to] = other.torque[from];
    }
}

impl<const N: usize> Accelerations<N> {
    #[inline(always)]
    fn take<const M: usize>(&mut self, to: usize, other: &Accelerations<M>, from: usize) {
        self.alone[to] = other.alone[from];
        self.by[to] = other.by[from];
    }
}

/// What finishing takes of the parameters: not all.
impl<const N: usize> Lanes<N> {
    #[inline(always)]
    fn take<const M: usize>(&mut self, to: usize, other: &Lanes<M>, from: usize) {
        self.ratio[to] = other.ratio[from];
        self.linear[to] = other.linear[from];
        self.cubic[to] = other.cubic[from];
        self.bend[to] = other.bend[from];
        self.unbend[to] = other.unbend[from];
        self.stiffest[to] = other.stiffest[from];
        self.length[to] = other.length[from];
        self.rate[to] = other.rate[from];
        self.motor.take(to, &other.motor, from);
        self.load.take(to, &other.load, from);
    }
}

impl<const N: usize> Bodies<N> {
    #[inline(always)]
    fn take<const M: usize>(&mut self, to: usize, other: &Bodies<M>, from: usize) {
        self.inverse_inertia[to] = other.inverse_inertia[from];
        self.decay[to] = other.decay[from];
        self.coulomb[to] = other.coulomb[from];
        self.level[to] = other.level[from];
        self.free[to] = other.free[from];
        for k in 0..POINTS - 1 {
            let (row, other) = (&mut self.points[k], &other.points[k]);
            row.drift[to] = other.drift[from];
            row.all[to] = other.all[from];
            for j in 0..=k {
                row.angle[j][to] = other.angle[j][from];
            }
        }
    }
}

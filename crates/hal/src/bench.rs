//! A bench: groups of axes, their poses and the light, in metres and seconds.
//!
//! Search, peak, approach and attaching are written over this trait. A bench plays motion [`Law`]s by itself and
//! says what happens as [`Event`]s; control never says what is to be done in one cycle. Behind it stands a controller that
//! closes its own loops, or a station that closes them over a [`Machine`](crate::Machine).
//!
//! **Frames.** Each arm has a frame of its own, right-handed: x across, y up, z towards the chip. Poses of its groups
//! are given in it. A tip stands where the groups of its arm have moved it together: the sum of their poses.
//!
//! **Time** is the bench's own, in seconds. It passes in [`Bench::next`] only.

mod check;
pub mod spec;

use crate::{Fault, FiberHandling};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::{Add, Mul, Neg, Sub};
use thiserror::Error;

/// Degrees of freedom of a pose.
pub const DEGREES: usize = 6;

/// A degree of freedom of a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Degree {
    /// Across, metres.
    X,
    /// Up, metres.
    Y,
    /// Towards the chip, metres.
    Z,
    /// About x, radians.
    Rx,
    /// About y, radians.
    Ry,
    /// About z, radians.
    Rz,
}

impl Degree {
    /// All of them, in index order.
    pub const ALL: [Self; DEGREES] = [Self::X, Self::Y, Self::Z, Self::Rx, Self::Ry, Self::Rz];

    /// Index into arrays over the degrees.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// The name that files and messages use.
    pub const fn name(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::Y => "y",
            Self::Z => "z",
            Self::Rx => "rx",
            Self::Ry => "ry",
            Self::Rz => "rz",
        }
    }
}

/// Where a group of axes stands, from where it is zero: metres along x, y, z, and radians about them, small.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Pose(pub [f64; DEGREES]);

impl Pose {
    /// Nothing moved.
    pub const ZERO: Self = Self([0.0; DEGREES]);

    /// Moved along x, y, z, metres.
    pub const fn at(x: f64, y: f64, z: f64) -> Self {
        Self([x, y, z, 0.0, 0.0, 0.0])
    }

    /// Across, metres.
    pub const fn x(&self) -> f64 {
        self.0[0]
    }

    /// Up, metres.
    pub const fn y(&self) -> f64 {
        self.0[1]
    }

    /// Towards the chip, metres.
    pub const fn z(&self) -> f64 {
        self.0[2]
    }

    /// The same with one degree of freedom changed.
    #[must_use]
    pub const fn with(mut self, degree: Degree, value: f64) -> Self {
        self.0[degree.index()] = value;
        self
    }

    /// Length of its displacement, metres.
    pub fn distance(&self) -> f64 {
        self.x().hypot(self.y()).hypot(self.z())
    }

    /// Whether all of it are numbers.
    pub fn is_finite(&self) -> bool {
        self.0.iter().all(|value| value.is_finite())
    }
}

impl Add for Pose {
    type Output = Self;
    fn add(self, by: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] + by.0[i]))
    }
}

impl Sub for Pose {
    type Output = Self;
    fn sub(self, by: Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] - by.0[i]))
    }
}

impl Neg for Pose {
    type Output = Self;
    fn neg(self) -> Self {
        Self(self.0.map(|value| -value))
    }
}

impl Mul<f64> for Pose {
    type Output = Self;
    fn mul(self, by: f64) -> Self {
        Self(self.0.map(|value| value * by))
    }
}

/// A group of axes that moves as one: its place in [`Caps::groups`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Group(pub usize);

/// A photodiode or meter: its place in [`Caps::channels`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Meter(pub usize);

/// Something that was begun and will be done, or fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Ticket(pub u64);

/// What a bench is able to do, as its datasheet and its calibration say.
#[derive(Debug, Clone, PartialEq)]
pub struct Caps {
    /// The bench's name.
    pub name: String,
    /// Names of its arms; each carries a fiber.
    pub arms: Vec<String>,
    /// Its groups of axes.
    pub groups: Vec<GroupCaps>,
    /// What measures light.
    pub channels: Vec<ChannelCaps>,
    /// Least power that its laser can be set to, percent of its full power; a hundred where it is on or off.
    pub least_power: u8,
    /// How long a fiber has to be held until it is fixed, seconds.
    pub bond: f64,
    /// Its time passes in steps of so many seconds, so that [`Bench::next`] ends up to half of one before or after the time
    /// that was asked for; zero: it passes as it is asked to.
    pub cycle: f64,
}

impl Caps {
    /// The group of an arm at a stage.
    pub fn group(&self, arm: usize, stage: Stage) -> Option<Group> {
        let of = |group: &GroupCaps| group.arm == arm && group.stage == stage;
        self.groups.iter().position(of).map(Group)
    }
}

/// Whether a group goes far or exactly.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    /// Far, and about where it is told.
    Coarse,
    /// Exactly, and not far.
    Fine,
}

/// What a group of axes is able to do.
#[derive(Debug, Clone, PartialEq)]
pub struct GroupCaps {
    /// The name that files and messages use, such as `left.fine`.
    pub name: String,
    /// The arm that it is of: its place in [`Caps::arms`].
    pub arm: usize,
    /// Far or exactly.
    pub stage: Stage,
    /// Its axes, by [`Degree`]; `None` where it does not move.
    pub axes: [Option<AxisCaps>; DEGREES],
    /// By when it has come to rest once it is where it was told to be, seconds.
    pub settling: f64,
    /// Fastest [`Law::Dither`] that it follows, hertz; zero for a group that plays none.
    pub bandwidth: f64,
    /// By how much a sample of light is later than the pose that it is of, as [`Bench::pose`] has it, seconds; and the
    /// standard deviation of that.
    pub lag: (f64, f64),
    /// Whether what it plays may be replaced by [`Bench::bend`].
    pub bends: bool,
}

/// What an axis is able to do; metres or radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisCaps {
    /// Lowest and highest place.
    pub range: (f64, f64),
    /// Least step.
    pub resolution: f64,
    /// Standard deviation of where it comes to stand, from one side.
    pub repeatability: f64,
    /// How far it falls short when it turns back.
    pub backlash: f64,
    /// Highest speed, a second.
    pub speed: f64,
}

/// What measures light.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelCaps {
    /// The name that files and messages use.
    pub name: String,
    /// Samples a second.
    pub rate: f64,
    /// Least step of a sample, volts.
    pub resolution: f64,
    /// Largest sample, volts.
    pub full_scale: f64,
}

/// How fast a line may be; `None`: as fast as the group can.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Limits {
    /// Metres a second along the line.
    pub speed: Option<f64>,
}

/// A value that goes over to another without a jump of its speed, as half a cosine does.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Glide<T> {
    /// Where it goes.
    pub to: T,
    /// Within so many seconds; zero: at once.
    pub within: f64,
}

impl<T> Glide<T> {
    /// At once.
    pub const fn at_once(to: T) -> Self {
        Self { to, within: 0.0 }
    }

    /// Which share of the way is gone after so many seconds.
    pub fn share(&self, since: f64) -> f64 {
        if since >= self.within {
            return 1.0;
        }
        let share = (since / self.within).max(0.0);
        0.5 - 0.5 * (std::f64::consts::PI * share).cos()
    }
}

/// The middle of a dither follows what another group is measured to travel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Lead {
    /// The group that leads.
    pub group: Group,
    /// From where its travel counts.
    pub from: Pose,
    /// How far the middle goes in x and in y for each metre of its travel in x, y, z.
    pub gain: [[f64; 3]; 2],
}

impl Lead {
    /// How far the middle goes, x and y, metres, when the group that leads is at a pose.
    pub fn by(&self, at: &Pose) -> [f64; 2] {
        let travel = *at - self.from;
        self.gain.map(|row| {
            row.iter()
                .zip(&travel.0)
                .map(|(gain, way)| gain * way)
                .sum()
        })
    }
}

/// A circle in x and y around a middle, which may move and follow.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Dither {
    /// Its middle in x and y, metres, from where it is now.
    pub centre: Glide<[f64; 2]>,
    /// Its radius, metres, from what it is now. With none it is a way to rest.
    pub radius: Glide<f64>,
    /// Turns a second. Its angle goes on from where it is.
    pub rate: f64,
    /// What its middle follows.
    pub lead: Option<Lead>,
    /// Its radius grows with the gap that the group which leads leaves. `None`: it does not.
    pub widens: Option<Widens>,
}

/// A radius that grows as a beam's does.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Widens {
    /// Pose in z of the group that leads at which the fiber would touch the chip, metres.
    pub contact: f64,
    /// Gap at which the radius is larger by a factor of the root of two, metres.
    pub doubles: f64,
}

impl Widens {
    /// By what the radius is multiplied when the group that leads is at a pose.
    pub fn times(&self, at: &Pose) -> f64 {
        let gap = (self.contact - at.z()).max(0.0) / self.doubles;
        (1.0 + gap * gap).sqrt()
    }
}

/// A point of a scan.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Knot {
    /// When, seconds from the scan's start; increasing.
    pub time: f64,
    /// Where.
    pub at: Pose,
}

/// How a group moves: data, so that it can be recorded, checked before it is played, and given to a controller that plays it
/// by itself.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Law {
    /// A straight line to a pose, and to rest there.
    Line {
        /// The pose.
        to: Pose,
        /// How fast.
        limits: Limits,
    },
    /// Straight from knot to knot in time.
    Scan(Vec<Knot>),
    /// A circle; goes on until it is replaced, or its radius has become none.
    Dither(Dither),
    /// To rest as fast as the group can.
    Brake,
}

/// What is asked of a bench beside motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Request {
    /// The laser on or off.
    Laser(bool),
    /// The power of the laser where it is on, percent of its full power.
    LaserPower {
        /// One to a hundred; no less than [`Caps::least_power`].
        percent: u8,
    },
    /// An arm takes the fiber for a port of its side, counted from zero.
    Load {
        /// The arm.
        arm: usize,
        /// The port.
        port: usize,
    },
    /// The fiber of an arm is fixed to the chip where it stands, and let go of once the bond has set.
    Attach {
        /// The arm.
        arm: usize,
    },
    /// The fiber of an arm goes back.
    Unload {
        /// The arm.
        arm: usize,
    },
    /// A step of the production cycle: gripping, dispensing, lamp, release, the next device. Benches that know none of it
    /// refuse.
    Handle {
        /// The arm.
        arm: usize,
        /// The step.
        what: FiberHandling,
    },
}

/// Light, all meters at one moment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Light {
    /// When it was measured, seconds.
    pub time: f64,
    /// By [`Meter`], volts; not a number where a meter has no sample at this moment.
    pub volts: Vec<f64>,
}

/// What a camera tells apart on an arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Tip {
    /// The fiber that the arm carries.
    Fiber,
    /// The multimode fiber beside it.
    Sensing,
}

/// A tip as a camera sees it, in the chip's frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Fix {
    /// The arm.
    pub arm: usize,
    /// Which of its tips.
    pub tip: Tip,
    /// Across the chip, metres.
    pub x: f64,
    /// Along the waveguide, metres.
    pub z: f64,
    /// Standard deviation of the independent noise of one frame, metres.
    pub sigma: f64,
}

/// What a camera saw at one moment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// When it was exposed, seconds. It arrives later.
    pub time: f64,
    /// The tips that it shows.
    pub fixes: Vec<Fix>,
}

/// What happened.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Event {
    /// Light was measured.
    Light(Light),
    /// It was measured some times while a controller played by itself, in order.
    Batch(Vec<Light>),
    /// A camera's frame has arrived, on a bench that has one.
    Frame(Frame),
    /// A ticket's law has been played to its end, and its group still comes to rest: [`Self::Done`] or
    /// [`Self::Failed`] follows. Only benches that know it say it.
    Played(Ticket),
    /// A ticket is done.
    Done(Ticket),
    /// A ticket has failed, and why.
    Failed(Ticket, String),
    /// Nothing did until the time that was asked for.
    Time,
}

/// A pose, and what says so.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// The pose.
    pub pose: Pose,
    /// Whether sensors say it, or only what the group was told.
    pub measured: bool,
}

/// Why a bench does not do what it is asked for. Nothing has moved.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Refused {
    /// There is no such group, arm or meter.
    #[error("there is no {what} {index}; this bench has {count}")]
    Unknown {
        /// Group, arm or meter.
        what: &'static str,
        /// What was asked for.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// A law that the group cannot play.
    #[error("{group} cannot play a {law}: {why}")]
    Law {
        /// The group.
        group: String,
        /// The law's name.
        law: &'static str,
        /// What it cannot.
        why: String,
    },
    /// A pose outside a range.
    #[error(
        "{group}.{axis} at {value:.9} is outside of its range, {low:.9} to {high:.9} (metres or radians)"
    )]
    Range {
        /// The group.
        group: String,
        /// The axis.
        axis: &'static str,
        /// What was asked for.
        value: f64,
        /// Lowest that is accepted.
        low: f64,
        /// Highest that is accepted.
        high: f64,
    },
    /// A ticket that is over, or never was.
    #[error("ticket {0} is not being played")]
    Ticket(u64),
    /// What the bench's state forbids, such as a second fiber in a holder.
    #[error("{0}")]
    State(String),
}

impl Law {
    /// The name that messages use.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Line { .. } => "line",
            Self::Scan(_) => "scan",
            Self::Dither(_) => "dither",
            Self::Brake => "brake",
        }
    }
}

impl fmt::Display for Ticket {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// A bench: real, simulated, replayed, or a station over a voltage machine.
///
/// Guard, recorder and replay implement it again around another bench.
pub trait Bench {
    /// What it is able to do.
    fn caps(&self) -> &Caps;

    /// The bench's time, seconds.
    fn now(&self) -> f64;

    /// Begins to play a law and returns at once. Groups move side by side; what the group has played before ends, and is
    /// never [`Event::Done`].
    ///
    /// # Errors
    ///
    /// [`Refused`], and nothing has changed.
    fn play(&mut self, group: Group, law: Law) -> Result<Ticket, Refused>;

    /// Replaces what is not yet played of a ticket's law. Returns from when on, seconds.
    ///
    /// # Errors
    ///
    /// [`Refused`], and the law goes on as it was.
    fn bend(&mut self, ticket: Ticket, law: Law) -> Result<f64, Refused>;

    /// Asks for something that is busy for a while, then done or failed.
    ///
    /// # Errors
    ///
    /// [`Refused`], and nothing has changed.
    fn request(&mut self, what: Request) -> Result<Ticket, Refused>;

    /// Lets time pass until something happens, or until a time. Events come in the order of their times.
    ///
    /// # Errors
    ///
    /// A [`Fault`] when the bench has stopped. It is then safe.
    fn next(&mut self, by: f64) -> Result<Event, Fault>;

    /// Where a group stood at a time that is not long past; `None` where that is not known.
    fn pose(&self, group: Group, at: f64) -> Option<Estimate>;

    /// Where a group is wanted at this moment: its controller's reference, which its pose follows. `None` where a bench
    /// does not tell.
    fn reference(&self, _group: Group) -> Option<Pose> {
        None
    }

    /// Whether a group gets to a pose. By the ranges of its axes, where a bench does not know better: its axes may
    /// stand askew.
    fn reaches(&self, group: Group, pose: &Pose) -> bool {
        let Some(group) = self.caps().groups.get(group.0) else {
            return false;
        };
        group.axes.iter().zip(&pose.0).all(|(axis, at)| {
            let (low, high) = axis.map_or((0.0, 0.0), |axis| axis.range);
            (low..=high).contains(at)
        })
    }

    /// Stops at once and holds. Never fails.
    fn stop(&mut self);
}

impl<B: Bench + ?Sized> Bench for &mut B {
    fn caps(&self) -> &Caps {
        (**self).caps()
    }

    fn now(&self) -> f64 {
        (**self).now()
    }

    fn play(&mut self, group: Group, law: Law) -> Result<Ticket, Refused> {
        (**self).play(group, law)
    }

    fn bend(&mut self, ticket: Ticket, law: Law) -> Result<f64, Refused> {
        (**self).bend(ticket, law)
    }

    fn request(&mut self, what: Request) -> Result<Ticket, Refused> {
        (**self).request(what)
    }

    fn next(&mut self, by: f64) -> Result<Event, Fault> {
        (**self).next(by)
    }

    fn pose(&self, group: Group, at: f64) -> Option<Estimate> {
        (**self).pose(group, at)
    }

    fn reference(&self, group: Group) -> Option<Pose> {
        (**self).reference(group)
    }

    fn reaches(&self, group: Group, pose: &Pose) -> bool {
        (**self).reaches(group, pose)
    }

    fn stop(&mut self) {
        (**self).stop();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_glide_begins_and_ends_without_speed() {
        let glide = Glide {
            to: 1.0,
            within: 2.0,
        };
        assert_eq!(glide.share(-1.0), 0.0);
        assert_eq!(glide.share(0.0), 0.0);
        assert!((glide.share(1.0) - 0.5).abs() < 1e-15);
        assert_eq!(glide.share(2.0), 1.0);
        assert!(glide.share(1e-4) < 1e-8);
        assert_eq!(Glide::at_once(1.0).share(0.0), 1.0);
    }

    #[test]
    fn a_lead_counts_travel_from_its_start() {
        let lead = Lead {
            group: Group(0),
            from: Pose::at(1.0, 2.0, 3.0),
            gain: [[-1.0, 0.0, 0.2], [0.0, -1.0, 0.0]],
        };
        assert_eq!(lead.by(&Pose::at(1.0, 2.0, 3.0)), [0.0, 0.0]);
        let [x, y] = lead.by(&Pose::at(2.0, 2.5, 4.0));
        assert!((x + 0.8).abs() < 1e-15 && (y + 0.5).abs() < 1e-15);
    }

    #[test]
    fn a_radius_widens_with_the_gap_only() {
        let widens = Widens {
            contact: 1.0,
            doubles: 0.5,
        };
        assert_eq!(widens.times(&Pose::at(0.0, 0.0, 1.2)), 1.0);
        assert!((widens.times(&Pose::at(0.0, 0.0, 0.5)).powi(2) - 2.0).abs() < 1e-12);
    }
}

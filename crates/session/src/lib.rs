//! A rig, a machine, a job and an observer: the one way to run anything.
//!
//! In goes a [`Rig`] (datasheet, belief and recipe, read and checked), any
//! [`Machine`](pigtail_hal::Machine) that stands at home (a twin, a replay, one's own), and a
//! [`Job`]. Out comes the job's typed result, or the way in which it [ended](Ended) without one:
//! bad input, a fault of the machine, or an honest negative. A [`Session`] always stands around the
//! machine: guarded, to be stopped by a person, recorded where somebody wants that, and what was recorded
//! can be [replayed](replay) to the last bit.
//!
//! Read in this order: [`rig`]; [`session`], what stands around a machine; [`job`], what runs in it; then
//! the jobs: [`align`], [`tune`], [`characterize`], [`identify`], [`piezos`], [`impulse`],
//! [`pulses`], [`contour`], [`first_light`], [`follow`]; and [`commission`], which puts them together. [`setup`] is a rig with a truth that twins are drawn around;
//! [`fleet`] says what it may be; [`scenario`] and [`faults`] change it. [`calibrations`] keeps what was believed
//! of a rig, version by version. [`mod@bench`] is the same for rigs that are controlled by position.
//!
//! # Ten lines
//!
//! The shipped rig, the twin that seed 7 draws, a device aligned on it, and how far off its fibers are in
//! truth, which only a twin can be asked for:
//!
//! ```
//! use pigtail_control::station::Unobserved;
//! use pigtail_session::{Session, Setup, align::Align};
//!
//! let setup = Setup::load("afpm", "y-branch")?;
//! let mut twin = setup.twin(7)?;
//! let aligned = Session::open(&setup.rig, &mut twin).run(&Align::default(), &mut Unobserved)?;
//! let truth = twin.truth();
//! for (fiber, truth) in aligned.fibers.iter().zip([truth.input].into_iter().chain(truth.outputs)) {
//!     let offset = truth.map(|fiber| 1e6 * fiber.x.hypot(fiber.y));
//!     println!("{}: {}, {offset:.3?} um off", fiber.port, fiber.outcome);
//! }
//! # assert!(aligned.fibers.iter().all(|fiber| fiber.outcome.is_aligned()));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! The same with a machine of one's own, which knows no truth. Here it stands in for hardware and hands all
//! on to a twin:
//!
//! ```
//! use pigtail_control::station::Unobserved;
//! use pigtail_hal::{Command, Fault, Machine, Measurement, Spec};
//! use pigtail_session::{Rig, Session, Setup, align::Align};
//!
//! struct Mine(pigtail_twin::Twin);
//!
//! impl Machine for Mine {
//!     fn spec(&self) -> &Spec {
//!         self.0.spec()
//!     }
//!     fn exchange(&mut self, command: &Command) -> Result<Measurement, Fault> {
//!         self.0.exchange(command)
//!     }
//!     fn stop(&mut self) {
//!         self.0.stop();
//!     }
//! }
//!
//! let rig = Rig::load("afpm", "y-branch")?;
//! let mut mine = Mine(Setup::of(rig.clone())?.twin(7)?);
//! let mut session = Session::open(&rig, &mut mine);
//! for fiber in session.run(&Align::default(), &mut Unobserved)?.fibers {
//!     println!("{}: {} after {:.2} s", fiber.port, fiber.outcome, fiber.seconds());
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod align;
pub mod bench;
pub mod calibrations;
pub mod characterize;
#[cfg(feature = "twin")]
pub mod commission;
pub mod contour;
#[cfg(feature = "twin")]
pub mod faults;
pub mod first_light;
#[cfg(feature = "twin")]
pub mod fleet;
pub mod follow;
pub mod guarded;
pub mod identify;
pub mod impulse;
pub mod job;
#[cfg(feature = "twin")]
pub mod own;
pub mod piezos;
pub mod procedure;
pub mod produce;
pub mod pulses;
pub mod records;
pub mod replay;
pub mod rig;
pub mod samples;
#[cfg(feature = "twin")]
pub mod scenario;
pub mod session;
#[cfg(feature = "twin")]
pub mod setup;
pub mod tune;

pub use job::{Ended, Job};
pub use rig::Rig;
pub use session::Session;
#[cfg(feature = "twin")]
pub use setup::Setup;

/// The code of the book's page on benches compiles.
#[cfg(all(doctest, feature = "twin"))]
#[doc = include_str!("../../../book/src/howto/bench.md")]
struct Book;

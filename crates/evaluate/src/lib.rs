//! Belief held against truth: what a procedure, an experiment or an algorithm is worth on twins.
//!
//! In goes a [`Setup`](pigtail_session::Setup), a rig with a truth; jobs run on the twins that seeds draw, and
//! out come documents in which what control says stands beside what is. Start with [`align`]; [`campaign`] does
//! it for many devices, [`benchmark`] for many algorithms. The others hold experiments against the truth:
//! [`maximize`], [`methods`], [`impulse`], [`hysteresis`], [`loops`], [`contour`].
//!
//! ```
//! use pigtail_control::station::Unobserved;
//! use pigtail_evaluate::align::align;
//! use pigtail_session::{Setup, procedure::Procedure};
//!
//! let setup = Setup::load("afpm", "y-branch")?;
//! let document = align(&setup, Procedure::Fast, 7, &mut Unobserved)?;
//! assert!(document.is_success(), "{}", document.outcome());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod align;
pub mod arms;
pub mod bench;
pub mod benchmark;
pub mod campaign;
pub mod contour;
pub mod entry;
pub mod hysteresis;
pub mod impulse;
pub mod loops;
pub mod maximize;
pub mod methods;
pub mod plan;
pub mod produce;
pub mod sample_data;
pub mod simulate;
pub mod trays;

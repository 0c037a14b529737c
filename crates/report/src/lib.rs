//! The page a person wants to look at: one self-contained HTML file for each kind of run.
//!
//! In goes what a run has found (documents of `session`, `evaluate`, `reproduce` and `records`), out comes
//! text. Nothing is computed here that a reader would have to trust. Start with `alignment`, the page of
//! `pigtail align`; `figure` draws, `html` is what all pages have in common.
//! [`text`] says the same to a terminal.
//!
//! ```
//! use pigtail_control::station::Unobserved;
//! use pigtail_session::{Setup, characterize::Step};
//!
//! let setup = Setup::load("afpm", "y-branch")?;
//! let job = Step { at: "left.z".parse()?, size: 1300 };
//! let (document, trace) = setup.run(&job, 7, &mut Unobserved)?;
//! let page = pigtail_report::step(&document, &trace)?;
//! assert!(page.starts_with("<!"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod accounts;
mod alignment;
mod axis;
mod benchmark;
mod campaign;
mod commission;
mod compare;
mod contour;
mod figure;
mod histogram;
mod html;
mod hysteresis;
mod impulse;
mod loops;
mod maximize;
mod micro;
mod plan;
mod plot;
mod produce;
mod pulses;
mod record;
mod scale;
mod scan;
mod shapes;
mod sureness;
pub mod text;
mod thesis;
mod trays;
mod tuning;
mod windup;

pub use alignment::{alignment, bench_alignment};
pub use axis::{frequency, margins, resolution, sine, step};
pub use benchmark::{benchmark, table as benchmark_table};
pub use campaign::{campaign, percent};
pub use commission::commission;
pub use compare::{compare, compared};
pub use contour::contour;
pub use hysteresis::{inverted, tried};
pub use impulse::response;
pub use loops::loops;
pub use maximize::{maximize, tables as maximize_tables};
pub use micro::micros;
pub use plan::plan;
pub use produce::{produce, tray_plan};
pub use pulses::{pulse_campaign, pulses};
pub use record::record;
pub use scan::{notes as scan_notes, scan};
pub use shapes::shapes;
pub use thesis::thesis;
pub use trays::trays;
pub use tuning::tuning;
pub use windup::windup;

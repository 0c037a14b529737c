//! The page a person wants to look at: one self-contained HTML file.

mod alignment;
mod axis;
mod benchmark;
mod campaign;
mod contour;
mod figure;
mod histogram;
mod html;
mod hysteresis;
mod impulse;
mod loops;
mod maximize;
mod micro;
mod pulses;
mod record;
mod scan;
mod thesis;
mod tuning;
mod windup;

pub use alignment::alignment;
pub use axis::{frequency, resolution, sine, step};
pub use benchmark::{benchmark, table as benchmark_table};
pub use campaign::campaign;
pub(crate) use campaign::percent;
pub use contour::contour;
pub use hysteresis::{inverted, tried};
pub use impulse::response;
pub use loops::loops;
pub use maximize::{maximize, tables as maximize_tables};
pub use micro::micro;
pub use pulses::{pulse_campaign, pulses};
pub use record::record;
pub use scan::{notes as scan_notes, scan};
pub use thesis::thesis;
pub use tuning::tuning;
pub use windup::windup;

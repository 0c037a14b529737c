//! The page a person wants to look at: one self-contained HTML file.

mod alignment;
mod axis;
mod campaign;
mod contour;
mod figure;
mod histogram;
mod html;
mod hysteresis;
mod loops;
mod maximize;
mod micro;
mod record;
mod scan;
mod tuning;
mod windup;

pub use alignment::alignment;
pub use axis::{frequency, resolution, sine, step};
pub use campaign::campaign;
pub(crate) use campaign::percent;
pub use contour::contour;
pub use hysteresis::{inverted, tried};
pub use loops::loops;
pub use maximize::{maximize, tables as maximize_tables};
pub use micro::micro;
pub use record::record;
pub use scan::{notes as scan_notes, scan};
pub use tuning::tuning;
pub use windup::windup;

//! The page a person wants to look at: one self-contained HTML file.

mod alignment;
mod axis;
mod contour;
mod figure;
mod html;
mod hysteresis;
mod loops;
mod micro;
mod tuning;
mod windup;

pub use alignment::alignment;
pub use axis::{frequency, resolution, sine, step};
pub use contour::contour;
pub use hysteresis::{inverted, tried};
pub use loops::loops;
pub use micro::micro;
pub use tuning::tuning;
pub use windup::windup;

//! The page a person wants to look at: one self-contained HTML file.

mod alignment;
mod axis;
mod figure;
mod html;
mod hysteresis;
mod micro;
mod tuning;
mod windup;

pub use alignment::alignment;
pub use axis::{frequency, resolution, sine, step};
pub use hysteresis::{inverted, tried};
pub use micro::micro;
pub use tuning::tuning;
pub use windup::windup;

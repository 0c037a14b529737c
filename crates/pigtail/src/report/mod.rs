//! The page a person wants to look at: one self-contained HTML file.

mod alignment;
mod figure;
mod html;
mod tuning;

pub use alignment::alignment;
pub use tuning::tuning;

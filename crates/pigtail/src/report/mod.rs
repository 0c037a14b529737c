//! The page a person wants to look at: one self-contained HTML file.

mod alignment;
mod figure;
mod html;

pub use alignment::alignment;

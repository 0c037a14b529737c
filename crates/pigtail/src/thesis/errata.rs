//! Where the thesis slips.

use crate::rig::Setup;

/// A slip.
#[derive(Debug, Clone, PartialEq)]
pub struct Erratum {
    /// Where.
    pub section: &'static str,
    /// What is printed.
    pub printed: &'static str,
    /// What it should be, and why.
    pub argument: String,
}

/// All of them.
pub fn all(_: &Setup) -> Vec<Erratum> {
    Vec::new()
}

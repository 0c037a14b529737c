//! Control software and a digital twin for automated fiber pigtailing.
//!
//! This crate is the program. It is the only place where belief (`pigtail-control`) and truth
//! (`pigtail-machines`) meet and may be compared.

pub mod rig;

//! Control software and a digital twin for automated fiber pigtailing.
//!
//! This crate is the program. It is the only place where belief (`pigtail-control`) and truth
//! (`pigtail-machines`) meet and may be compared.
//!
//! - [`rig`]: what is loaded before anything moves;
//! - [`procedure`]: the ways to align a device;
//! - [`align`]: one device aligned on a twin, and what came of it;
//! - [`methods`]: first light alone, by the thesis's three methods; [`plan`]: all ways to align,
//!   side by side;
//! - [`benchmark`]: alignment algorithms, one's own too, on the same devices;
//! - [`maximize`]: staying at the peak, measured;
//! - [`scan`]: search and peak on a measured power map;
//! - [`campaign`]: many of them, and what they have in common;
//! - [`record`]: what was seen on the way;
//! - [`report`]: the page a person wants to look at;
//! - [`runs`]: the folder all of that goes to; [`ledger`]: the store of all runs;
//! - [`simulate`]: one joint alone; [`tune`]: one axis's gains;
//!   [`characterize`]: what one axis can do; [`identify`]: its windup; [`hysteresis`]: the piezos';
//!   [`records`]: an axis from a record that a person brings;
//! - [`thesis`]: all of the thesis's experiments, beside what it prints;
//! - [`cli`]: the commands.

pub mod align;
pub mod benchmark;
pub mod campaign;
pub mod characterize;
pub mod cli;
pub mod contour;
pub mod faults;
pub mod guarded;
pub mod hysteresis;
pub mod identify;
pub mod impulse;
pub mod ledger;
pub mod loops;
pub mod maximize;
pub mod methods;
pub mod plan;
pub mod procedure;
pub mod record;
pub mod records;
pub mod replay;
pub mod report;
pub mod rig;
pub mod runs;
pub mod scan;
pub mod scenario;
pub mod simulate;
pub mod thesis;
pub mod tune;

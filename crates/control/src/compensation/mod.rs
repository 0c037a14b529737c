//! What stands between the wanted motion and the servo: models of what the mechanics do with it.

pub mod hysteresis;
pub mod micro;
pub mod online;

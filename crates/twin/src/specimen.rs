//! Which of all machines and devices a twin is.

/// Which machine, and which device on it.
///
/// A seed names both: the seed of the machine, and the number of the device in its trillions.
///
/// ```
/// # use pigtail_twin::Specimen;
/// let fourth = Specimen::of(7, 3);
/// assert_eq!(fourth.seed(), 3_000_000_000_007);
/// assert_eq!(fourth.machine(), Specimen::from(7).machine());
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Specimen(u64);

/// The first seed that is no machine's.
const MACHINES: u64 = 1_000_000_000_000;

impl Specimen {
    /// A device, counted from zero, on the machine of a seed.
    pub fn of(machine: u64, device: u64) -> Self {
        Self(machine.wrapping_add(device.wrapping_mul(MACHINES)))
    }

    /// The seed that names both.
    pub fn seed(self) -> u64 {
        self.0
    }

    /// The seed of the machine: mechanics, their places, the sensing fiber.
    pub fn machine(self) -> u64 {
        self.0 % MACHINES
    }

    /// Which device on the machine, from zero.
    pub fn device(self) -> u64 {
        self.0 / MACHINES
    }
}

impl From<u64> for Specimen {
    fn from(seed: u64) -> Self {
        Self(seed)
    }
}

//! Where the light goes: from the input fiber through the Y-branch to the photodiodes.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use super::plant::{Device, Fiber, Light, Plant, Scatter};
use super::{FiberTruth, Fixed};
use pigtail_hal::spec::{CHANNELS, Channel, OUTPUTS, Side};
use pigtail_model::Invalid;
use pigtail_model::exponential::exp;
use pigtail_model::frames::{Chip, Displacement, Point};
use pigtail_model::optics::{
    Coupler, GaussianMode, Misalignment, core_capture, disc_below_edge, exit_angle,
};
use pigtail_numerics::golden::least;
use rand::RngExt;
use std::f64::consts::PI;

/// Less light than this is none, volts: less than two millionths of a step of a converter of 24 bits over 10 V.
const NO_LIGHT: f64 = 1e-12;

/// A fiber as it sits in its holder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FiberInHolder {
    /// From where the holder believes its tip to be to where it is, chip frame, metres.
    pub(super) offset: [f64; 3],
    /// Tilt from the direction of the refracted beam in x and y, radians.
    pub(super) tilt: [f64; 2],
    /// Roll about its own axis, of its slow axis from the guides' polarization, radians.
    pub(super) roll: f64,
}

impl FiberInHolder {
    pub(super) fn draw(plant: &Plant, rng: &mut impl RngExt) -> Self {
        let m = &plant.misplacement;
        Self {
            offset: [
                m.offset(rng, m.fiber_x),
                m.offset(rng, m.y),
                m.offset(rng, m.fiber_z),
            ],
            // A fiber does not turn with the chip.
            tilt: [
                m.offset(rng, m.tilt) - plant.device.turn,
                m.offset(rng, m.tilt),
            ],
            roll: if m.roll > 0.0 {
                m.offset(rng, m.roll)
            } else {
                0.0
            },
        }
    }
}

/// A port of the device: an end of a waveguide at a facet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Port {
    pub(super) position: Point<Chip>,
    /// -1 where the outward normal of the facet is -z, the input; +1 at the outputs.
    outward: f64,
    /// How far the facet stands out for a metre in x.
    slope: f64,
    sin_exit: f64,
    cos_exit: f64,
}

impl Port {
    /// Clearance between the facet's inclined plane and a tip, metres; negative inside the chip.
    /// A tip is a point here: the fiber's own diameter is not modelled.
    pub(super) fn clearance(&self, tip: Point<Chip>) -> f64 {
        self.gap(tip) - (tip.x - self.position.x) * self.slope
    }

    /// Gap between the port and a tip along z, metres.
    pub(super) fn gap(&self, tip: Point<Chip>) -> f64 {
        self.outward * (tip.z - self.position.z)
    }

    /// How a fiber at `tip` sits in the beam that leaves this port.
    fn misalignment(&self, tip: Point<Chip>, tilt: [f64; 2]) -> Misalignment {
        let (dx, dy) = (tip.x - self.position.x, tip.y - self.position.y);
        let gap = self.gap(tip);
        Misalignment {
            x: dx * self.cos_exit - gap * self.sin_exit,
            y: dy,
            z: gap * self.cos_exit + dx * self.sin_exit,
            tilt_x: tilt[0],
            tilt_y: tilt[1],
        }
    }
}

/// The device, the light in it and the fluctuation of what is scattered.
#[derive(Debug, Clone)]
pub(super) struct LightPath {
    coupler: Coupler,
    input: Port,
    outputs: [Port; OUTPUTS],
    /// Transmission of each branch, relative to a lossless half.
    branch: [f64; OUTPUTS],
    full: f64,
    fiber_radius: f64,
    core_radius: f64,
    scatter_level: f64,
    /// What of it falls into a sensing fiber's core and into a fiber's mode, for whole in the core that it is stated for.
    scattered: [f64; 2],
    scatter_spread: f64,
    /// Share of the side lobe and how far up it stands, metres.
    side_lobe: (f64, f64),
    /// Interference in the gap: the darkest, relative to the brightest, and 4 pi / wavelength.
    ripple: (f64, f64),
}

/// What the optics need to know of the mechanics.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tips {
    /// Coupling of the input fiber, 0 to 1.
    pub(super) input: f64,
    /// Coupling and tip of each output fiber; `None` where none is loaded or attached.
    pub(super) outputs: [Option<(f64, Point<Chip>)>; OUTPUTS],
    /// Tip of the sensing fiber.
    pub(super) sensing: Point<Chip>,
}

/// What light passes through.
pub(super) struct Optics<'p> {
    pub(super) device: &'p Device,
    pub(super) fiber: &'p Fiber,
    pub(super) light: &'p Light,
    pub(super) scatter: &'p Scatter,
    /// Greatest excess loss of a branch.
    pub(super) loss: f64,
    /// Diameter of the sensing fiber's core, metres.
    pub(super) core: f64,
}

impl LightPath {
    pub(super) fn new(optics: &Optics, rng: &mut impl RngExt) -> Result<Self, Invalid> {
        let Optics {
            device,
            light,
            scatter,
            ..
        } = *optics;
        let (sin_exit, cos_exit) =
            exit_angle(device.facet, device.index, light.gap_index).sin_cos();
        let port = |[x, y, z]: [f64; 3], outward: f64| Port {
            position: Point::new(x, y, z),
            outward,
            slope: device.facet.tan(),
            sin_exit,
            cos_exit,
        };
        let [radius_x, radius_y] = device.mode_radius;
        let fiber = optics.fiber.mode_radius;
        Ok(Self {
            coupler: Coupler::new(
                GaussianMode { radius_x, radius_y },
                GaussianMode {
                    radius_x: fiber,
                    radius_y: fiber,
                },
                light.wavelength / light.gap_index,
            )?,
            input: port(device.input, -1.0),
            outputs: device.outputs.map(|p| port(p, 1.0)),
            branch: device
                .transmission
                .map(|share| share * (1.0 - optics.loss * rng.random::<f64>())),
            full: light.full,
            fiber_radius: fiber,
            core_radius: 0.5 * optics.core,
            scatter_level: scatter.level,
            // What falls into a core grows with its area; a mode takes in what falls into its own.
            scattered: [0.5 * optics.core, fiber]
                .map(|radius| (radius / (0.5 * scatter.core)).powi(2)),
            scatter_spread: scatter.spread,
            side_lobe: (device.side_lobe, device.side_lobe_at),
            ripple: (
                10_f64.powf(-0.1 * device.ripple_db),
                4.0 * PI * light.gap_index / light.wavelength,
            ),
        })
    }

    /// The port that the fiber `index` of a side belongs to.
    pub(super) fn port(&self, side: Side, index: usize) -> &Port {
        match side {
            Side::Left => &self.input,
            Side::Right => &self.outputs[index],
        }
    }

    /// Power coupled between a port and a fiber at `tip`, 0 to 1. The same into the chip and out of it, but
    /// for a fiber's roll: the guides carry one polarization alone, so that of the input's light they take the
    /// part along it, while an output fiber takes all of it, in both of its axes, and its photodiode with it.
    #[inline(always)]
    pub(super) fn coupling(&self, port: &Port, tip: Point<Chip>, fiber: &FiberInHolder) -> f64 {
        let polarized = if port.outward < 0.0 && fiber.roll != 0.0 {
            fiber.roll.cos().powi(2)
        } else {
            1.0
        };
        polarized * self.coupled(port, tip, fiber.tilt)
    }

    /// The same of a fiber that has not rolled.
    #[inline(always)]
    fn coupled(&self, port: &Port, tip: Point<Chip>, tilt: [f64; 2]) -> f64 {
        let at = port.misalignment(tip, tilt);
        let mut coupling = self.coupler.efficiency(&at);
        let (share, up) = self.side_lobe;
        if share > 0.0 {
            let y = at.y - up;
            coupling += share * self.coupler.efficiency(&Misalignment { y, ..at });
        }
        let (darkest, wave) = self.ripple;
        if darkest < 1.0 {
            // Facet and fiber's end reflect: bright and dark in turns of half a wavelength.
            let turn = 0.5 + 0.5 * (wave * port.gap(tip)).cos();
            coupling *= darkest + (1.0 - darkest) * turn;
        }
        coupling
    }

    /// Photodiode signals, volts, for a relative level of scattered light (1 on average).
    #[inline(always)]
    pub(super) fn signals(&self, tips: &Tips, fluctuation: f64) -> [f64; CHANNELS] {
        let mut volts = [0.0; CHANNELS];
        let missed = self.full * self.scatter_level * (1.0 - tips.input) * fluctuation;
        let [in_core, in_mode] = self.scattered;
        for (k, output) in tips.outputs.iter().enumerate() {
            if let Some((coupling, tip)) = output {
                let guided = self.full * self.branch[k] * tips.input * coupling;
                let scattered = missed * in_mode * self.substrate(*tip, self.fiber_radius);
                volts[Channel::of_output(k).index()] += guided + scattered;
            }
        }
        let mut sensing = missed * in_core * self.substrate(tips.sensing, self.core_radius);
        for (port, branch) in self.outputs.iter().zip(self.branch) {
            let guided = self.full * branch * tips.input;
            if guided < NO_LIGHT {
                continue;
            }
            // The beam leaves at an angle and spreads.
            let gap = port.gap(tips.sensing).max(0.0);
            let x = port.position.x + gap * port.sin_exit / port.cos_exit;
            let beside = Displacement::new(tips.sensing.x - x, tips.sensing.y - port.position.y);
            let offset = beside.norm();
            let beam = self.coupler.beam_radius(gap);
            if offset < self.core_radius + 3.0 * beam {
                sensing += guided * core_capture(offset, self.core_radius, beam);
            }
        }
        volts[Channel::Sensing.index()] += sensing;
        volts
    }

    /// Relative level of the light in the substrate over a disc: none above the chip's top, a
    /// broad hill around the outputs below it (thesis, Fig. 3.4).
    #[inline(always)]
    fn substrate(&self, tip: Point<Chip>, radius: f64) -> f64 {
        let middle = &self.outputs[0].position;
        let x = (tip.x - 0.5 * (middle.x + self.outputs[1].position.x)) / self.scatter_spread;
        let y = (tip.y - middle.y) / self.scatter_spread;
        let hill = x * x + y * y;
        if hill > 30.0 {
            return 0.0;
        }
        let below = disc_below_edge(tip.y - middle.y, radius);
        if below == 0.0 {
            return 0.0;
        }
        exp(-hill) * below
    }

    /// Where a fiber that is fixed really is.
    pub(super) fn truth(&self, side: Side, port: usize, fixed: &Fixed) -> FiberTruth {
        let at = self.port(side, port);
        let peak = self.peak(at, fixed.tip, fixed.fiber.tilt);
        let best = Point::new(peak.x, peak.y, fixed.tip.z);
        FiberTruth {
            x: fixed.tip.x - peak.x,
            y: fixed.tip.y - peak.y,
            gap: at.gap(fixed.tip),
            coupling: fixed.coupling,
            best: self.coupling(at, best, &fixed.fiber),
            roll: fixed.fiber.roll,
        }
    }

    /// The lateral position at which the coupling to `port` peaks for a fiber of this tilt at the
    /// gap of `tip`, chip frame.
    fn peak(&self, port: &Port, tip: Point<Chip>, tilt: [f64; 2]) -> Displacement {
        /// How far the peak may be from where the port's ray is, metres.
        const REACH: f64 = 10e-6;
        /// Far below where rounding hides which of two places is the brighter, metres.
        const ACCURATE: f64 = 1e-15;
        let exit = port.sin_exit / port.cos_exit;
        let (mut x, mut y) = (port.position.x + exit * port.gap(tip), port.position.y);
        let around = |at: f64| (at - REACH, at + REACH);
        let lost = |x: f64, y: f64| -self.coupled(port, Point::new(x, y, tip.z), tilt);
        // The two directions are separable but for the small rotation of the beam's frame.
        for _ in 0..3 {
            x = least(around(x), ACCURATE, |x| lost(x, y));
            y = least(around(y), ACCURATE, |y| lost(x, y));
        }
        Displacement::new(x, y)
    }
}

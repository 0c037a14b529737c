//! From a wanted position to encoder counts and piezo volts, and back, as control believes.

#![expect(
    clippy::inline_always,
    reason = "what is not inlined does not get the instructions of its caller"
)]

use crate::calibration::{Calibration, FiveBarGeometry, PlacementBelief};
use crate::compensation::hysteresis::Range;
use pigtail_hal::quantity::{Counts, Volts};
use pigtail_hal::spec::{AXES, MICRO_AXES};
use pigtail_hal::{Axis, Side, Spec};
use pigtail_model::fivebar::{FiveBar, JointAngle, Turning, Unreachable};
use pigtail_model::frames::{Chip, Displacement, Macro, Placement, Point};
use pigtail_model::leadscrew::LeadScrew;

/// The believed kinematics of one manipulator.
#[derive(Debug, Clone, PartialEq)]
pub struct Kinematics {
    five_bar: FiveBar,
    home: [f64; 2],
    home_angles: [JointAngle; 2],
    screw: LeadScrew,
    /// Encoder counts for one radian of an output.
    counts_per_radian: [f64; AXES],
    /// Motor turns for one turn of an output.
    gear_ratios: [f64; AXES],
    /// Highest speed of each motor, rad/s.
    motor_speeds: [f64; AXES],
    placement: Placement,
    half_workspace: f64,
    half_travel: f64,
    micro: MicroKinematics,
}

/// The believed kinematics of a micro manipulator.
#[derive(Debug, Clone, Copy, PartialEq)]
struct MicroKinematics {
    sin: f64,
    cos: f64,
    volts_per_metre: f64,
    centre: f64,
    half_range: f64,
    /// How far each piezo goes, metres. Farther out a command changes nothing, and whoever looks at the
    /// light then takes that for a peak.
    ranges: [Range; MICRO_AXES],
}

fn five_bar_of(geometry: &FiveBarGeometry) -> Result<FiveBar, String> {
    FiveBar::new(geometry.base, geometry.proximal, geometry.distal)
        .map_err(|invalid| invalid.to_string())
}

/// Checks that a five-bar of this geometry reaches the whole workspace of the datasheet.
pub(crate) fn check_workspace(geometry: &FiveBarGeometry, spec: &Spec) -> Result<(), String> {
    const STEPS: i32 = 10;
    let five_bar = five_bar_of(geometry)?;
    let half = 0.5 * spec.five_bar.workspace;
    for ix in -STEPS..=STEPS {
        for iy in -STEPS..=STEPS {
            let (dx, dy) = (
                half * f64::from(ix) / f64::from(STEPS),
                half * f64::from(iy) / f64::from(STEPS),
            );
            five_bar.inverse(geometry.home[0] + dx, geometry.home[1] + dy).map_err(|why| {
                format!(
                    "{:.2} mm, {:.2} mm from home: {why}; accepted are links that reach the whole \
                     workspace of {} mm",
                    dx * 1e3,
                    dy * 1e3,
                    spec.five_bar.workspace * 1e3
                )
            })?;
        }
    }
    Ok(())
}

impl Kinematics {
    /// The kinematics of a manipulator. The calibration has been checked against the datasheet
    /// while it was parsed.
    ///
    /// # Panics
    ///
    /// When home cannot be reached, which [`Calibration::parse`] excludes.
    pub fn new(spec: &Spec, calibration: &Calibration, side: Side) -> Self {
        let geometry = &calibration.geometry;
        let five_bar =
            five_bar_of(&geometry.five_bar).expect("links were checked by Calibration::parse");
        let home = geometry.five_bar.home;
        let home_angles = five_bar
            .inverse(home[0], home[1])
            .expect("home was checked by Calibration::parse");
        let PlacementBelief {
            home: [x, y, z],
            yaw,
            ..
        } = geometry.of(side).clone();
        let (sin, cos) = spec.micro.angle.sin_cos();
        let half_range = 0.5 * spec.micro.range;
        let printed = Range {
            low: -half_range,
            high: half_range,
        };
        let ranges = match calibration.hysteresis.of(side) {
            Some(model) => model.ranges(spec).map(|range| Range {
                low: range.low.max(printed.low),
                high: range.high.min(printed.high),
            }),
            None => [printed; MICRO_AXES],
        };
        Self {
            five_bar,
            home,
            home_angles,
            screw: LeadScrew::from_lead(geometry.z.lead),
            counts_per_radian: Axis::ALL.map(|axis| {
                let drive = spec.drive(axis);
                drive.gear_ratio / drive.count()
            }),
            gear_ratios: Axis::ALL.map(|axis| spec.drive(axis).gear_ratio),
            motor_speeds: Axis::ALL.map(|axis| spec.drive(axis).speed),
            placement: Placement::new(Point::new(x, y, z), yaw),
            half_workspace: 0.5 * spec.five_bar.workspace,
            half_travel: 0.5 * spec.z_stage.travel,
            micro: MicroKinematics {
                sin,
                cos,
                volts_per_metre: 1.0 / geometry.micro.gain,
                centre: 0.5 * spec.micro.voltage,
                half_range,
                ranges,
            },
        }
    }

    /// How far the workspace, a box around home, reaches to either side in x, y and z, metres.
    pub fn workspace(&self) -> [f64; 3] {
        [self.half_workspace, self.half_workspace, self.half_travel]
    }

    /// Whether a point lies inside the workspace.
    pub fn contains(&self, p: Point<Macro>) -> bool {
        let reaches = self.workspace();
        [p.x, p.y, p.z]
            .iter()
            .zip(reaches)
            .all(|(at, reach)| at.abs() <= reach)
    }

    /// Highest speed of each motor by the datasheet, rad/s.
    pub fn motor_speeds(&self) -> [f64; AXES] {
        self.motor_speeds
    }

    /// Motor angles from home that put the endpoint at `p`, radians.
    ///
    /// # Errors
    ///
    /// When the five-bar does not reach it.
    pub fn motor_angles_at(&self, p: Point<Macro>) -> Result<[f64; AXES], Unreachable> {
        let outputs = self.outputs_at(p)?;
        Ok(std::array::from_fn(|i| self.gear_ratios[i] * outputs[i]))
    }

    /// Bound of each motor's speed, rad/s, while the endpoint stays between the corners `low` and
    /// `high` and is no faster than `across` in the x-y plane and `along` z, m/s.
    pub fn most_motor_speeds(
        &self,
        [low, high]: [Point<Macro>; 2],
        across: f64,
        along: f64,
    ) -> [f64; AXES] {
        let home = Displacement::new(self.home[0], self.home[1]);
        let [a, b] = self
            .five_bar
            .most_rate(home + low.across(), home + high.across());
        let outputs = [a * across, b * across, self.screw.angle(along)];
        std::array::from_fn(|i| self.gear_ratios[i] * outputs[i])
    }

    /// Output angles from home that put the endpoint at `p`, radians.
    ///
    /// # Errors
    ///
    /// When the five-bar does not reach it.
    pub fn outputs_at(&self, p: Point<Macro>) -> Result<[f64; AXES], Unreachable> {
        let [a, b] = self
            .five_bar
            .inverse(self.home[0] + p.x, self.home[1] + p.y)?;
        Ok(self.less_home([a, b], p))
    }

    /// The same of points that move little from one call to the next.
    #[inline(always)]
    pub(crate) fn outputs_from(
        &self,
        turning: &mut [Turning; 2],
        p: Point<Macro>,
    ) -> Result<[f64; AXES], Unreachable> {
        let (x, y) = (self.home[0] + p.x, self.home[1] + p.y);
        let angles = self.five_bar.inverse_from(turning, x, y)?;
        Ok(self.less_home(angles, p))
    }

    #[inline(always)]
    fn less_home(&self, [a, b]: [JointAngle; 2], p: Point<Macro>) -> [f64; AXES] {
        let [home_a, home_b] = self.home_angles;
        [a.0 - home_a.0, b.0 - home_b.0, self.screw.angle(p.z)]
    }

    /// Where the endpoint is with these output angles from home, radians.
    ///
    /// # Errors
    ///
    /// When no assembled mechanism has these angles.
    pub fn endpoint_at(&self, [a, b, z]: [f64; AXES]) -> Result<Point<Macro>, Unreachable> {
        let [home_a, home_b] = self.home_angles;
        let (x, y) = self
            .five_bar
            .forward([JointAngle(home_a.0 + a), JointAngle(home_b.0 + b)])?;
        Ok(Point::new(
            x - self.home[0],
            y - self.home[1],
            self.screw.position(z),
        ))
    }

    /// The same of angles that change little from one call to the next.
    ///
    /// # Errors
    ///
    /// When no assembled mechanism has these angles.
    #[inline(always)]
    pub(crate) fn endpoint_from(
        &self,
        turning: &mut [Turning; 2],
        [a, b, z]: [f64; AXES],
    ) -> Result<Point<Macro>, Unreachable> {
        let [home_a, home_b] = self.home_angles;
        let angles = [JointAngle(home_a.0 + a), JointAngle(home_b.0 + b)];
        let (x, y) = self.five_bar.forward_from(turning, angles)?;
        Ok(Point::new(
            x - self.home[0],
            y - self.home[1],
            self.screw.position(z),
        ))
    }

    /// Where the endpoint is with these output angles of the five-bar from home (radians) and the
    /// z-stage at `z` metres.
    ///
    /// # Errors
    ///
    /// When no assembled mechanism has these angles.
    pub fn endpoint_from_probes(
        &self,
        [a, b]: [f64; 2],
        z: f64,
    ) -> Result<Point<Macro>, Unreachable> {
        self.endpoint_at([a, b, self.screw.angle(z)])
    }

    /// Angle of the screw for a position of the z-stage, metres from home: radians.
    pub fn screw_angle(&self, z: f64) -> f64 {
        self.screw.angle(z)
    }

    /// Encoder counts of an axis whose transmission has this input angle, radians of the output.
    #[inline(always)]
    pub fn counts(&self, axis: usize, input: f64) -> Counts {
        // The method `round` is a call into the C library on most targets.
        let counts = input * self.counts_per_radian[axis];
        Counts((counts + 0.5_f64.copysign(counts)) as i64)
    }

    /// Input angle of an axis's transmission at these encoder counts, radians of the output.
    #[inline(always)]
    pub fn input(&self, axis: usize, counts: Counts) -> f64 {
        counts.0 as f64 / self.counts_per_radian[axis]
    }

    /// Angles of the outputs from home at these encoder counts, less what the transmissions hold back (2.23), radians.
    #[inline(always)]
    pub(crate) fn outputs_of(
        &self,
        encoders: &[Counts; AXES],
        windup: &[f64; AXES],
    ) -> [f64; AXES] {
        std::array::from_fn(|i| self.input(i, encoders[i]) - windup[i])
    }

    /// How its frame lies in that of the chip.
    pub fn placement(&self) -> Placement {
        self.placement
    }

    /// The endpoint's position in the chip's frame.
    pub fn chip_from_macro(&self, p: Point<Macro>) -> Point<Chip> {
        self.placement.chip_from_macro(p)
    }

    /// A position of the chip's frame in this manipulator's.
    pub fn macro_from_chip(&self, p: Point<Chip>) -> Point<Macro> {
        self.placement.macro_from_chip(p)
    }

    /// How far each piezo has to go, metres, to displace the tip so far in the manipulator's frame.
    pub fn along_piezos(&self, by: Displacement) -> [f64; MICRO_AXES] {
        let along = by.turned(-self.micro.sin, self.micro.cos);
        [along.x, along.y]
    }

    /// Inputs of piezos that are to go so far, metres, held within the range.
    pub fn piezo_volts(&self, along: [f64; MICRO_AXES]) -> [Volts; MICRO_AXES] {
        let m = &self.micro;
        along.map(|d| Volts(m.centre + d.clamp(-m.half_range, m.half_range) * m.volts_per_metre))
    }

    /// Piezo inputs that displace the tip so far in the manipulator's frame, held within the range.
    pub fn micro_volts(&self, by: Displacement) -> [Volts; MICRO_AXES] {
        self.piezo_volts(self.along_piezos(by))
    }

    /// Whether piezos can go so far, metres, as far as is known of them.
    pub fn piezos_reach(&self, along: [f64; MICRO_AXES]) -> bool {
        let ranges = self.micro.ranges.iter();
        ranges
            .zip(along)
            .all(|(range, d)| d >= range.low && d <= range.high)
    }

    /// The least box around what the micro reaches in the manipulator's x and y, metres.
    pub fn micro_box(&self) -> [(f64, f64); 2] {
        let m = &self.micro;
        let corners = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(i, j)| {
            let end = |range: &Range, i: usize| [range.low, range.high][i];
            let along = Displacement::new(end(&m.ranges[0], i), end(&m.ranges[1], j));
            let at = along.turned(m.sin, m.cos);
            [at.x, at.y]
        });
        std::array::from_fn(|i| {
            let of = corners.map(|corner| corner[i]);
            let low = of.into_iter().fold(f64::INFINITY, f64::min);
            (low, of.into_iter().fold(f64::NEG_INFINITY, f64::max))
        })
    }

    /// How far the micro reaches to either side along x alone by the datasheet, metres.
    pub fn micro_range_x(&self) -> f64 {
        self.micro.half_range / self.micro.cos.abs().max(self.micro.sin.abs())
    }
}

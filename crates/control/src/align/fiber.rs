//! A fiber in the arm of a bench, from the tray to the chip.

use super::climb::{begin, circles, range};
use super::{Dark, Taught};
use crate::beam::{Beam, Peak};
use crate::belief::{Across, Place};
use crate::conical_scan::{Closing, ConicalScan, Gap, Ready};
use crate::job::Job;
use crate::last_turns::{AtChip, Expected, Rest, last_turns};
use crate::outcome::{Halt, Outcome};
use crate::reactor::{LONGEST, Reactor};
use crate::recipe::Recipe;
use crate::still_there::LightCheck;
use crate::tuning::TUNING;
use pigtail_hal::bench::{
    AxisCaps, Degree, Dither, Glide, Group, Law, Meter, Pose, Request, Stage,
};
use pigtail_model::frames::Displacement;

/// A fiber on its way.
pub(super) struct Fiber<'d> {
    recipe: &'d Recipe,
    taught: &'d Taught,
    pub(super) meter: Meter,
    coarse: Group,
    fine: Group,
    beam: Beam,
    /// Gap of the search, metres.
    back: f64,
    /// How far the coarse group stands aside of what was taught, metres.
    aside: Displacement,
    /// Gap that was asked for last, metres.
    gap: f64,
    scan: ConicalScan<'d>,
    /// Light at the peak at no gap when the approach began, volts, and the gap at which it was seen, metres.
    before: (f64, f64),
}

impl<'d> Fiber<'d> {
    pub(super) fn new(
        bench: &Reactor<'_>,
        recipe: &'d Recipe,
        taught: &'d Taught,
        meter: Meter,
    ) -> Result<Self, Outcome> {
        let caps = bench.caps();
        let group = |stage| caps.group(taught.arm, stage).ok_or(Outcome::NotTaught);
        let (coarse, fine) = (group(Stage::Coarse)?, group(Stage::Fine)?);
        let beam = Beam::new(&recipe.mode, recipe.ports.exit_angle);
        let gap = TUNING.taught.clear;
        let scan = begin(bench, (fine, meter), beam, recipe, &Dark::default(), gap);
        Ok(Self {
            recipe,
            taught,
            meter,
            coarse,
            fine,
            beam,
            back: taught.search_gap(recipe),
            aside: Displacement::ZERO,
            gap,
            scan,
            before: (0.0, 0.0),
        })
    }

    /// Standard deviation of where its peak is, metres.
    pub(super) fn across(&self) -> f64 {
        self.taught.across
    }

    /// The arm that carries it.
    pub(super) fn arm(&self) -> usize {
        self.taught.arm
    }

    /// How far the light goes across, in x of the arm, for each metre of gap.
    pub(super) fn walk(&self) -> f64 {
        let at = |gap| self.taught.at_gap(self.recipe, gap, [0.0; 2]).x();
        at(1.0) - at(0.0)
    }

    /// Pose of the coarse group on the beam at a gap.
    fn at_gap(&self, gap: f64) -> Pose {
        let Displacement { x, y } = self.aside;
        self.taught.at_gap(self.recipe, gap, [x, y])
    }

    /// The gap by the coarse group's own measure, metres.
    pub(super) fn measured_gap(&self, bench: &Reactor<'_>) -> f64 {
        measured_gap(bench, self.coarse, self.taught, self.gap)
    }

    /// How far off the gap may be: its bound, or three standard deviations of it, metres.
    pub(super) fn unsure_of_gap(&self) -> f64 {
        self.taught.bound_z.max(3.0 * self.taught.sigma_z)
    }

    /// How far below its place a fiber is before it comes there, so that whatever gives way does so in one direction, metres.
    pub(super) fn run_up(&self, bench: &Reactor<'_>) -> f64 {
        let axes = bench.caps().groups[self.coarse.0].axes;
        let backlash = axes.iter().flatten().map(|axis| axis.backlash);
        TUNING
            .lines
            .least_run
            .max(TUNING.lines.run * backlash.fold(0.0, f64::max))
    }

    fn led(&self) -> Gap {
        Gap::Led {
            by: self.coarse,
            contact: self.taught.pose.z(),
        }
    }

    /// Away from the chip, then a new fiber.
    pub(super) async fn load(&mut self, bench: &Reactor<'_>) -> Result<(), Halt> {
        self.go_back(bench).await?;
        let Taught { arm, port, .. } = *self.taught;
        bench.ask(Request::Load { arm, port }, LONGEST).await
    }

    /// Away from the chip, straight back along z first.
    pub(super) async fn go_back(&self, bench: &Reactor<'_>) -> Result<(), Halt> {
        let here = bench.pose(self.coarse, bench.now());
        let here = here.map_or(self.at_gap(TUNING.taught.clear), |at| at.pose);
        let clear = (self.taught.pose.z() - TUNING.taught.clear).min(here.z());
        bench
            .line(self.coarse, here.with(Degree::Z, clear), None)
            .await
    }

    /// Some fibers together to where the search begins: from below, along the beam.
    pub(super) async fn come_near<const N: usize>(
        bench: &Reactor<'_>,
        fibers: [&mut Self; N],
    ) -> Result<(), Halt> {
        for behind in [true, false] {
            let mut tickets = Vec::with_capacity(N);
            for fiber in &fibers {
                let to = if behind {
                    fiber.at_gap(2.0 * fiber.back) + Pose::at(0.0, -fiber.run_up(bench), 0.0)
                } else {
                    fiber.at_gap(fiber.back)
                };
                tickets.push(bench.send_to(fiber.coarse, to, None)?);
            }
            bench.done(tickets, LONGEST).await?;
        }
        for fiber in fibers {
            fiber.gap = fiber.back;
        }
        Ok(())
    }

    /// Places to look at around where it was taught, from the middle out, as far as so many standard deviations, so many
    /// widths apart.
    pub(super) fn places(&self, pitch: f64, far: f64) -> Vec<Displacement> {
        let step = pitch * self.beam.width(self.back);
        let far = far * self.taught.across;
        let n = (far / step).ceil() as i32;
        let grid = (-n..=n).flat_map(|j| (-n..=n).map(move |i| (f64::from(i), f64::from(j))));
        let places = grid.map(|(i, j)| Displacement::new(i * step, j * step));
        places.filter(|at| at.norm() <= far + 0.5 * step).collect()
    }

    /// Stands so far aside of the beam, with the fine group, or the coarse one where that does not reach.
    pub(super) async fn stand_at(
        &mut self,
        bench: &Reactor<'_>,
        at: Displacement,
    ) -> Result<(), Halt> {
        let by = at - self.aside;
        if bench.reaches(self.fine, &Pose::at(by.x, by.y, 0.0)) {
            return self.fine_to(bench, by).await;
        }
        self.fine_to(bench, Displacement::ZERO).await?;
        self.aside = at;
        bench.line(self.coarse, self.at_gap(self.gap), None).await
    }

    /// The fine group goes somewhere and comes to rest.
    async fn fine_to(&self, bench: &Reactor<'_>, to: Displacement) -> Result<(), Halt> {
        let here = bench.across(self.fine).unwrap_or(Displacement::ZERO);
        if (here - to).norm() < TUNING.circle.centred * self.beam.width(0.0) {
            return Ok(());
        }
        let settling = bench.settling(self.fine);
        let law = Dither {
            centre: Glide {
                to: [to.x, to.y],
                within: settling,
            },
            radius: Glide::at_once(0.0),
            rate: 0.0,
            lead: None,
            widens: None,
        };
        bench.send(self.fine, Law::Dither(law))?;
        Ok(bench.wait(2.0 * settling).await?)
    }

    /// Circles begin where the fine group stands.
    pub(super) fn begin_scan(&mut self, bench: &Reactor<'_>, dark: &Dark) {
        let of = (self.fine, self.meter);
        self.scan = begin(bench, of, self.beam, self.recipe, dark, self.gap);
    }

    /// Radius of circles that find the peak, in its widths.
    fn radius(&self, bench: &Reactor<'_>) -> f64 {
        let wanted = self.recipe.fast.conical_scan.radius;
        circles(bench, self.fine, self.beam.width(self.gap), wanted)
    }

    /// How noisy the light is where the fiber stands still: a meter's noise grows with its light.
    async fn learn_noise(&mut self, bench: &Reactor<'_>, dark: &Dark) -> Result<(), Halt> {
        let samples = TUNING.taught.look;
        learn_noise(bench, &mut self.scan, dark, samples).await
    }

    /// To the peak at this gap, and to rest there.
    pub(super) async fn centre(
        &mut self,
        bench: &Reactor<'_>,
        dark: &Dark,
        phase: &'static str,
    ) -> Result<(), Halt> {
        self.learn_noise(bench, dark).await?;
        let gap = self.measured_gap(bench);
        let coarse = TUNING.circle.centred * self.beam.width(gap);
        let mut why = None;
        for _ in 0..self.recipe.fast.retry.handed_over {
            self.scan.set_radius(self.radius(bench));
            let peak = self.scan.centre(bench, gap, coarse, phase, 1).await;
            self.scan.rest(bench, gap).await?;
            match peak {
                Ok(peak) => {
                    why = None;
                    self.before = (peak.full, gap);
                    if !self.make_room(bench, TUNING.taught.room).await? {
                        return Ok(());
                    }
                }
                Err(Halt::Outcome(beyond)) => {
                    let Outcome::MicroRange { x, y, .. } = beyond else {
                        return Err(beyond.into());
                    };
                    // The fine group does not get there: the coarse one does.
                    self.scan.expect_at(Displacement::new(x, y), gap);
                    self.make_room(bench, 0.0).await?;
                    why = Some(beyond);
                }
                Err(fault) => return Err(fault),
            }
        }
        // It stands where it was handed over to the last time, near its peak.
        why.map_or(Ok(()), |why| Err(why.into()))
    }

    /// The coarse group takes over what the fine one stands aside, where that is more than a share of its range. Whether it
    /// was so.
    async fn make_room(&mut self, bench: &Reactor<'_>, share: f64) -> Result<bool, Halt> {
        let gap = self.measured_gap(bench);
        let place = self.scan.place(gap);
        let room = |degree| share * range(bench, self.fine, degree);
        if place.x.abs() <= room(Degree::X) && place.y.abs() <= room(Degree::Y) {
            return Ok(false);
        }
        let before = bench.across(self.coarse);
        self.aside += place;
        self.fine_to(bench, Displacement::ZERO).await?;
        bench.line(self.coarse, self.at_gap(self.gap), None).await?;
        let after = bench.across(self.coarse);
        let by = before
            .zip(after)
            .map_or(place, |(before, after)| after - before);
        self.scan.hand_over(by);
        Ok(true)
    }

    /// Closes the gap along the beam to the one that is wanted, metres, from one gap to the next, on circles.
    pub(super) async fn approach(
        &mut self,
        bench: &Reactor<'_>,
        dark: &Dark,
        wanted: f64,
    ) -> Result<(), Halt> {
        let (before, _) = self.before;
        let least = self.recipe.fast.accept * before;
        while self.gap > wanted {
            let here = self.gap;
            // One that would be left with hardly a way goes there at once.
            self.gap = if TUNING.taught.nearer * here < wanted / TUNING.taught.nearer.sqrt() {
                wanted
            } else {
                TUNING.taught.nearer * here
            };
            let (to, led) = (self.at_gap(self.gap), self.led());
            let speed = TUNING.taught.closing * self.gap / self.scan.period();
            let ticket = bench.send_to(self.coarse, to, Some(speed))?;
            self.scan.set_radius(self.radius(bench));
            let way = Closing {
                group: self.coarse,
                rests: Some(ticket),
                turns: 0,
                before,
                least,
                stray: self.recipe.fast.stray,
            };
            let (coarse, taught, asked) = (self.coarse, self.taught, self.gap);
            let measured = || measured_gap(bench, coarse, taught, asked);
            let scan = &mut self.scan;
            scan.close(bench, &way, || led, measured).await?;
            let gap = measured();
            let near = TUNING.circle.centred * scan.beam_width(gap);
            let peak = scan.centre(bench, gap, near, "approach", 1).await?;
            scan.rest(bench, gap).await?;
            Outcome::of_growth(before, peak.full, least)?;
            self.learn_noise(bench, dark).await?;
        }
        Ok(())
    }

    /// The last turns at the chip, and the bond.
    pub(super) async fn finish(
        &mut self,
        job: &mut Job<'_>,
        bench: &Reactor<'_>,
        dark: &Dark,
    ) -> Result<(), Halt> {
        let gap = self.measured_gap(bench);
        let place = self.place(bench, Across::default());
        place.sure_along(self.recipe.accept.gap)?;
        let (before, far) = self.before;
        let least = self.recipe.fast.accept * before;
        let expected = Expected { before, far, least };
        let chip = Unseen {
            bench,
            dark,
            beam: self.beam,
            gap,
            radius: self.radius(bench),
        };
        let scan = &mut self.scan;
        let last = last_turns(job, bench, &chip, scan, &expected).await;
        let Rest {
            look,
            foreseen,
            across,
        } = last?;
        let check = chip.check(scan);
        job.bond(bench, check, look, Some(foreseen)).await?;
        job.place = Some(Place { across, ..place });
        Ok(())
    }

    /// Where the fiber is believed to be, with its place across known so well.
    fn place(&self, bench: &Reactor<'_>, across: Across) -> Place {
        let repeats = axis(bench, self.coarse, Degree::Z);
        let repeats = repeats.map_or(0.0, |axis| axis.repeatability);
        Place {
            across,
            off: self.measured_gap(bench) - self.recipe.approach.gap,
            bound: self.taught.bound_z,
            sigma: self.taught.sigma_z.hypot(repeats),
        }
    }
}

fn axis(bench: &Reactor<'_>, group: Group, degree: Degree) -> Option<AxisCaps> {
    bench.caps().groups[group.0].axes[degree.index()]
}

/// The gap by the measure of a coarse group, or the one that was asked for where it has none, metres.
fn measured_gap(bench: &Reactor<'_>, coarse: Group, taught: &Taught, asked: f64) -> f64 {
    let pose = bench.pose(coarse, bench.now());
    pose.map_or(asked, |at| taught.pose.z() - at.pose.z())
}

/// How noisy the light of circles at rest is, by so many samples.
async fn learn_noise(
    bench: &Reactor<'_>,
    scan: &mut ConicalScan<'_>,
    dark: &Dark,
    samples: usize,
) -> Result<(), Halt> {
    let (_, sigma) = bench.look(scan.meter().0, samples).await?;
    scan.set_noise(sigma.max(dark.sigma), samples as f64 - 2.0);
    Ok(())
}

/// A fiber at the chip that nobody sees: its gap is as it was taught.
struct Unseen<'f, 'b> {
    bench: &'f Reactor<'b>,
    dark: &'f Dark,
    beam: Beam,
    gap: f64,
    /// Of circles, in widths.
    radius: f64,
}

impl AtChip for Unseen<'_, '_> {
    fn beam(&self) -> Beam {
        self.beam
    }

    fn check(&self, scan: &ConicalScan<'_>) -> LightCheck {
        LightCheck {
            meter: scan.meter().0,
            background: self.dark.mean,
            noise: scan.noise(),
            samples: TUNING.taught.look,
            less: TUNING.bond.taught_less,
        }
    }

    async fn begin(&self, scan: &mut ConicalScan<'_>) -> Result<(), Halt> {
        // At its peak light does not tell how a tip shakes: what is seen there is noise.
        scan.rest(self.bench, self.gap).await?;
        learn_noise(self.bench, scan, self.dark, TUNING.taught.steady).await?;
        scan.set_radius(self.radius);
        Ok(())
    }

    async fn settle(
        &self,
        scan: &mut ConicalScan<'_>,
        accuracy: (f64, f64),
    ) -> Result<(Peak, f64), Halt> {
        let peak = scan.settle(self.bench, self.gap, accuracy, "final", &|| Ready::Yes);
        Ok((peak.await?, self.gap))
    }
}

//! The approach: circles follow the peak while the gap closes, for as long as its light is there and does not stray.

use super::{ConicalScan, Gap};
use crate::outcome::{Halt, Outcome};
use crate::reactor::{LONGEST, Reactor};
use crate::tuning::TUNING;
use pigtail_hal::bench::{Event, Group, Law, Ticket};

/// A group on its way to the chip, and what the light has to be meanwhile.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Closing {
    /// The group.
    pub(crate) group: Group,
    /// Its way, where that is over only once the group has come to rest; else it is when it was brought there.
    pub(crate) rests: Option<Ticket>,
    /// Turns that are made where it ends.
    pub(crate) turns: u64,
    /// Light at the peak at no gap before, volts.
    pub(crate) before: f64,
    /// The least that it may be: light that does not come out of the guide does not grow as the gap closes. Volts.
    pub(crate) least: f64,
    /// How far the peak may walk otherwise than expected, metres: what strays farther is none.
    pub(crate) stray: f64,
}

impl ConicalScan<'_> {
    /// Follows the peak while a group closes the gap. How the gap `leads` the circles may come to be known better on the way, and so may the `gap`,
    /// metres. Whatever happens, the group is stopped before anyone tries again.
    ///
    /// # Errors
    ///
    /// A fault; [`Outcome::LightLost`], [`Outcome::Strayed`] or [`Outcome::MicroRange`]; [`Outcome::BenchFailed`] where the way fails.
    pub(crate) async fn close(
        &mut self,
        bench: &Reactor<'_>,
        way: &Closing,
        leads: impl Fn() -> Gap,
        gap: impl Fn() -> f64,
    ) -> Result<(), Halt> {
        let start = self.place(0.0);
        let latest = bench.now() + LONGEST;
        let (mut next, mut end) = (bench.now() + self.period, f64::INFINITY);
        loop {
            let by = next.min(end);
            let event = self.follow(bench, leads(), by).await?;
            let over = match way.rests {
                None => !bench.moving(way.group),
                Some(ticket) => match &event {
                    Event::Failed(failed, why) if *failed == ticket => {
                        return Err(Outcome::BenchFailed { why: why.clone() }.into());
                    }
                    event => *event == Event::Done(ticket),
                },
            };
            if over && end.is_infinite() {
                end = bench.now() + way.turns as f64 * self.period;
            }
            if event != Event::Time {
                continue;
            }
            if by >= end {
                return self.arrive(bench, way, gap()).await;
            }
            next += self.period;
            // A peak that the group does not reach is lost too. What is as dim as noise leads nowhere.
            let light = match self.clear_peak() {
                Some(peak) => self.go_to(bench, &peak, gap()).map(|_| peak.full),
                None => Ok(self.peak().map_or(0.0, |peak| peak.full)),
            };
            let strayed = (self.place(0.0) - start).norm();
            let why = match light {
                _ if bench.is_past(latest) => Outcome::BenchFailed {
                    why: format!("a way to the chip was not over within {LONGEST} s"),
                },
                Ok(light) if light >= way.least && strayed <= way.stray => continue,
                Ok(light) if light >= way.least => Outcome::Strayed {
                    by: strayed,
                    accepted: way.stray,
                },
                Ok(level) => Outcome::LightLost {
                    phase: "approach",
                    level,
                    expected: way.before,
                },
                Err(beyond) => beyond,
            };
            bench.send(way.group, Law::Brake)?;
            bench.played(way.group).await?;
            return Err(why.into());
        }
    }
    /// Whether the peak has come along to where the way ends. What a turn saw of it on the way may be no more than its rim, left behind by now:
    /// where it does not stand out, turns have to find it here.
    async fn arrive(&mut self, bench: &Reactor<'_>, way: &Closing, gap: f64) -> Result<(), Halt> {
        let accuracy = TUNING.circle.near * self.beam.width(gap);
        let peak = match self.clear_peak() {
            Some(peak) => self.go_to(bench, &peak, gap).map(|_| peak)?,
            None => match self.centre(bench, gap, accuracy, "approach", 1).await {
                // Too dim to be found so well, but there.
                Err(Halt::Outcome(Outcome::Unsure { .. })) => return Ok(()),
                peak => peak?,
            },
        };
        if peak.full < way.least {
            return Err(Outcome::LightLost {
                phase: "approach",
                level: peak.full,
                expected: way.before,
            }
            .into());
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::beam::Beam;
    use crate::conical_scan::{Gap, Watch};
    use crate::reactor::{Watched, refused};
    use crate::recipe::{ConicalScan as Shape, Mode};
    use crate::station::{Observer, Unobserved};
    use pigtail_hal::Fault;
    use pigtail_hal::bench::{
        AxisCaps, Bench, Caps, ChannelCaps, Dither, Estimate, GroupCaps, Light, Limits, Meter,
        Pose, Refused, Request, Stage,
    };
    use pigtail_model::frames::Displacement;
    use std::f64::consts::TAU;

    const FINE: Group = Group(0);
    const COARSE: Group = Group(1);
    const RATE: f64 = 200.0;

    /// A fine group that goes exactly where it is told on a coarse one that goes along z at a speed, metres a second.
    struct Stages {
        caps: Caps,
        now: f64,
        sample: f64,
        circle: Option<(Ticket, Dither)>,
        line: Option<(Ticket, f64)>,
        z: f64,
        speed: f64,
        /// From where on there is no light any more, metres.
        dark: f64,
        tickets: u64,
        unobserved: Unobserved,
    }

    impl Stages {
        fn new(speed: f64, dark: f64) -> Self {
            let axis = AxisCaps {
                range: (-50e-6, 50e-6),
                resolution: 0.0,
                repeatability: 0.0,
                backlash: 0.0,
                speed: 1.0,
            };
            let group = |name: &str, stage| GroupCaps {
                name: name.to_owned(),
                arm: 0,
                stage,
                axes: [Some(axis), Some(axis), Some(axis), None, None, None],
                settling: 0.0,
                bandwidth: 20.0,
                lag: (0.0, 0.0),
                bends: true,
            };
            let caps = Caps {
                name: "stages".to_owned(),
                arms: vec!["left".to_owned()],
                groups: vec![group("fine", Stage::Fine), group("coarse", Stage::Coarse)],
                channels: vec![ChannelCaps {
                    name: "light".to_owned(),
                    rate: RATE,
                    resolution: 0.0,
                    full_scale: 10.0,
                }],
                least_power: 100,
                bond: 0.0,
                cycle: 0.0,
            };
            Self {
                caps,
                now: 0.0,
                sample: 0.0,
                circle: None,
                line: None,
                z: 0.0,
                speed,
                dark,
                tickets: 0,
                unobserved: Unobserved,
            }
        }

        fn fine(&self) -> Pose {
            let Some((_, circle)) = &self.circle else {
                return Pose::ZERO;
            };
            let (sin, cos) = (TAU * circle.rate * self.now).sin_cos();
            let [x, y] = circle.centre.to;
            let radius = circle.radius.to;
            Pose::at(x + radius * cos, y + radius * sin, 0.0)
        }

        /// A Gaussian peak that does not walk.
        fn light(&self) -> f64 {
            if self.z >= self.dark {
                return 0.0;
            }
            let (at, mode) = (self.fine(), Mode::default().radius);
            (-(at.x().hypot(at.y()) / mode).powi(2)).exp()
        }
    }

    impl Watched for Stages {
        fn observer(&mut self) -> &mut dyn Observer {
            &mut self.unobserved
        }
    }

    impl Bench for Stages {
        fn caps(&self) -> &Caps {
            &self.caps
        }
        fn now(&self) -> f64 {
            self.now
        }
        fn play(&mut self, _: Group, law: Law) -> Result<Ticket, Refused> {
            self.tickets += 1;
            let ticket = Ticket(self.tickets);
            match law {
                Law::Line { to, .. } => self.line = Some((ticket, to.z())),
                Law::Dither(circle) => self.circle = Some((ticket, circle)),
                _ => self.line = Some((ticket, self.z)),
            }
            Ok(ticket)
        }
        fn bend(&mut self, ticket: Ticket, law: Law) -> Result<f64, Refused> {
            match (&mut self.circle, law) {
                (Some((played, circle)), Law::Dither(to)) if *played == ticket => *circle = to,
                _ => return Err(Refused::Ticket(ticket.0)),
            }
            Ok(self.now)
        }
        fn request(&mut self, _: Request) -> Result<Ticket, Refused> {
            Err(Refused::State("nothing".to_owned()))
        }
        fn next(&mut self, by: f64) -> Result<Event, Fault> {
            let end = self.line.map_or(f64::INFINITY, |(_, to)| {
                self.now + (to - self.z).max(0.0) / self.speed
            });
            let then = by.min(self.sample).min(end);
            if self.line.is_some() {
                self.z += self.speed * (then - self.now);
            }
            self.now = then;
            if then == end {
                let (ticket, _) = self.line.take().expect("a line that ends");
                return Ok(Event::Done(ticket));
            }
            if then == self.sample {
                self.sample += RATE.recip();
                let (time, volts) = (then, vec![self.light()]);
                return Ok(Event::Light(Light { time, volts }));
            }
            Ok(Event::Time)
        }
        fn pose(&self, group: Group, _: f64) -> Option<Estimate> {
            let pose = if group == FINE {
                self.fine()
            } else {
                Pose::at(0.0, 0.0, self.z)
            };
            Some(Estimate {
                pose,
                measured: true,
            })
        }
        fn stop(&mut self) {}
    }

    /// What a way of 30 um to a gap of 10 um comes to, on which there is light up to a place.
    fn way(dark: f64) -> Result<(), Halt> {
        const GAP: f64 = 40e-6;
        const WAY: f64 = 30e-6;
        let mut stages = Stages::new(3e-4, dark);
        let bench = Reactor::new(&mut stages);
        let shape = Shape::default();
        let watch = Watch {
            group: FINE,
            meter: Meter(0),
            background: 0.0,
            noise: 1e-3,
            still: 1e-3,
            still_degrees: 100.0,
        };
        let (beam, walk) = (Beam::new(&Mode::default(), 0.0), Displacement::ZERO);
        let from = (Displacement::new(1e-6, 0.0), GAP);
        let mut scan = ConicalScan::new(watch, beam, &shape, &bench, from, walk, None);
        let led = Gap::Led {
            by: COARSE,
            contact: GAP,
        };
        let close = async {
            let to = Pose::at(0.0, 0.0, WAY);
            let limits = Limits::default();
            bench
                .play(COARSE, Law::Line { to, limits })
                .map_err(|why| refused(&why))?;
            let way = Closing {
                group: COARSE,
                rests: None,
                turns: 1,
                before: 1.0,
                least: 0.5,
                stray: 20e-6,
            };
            scan.close(&bench, &way, || led, || GAP - WAY).await
        };
        bench.run(close)
    }

    #[test]
    fn a_way_ends_where_its_light_is_and_nowhere_else() {
        assert!(way(1.0).is_ok());
        // On the way, and just before its end: what the last turn saw of it was farther back.
        for dark in [10e-6, 25e-6, 29.9e-6] {
            let lost = way(dark);
            assert!(
                matches!(lost, Err(Halt::Outcome(Outcome::LightLost { .. }))),
                "{dark} {lost:?}"
            );
        }
    }
}

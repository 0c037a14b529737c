//! What lines of control ask of a bench, and how they wait for it.

use super::Reactor;
use crate::outcome::{Halt, Outcome};
use crate::tuning::TUNING;
use pigtail_hal::Fault;
use pigtail_hal::bench::{Event, Group, Law, Light, Limits, Pose, Refused, Request, Ticket};
use pigtail_model::frames::Displacement;
use pigtail_numerics::line::Line;

/// Longest that anything which is asked of a bench may take, seconds.
pub(crate) const LONGEST: f64 = 120.0;

impl Reactor<'_> {
    /// Lets time pass, seconds.
    ///
    /// # Errors
    ///
    /// The bench's fault.
    pub async fn wait(&self, seconds: f64) -> Result<(), Fault> {
        let end = self.now() + seconds;
        while !(self.next_as(end, |event| *event == Event::Time).await?) {}
        Ok(())
    }

    /// For how long a meter may remember what the laser was before, seconds.
    pub fn forgets_laser(&self, meter: usize) -> f64 {
        f64::from(TUNING.dark.forgotten) / self.caps().channels[meter].rate
    }

    /// The next light of a meter, volts, and when it was measured; `None` for any other event, and at the time `by`.
    ///
    /// # Errors
    ///
    /// The bench's fault.
    pub async fn sample(&self, meter: usize, by: f64) -> Result<Option<(f64, f64)>, Fault> {
        let seen = |event: &Event| {
            let Event::Light(Light { time, volts }) = event else {
                return None;
            };
            let volts = volts.get(meter).copied().filter(|volts| !volts.is_nan());
            volts.map(|volts| (*time, volts))
        };
        let seen = self.next_as(by, seen).await?;
        if let Some((time, _)) = seen {
            self.note_reading(time);
        }
        Ok(seen)
    }

    /// Has a group play a law; why the bench does not is how a fiber's alignment ends.
    ///
    /// # Errors
    ///
    /// [`Outcome::BenchFailed`].
    pub fn send(&self, group: Group, law: Law) -> Result<Ticket, Outcome> {
        self.play(group, law).map_err(|why| refused(&why))
    }

    /// Sends a group straight to a pose, no faster than `speed` m/s.
    ///
    /// # Errors
    ///
    /// As [`Self::send`].
    pub fn send_to(&self, group: Group, to: Pose, speed: Option<f64>) -> Result<Ticket, Outcome> {
        let limits = Limits { speed };
        self.send(group, Law::Line { to, limits })
    }

    /// The same, and waits until it has come to rest.
    ///
    /// # Errors
    ///
    /// A fault; [`Outcome::BenchFailed`] where it may not go there, or does not arrive.
    pub async fn line(&self, group: Group, to: Pose, speed: Option<f64>) -> Result<(), Halt> {
        let ticket = self.send_to(group, to, speed)?;
        self.done(vec![ticket], LONGEST).await
    }

    /// Where a group stands across, x and y, where that is known.
    pub fn across(&self, group: Group) -> Option<Displacement> {
        let here = self.pose(group, self.now())?;
        Some(across(&here.pose))
    }

    /// Waits for the next light of a meter, volts.
    ///
    /// # Errors
    ///
    /// The bench's fault.
    pub async fn next_light(&self, meter: usize) -> Result<f64, Fault> {
        loop {
            if let Some((_, volts)) = self.sample(meter, f64::INFINITY).await? {
                return Ok(volts);
            }
        }
    }

    /// So many samples of a meter from now on: their times, seconds, and volts.
    ///
    /// # Errors
    ///
    /// The bench's fault; [`Outcome::BenchFailed`] where the meter is silent.
    pub async fn samples(&self, meter: usize, samples: usize) -> Result<Vec<(f64, f64)>, Halt> {
        let mut seen: Vec<(f64, f64)> = Vec::with_capacity(samples);
        let rate = self.caps().channels[meter].rate;
        let end = self.now() + LONGEST + 10.0 * samples as f64 / rate;
        while seen.len() < samples {
            match self.sample(meter, end).await? {
                Some(seen_now) => seen.push(seen_now),
                None if self.is_past(end) => {
                    let why = "its meter is silent".to_owned();
                    return Err(Outcome::BenchFailed { why }.into());
                }
                None => {}
            }
        }
        Ok(seen)
    }

    /// Mean of so many samples of a meter (two or more), and their standard deviation about a straight line in time, volts.
    ///
    /// # Errors
    ///
    /// As [`Self::samples`].
    pub async fn look(&self, meter: usize, samples: usize) -> Result<(f64, f64), Halt> {
        let seen = self.samples(meter, samples).await?;
        let n = seen.len() as f64;
        let mean = seen.iter().map(|(_, volts)| volts).sum::<f64>() / n;
        let line = Line::through(seen.iter().copied());
        let squares: f64 = seen.iter().map(|(t, v)| line.left(*t, *v).powi(2)).sum();
        let sigma = (squares / (n - 2.0).max(1.0)).sqrt();
        Ok((mean, sigma))
    }

    /// Lets time pass until a group has been brought to the end of what it plays.
    ///
    /// # Errors
    ///
    /// The bench's fault.
    pub async fn played(&self, group: Group) -> Result<(), Fault> {
        while self.moving(group) {
            self.next_as(f64::INFINITY, |_| ()).await?;
        }
        Ok(())
    }

    /// Lets time pass until all of some tickets are done.
    ///
    /// # Errors
    ///
    /// The bench's fault; [`Outcome::BenchFailed`] where one fails, or is not done within `longest` seconds.
    pub async fn done(&self, mut tickets: Vec<Ticket>, longest: f64) -> Result<(), Halt> {
        let end = self.now() + longest;
        let told = |event: &Event| match event {
            Event::Done(_) | Event::Failed(..) | Event::Time => Some(event.clone()),
            _ => None,
        };
        while !tickets.is_empty() {
            let Some(event) = self.next_as(end, told).await? else {
                continue;
            };
            match event {
                Event::Done(done) => tickets.retain(|ticket| *ticket != done),
                Event::Failed(failed, why) if tickets.contains(&failed) => {
                    return Err(Outcome::BenchFailed { why }.into());
                }
                Event::Time => {
                    let why = format!("something was not done within {longest} s");
                    return Err(Outcome::BenchFailed { why }.into());
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Asks for something and waits until it is done.
    ///
    /// # Errors
    ///
    /// The bench's fault; [`Outcome::BenchFailed`].
    pub async fn ask(&self, what: Request, longest: f64) -> Result<(), Halt> {
        let ticket = self.request(what).map_err(|why| refused(&why))?;
        self.done(vec![ticket], longest).await
    }
}

/// A pose's x and y.
pub(crate) fn across(pose: &Pose) -> Displacement {
    Displacement::new(pose.x(), pose.y())
}

/// What a bench refuses is how a fiber's alignment ends.
pub(crate) fn refused(why: &Refused) -> Outcome {
    Outcome::BenchFailed {
        why: why.to_string(),
    }
}

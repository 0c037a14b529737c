//! Steps of the fiber handling that take their time: busy, then done or failed.

use super::{Station, bench};
use pigtail_hal::bench::{Event, Refused, Ticket};
use pigtail_hal::{FiberHandling, Handled, Side};

impl Station<'_> {
    /// Begins a step of an arm.
    ///
    /// # Errors
    ///
    /// [`Refused`] where there is no such arm, it is busy, or it is no such step.
    pub(super) fn begin_handling(
        &mut self,
        arm: usize,
        what: FiberHandling,
    ) -> Result<Ticket, Refused> {
        let side = bench::side_of(arm)?;
        let name = side.name();
        let state = |text: String| Err(Refused::State(text));
        if self.playing.handling[side.index()].is_some() {
            return state(format!("the holder of {name} is busy"));
        }
        match what {
            FiberHandling::Load(_) | FiberHandling::Attach | FiberHandling::Unload => {
                return state("that is a request of its own".to_owned());
            }
            FiberHandling::Pick(_) if self.carries(side) => {
                return state(format!("the holder of {name} has a fiber already"));
            }
            FiberHandling::Wet(_) | FiberHandling::Release if !self.carries(side) => {
                return state(format!("the holder of {name} has no fiber"));
            }
            _ => {}
        }
        self.command.fiber[side.index()] = Some(what);
        let ticket = self.playing.ticket();
        self.playing.handling[side.index()] = Some((ticket, what));
        Ok(ticket)
    }

    /// Takes in what has ended in this cycle.
    pub(super) fn end_handling(&mut self) {
        for side in Side::ALL {
            let i = side.index();
            let Some(how) = self.measurement.handled[i] else {
                continue;
            };
            let Some((ticket, what)) = self.playing.handling[i].take() else {
                continue;
            };
            match (what, how) {
                (FiberHandling::Pick(_), Handled::Done) => self.arms[i].loaded = true,
                (FiberHandling::Release, Handled::Done) => self.arms[i].loaded = false,
                _ => {}
            }
            self.playing.events.push_back(match how {
                Handled::Done => Event::Done(ticket),
                Handled::Missed => Event::Failed(ticket, missed(what).to_owned()),
            });
        }
    }
}

fn missed(what: FiberHandling) -> &'static str {
    match what {
        FiberHandling::Pick(_) => "the gripper has missed the fiber",
        FiberHandling::Index => "there is no next device",
        _ => "the machine could not do it",
    }
}

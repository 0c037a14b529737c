//! Whether a bench is able to play a law, before it is played.

use super::{AxisCaps, Caps, Degree, Dither, Group, GroupCaps, Knot, Law, Pose, Refused, Request};

impl Caps {
    /// Whether a group is able to play a law: numbers, axes, ranges, rates. It asks for nothing but the law, so a
    /// guard and the bench itself answer alike.
    ///
    /// ```
    /// use pigtail_hal::bench::{Group, Law, Limits, Pose};
    /// # let text = include_str!("../../../../rigs/bench-piezo/machine.toml");
    /// # let caps = pigtail_hal::bench::spec::BenchSpec::parse("machine.toml", text)?.caps();
    /// let to = Pose::at(0.0, 0.0, f64::NAN);
    /// let line = Law::Line { to, limits: Limits::default() };
    /// let refused = caps.accepts(Group(0), &line).unwrap_err();
    /// assert!(refused.to_string().contains("not a number"), "{refused}");
    /// # Ok::<(), pigtail_hal::Error>(())
    /// ```
    ///
    /// # Errors
    ///
    /// Why it is not.
    pub fn accepts(&self, group: Group, law: &Law) -> Result<(), Refused> {
        let of = self.group_caps(group)?;
        let unable = |why: String| Refused::Law {
            group: of.name.clone(),
            law: law.name(),
            why,
        };
        match law {
            Law::Brake => Ok(()),
            Law::Line { to, limits } => {
                of.reaches(to, law)?;
                match limits.speed {
                    Some(speed) if !(speed.is_finite() && speed > 0.0) => Err(unable(format!(
                        "a speed of {speed} m/s; accepted is more than zero"
                    ))),
                    _ => Ok(()),
                }
            }
            Law::Scan(knots) => of.follows(knots, law),
            Law::Dither(dither) => {
                if let Some(lead) = &dither.lead {
                    self.group_caps(lead.group)?;
                    if lead.group == group {
                        return Err(unable("a group cannot lead itself".to_owned()));
                    }
                } else if dither.widens.is_some() {
                    let why =
                        "its radius widens with the travel of a group that leads, and none does";
                    return Err(unable(why.to_owned()));
                }
                of.turns(dither, law)
            }
        }
    }

    /// Whether what a request names is there.
    ///
    /// # Errors
    ///
    /// What is not.
    pub fn answers(&self, request: &Request) -> Result<(), Refused> {
        match *request {
            Request::Load { arm, .. }
            | Request::Attach { arm }
            | Request::Unload { arm }
            | Request::Handle { arm, .. } => {
                let count = self.arms.len();
                if arm < count {
                    return Ok(());
                }
                Err(Refused::Unknown {
                    what: "arm",
                    index: arm,
                    count,
                })
            }
            Request::LaserPower { percent } if !(self.least_power..=100).contains(&percent) => {
                Err(Refused::State(format!(
                    "the laser's power can be set to {} to 100 percent, not to {percent}",
                    self.least_power
                )))
            }
            Request::Laser(_) | Request::LaserPower { .. } => Ok(()),
        }
    }

    /// What a group is able to do.
    ///
    /// # Errors
    ///
    /// Where there is no such group.
    pub fn group_caps(&self, Group(index): Group) -> Result<&GroupCaps, Refused> {
        self.groups.get(index).ok_or(Refused::Unknown {
            what: "group",
            index,
            count: self.groups.len(),
        })
    }
}

/// The places that are accepted along an axis; none but zero where there is none.
fn accepted(axis: Option<&AxisCaps>) -> (f64, f64) {
    let (low, high) = axis.map_or((0.0, 0.0), |axis| axis.range);
    // What rounding adds at the edge is no way.
    let slack = 1e-9 * (high - low);
    (low - slack, high + slack)
}

impl GroupCaps {
    fn unable(&self, law: &Law, why: String) -> Refused {
        Refused::Law {
            group: self.name.clone(),
            law: law.name(),
            why,
        }
    }

    fn reaches(&self, to: &Pose, law: &Law) -> Result<(), Refused> {
        // Without a short cut: most laws have many places, and all of them are reached.
        let within = |(axis, value): (&Option<AxisCaps>, f64)| {
            let (low, high) = accepted(axis.as_ref());
            (low..=high).contains(&value) & value.is_finite()
        };
        let each = self.axes.iter().zip(to.0);
        if each.fold(true, |well, of| well & within(of)) {
            return Ok(());
        }
        for (degree, value) in Degree::ALL.into_iter().zip(to.0) {
            self.reaches_on(degree, value, law)?;
        }
        Ok(())
    }

    #[cold]
    fn reaches_on(&self, degree: Degree, value: f64, law: &Law) -> Result<(), Refused> {
        if !value.is_finite() {
            let why = format!("its {} of {value} is not a number", degree.name());
            return Err(self.unable(law, why));
        }
        let axis = self.axes[degree.index()].as_ref();
        let (low, high) = accepted(axis);
        if (low..=high).contains(&value) {
            return Ok(());
        }
        let (low, high) = axis.map_or((0.0, 0.0), |axis| axis.range);
        Err(Refused::Range {
            group: self.name.clone(),
            axis: degree.name(),
            value,
            low,
            high,
        })
    }

    fn follows(&self, knots: &[Knot], law: &Law) -> Result<(), Refused> {
        if self.bandwidth <= 0.0 {
            let why = "it plays lines only".to_owned();
            return Err(self.unable(law, why));
        }
        let mut before: Option<&Knot> = None;
        for knot in knots {
            self.reaches(&knot.at, law)?;
            let since = before.map_or(0.0, |before| before.time);
            if !(knot.time.is_finite() && knot.time >= since)
                || before.is_some_and(|before| knot.time <= before.time)
            {
                let why = format!(
                    "a knot at {} s behind one at {since} s; accepted are times that increase",
                    knot.time
                );
                return Err(self.unable(law, why));
            }
            if let Some(before) = before {
                let seconds = knot.time - before.time;
                let ways = (knot.at - before.at).0;
                for (axis, way) in self.axes.iter().zip(ways) {
                    let speed = way.abs() / seconds;
                    if let Some(axis) = axis
                        && speed > axis.speed * (1.0 + 1e-9)
                    {
                        let why = format!(
                            "{speed:.6} m/s at {:.4} s; accepted is at most {:.6} m/s",
                            before.time, axis.speed
                        );
                        return Err(self.unable(law, why));
                    }
                }
            }
            before = Some(knot);
        }
        if before.is_none() {
            let why = "it has no knots; accepted is one or more".to_owned();
            return Err(self.unable(law, why));
        }
        Ok(())
    }

    fn turns(&self, dither: &Dither, law: &Law) -> Result<(), Refused> {
        let (centre, radius) = (&dither.centre, &dither.radius);
        let widens = dither.widens.map(|widens| (widens.contact, widens.doubles));
        let lead = dither.lead.map_or([[0.0; 3]; 2], |lead| lead.gain);
        let from = dither.lead.map_or(Pose::ZERO, |lead| lead.from);
        let (contact, doubles) = widens.unwrap_or((0.0, 1.0));
        let numbers = [
            radius.to,
            dither.rate,
            centre.within,
            radius.within,
            contact,
            doubles,
        ];
        let all = numbers.into_iter().chain(centre.to).chain(from.0);
        if !all.chain(lead.into_iter().flatten()).all(f64::is_finite) {
            return Err(self.unable(law, "one of its numbers is not a number".to_owned()));
        }
        if self.bandwidth <= 0.0 {
            return Err(self.unable(law, "it plays lines only".to_owned()));
        }
        for (name, value) in [
            ("a radius", radius.to),
            ("a time to glide", centre.within),
            ("a time to glide", radius.within),
            ("a gap at which it doubles", doubles),
        ] {
            if value < 0.0 {
                let why = format!("{name} of {value}; accepted is zero or more");
                return Err(self.unable(law, why));
            }
        }
        if doubles == 0.0 {
            let why = "it widens within no gap; accepted is more than zero".to_owned();
            return Err(self.unable(law, why));
        }
        if dither.rate.abs() > self.bandwidth * (1.0 + 1e-9) {
            let why = format!(
                "{} turns a second; accepted is at most {}",
                dither.rate, self.bandwidth
            );
            return Err(self.unable(law, why));
        }
        for (degree, to) in [Degree::X, Degree::Y].into_iter().zip(centre.to) {
            for value in [to - radius.to, to + radius.to] {
                self.reaches_on(degree, value, law)?;
            }
        }
        Ok(())
    }
}

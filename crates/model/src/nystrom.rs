//! One step of a body that friction slows down in proportion to its speed, `q'' = n(t) - d q'`.
//!
//! A servo cycle is long beside the decay of a load (`d h` is about one for a five-bar's), short
//! beside what the transmission's spring does. So the decay is solved exactly, and only the other
//! accelerations `n` are interpolated: through four points in time, at each of which the angle comes
//! from the points before it (an exponential Nystrom method). A Runge-Kutta step has as many evaluations and
//! errs a hundred times as much on a five-bar; and what it interpolates gives the state at every
//! time within the step as exactly as at its end, which is what looking for an event needs.
//!
//! With `phi_0(z) = exp(z)` and `phi_(k+1)(z) = (phi_k(z) - 1/k!) / z`, an acceleration `t^k / k!`
//! since the start adds `t^(k+1) phi_(k+1)(-d t)` to the velocity and `t^(k+2) phi_(k+2)(-d t)` to the
//! angle. M. Hochbruck, A. Ostermann, *Exponential integrators*, Acta Numerica 19, 2010, has the theory.

/// At which shares of a step accelerations are evaluated. Searched for on a raster of a fortieth: of the
/// triples whose steps never add to the energy of a spring, however long they are up to 1.5 radians,
/// these err least but one on the thesis's joints under voltages that jump by almost a half, and the
/// one loses more energy.
pub(crate) const NODES: [f64; POINTS] = [0.0, 0.125, 0.45, 0.825];

/// How many they are.
pub(crate) const POINTS: usize = 4;

/// `LAGRANGE[i][j][k]`: what point `j` contributes to the coefficient of `s^k` of the polynomial
/// through the first `i + 1` points, `s` from 0 to 1 along the step.
pub(crate) const LAGRANGE: [[[f64; POINTS]; POINTS]; POINTS] =
    [lagrange(1), lagrange(2), lagrange(3), lagrange(4)];

const fn lagrange(points: usize) -> [[f64; POINTS]; POINTS] {
    let mut all = [[0.0; POINTS]; POINTS];
    let mut j = 0;
    while j < points {
        // The product of (s - s_i) / (s_j - s_i), multiplied out.
        let mut product = [0.0; POINTS];
        product[0] = 1.0;
        let (mut i, mut degree) = (0, 0);
        while i < points {
            if i != j {
                let by = 1.0 / (NODES[j] - NODES[i]);
                let mut k = degree + 1;
                while k > 0 {
                    product[k] = (product[k - 1] - NODES[i] * product[k]) * by;
                    k -= 1;
                }
                product[0] *= -NODES[i] * by;
                degree += 1;
            }
            i += 1;
        }
        all[j] = product;
        j += 1;
    }
    all
}

/// Divided by these the powers of `z` make the series of `phi_5`: `1/(n + 5)!`.
pub(crate) const SERIES: [f64; 16] = {
    let mut all = [0.0; 16];
    let (mut n, mut term) = (0, 1.0 / 120.0);
    while n < 16 {
        all[n] = term;
        n += 1;
        term /= (n + 5) as f64;
    }
    all
};

/// Up to this `z` eight terms of it are enough.
const SLOW: f64 = 0.15;

/// `phi_0` to `phi_5`, to 1e-13 of each.
#[inline]
fn phi(z: f64) -> [f64; 6] {
    if z.abs() > 1.0 {
        return phi_of_fast_decay(z);
    }
    // Sums are taken in pairs, which do not wait for each other.
    let c = &SERIES;
    let z2 = z * z;
    let z4 = z2 * z2;
    let four = |n: usize| (c[n] + c[n + 1] * z) + z2 * (c[n + 2] + c[n + 3] * z);
    let mut p5 = four(0) + z4 * four(4);
    // A slow decay needs few terms.
    if z.abs() > SLOW {
        p5 += z4 * z4 * (four(8) + z4 * four(12));
    }
    let [half, sixth, part] = [0.5, 1.0 / 6.0, 1.0 / 24.0];
    [
        (1.0 + z) + z2 * ((half + z * sixth) + z2 * (part + z * p5)),
        (1.0 + z * half) + z2 * ((sixth + z * part) + z2 * p5),
        (half + z * sixth) + z2 * (part + z * p5),
        (sixth + z * part) + z2 * p5,
        part + z * p5,
        p5,
    ]
}

#[cold]
fn phi_of_fast_decay(z: f64) -> [f64; 6] {
    let p0 = libm::exp(z);
    let p1 = (p0 - 1.0) / z;
    let p2 = (p1 - 1.0) / z;
    let p3 = (p2 - 0.5) / z;
    let p4 = (p3 - 1.0 / 6.0) / z;
    [p0, p1, p2, p3, p4, (p4 - 1.0 / 24.0) / z]
}

/// How velocity and angle at one time follow from those at the start and from accelerations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Row {
    /// What is left of the velocity.
    pub(crate) keep: f64,
    /// The way of a unit of it.
    pub(crate) drift: f64,
    /// Velocity from the acceleration at each point.
    pub(crate) velocity: [f64; POINTS],
    /// Way from the acceleration at each point.
    pub(crate) angle: [f64; POINTS],
}

impl Row {
    /// At the share `s` of a step of `h` seconds, from the first `points` points.
    fn new(decay: f64, h: f64, s: f64, points: usize) -> Self {
        let t = s * h;
        let p = phi(-decay * t);
        let (mut velocity, mut angle) = ([0.0; POINTS], [0.0; POINTS]);
        for j in 0..points {
            let mut power = t;
            for k in 0..points {
                velocity[j] += LAGRANGE[points - 1][j][k] * power * p[k + 1];
                angle[j] += LAGRANGE[points - 1][j][k] * power * t * p[k + 2];
                power *= s * (k + 1) as f64;
            }
        }
        Self {
            keep: p[0],
            drift: t * p[1],
            velocity,
            angle,
        }
    }

    /// The way since the start, at a velocity there.
    #[inline]
    pub(crate) fn way(&self, velocity: f64, accelerations: &[f64; POINTS]) -> f64 {
        dot(&self.angle, accelerations) + self.drift * velocity
    }

    /// The velocity.
    #[inline]
    pub(crate) fn velocity(&self, velocity: f64, accelerations: &[f64; POINTS]) -> f64 {
        dot(&self.velocity, accelerations) + self.keep * velocity
    }
}

/// Of as many points as count: those that do not are zero in the row and cost nothing once it is unrolled.
#[inline]
pub(crate) fn dot(a: &[f64; POINTS], b: &[f64; POINTS]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
}

/// One body's step of a certain length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Weights {
    /// At the points but the first, each from those before it.
    pub(crate) points: [Row; POINTS - 1],
    /// At the end.
    pub(crate) end: Row,
}

impl Weights {
    /// For a body that slows down by `decay` (1/s), and a step of `h` seconds.
    pub(crate) fn new(decay: f64, h: f64) -> Self {
        Self {
            points: std::array::from_fn(|i| Row::new(decay, h, NODES[i + 1], i + 1)),
            end: Row::new(decay, h, 1.0, POINTS),
        }
    }
}

/// A body's motion within a step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Motion {
    velocity: f64,
    decay: f64,
    /// Coefficients of the accelerations over the time in seconds, times `k!`.
    accelerations: [f64; POINTS],
}

impl Motion {
    /// From `velocity` at the start, with these accelerations beside the decay at the points of a step of
    /// `h` seconds.
    pub(crate) fn new(velocity: f64, decay: f64, at_points: &[f64; POINTS], h: f64) -> Self {
        let mut accelerations = [0.0; POINTS];
        let mut scale = 1.0;
        for (k, a) in accelerations.iter_mut().enumerate() {
            for j in 0..POINTS {
                *a += LAGRANGE[POINTS - 1][j][k] * at_points[j];
            }
            *a *= scale;
            scale *= (k + 1) as f64 / h;
        }
        Self {
            velocity,
            decay,
            accelerations,
        }
    }

    /// Way since the start and velocity after `t` seconds.
    #[inline]
    pub(crate) fn after(&self, t: f64) -> (f64, f64) {
        let p = phi(-self.decay * t);
        let [a, b, c, d] = self.accelerations;
        let t2 = t * t;
        let way = (p[2] * a + t * (p[3] * b)) + t2 * (p[4] * c + t * (p[5] * d));
        let velocity = (p[1] * a + t * (p[2] * b)) + t2 * (p[3] * c + t * (p[4] * d));
        (
            t * (p[1] * self.velocity + t * way),
            p[0] * self.velocity + t * velocity,
        )
    }

    /// Acceleration after `t` seconds, at the velocity then.
    #[inline]
    pub(crate) fn acceleration(&self, t: f64, velocity: f64) -> f64 {
        let [a, b, c, d] = self.accelerations;
        a + t * (b + t * (0.5 * c + t * (d * (1.0 / 6.0)))) - self.decay * velocity
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_two_forms_of_phi_meet() {
        for z in [-1.0, -0.15, 0.15] {
            let (a, b) = (phi(z), phi(z * (1.0 + 1e-15)));
            for k in 0..6 {
                assert!((a[k] / b[k] - 1.0).abs() < 1e-11, "phi_{k}({z})");
            }
        }
        let mut factorial = 1.0;
        for (k, p) in phi(0.0).into_iter().enumerate() {
            assert_eq!(p, 1.0 / factorial);
            factorial *= (k + 1) as f64;
        }
    }

    /// `n = exp(-w t)` has a solution in closed form; and where `n` is a cubic the step is exact.
    #[test]
    fn a_known_motion_is_met_at_every_time() {
        let h = 4e-4;
        for decay in [0.0, 20.0, 2420.0, 9000.0] {
            let n = |t: f64| 50.0 + t * (3e5 + t * (-4e8 + t * 7e11));
            let at_points = NODES.map(|s| n(s * h));
            let motion = Motion::new(0.7, decay, &at_points, h);
            for s in [0.1, 0.5, 1.0] {
                // Small steps of the midpoint rule, extrapolated.
                let run = |steps: i32| {
                    let dt = s * h / f64::from(steps);
                    let (mut q, mut v) = (0.0, 0.7);
                    for i in 0..steps {
                        let t = f64::from(i) * dt;
                        let half = v + 0.5 * dt * (n(t) - decay * v);
                        q += dt * half;
                        v += dt * (n(t + 0.5 * dt) - decay * half);
                    }
                    (q, v)
                };
                let (coarse, fine) = (run(2000), run(4000));
                let q = (4.0 * fine.0 - coarse.0) / 3.0;
                let v = (4.0 * fine.1 - coarse.1) / 3.0;
                let (way, velocity) = motion.after(s * h);
                assert!((way / q - 1.0).abs() < 1e-8, "{way} {q}");
                assert!((velocity / v - 1.0).abs() < 1e-8, "{velocity} {v}");
            }
            let end = Weights::new(decay, h).end;
            let (way, velocity) = motion.after(h);
            assert!((end.way(0.7, &at_points) / way - 1.0).abs() < 1e-12);
            assert!((end.velocity(0.7, &at_points) / velocity - 1.0).abs() < 1e-12);
        }
    }
}

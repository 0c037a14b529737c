//! The straight line through points, without an allocation. Where its uncertainty is asked for, use
//! [`regression`](crate::regression).

/// The straight line through points whose squares of what is left, along y, are least.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Mean of the points' x.
    pub x: f64,
    /// Mean of their y: the line goes through both.
    pub y: f64,
    /// By how much it rises for one in x; zero where the points do not differ in x.
    pub slope: f64,
    /// Sum of the squares of x less its mean.
    pub spread: f64,
}

impl Line {
    /// The line through these points.
    ///
    /// ```
    /// use pigtail_numerics::line::Line;
    /// let line = Line::through([(0.0, 1.0), (1.0, 3.0), (2.0, 5.0)]);
    /// assert_eq!((line.slope, line.at(10.0), line.left(0.0, 1.5)), (2.0, 21.0, 0.5));
    /// ```
    pub fn through(points: impl IntoIterator<Item = (f64, f64), IntoIter: Clone>) -> Self {
        let points = points.into_iter();
        let (mut n, mut x, mut y) = (0.0, 0.0, 0.0);
        for (a, b) in points.clone() {
            n += 1.0;
            x += a;
            y += b;
        }
        let (x, y) = (x / n, y / n);
        let (mut spread, mut together) = (0.0, 0.0);
        for (a, b) in points {
            spread += (a - x) * (a - x);
            together += (a - x) * (b - y);
        }
        let slope = if spread > 0.0 { together / spread } else { 0.0 };
        Self {
            x,
            y,
            slope,
            spread,
        }
    }

    /// Its y at an x.
    pub fn at(&self, x: f64) -> f64 {
        self.y + self.slope * (x - self.x)
    }

    /// What it leaves of a point, along y.
    pub fn left(&self, x: f64, y: f64) -> f64 {
        y - self.y - self.slope * (x - self.x)
    }
}

//! What a figure shows, apart from how it is drawn.

/// Points of a curve.
pub type Points = Vec<(f64, f64)>;

/// A picture with its axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Name and unit of the axis across, and its ends where they are not to be found from the data.
    pub x: (&'static str, Option<(f64, f64)>),
    /// The same of the axis upward.
    pub y: (&'static str, Option<(f64, f64)>),
    /// What is in it.
    pub content: Content,
    /// What to see in it.
    pub caption: String,
    /// Whether the axis upward is logarithmic.
    pub log_y: bool,
    /// Whether both axes have one scale: places on a plane, whose form is to be seen.
    pub equal: bool,
    /// What the values from 0 to 1 of cells and dots are; empty where they are all one.
    pub colour: &'static str,
}

/// What is in a picture.
#[derive(Debug, Clone, PartialEq)]
pub enum Content {
    /// Named curves.
    Curves(Vec<(String, Points)>),
    /// A histogram of values in so many bars.
    Bars(Vec<f64>, usize),
    /// Cells up to x and y with a value from 0 to 1, and their size.
    Cells(Vec<(f64, f64, f64)>, (f64, f64)),
    /// Points with a value from 0 to 1.
    Dots(Vec<(f64, f64, f64)>),
}

/// More points would show no more.
const POINTS: usize = 600;

/// Every so many of a series of points that no more than some hundred are left, and the last.
pub fn thin(points: impl IntoIterator<Item = (f64, f64)>) -> Points {
    let all: Points = points.into_iter().collect();
    let every = all.len().div_ceil(POINTS).max(1);
    let mut thin: Points = all.iter().copied().step_by(every).collect();
    if thin.last() != all.last() {
        thin.extend(all.last());
    }
    thin
}

impl Picture {
    /// Curves over axes whose ends are found from them.
    pub fn curves<N: Into<String>>(
        x: &'static str,
        y: &'static str,
        curves: impl IntoIterator<Item = (N, Points)>,
    ) -> Self {
        let curves = curves.into_iter().map(|(n, p)| (n.into(), p)).collect();
        Self::of(x, y, Content::Curves(curves))
    }

    /// Any content over axes whose ends are found from it.
    pub fn of(x: &'static str, y: &'static str, content: Content) -> Self {
        Self {
            x: (x, None),
            y: (y, None),
            content,
            caption: String::new(),
            log_y: false,
            equal: false,
            colour: "",
        }
    }

    /// With ends of the axis across.
    #[must_use]
    pub fn x(mut self, from: f64, to: f64) -> Self {
        self.x.1 = Some((from, to));
        self
    }

    /// With ends of the axis upward.
    #[must_use]
    pub fn y(mut self, from: f64, to: f64) -> Self {
        self.y.1 = Some((from, to));
        self
    }

    /// With a logarithmic axis upward.
    #[must_use]
    pub fn log_y(mut self) -> Self {
        self.log_y = true;
        self
    }

    /// With one scale for both axes.
    #[must_use]
    pub fn equal(mut self) -> Self {
        self.equal = true;
        self
    }

    /// With the name of what colours show.
    #[must_use]
    pub fn colour(mut self, name: &'static str) -> Self {
        self.colour = name;
        self
    }

    /// With a caption.
    #[must_use]
    pub fn caption(mut self, text: impl Into<String>) -> Self {
        self.caption = text.into();
        self
    }
}

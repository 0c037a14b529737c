//! The seven schematics of the thesis (Figs. 1.1, 1.2, 2.1, 2.2, 3.1, 4.1 and 4.2), drawn by our own hand from the shipped
//! rig's dimensions for the book. A test fails where the rig has other dimensions than the drawings;
//! `UPDATE_PAGES=1 cargo test -p pigtail --test schematics` draws them anew.

use pigtail_model::fivebar::FiveBar;
use pigtail_session::Setup;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

/// A drawing that grows from top to bottom. Lengths are units of the picture.
struct Drawing {
    body: String,
    size: (f64, f64),
}

const LINE: &str = "#334";
const LINK: &str = "#2b6cb0";
const LIGHT: &str = "#d9480f";
const GREY: &str = "#d8dde6";

impl Drawing {
    fn new(width: f64, height: f64, title: &str) -> Self {
        let mut drawing = Self {
            body: String::new(),
            size: (width, height),
        };
        drawing.text(0.5 * width, 22.0, "middle", title);
        drawing
    }

    fn line(&mut self, from: (f64, f64), to: (f64, f64), colour: &str, width: f64) {
        let _ = writeln!(
            self.body,
            "<line x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\" stroke=\"{colour}\" stroke-width=\"{width}\" \
             stroke-linecap=\"round\"/>",
            from.0, from.1, to.0, to.1
        );
    }

    fn arrow(&mut self, from: (f64, f64), to: (f64, f64), colour: &str) {
        self.line(from, to, colour, 1.5);
        let (dx, dy) = (to.0 - from.0, to.1 - from.1);
        let long = dx.hypot(dy).max(1e-9);
        let (ux, uy) = (7.0 * dx / long, 7.0 * dy / long);
        for side in [-0.5, 0.5] {
            let back = (to.0 - ux - side * uy, to.1 - uy + side * ux);
            self.line(to, back, colour, 1.5);
        }
    }

    fn rect(&mut self, at: (f64, f64), size: (f64, f64), fill: &str) {
        let _ = writeln!(
            self.body,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"{fill}\" stroke=\"{LINE}\"/>",
            at.0, at.1, size.0, size.1
        );
    }

    fn circle(&mut self, at: (f64, f64), radius: f64, fill: &str) {
        let _ = writeln!(
            self.body,
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"{radius:.1}\" fill=\"{fill}\" stroke=\"{LINE}\"/>",
            at.0, at.1
        );
    }

    fn shape(&mut self, points: &[(f64, f64)], fill: &str) {
        let points: Vec<String> = points
            .iter()
            .map(|(x, y)| format!("{x:.1},{y:.1}"))
            .collect();
        let _ = writeln!(
            self.body,
            "<polygon points=\"{}\" fill=\"{fill}\" stroke=\"{LINE}\"/>",
            points.join(" ")
        );
    }

    fn text(&mut self, x: f64, y: f64, anchor: &str, text: &str) {
        let _ = writeln!(
            self.body,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{text}</text>"
        );
    }

    fn svg(&self) -> String {
        let (w, h) = self.size;
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {w:.0} {h:.0}\" font-family=\"sans-serif\" \
             font-size=\"13\" fill=\"{LINE}\">\n<rect width=\"{w:.0}\" height=\"{h:.0}\" fill=\"#fff\"/>\n{}</svg>\n",
            self.body
        )
    }
}

/// A length in millimetres, or micrometres where it is short.
fn length(metres: f64) -> String {
    if metres.abs() < 1e-3 {
        format!("{} um", (1e9 * metres).round() * 1e-3)
    } else {
        format!("{} mm", (1e6 * metres).round() * 1e-3)
    }
}

/// The five-bar at home, its bases' middle at `middle`, so many units a metre, y up. Returns the endpoint.
fn five_bar(
    drawing: &mut Drawing,
    setup: &Setup,
    middle: (f64, f64),
    scale: f64,
) -> [(f64, f64); 5] {
    let bar = &setup.rig.calibration.geometry.five_bar;
    let links = FiveBar::new(bar.base, bar.proximal, bar.distal).expect("it can be built");
    let [a, b] = links
        .inverse(bar.home[0], bar.home[1])
        .expect("home is in reach");
    let half = 0.5 * bar.base;
    let at = |x: f64, y: f64| (middle.0 + scale * x, middle.1 - scale * y);
    let elbow = |base: f64, angle: f64| {
        at(
            base + bar.proximal * angle.cos(),
            bar.proximal * angle.sin(),
        )
    };
    let points = [
        at(-half, 0.0),
        elbow(-half, a.0),
        at(bar.home[0], bar.home[1]),
        elbow(half, b.0),
        at(half, 0.0),
    ];
    for pair in points.windows(2) {
        drawing.line(pair[0], pair[1], LINK, 6.0);
    }
    for (k, point) in points.iter().enumerate() {
        let base = k == 0 || k == 4;
        drawing.circle(
            *point,
            if base { 9.0 } else { 5.0 },
            if base { GREY } else { "#fff" },
        );
    }
    points
}

fn process() -> Drawing {
    let mut d = Drawing::new(640.0, 300.0, "The process (Fig. 1.1)");
    d.rect((20.0, 200.0), (600.0, 26.0), GREY);
    d.text(610.0, 250.0, "end", "conveyor");
    d.arrow((40.0, 246.0), (120.0, 246.0), LINE);
    for x in [60.0, 250.0, 440.0] {
        d.rect((x, 150.0), (140.0, 50.0), "#fff");
        d.rect((x + 45.0, 165.0), (50.0, 20.0), LIGHT);
        d.circle((x + 22.0, 175.0), 14.0, "none");
        d.circle((x + 118.0, 175.0), 14.0, "none");
    }
    d.text(130.0, 218.0, "middle", "tray: chips and fiber coils");
    for (x, name) in [
        (215.0, "left manipulator: input"),
        (425.0, "right manipulator: outputs"),
    ] {
        d.rect((x - 45.0, 50.0), (90.0, 36.0), GREY);
        d.line(
            (x, 86.0),
            (if x < 320.0 { 290.0 } else { 350.0 }, 172.0),
            LINK,
            6.0,
        );
        d.text(x, 44.0, "middle", name);
    }
    d.rect((300.0, 60.0), (40.0, 26.0), "#fff");
    d.text(320.0, 104.0, "middle", "vision");
    d.text(
        320.0,
        276.0,
        "middle",
        "pick up, adhesive, align, cure, release",
    );
    d
}

fn manipulator(setup: &Setup) -> Drawing {
    let spec = &setup.rig.spec;
    let mut d = Drawing::new(640.0, 330.0, "A macro/micro manipulator (Fig. 1.2)");
    d.rect((30.0, 270.0), (260.0, 16.0), GREY);
    d.text(
        160.0,
        306.0,
        "middle",
        &format!("linear stage, {} of travel", length(spec.z_stage.travel)),
    );
    d.rect((40.0, 236.0), (240.0, 34.0), "#fff");
    d.text(160.0, 258.0, "middle", "harmonic drives");
    let points = five_bar(&mut d, setup, (160.0, 225.0), 1500.0);
    let (x, y) = points[2];
    d.rect((x - 14.0, y - 26.0), (28.0, 20.0), LIGHT);
    d.arrow((x + 20.0, y - 16.0), (430.0, 90.0), LINE);
    d.rect((430.0, 60.0), (170.0, 150.0), "#fff");
    d.text(515.0, 52.0, "middle", "micro, enlarged");
    for (dx, dy) in [(-38.0, 38.0), (38.0, 38.0)] {
        d.line((515.0 + 1.4 * dx, 190.0), (515.0 + dx, 152.0), LIGHT, 5.0);
        d.line((515.0 + dx, 190.0 - dy), (515.0, 105.0), LINK, 3.0);
    }
    d.circle((515.0, 105.0), 6.0, LIGHT);
    d.text(
        515.0,
        92.0,
        "middle",
        &format!("{} in two axes", length(spec.micro.range)),
    );
    d.text(515.0, 228.0, "middle", "bimorph piezos carry inert links");
    d
}

fn macro_manipulator(setup: &Setup) -> Drawing {
    let spec = &setup.rig.spec;
    let bar = &setup.rig.calibration.geometry.five_bar;
    let mut d = Drawing::new(640.0, 400.0, "The macro manipulator (Fig. 2.1)");
    let points = five_bar(&mut d, setup, (230.0, 330.0), 2600.0);
    let [a, elbow, end, other, b] = points;
    let mid = |p: (f64, f64), q: (f64, f64)| (0.5 * (p.0 + q.0), 0.5 * (p.1 + q.1));
    let at = mid(a, elbow);
    d.text(at.0 - 12.0, at.1, "end", &length(bar.proximal));
    let at = mid(elbow, end);
    d.text(at.0 - 12.0, at.1 - 6.0, "end", &length(bar.distal));
    d.arrow((a.0, 358.0), (b.0, 358.0), LINE);
    d.text(230.0, 378.0, "middle", &length(bar.base));
    // Belts in series hold the endpoint's orientation.
    for (from, to) in [(b, other), (other, end)] {
        let (dx, dy) = (to.0 - from.0, to.1 - from.1);
        let long = dx.hypot(dy);
        for side in [-9.0, 9.0] {
            let (ox, oy) = (-side * dy / long, side * dx / long);
            d.line(
                (from.0 + ox, from.1 + oy),
                (to.0 + ox, to.1 + oy),
                LINE,
                1.0,
            );
        }
    }
    d.rect((end.0 - 12.0, end.1 - 24.0), (24.0, 16.0), LIGHT);
    let half = 0.5 * 2600.0 * spec.five_bar.workspace;
    d.shape(
        &[
            (end.0 - half, end.1 - half),
            (end.0 + half, end.1 - half),
            (end.0 + half, end.1 + half),
            (end.0 - half, end.1 + half),
        ],
        "none",
    );
    for (k, text) in [
        format!("workspace {} by as much", length(spec.five_bar.workspace)),
        format!("harmonic drives {}:1", spec.five_bar.drive.gear_ratio),
        "two timing belts hold the orientation".to_owned(),
        format!("z: {} of travel,", length(spec.z_stage.travel)),
        format!(
            "  a turn of the screw {},",
            length(setup.rig.calibration.geometry.z.lead)
        ),
        format!("  behind a belt of {}:1", spec.z_stage.drive.gear_ratio),
    ]
    .iter()
    .enumerate()
    {
        d.text(420.0, 230.0 + 22.0 * k as f64, "start", text);
    }
    d
}

fn free_body() -> Drawing {
    let mut d = Drawing::new(640.0, 230.0, "A joint, cut free (Fig. 2.2)");
    d.circle((150.0, 120.0), 48.0, GREY);
    d.text(150.0, 125.0, "middle", "motor Jm");
    d.circle((490.0, 120.0), 58.0, GREY);
    d.text(490.0, 125.0, "middle", "load Jl");
    let mut last = (198.0, 120.0);
    for k in 0..=12 {
        let x = 230.0 + 15.0 * f64::from(k);
        let y = match k {
            0 | 12 => 120.0,
            k if k % 2 == 0 => 106.0,
            _ => 134.0,
        };
        d.line(last, (x, y), LINE, 1.5);
        last = (x, y);
    }
    d.line(last, (432.0, 120.0), LINE, 1.5);
    d.text(
        320.0,
        92.0,
        "middle",
        "Ts = ks (r qm - ql) + kh (r qm - ql)^3",
    );
    d.text(320.0, 160.0, "middle", "gear r");
    for (from, to, text, anchor, at) in [
        (
            (70.0, 60.0),
            (120.0, 76.0),
            "Tm, of the voltage u",
            "start",
            (30.0, 52.0),
        ),
        (
            (120.0, 170.0),
            (76.0, 190.0),
            "Fm: friction",
            "start",
            (30.0, 212.0),
        ),
        (
            (560.0, 172.0),
            (596.0, 192.0),
            "Fl: friction",
            "end",
            (620.0, 212.0),
        ),
    ] {
        d.arrow(from, to, LIGHT);
        d.text(at.0, at.1, anchor, text);
    }
    d.text(196.0, 76.0, "start", "qm");
    d.text(490.0, 54.0, "middle", "ql");
    d
}

fn workspace(setup: &Setup) -> Drawing {
    let ports = &setup.rig.recipe.ports;
    let core = setup.rig.spec.sensing_fiber.core;
    let mut d = Drawing::new(640.0, 320.0, "The workspace, seen from above (Fig. 3.1)");
    // The chip is drawn short: its facets' angle and the ports are to scale across.
    let scale = 0.25e6;
    let (left, right, middle) = (200.0, 430.0, 165.0);
    let x = |metres: f64| middle - scale * metres;
    let [one, two] = ports.outputs;
    let slope = (one[2] - two[2]) / (one[0] - two[0]);
    let lean = |from: f64, across: f64, sign: f64| from + sign * slope * scale * across;
    let edge = 0.36e-3;
    d.shape(
        &[
            (lean(left, edge, -1.0), x(edge)),
            (lean(right, edge, 1.0), x(edge)),
            (lean(right, -edge, 1.0), x(-edge)),
            (lean(left, -edge, -1.0), x(-edge)),
        ],
        GREY,
    );
    let branch = (310.0, x(0.0));
    d.line((left, x(ports.input[0])), branch, LIGHT, 2.5);
    for output in ports.outputs {
        let to = (lean(right, output[0], 1.0), x(output[0]));
        d.line(branch, to, LIGHT, 2.5);
        let far = (to.0 + 150.0, to.1 - 150.0 * ports.exit_angle.tan());
        d.line(
            (to.0 + 6.0, to.1 - 6.0 * ports.exit_angle.tan()),
            far,
            LINK,
            5.0,
        );
    }
    d.line(
        (left - 6.0, x(0.0) - 1.0),
        (40.0, x(0.0) - 160.0 * ports.exit_angle.tan()),
        LINK,
        5.0,
    );
    let out = (lean(right, one[0], 1.0), x(one[0]));
    d.rect((out.0 + 40.0, out.1 - 70.0), (110.0, scale * core), "#fff");
    d.text(
        out.0 + 95.0,
        out.1 - 78.0,
        "middle",
        &format!("sensing fiber, core {}", length(core)),
    );
    d.text(110.0, 215.0, "middle", "input fiber: left");
    d.text(560.0, 262.0, "middle", "output fibers: right");
    d.text(
        315.0,
        290.0,
        "middle",
        &format!(
            "outputs {} apart; light leaves at {:.1} deg to z",
            length(one[0] - two[0]),
            ports.exit_angle.to_degrees()
        ),
    );
    d.arrow((40.0, 290.0), (90.0, 290.0), LINE);
    d.text(96.0, 294.0, "start", "z");
    d.arrow((40.0, 290.0), (40.0, 245.0), LINE);
    d.text(40.0, 238.0, "middle", "x");
    d
}

fn micro(setup: &Setup) -> Drawing {
    let spec = &setup.rig.spec.micro;
    let mut d = Drawing::new(
        640.0,
        360.0,
        "The micro manipulator and what it reaches (Fig. 4.1)",
    );
    let end = (320.0, 130.0);
    let angle = spec.angle;
    for side in [-1.0, 1.0] {
        let along = (side * angle.cos(), angle.sin());
        let knee = (end.0 + 120.0 * along.0, end.1 + 120.0 * along.1);
        let base = (knee.0 - 120.0 * along.0 * 0.15, knee.1 + 110.0);
        d.line(end, knee, LINK, 4.0);
        d.line(knee, base, LIGHT, 8.0);
        d.rect((base.0 - 24.0, base.1), (48.0, 14.0), GREY);
        d.circle(knee, 4.0, "#fff");
        d.text(
            knee.0 + side * 22.0,
            knee.1 + 60.0,
            if side < 0.0 { "end" } else { "start" },
            if side < 0.0 {
                "bimorph, vx"
            } else {
                "bimorph, vy"
            },
        );
    }
    // Its range, as a square that stands on its corner, a unit a micrometre.
    let half = 0.5e6 * spec.range;
    let (c, s) = (angle.cos(), angle.sin());
    let corner = |u: f64, v: f64| {
        (
            end.0 + half * (u * c - v * s),
            end.1 - half * (u * s + v * c),
        )
    };
    d.shape(
        &[
            corner(1.0, 1.0),
            corner(-1.0, 1.0),
            corner(-1.0, -1.0),
            corner(1.0, -1.0),
        ],
        "none",
    );
    d.circle(end, 4.0, LIGHT);
    d.text(
        end.0 + 60.0,
        end.1 - 40.0,
        "start",
        &format!(
            "{} by {} at {:.0} deg, {} across",
            length(spec.range),
            length(spec.range),
            angle.to_degrees(),
            length((2.0_f64.sqrt() * spec.range * 1e6).round() * 1e-6)
        ),
    );
    d.text(end.0 - 60.0, end.1 - 70.0, "end", "inert links");
    d
}

fn bimorph(setup: &Setup) -> Drawing {
    let spec = &setup.rig.spec.micro;
    let mut d = Drawing::new(640.0, 230.0, "A bimorph piezo (Fig. 4.2)");
    d.rect((60.0, 90.0), (60.0, 70.0), GREY);
    let bend = |x: f64| 22.0 * ((x - 120.0) / 400.0).powi(2);
    for (top, fill) in [(0.0, LIGHT), (14.0, "#f4a261")] {
        let upper = (0..=40).map(|k| 120.0 + 10.0 * f64::from(k));
        let mut points: Vec<(f64, f64)> =
            upper.clone().map(|x| (x, 110.0 + top - bend(x))).collect();
        points.extend(upper.rev().map(|x| (x, 124.0 + top - bend(x))));
        d.shape(&points, fill);
    }
    d.line((520.0, 124.0), (560.0, 124.0), LINE, 1.0);
    d.arrow((548.0, 124.0), (548.0, 102.0), LINE);
    d.text(556.0, 108.0, "start", &length(spec.range));
    d.line((90.0, 90.0), (90.0, 60.0), LINE, 1.5);
    d.text(90.0, 52.0, "middle", &format!("0 to {} V", spec.voltage));
    d.text(
        320.0,
        190.0,
        "middle",
        "two strips: one stretches, one shrinks; the cantilever bends",
    );
    d
}

/// Each with its number.
fn all(setup: &Setup) -> [(&'static str, Drawing); 7] {
    [
        ("1.1", process()),
        ("1.2", manipulator(setup)),
        ("2.1", macro_manipulator(setup)),
        ("2.2", free_body()),
        ("3.1", workspace(setup)),
        ("4.1", micro(setup)),
        ("4.2", bimorph(setup)),
    ]
}

#[test]
fn the_drawings_have_the_rigs_dimensions() {
    let setup = Setup::load("afpm", "y-branch").expect("the shipped rig");
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../book/src/pictures");
    for (id, drawing) in all(&setup) {
        let path = folder.join(format!("thesis-{id}.svg"));
        let svg = drawing.svg();
        if std::env::var_os("UPDATE_PAGES").is_some() {
            fs::write(&path, &svg).expect("the picture can be written");
        }
        let there = fs::read_to_string(&path).unwrap_or_default();
        assert!(
            there == svg,
            "{} is out of date; `UPDATE_PAGES=1 cargo test -p pigtail --test schematics` draws it anew",
            path.display()
        );
    }
}

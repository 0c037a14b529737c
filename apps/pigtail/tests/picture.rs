//! The picture of the machine that README and book begin with: drawn to scale from the shipped rig, and moving. A test fails
//! where the rig has other dimensions than the picture; `UPDATE_PAGES=1 cargo test -p pigtail --test picture` draws it anew.

use pigtail_model::fivebar::FiveBar;
use pigtail_session::Setup;
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

/// Moments of the loop that are drawn; between them it is drawn straight.
const MOMENTS: usize = 24;
/// Units of the picture a millimetre.
const SCALE: f64 = 2.4;

/// Points as SVG has them, from millimetres, about an origin in the picture, y up.
fn points(origin: (f64, f64), all: &[(f64, f64)]) -> String {
    let one =
        |(x, y): &(f64, f64)| format!("{:.1},{:.1}", origin.0 + SCALE * x, origin.1 - SCALE * y);
    all.iter().map(one).collect::<Vec<_>>().join(" ")
}

fn moving(attribute: &str, values: &[String]) -> String {
    format!(
        "<animate attributeName=\"{attribute}\" dur=\"8s\" repeatCount=\"indefinite\" values=\"{}\"/>",
        values.join(";")
    )
}

/// Where the endpoint and the stages are, as shares of their ways: apart, to the chip, a circle there, and back.
fn share(moment: usize) -> (f64, f64) {
    let t = moment as f64 / (MOMENTS - 1) as f64;
    let near = (1.15 * (0.5 - 0.5 * (TAU * t).cos())).min(1.0);
    (near, TAU * 3.0 * t)
}

#[expect(
    clippy::too_many_lines,
    reason = "a picture is written from top to bottom"
)]
fn drawn(setup: &Setup) -> String {
    let geometry = &setup.rig.calibration.geometry;
    let bar = &geometry.five_bar;
    let five_bar = FiveBar::new(bar.base, bar.proximal, bar.distal).expect("it can be built");
    let mm = 1e3;
    let half = 0.5 * bar.base * mm;
    let home = (bar.home[0] * mm, bar.home[1] * mm);
    // Front: one five-bar and its way.
    let front = (190.0, 330.0);
    let place = |moment: usize| {
        let (near, turn) = share(moment);
        let way = 9.0 * (1.0 - near);
        (
            home.0 + way * turn.cos(),
            home.1 - 6.0 * (1.0 - near) + way * turn.sin(),
        )
    };
    let links = |moment: usize| {
        let (x, y) = place(moment);
        let angles = five_bar.inverse(x / mm, y / mm).expect("within reach");
        let elbow = |side: f64, k: usize| {
            let angle = angles[k].0;
            (
                side * half + bar.proximal * mm * angle.cos(),
                bar.proximal * mm * angle.sin(),
            )
        };
        [
            (-half, 0.0),
            elbow(-1.0, 0),
            (x, y),
            elbow(1.0, 1),
            (half, 0.0),
        ]
    };
    let all: Vec<String> = (0..MOMENTS).map(|m| points(front, &links(m))).collect();
    let ends = |of: fn((f64, f64)) -> f64| -> Vec<String> {
        let at = |m: usize| place(m);
        (0..MOMENTS)
            .map(|m| {
                let (x, y) = at(m);
                let shown = of((front.0 + SCALE * x, front.1 - SCALE * y));
                format!("{shown:.1}")
            })
            .collect()
    };
    // Side: both stages along z, the chip between them.
    let side = (500.0, 150.0);
    let long = 20.0;
    let travel = setup.rig.spec.z_stage.travel * mm;
    let stage = |left: bool, moment: usize| {
        let way = 0.5 * travel * (1.0 - share(moment).0);
        if left { -way } else { way }
    };
    let shifts = |left: bool| -> Vec<String> {
        (0..MOMENTS)
            .map(|m| format!("{:.1} 0", SCALE * stage(left, m)))
            .collect()
    };
    let shift = |left: bool| {
        format!(
            "<animateTransform attributeName=\"transform\" type=\"translate\" dur=\"8s\" repeatCount=\"indefinite\" values=\"{}\"/>",
            shifts(left).join(";")
        )
    };
    let (chip_left, chip_right) = (side.0, side.0 + SCALE * long);
    let mut svg = String::new();
    let _ = writeln!(
        svg,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 900 400\" font-family=\"system-ui, sans-serif\" font-size=\"13\">\n\
         <title>The machine of the rig afpm, to scale: a five-bar on a stage, a piezo micro on the five-bar, twice</title>\n\
         <style>.ink{{fill:#1f2933}}.soft{{fill:#667}}.link{{fill:none;stroke:#1f77b4;stroke-width:7;stroke-linejoin:round;stroke-linecap:round}}\
         .pivot{{fill:#fff;stroke:#1f2933;stroke-width:2}}.base{{fill:#c8d0d8}}.micro{{fill:#d62728}}.chip{{fill:#2a9d8f}}.fiber{{stroke:#e08a00;stroke-width:2.5}}\
         .guide{{stroke:#fff;stroke-width:1.5;fill:none}}.line{{stroke:#8893a0;stroke-width:1}}\
         @media (prefers-color-scheme: dark){{.ink{{fill:#e6e9ec}}.soft{{fill:#9aa5b1}}.base{{fill:#48525c}}.pivot{{fill:#14191f;stroke:#e6e9ec}}}}</style>"
    );
    let _ = writeln!(
        svg,
        "<text class=\"ink\" x=\"20\" y=\"24\">from the front: a five-bar, {:.0} mm base, links of {:.0} and {:.1} mm, its motors geared {:.0} : 1</text>",
        bar.base * mm,
        bar.proximal * mm,
        bar.distal * mm,
        setup.rig.spec.five_bar.drive.gear_ratio
    );
    let _ = writeln!(
        svg,
        "<rect class=\"base\" x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"22\" rx=\"4\"/>",
        front.0 - SCALE * (half + 10.0),
        front.1 - 8.0,
        2.0 * SCALE * (half + 10.0)
    );
    let _ = writeln!(
        svg,
        "<polyline class=\"link\" points=\"{}\">{}</polyline>",
        all[0],
        moving("points", &all)
    );
    for x in [-half, half] {
        let at = points(front, &[(x, 0.0)]);
        let (x, y) = at.split_once(',').expect("a pair");
        let _ = writeln!(
            svg,
            "<circle class=\"pivot\" cx=\"{x}\" cy=\"{y}\" r=\"7\"/>"
        );
    }
    let (xs, ys) = (ends(|p| p.0), ends(|p| p.1));
    let _ = writeln!(
        svg,
        "<circle class=\"micro\" cx=\"{}\" cy=\"{}\" r=\"6\">{}{}</circle>",
        xs[0],
        ys[0],
        moving("cx", &xs),
        moving("cy", &ys)
    );
    let _ = writeln!(
        svg,
        "<text class=\"soft\" x=\"20\" y=\"372\">The red dot is the micro: two piezos of {:.0} um. It moves a fiber in steps of nanometres,</text>\n\
         <text class=\"soft\" x=\"20\" y=\"390\">where the five-bar below it sticks, slips and winds up by tens of micrometres.</text>",
        setup.rig.spec.micro.range * 1e6
    );
    // The side view.
    let _ = writeln!(
        svg,
        "<text class=\"ink\" x=\"400\" y=\"70\">from the side: two of them on stages of {travel:.0} mm</text>"
    );
    let _ = writeln!(
        svg,
        "<rect class=\"chip\" x=\"{chip_left:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"14\"/>\
         <path class=\"guide\" d=\"M{chip_left:.1} {mid:.1}h{a:.1}l{b:.1} -4h{c:.1}M{:.1} {mid:.1}l{b:.1} 4h{c:.1}\"/>",
        side.1 - 7.0,
        chip_right - chip_left,
        chip_left + 16.0,
        mid = side.1,
        a = 16.0,
        b = 12.0,
        c = chip_right - chip_left - 28.0,
    );
    for left in [true, false] {
        let (tip, out, name) = if left {
            (chip_left - 1.5, -1.0, "input fiber")
        } else {
            (chip_right + 1.5, 1.0, "output fibers")
        };
        let column = tip + out * 62.0;
        let _ = writeln!(
            svg,
            "<g transform=\"translate({})\">{}<line class=\"fiber\" x1=\"{tip:.1}\" y1=\"{y:.1}\" x2=\"{:.1}\" y2=\"{y:.1}\"/>\
             <rect class=\"micro\" x=\"{:.1}\" y=\"{:.1}\" width=\"14\" height=\"12\"/>\
             <rect class=\"link\" style=\"stroke-width:2\" x=\"{:.1}\" y=\"{y:.1}\" width=\"12\" height=\"120\"/>\
             <rect class=\"base\" x=\"{:.1}\" y=\"{:.1}\" width=\"64\" height=\"18\" rx=\"3\"/>\
             <text class=\"soft\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{name}</text></g>",
            shifts(left)[0],
            shift(left),
            column + out * 26.0,
            column - 7.0,
            side.1 - 6.0,
            column - 6.0,
            column - 32.0,
            side.1 + 120.0,
            column + out * 6.0,
            side.1 - 22.0,
            y = side.1,
        );
    }
    let _ = writeln!(
        svg,
        "<line class=\"line\" x1=\"350\" y1=\"{y:.1}\" x2=\"850\" y2=\"{y:.1}\"/>\
         <text class=\"soft\" x=\"400\" y=\"{below:.1}\">A chip of {long:.0} mm between them. A fiber is aligned within 0.1 um in x and y,</text>\n\
         <text class=\"soft\" x=\"400\" y=\"{last:.1}\">from no light at all.</text>",
        y = side.1 + 141.0,
        below = side.1 + 170.0,
        last = side.1 + 188.0,
    );
    svg += "</svg>\n";
    svg
}

#[test]
fn the_picture_of_the_machine_has_the_dimensions_of_the_rig() {
    let setup = Setup::load("afpm", "y-branch").expect("the rig that ships");
    let wanted = drawn(&setup);
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../book/src/pictures/machine.svg");
    if std::env::var_os("UPDATE_PAGES").is_some() {
        fs::write(&path, &wanted).expect("the picture can be written");
    }
    let there = fs::read_to_string(&path).unwrap_or_default();
    assert!(there == wanted, "{} is out of date", path.display());
}

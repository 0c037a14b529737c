//! Enters an algorithm of one's own into the benchmark and prints the table:
//!
//! ```text
//! cargo run --release --example my_algorithm
//! ```
//!
//! This one finds light as the baselines do and brings its own climb: a line in x through the light,
//! a line in y, each time to the vertex of a parabola through what was seen. An algorithm that wants
//! to do all by itself is a `fn(&mut Station, &Recipe) -> Vec<FiberReport>` that never calls
//! `with_climb`.

use anyhow::Result;
use pigtail_control::baselines::{Spot, with_climb};
use pigtail_control::cell::AlignmentCell;
use pigtail_control::job::FiberReport;
use pigtail_control::outcome::Halt;
use pigtail_control::recipe::Recipe;
use pigtail_control::station::Station;
use pigtail_evaluate::benchmark::{ALGORITHMS, Algorithm, run};
use pigtail_model::frames::Displacement;
use pigtail_report::benchmark_table;
use pigtail_session::rig::{DEFAULT_RECIPE_NAME, DEFAULT_RIG_NAME};
use pigtail_session::setup::Setup;

/// Devices, from this seed on.
const DEVICES: u64 = 20;
const SEED: u64 = 1000;

const MINE: Algorithm = Algorithm {
    name: "my-lines",
    about: "spiral, then parabolas through lines in x and y",
    run: my_lines,
};

fn my_lines(station: &mut Station, recipe: &Recipe) -> Vec<FiberReport> {
    with_climb(station, recipe, async |cell, _, spot| {
        for span in [1.0, 1.0, 0.5] {
            for along in [Displacement::new(1.0, 0.0), Displacement::new(0.0, 1.0)] {
                line(cell, spot, span * spot.reach, along).await?;
            }
        }
        Ok(())
    })
}

/// Looks at five points of a line and goes to where a parabola through them is highest.
async fn line(
    cell: &AlignmentCell<'_>,
    spot: &Spot,
    span: f64,
    along: Displacement,
) -> Result<(), Halt> {
    let here = cell.micro(spot.side);
    let mut light = [0.0; 5];
    for (k, volts) in light.iter_mut().enumerate() {
        let way = span * (k as f64 / 2.0 - 1.0);
        cell.move_micro(spot.side, here + along * way)?;
        cell.wait(6e-3).await?;
        *volts = cell.level(spot.channel, spot.average).await?.mean;
    }
    // Least squares over -1, -1/2, 0, 1/2, 1: slope and curvature in units of the span.
    let slope = (2.0 * (light[4] - light[0]) + (light[3] - light[1])) / 5.0;
    let bend = (2.0 * (light[0] + light[4]) - (light[1] + light[3]) - 2.0 * light[2]) * 8.0 / 14.0;
    let vertex = if bend < 0.0 {
        (-slope / bend).clamp(-1.0, 1.0)
    } else {
        slope.signum()
    };
    let way = vertex * span;
    cell.move_micro(spot.side, here + along * way)?;
    cell.wait(20e-3).await?;
    Ok(())
}

#[expect(clippy::print_stdout, reason = "printing is what it is for")]
fn main() -> Result<()> {
    let setup = Setup::load(DEFAULT_RIG_NAME, DEFAULT_RECIPE_NAME)?;
    let entries = [&[MINE], ALGORITHMS].concat();
    let measured = run(&setup, &entries, SEED, DEVICES, &|_| ())?;
    for row in benchmark_table(&measured.document) {
        let cells: Vec<String> = row
            .iter()
            .map(|cell| format!("{:>10}", cell.replace('\n', " ")))
            .collect();
        println!("{}", cells.join(" "));
    }
    Ok(())
}

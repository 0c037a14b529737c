//! Fleets: what is drawn is what their files say, and a file that says something wrong is refused with its name.

use pigtail_session::Setup;
use pigtail_session::fleet::Fleet;
use pigtail_twin::{Plant, Specimen, Twin};
use std::collections::BTreeMap;
use std::fs;
use std::sync::Arc;
use tempfile::TempDir;

const SHIPPED: [&str; 5] = ["nominal", "thesis", "workshop", "harsh", "shift"];

fn setup(fleet: &str) -> Setup {
    let setup = Setup::load("afpm", "y-branch").expect("the shipped rig");
    setup.of_fleet(fleet).expect("a fleet")
}

fn fleet(name: &str) -> Arc<Fleet> {
    setup(name).fleet.expect("it draws something")
}

/// A fleet of a file with this content, or its error; the file's name is gone from it.
fn written(text: &str) -> Result<Arc<Fleet>, String> {
    let folder = TempDir::new().expect("a folder");
    let file = folder.path().join("own.toml");
    fs::write(&file, format!("about = \"a test's\"\n{text}")).expect("a file");
    let setup = Setup::load("afpm", "y-branch").expect("the shipped rig");
    let name = file.display().to_string();
    match setup.of_fleet(&name) {
        Ok(setup) => Ok(setup.fleet.expect("it draws something")),
        Err(error) => {
            let error = error.to_string();
            assert!(error.contains(&name), "no {name} in: {error}");
            Err(error.replace(&name, ""))
        }
    }
}

fn plants(fleet: &Fleet, seeds: std::ops::Range<u64>) -> Vec<Plant> {
    seeds
        .map(|seed| {
            fleet
                .draw(seed)
                .unwrap_or_else(|why| panic!("{seed}: {why}"))
        })
        .collect()
}

fn sorted(values: impl IntoIterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<_> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    values
}

fn percentile(sorted: &[f64], share: f64) -> f64 {
    sorted[(share * (sorted.len() - 1) as f64).round() as usize]
}

#[test]
fn every_shipped_fleet_draws_machines() {
    for name in SHIPPED {
        let setup = setup(name);
        assert_eq!(setup.fleet_name(), name);
        assert_eq!(setup.fleet.is_none(), name == "nominal");
        for seed in 0..300 {
            let told = setup
                .at(seed)
                .unwrap_or_else(|why| panic!("{name}, {seed}: {why}"));
            let twin = told.twin(seed);
            assert!(twin.is_ok(), "{name}, {seed}: {:?}", twin.err());
        }
    }
}

#[test]
fn the_nominal_fleet_is_the_plant_as_it_is() {
    let plain = Setup::load("afpm", "y-branch").expect("the shipped rig");
    let nominal = setup("nominal");
    assert_eq!(nominal.plant, plain.plant);
    assert_eq!(nominal.rig.hashes, plain.rig.hashes);
    // Any other is told of with the files of the rig.
    assert_eq!(setup("thesis").rig.hashes.len(), plain.rig.hashes.len() + 1);
}

#[test]
fn a_seed_is_one_plant() {
    let (fleet, again) = (fleet("workshop"), fleet("workshop"));
    for seed in [0, 7, Specimen::of(7, 3).seed()] {
        let plant = fleet.draw(seed).expect("a plant");
        assert_eq!(plant, again.draw(seed).expect("a plant"));
        assert_ne!(plant, fleet.draw(seed + 1).expect("a plant"));
    }
}

#[test]
fn devices_of_a_machine_share_the_machine_and_nothing_else() {
    let setup = setup("workshop");
    let fleet = setup.fleet.clone().expect("it draws something");
    let seeds = [0, 1].map(|device| Specimen::of(7, device).seed());
    let [first, second] = seeds.map(|seed| fleet.draw(seed).expect("a plant"));
    assert_eq!(first.micro.resonance, second.micro.resonance);
    assert_eq!(first.micro.second, second.micro.second);
    assert_eq!(first.placement, second.placement);
    assert_eq!(first.floor, second.floor);
    assert_eq!(first.camera, second.camera);
    assert_eq!(first.electronics, second.electronics);
    assert_eq!(first.device.facet, second.device.facet);
    assert_ne!(first.device.mode_radius, second.device.mode_radius);
    assert_ne!(first.device.input, second.device.input);
    assert_ne!(first.fiber, second.fiber);
    assert_ne!(first.micro.history, second.micro.history);
    // One product: guides of two devices differ less than those of two machines.
    let [a, b] = [&first, &second].map(|plant| plant.device.mode_radius[0]);
    assert!((a / b).ln().abs() < 6.0 * 0.03, "{a} and {b}");
    let [told, too] = seeds.map(|seed| setup.at(seed).expect("a datasheet").rig.spec.clone());
    assert_eq!(told, too);
    let other = setup.at(8).expect("a datasheet").rig.spec.clone();
    assert_ne!(told.vision.accuracy_z, other.vision.accuracy_z);
}

#[test]
fn what_is_drawn_is_spread_as_the_file_says() {
    // resonance = { lognormal = 0.4, low = "50 Hz", high = "2 kHz" } around 200 Hz.
    let fleet = fleet("workshop");
    let plants = plants(&fleet, 0..2000);
    let resonances = sorted(plants.iter().map(|plant| plant.micro.resonance));
    for (share, wanted) in [(0.025, 91.0), (0.5, 200.0), (0.975, 440.0)] {
        let value = percentile(&resonances, share);
        // Three standard deviations of such a percentile of so many: of the median 0.4 * 1.25 / sqrt(2000).
        let off = if share == 0.5 { 0.034 } else { 0.075 };
        assert!((value / wanted - 1.0).abs() < off, "{value} for {wanted}");
    }
    // Half of the servos are a cycle late: none is so by more than the widest delay.
    let delays = sorted(plants.iter().map(|plant| plant.electronics.delay));
    assert!(delays[0] >= 0.0 && delays[1999] <= 0.4e-3);
    assert!((percentile(&delays, 0.5) / 0.2e-3 - 1.0).abs() < 0.1);
    // scale = { about = [0.0, 0.0], normal = 0.001 }: of a plain number about zero no share is meant. Of each, three standard deviations.
    for i in 0..2 {
        let squares: f64 = plants.iter().map(|p| p.camera.scale[i].powi(2)).sum();
        let deviation = (squares / plants.len() as f64).sqrt();
        assert!((deviation / 1e-3 - 1.0).abs() < 0.05, "{deviation}");
    }
}

#[test]
fn nothing_is_drawn_beyond_its_bounds() {
    let fleet = written(
        "[machine.micro]\n\
         resonance = { lognormal = 1.0, low = \"0.15 kHz\", high = \"250 Hz\" }\n\
         noise = { about = \"8 nm\", normal = \"8 nm\", low = \"0 nm\" }\n\
         damping = { uniform = 0.5, high = 0.6 }\n",
    )
    .expect("a fleet");
    let plants = plants(&fleet, 0..1000);
    let within = |of: fn(&Plant) -> f64, low: f64, high: f64| {
        let values = sorted(plants.iter().map(of));
        let (least, most) = (values[0], values[999]);
        // A bound may be off by what the error function leaves.
        let close = 1e-6 * high;
        assert!(
            least >= low - close && most <= high + close,
            "{least} to {most}"
        );
        // What is beyond is drawn anew, and not put onto the bound.
        let onto = |bound: f64| values.iter().filter(|v| (*v - bound).abs() < close).count();
        assert!(onto(low) < 3 && onto(high) < 3, "{least} to {most}");
        assert!(least < low + 0.02 * (high - low), "{least}");
    };
    within(|plant| plant.micro.resonance, 150.0, 250.0);
    within(|plant| plant.micro.damping, 0.25, 0.6);
    let noises = sorted(plants.iter().map(|plant| plant.micro.noise));
    assert!(noises[0] >= -1e-15, "{}", noises[0]);
}

#[test]
fn keys_that_are_drawn_with_one_thing_go_together() {
    let fleet = written(
        "[machine.micro]\n\
         resonance = { lognormal = 0.2, with = \"size\", correlation = 0.8 }\n\
         gain = { lognormal = 0.1, with = \"size\", correlation = -0.8 }\n\
         noise = { about = \"8 nm\", lognormal = 0.3 }\n\
         [machine.light]\n\
         full = { lognormal = 0.1, with = \"size\" }\n",
    )
    .expect("a fleet");
    let plants = plants(&fleet, 0..2000);
    let of = |key: fn(&Plant) -> f64| -> Vec<f64> {
        let logs: Vec<f64> = plants.iter().map(|plant| key(plant).ln()).collect();
        let mean = logs.iter().sum::<f64>() / logs.len() as f64;
        let rms = (logs.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / logs.len() as f64).sqrt();
        logs.iter().map(|v| (v - mean) / rms).collect()
    };
    let resonance = of(|plant| plant.micro.resonance);
    let correlation = |other: Vec<f64>| {
        let products = resonance.iter().zip(&other).map(|(a, b)| a * b);
        products.sum::<f64>() / resonance.len() as f64
    };
    for (what, found, wanted) in [
        ("full", correlation(of(|plant| plant.light.full)), 0.8),
        ("gain", correlation(of(|plant| plant.micro.gain)), -0.64),
        ("noise", correlation(of(|plant| plant.micro.noise)), 0.0),
    ] {
        assert!(
            (found - wanted).abs() < 0.07,
            "{what}: {found} for {wanted}"
        );
    }
}

#[test]
fn another_key_leaves_what_is_drawn_of_the_others() {
    let one = "[machine.micro]\nresonance = { lognormal = 0.4 }\n";
    let two = "[machine.light]\nfull = { lognormal = 0.3 }\n\
               [machine.micro]\ndamping = { lognormal = 0.1 }\nresonance = { lognormal = 0.4 }\n";
    let [one, two] = [one, two].map(|text| written(text).expect("a fleet"));
    for (a, b) in plants(&one, 0..20).iter().zip(plants(&two, 0..20)) {
        assert_eq!(a.micro.resonance, b.micro.resonance);
        assert_ne!(a.light.full, b.light.full);
    }
}

#[test]
fn a_wrong_file_is_refused_by_file_and_key() {
    let cases = BTreeMap::from([
        (
            "[machine.micro]\nresonance = { normal = \"10 Hz\", lognormal = 0.2 }\n",
            ["machine.micro.resonance", "has several laws"],
        ),
        (
            "[machine.camera]\nbias = { about = [\"0 um\", \"0 um\"], normal = 0.3 }\n",
            ["machine.camera.bias", "a share is nothing"],
        ),
        (
            "[machine.micro]\nresonnance = { lognormal = 0.2 }\n",
            ["machine.micro.resonnance", "no such key"],
        ),
        (
            "[machine.micro]\nresonnance = \"200 Hz\"\n",
            ["micro", "resonnance"],
        ),
        (
            "[device.light]\nnoise = { uniform = \"1 nm\" }\n",
            ["device.light.noise", "of another kind"],
        ),
        (
            "[device.light]\nnoise = { uniform = \"1 mV\", low = \"3 Hz\" }\n",
            ["device.light.noise", "of another kind"],
        ),
        (
            "[device.light]\nnoise = { uniform = \"-1 mV\" }\n",
            ["device.light.noise", "no width"],
        ),
        (
            "[device.light]\nnoise = { lognormal = 0.1, width = 3 }\n",
            ["device.light.noise", "width"],
        ),
        (
            "[device.light]\nnoise = { lognormal = 0.1, low = \"1 V\" }\n",
            ["device.light.noise", "leaves nothing"],
        ),
        (
            "[device.light]\nnoise = { lognormal = 0.1, correlation = 0.5 }\n",
            ["device.light.noise", "beside `with`"],
        ),
        (
            "[datasheet.vision]\naccuracy_z = { lognormal = 0.1, with = \"a\", correlation = 2 }\n",
            ["datasheet.vision.accuracy_z", "-1 to 1"],
        ),
        (
            "[machines.micro]\nresonance = \"200 Hz\"\n",
            ["machines", "datasheet"],
        ),
    ]);
    for (text, parts) in cases {
        let error = written(text).expect_err(text);
        for part in parts {
            assert!(error.contains(part), "no \"{part}\" in: {error}");
        }
    }
}

#[test]
fn a_fleet_that_is_not_there_is_told_with_those_that_are() {
    let setup = Setup::load("afpm", "y-branch").expect("the shipped rig");
    let error = setup.of_fleet("nosuch").expect_err("none").to_string();
    for part in ["nosuch", "no such fleet"].iter().chain(&SHIPPED) {
        assert!(error.contains(part), "no \"{part}\" in: {error}");
    }
}

#[test]
fn a_drawn_plant_makes_a_twin_of_its_own() {
    let setup = setup("thesis");
    let fleet = setup.fleet.clone().expect("it draws something");
    let plant = fleet.draw(3).expect("a plant");
    assert!(plant.micro.resonance < 150.0, "{}", plant.micro.resonance);
    assert!((setup.at(3).expect("a datasheet").rig.spec.vision.accuracy_z - 2e-6).abs() < 1e-12);
    assert!(Twin::new(setup.rig.spec.clone(), &plant, 3).is_ok());
}

//! The first steps of commissioning: what is well passes, and what is not is said.

use pigtail_control::calibration::Calibration;
use pigtail_control::station::Unobserved;
use pigtail_hal::quantity::Volts;
use pigtail_hal::{Axis, AxisName, Command, Error, Fault, Machine, Measurement, Side, Spec};
use pigtail_session::Setup;
use pigtail_session::commission::{
    CommissionDocument, Machines, Plan, StepName, Verdict, commission, commission_with,
};
use pigtail_session::piezos::PiezoModel;
use pigtail_twin::Twin;
use strum::VariantArray;

fn setup() -> Setup {
    Setup::load("afpm", "y-branch").expect("the shipped rig")
}

fn plan(steps: &[StepName]) -> Plan {
    Plan {
        steps: steps.to_vec(),
        devices: 1,
        date: "2026-11-23".to_owned(),
        run: "a-test".to_owned(),
        before: Vec::new(),
    }
}

/// A twin of which something is connected otherwise.
struct Connected<F> {
    twin: Twin,
    command: F,
}

impl<F: Fn(&mut Command)> Machine for Connected<F> {
    fn spec(&self) -> &Spec {
        self.twin.spec()
    }

    fn exchange(&mut self, command: &Command) -> Result<Measurement, Fault> {
        let mut command = *command;
        (self.command)(&mut command);
        self.twin.exchange(&command)
    }

    fn stop(&mut self) {
        self.twin.stop();
    }
}

/// What comes of these steps on a machine whose commands arrive so.
fn of_connected(
    steps: &[StepName],
    command: impl Fn(&mut Command) + Clone + 'static,
) -> CommissionDocument {
    let mut machines = |setup: &Setup, seed| -> Result<Box<dyn Machine>, Error> {
        let twin = setup.twin(seed)?;
        let command = command.clone();
        Ok(Box::new(Connected { twin, command }))
    };
    let machines: &mut Machines<'_> = &mut machines;
    let (setup, plan) = (setup(), plan(steps));
    commission_with(&setup, 3, &plan, machines, &mut Unobserved, |_| ())
        .expect("a machine that fails is no error")
        .document
}

#[test]
fn the_shipped_machine_moves_and_is_dark() {
    let mut told = Vec::new();
    // In any order: they are done in their own.
    let plan = plan(&[StepName::Dark, StepName::Axes]);
    let done = commission(&setup(), 3, &plan, &mut Unobserved, |step| {
        told.push(step.step.name);
    })
    .expect("a machine");
    assert_eq!(told, [StepName::Axes, StepName::Dark]);
    let document = done.document;
    for step in &document.steps {
        assert_eq!((step.verdict, step.why.as_str()), (Verdict::Passed, ""));
        assert!(step.seconds > 0.0);
    }
    let [axes, dark] = document.steps.as_slice() else {
        panic!("{document:?}");
    };
    assert_eq!(axes.values.len(), 6);
    for (name, axis) in &axes.values {
        let volts = ["forward_V", "backward_V"].map(|key| axis[key].as_f64().expect("volts"));
        assert!(
            volts.iter().all(|v| (0.3..3.0).contains(v)),
            "{name}: {volts:?}"
        );
    }
    assert_eq!(dark.values.len(), 3);
    let level = dark.values["output1"]["mean_V"].as_f64().expect("volts");
    assert!((level - 0.05).abs() < 1e-3, "{level}");
    let together: f64 = document.steps.iter().map(|step| step.seconds).sum();
    assert!((together - document.seconds_machine).abs() < 1e-3);
    // No device was tried, and nothing was found that is to be believed.
    assert!(!document.accepted && done.tables.is_empty());
}

#[test]
#[ignore = "long: the piezos of two machines, and a device on each"]
fn piezos_are_commissioned_by_the_model_that_is_asked_for() {
    let of = |piezo_model| {
        let setup = Setup {
            piezo_model,
            ..setup()
        };
        let plan = plan(&[StepName::Piezos]);
        let done = commission(&setup, 5, &plan, &mut Unobserved, |_| ()).expect("a machine");
        let step = &done.document.steps[0];
        assert_eq!((step.verdict, step.why.as_str()), (Verdict::Passed, ""));
        assert_eq!(done.tables, ["hysteresis.left", "hysteresis.right"]);
        setup.rig.with_belief(&done.belief).expect("a belief")
    };
    let [memory, networks, none] = PiezoModel::VARIANTS else {
        panic!("{:?}", PiezoModel::VARIANTS);
    };
    let (memory, networks) = (of(*memory), of(*networks));
    // All of the range first: then it does not matter where a piezo came from.
    let path: Vec<f64> = [0.0, 10.0, 0.0, 9.0, 2.0, 7.0, 3.0]
        .windows(2)
        .flat_map(|way| (0..500).map(|k| way[0] + (way[1] - way[0]) * f64::from(k) / 500.0))
        .collect();
    for side in Side::ALL {
        let ways = [&memory, &networks].map(|rig| {
            let model = rig.calibration.hysteresis.of(side).expect("a model");
            let piezo = &model.piezos[0];
            let mut state = piezo.at_rest(path[0]);
            let each = path
                .iter()
                .map(|v| piezo.displacement(&mut state, *v, 0.01));
            (piezo.name(), each.collect::<Vec<f64>>())
        });
        let [(_, memory), (name, networks)] = &ways;
        assert_eq!(*name, "rbf");
        // Of the same frames: where one has the piezo, which goes some 60 um, the other has it too.
        let apart = memory.iter().zip(networks).map(|(a, b)| a - b);
        let apart: Vec<f64> = apart.skip(1000).collect();
        let mean = apart.iter().sum::<f64>() / apart.len() as f64;
        let most = apart.iter().fold(0.0, |m: f64, a| m.max((a - mean).abs()));
        assert!(most < 1.5e-6, "{}: {:.2} um", side.name(), 1e6 * most);
    }
    let without = of(*none);
    assert!(Side::ALL.map(|side| without.calibration.hysteresis.of(side)) == [None, None]);
}

#[test]
fn a_motor_that_is_connected_the_other_way_round_is_named() {
    for at in ["left.a", "right.z"] {
        let AxisName { side, axis } = at.parse().expect("an axis");
        let document = of_connected(&[StepName::Axes, StepName::Dark], move |command| {
            let motor = &mut command.motors[side.index()][axis.index()];
            *motor = Volts(-motor.0);
        });
        let [axes, dark] = document.steps.as_slice() else {
            panic!("{document:?}");
        };
        assert_eq!(axes.verdict, Verdict::Failed);
        assert!(
            axes.why.contains(at) && axes.why.contains("the other way round"),
            "{}",
            axes.why
        );
        // The other steps are done all the same.
        assert_eq!(dark.verdict, Verdict::Passed);
        assert!(!document.accepted);
    }
}

#[test]
fn a_motor_without_its_cable_does_not_move() {
    let (side, axis) = (Side::Right, Axis::B);
    let document = of_connected(&[StepName::Axes], move |command| {
        command.motors[side.index()][axis.index()] = Volts(0.0);
    });
    let axes = &document.steps[0];
    assert_eq!(axes.verdict, Verdict::Failed);
    assert!(
        axes.why.contains("right.b") && axes.why.contains("does not move"),
        "{}",
        axes.why
    );
}

#[test]
fn light_in_the_dark_is_told() {
    let mut setup = setup();
    setup.plant.light.stray = 3.0;
    let plan = plan(&[StepName::Dark]);
    let done = commission(&setup, 3, &plan, &mut Unobserved, |_| ()).expect("a machine");
    let dark = &done.document.steps[0];
    assert_eq!(dark.verdict, Verdict::Failed);
    assert!(dark.why.contains("without light"), "{}", dark.why);
}

/// Stages that stand askew are told as they stand, and home and yaw are believed; the rest is for whoever sets them up.
#[test]
fn how_stages_stand_is_seen_by_the_camera() {
    let mut setup = setup();
    let mrad = 1e-3_f64;
    setup.plant.placement.left.yaw += 5.0 * mrad;
    setup.plant.placement.left.squareness[0] = 1.0 * mrad;
    setup.plant.placement.right.yaw -= 3.0 * mrad;
    setup.plant.placement.right.roll = 2.0 * mrad;
    setup.plant.placement.left.home[0] += 80e-6;
    setup.plant.placement.right.home[2] -= 60e-6;
    let plan = plan(&[StepName::Geometry]);
    let done = commission(&setup, 3, &plan, &mut Unobserved, |_| ()).expect("a machine");
    let step = &done.document.steps[0];
    assert_eq!((step.verdict, step.why.as_str()), (Verdict::Passed, ""));
    let angle = |side: &str, key: &str| {
        let value = step.values[side][key][0].as_f64().expect("an angle");
        value.to_radians() / mrad
    };
    // Of an axis by camera and probes, 0.06 mrad; the axis along the light is turned by yaw and by how far it leans.
    let near = |told: f64, truth: f64| assert!((told - truth).abs() < 0.6, "{told} {truth} mrad");
    near(angle("left", "yaw_deg"), 6.0);
    near(angle("left", "squareness_deg"), -1.0);
    near(angle("right", "yaw_deg"), -3.0);
    near(angle("right", "squareness_deg"), 0.0);
    near(angle("right", "roll_deg").abs(), 2.0);
    let known = step.values["left"]["yaw_deg"][1].as_f64();
    assert!(known.expect("a deviation") < 0.01, "degrees");
    // Chips and fibers lie otherwise each time: home is known to what they make of four.
    let um = |side: &str, key: &str| step.values[side][key][0].as_f64().expect("micrometres");
    for (side, [x, z]) in [("left", [80.0, 0.0]), ("right", [0.0, -60.0])] {
        assert!(
            (um(side, "home_x_um") - x).abs() < 100.0,
            "{:?}",
            step.values
        );
        assert!(
            (um(side, "home_z_um") - z).abs() < 50.0,
            "{:?}",
            step.values
        );
    }
    assert_eq!(done.tables, ["geometry.left", "geometry.right"]);
    // How ways across go along is believed, and which way, for where light is brightest beside a peak by that: both turn ways in x towards the
    // chip's -z.
    let believed = Calibration::parse("calibration.toml", &done.belief.text, &setup.rig.spec);
    let geometry = believed.expect("a calibration").geometry;
    for (side, [x, y]) in [(Side::Left, [5.0, 0.0]), (Side::Right, [3.0, 0.0])] {
        let askew = geometry.of(side).askew(&setup.rig.spec);
        for (known, truth) in askew.ways.into_iter().zip([x, y]) {
            let off = known / mrad - truth;
            assert!(off.abs() < 4.0 * askew.deviation / mrad, "{off} {askew:?}");
        }
        assert!(askew.deviation < 0.4 * mrad, "{askew:?}");
    }
}

//! Chapter 4: nonlinear control methods.

use super::Basis::{Calibrated, Definition, Doubtful, Prediction};
use super::Kind::{Above, Below, Factor, Formula, Measured, Share};
use super::{Statement, claim};

/// What set these joints: the thesis prints no parameters.
const FIVE_BAR: &str = "five_bar.joint of plant.toml: one set that meets the thesis's figures of this axis, chosen by \
    them";
const Z_STAGE: &str = "z_stage.joint of plant.toml: one set that meets the thesis's figures of this axis, chosen by them";
const OPENING: &str = "micro.hysteresis of plant.toml, 0.15";
const PLAYS: &str = "the twin's piezo is a sum of plays: its way back begins where it turns";
const HARMONIC: &str = "a way there and back is its own first harmonic, at 1/(2 x 5 V)";
const LEFT_OUT: &str = "the share that may be left out, 0.5 %, was chosen with 0.5/V known";
const NETWORKS: &str =
    "what the networks may leave out and how wide they may be was chosen for this hundredth";
const TWENTY: &str =
    "the networks' width, ridge and records were worked on until a scan gains twenty times";
const BREAKAWAY: &str = "fsm is what a motor breaks away at: a smaller pulse moves nothing";
const FIVE_BAR_PULSE: &str = "the pulse, 0.15 um: the thesis prints none";
const Z_PULSE: &str = "the pulse, 15 nm: the thesis prints none";

pub(super) const CLAIMS: &[Statement] = &[
    claim(
        "4.3-opening",
        (
            "4.2",
            "the hysteresis results in a maximum deviation of 15% of the actuator range",
        ),
        "largest difference between the ways back and forward over the range",
        (15.0, "%", Measured),
        Calibrated(OPENING),
    ),
    claim(
        "4.4-turns",
        (
            "4.2.1",
            "the actuator response depends on vx and v1 for the return path",
        ),
        "greatest difference at one voltage between ways back from two turns, share of the range",
        (0.02, "", Above),
        Definition(PLAYS),
    ),
    claim(
        "4.6-first",
        (
            "4.2.2",
            "the largest component corresponds to the first harmonic (f = 0.1Hz)",
        ),
        "frequency of the largest component, v1 = 5",
        (0.1, "1/V", Formula),
        Definition(HARMONIC),
    ),
    claim(
        "4.6-highest",
        (
            "4.2.2",
            "there are substantial components up to around (f = 0.5Hz)",
        ),
        "frequency beyond which less than 0.5 % of the range is left, v1 = 5",
        (0.5, "1/V", Factor),
        Calibrated(LEFT_OUT),
    ),
    claim(
        "4.8-forward",
        (
            "4.2.2",
            "75 radial basis functions were required to approximate the forward and inverse functions",
        ),
        "rms error of f with 75 functions, share of the range; to approximate is to 1 %",
        (0.01, "", Below),
        Doubtful(NETWORKS),
    ),
    claim(
        "4.9-inverse",
        (
            "4.2.2",
            "75 radial basis functions were required to approximate the forward and inverse functions",
        ),
        "rms error of g with 75 functions, share of the range; to approximate is to 1 %",
        (0.01, "", Below),
        Doubtful(NETWORKS),
    ),
    claim(
        "4.10-factor",
        (
            "4.2.2",
            "it is evident that open loop accuracy is increased by a factor of 20",
        ),
        "difference between the ways without the network over that with it, mean of four identifications (a quick run: two)",
        (20.0, "", Factor),
        Calibrated(TWENTY),
    )
    .because(33.8, "Better than printed: the ways of every turn follow from the networks by Everett's function. By seeds 0 to 5, four identifications each, it is 28 to 41, 33.8 on average. Before, 15 drawn micros gained 19 to 42 times."),
    claim(
        "4.10-worst",
        ("4.2.2", "open loop accuracy is increased by a factor of 20"),
        "the same in the worst of the identifications",
        (20.0, "", Above),
        Calibrated(TWENTY),
    ),
    claim(
        "4.12-step",
        (
            "4.3",
            "the z-stage has the capability to move 20nm increments or less using impulse control",
        ),
        "least mean step of consistent pulses of z",
        (20.0, "nm", Below),
        Prediction,
    ),
    claim(
        "4.15-motor",
        (
            "4.3.1",
            "most of the motion of the motor inertia occurs during the 1ms impulse",
        ),
        "share of the motor's way that it goes within the pulse",
        (0.5, "", Above),
        Calibrated(Z_STAGE),
    )
    .simulated(),
    claim(
        "4.15-load",
        (
            "4.3.1",
            "whereas most of the motion of load inertia occurs after the impulse",
        ),
        "share of the load's way that it goes after the pulse",
        (0.5, "", Above),
        Calibrated(Z_STAGE),
    )
    .simulated(),
    claim(
        "4.16-displacement",
        (
            "4.3.1",
            "The resulting z displacement of 35nm is shown in Figure 4.16",
        ),
        "displacement of z, a1 = 1.5 fsm, a2 = 12.5 fsm",
        (35.0, "nm", Measured),
        Calibrated(Z_STAGE),
    )
    .simulated(),
    claim(
        "4.17-dead",
        (
            "4.3.1",
            "the system moves forward only when a1 is above some threshold",
        ),
        "dead zone of z without second harmonic; a threshold is above fsm",
        (1.0, "fsm", Above),
        Definition(BREAKAWAY),
    )
    .simulated(),
    claim(
        "4.17-shrinks",
        (
            "4.3.1",
            "the size of the dead zone can be decreased by increasing a2",
        ),
        "dead zone with half of that second harmonic over that without",
        (1.0, "", Below),
        Doubtful(Z_STAGE),
    )
    .simulated(),
    claim(
        "4.17-second",
        (
            "4.3.1",
            "eliminate the dead zone. This occurs when a2 = 12.5 fcm",
        ),
        "second harmonic that leaves no dead zone of z",
        (12.5, "fsm", Measured),
        Calibrated(Z_STAGE),
    )
    .simulated(),
    claim(
        "4.18-parabola",
        (
            "4.3.1",
            "the displacement is approximately a parabolic function of a1",
        ),
        "R2 of (4.8) on z; approximately is above 0.9",
        (0.9, "", Above),
        Prediction,
    )
    .simulated(),
    claim(
        "4.19-dead",
        (
            "4.3.1",
            "the dead zone is small ... for the range of parameters",
        ),
        "a1 from which on nine of ten machines move forward",
        (1.0, "fsm", Below),
        Prediction,
    )
    .simulated(),
    claim(
        "4.19-parabola",
        (
            "4.3.1",
            "the parabolic relationship holds for the range of parameters",
        ),
        "R2 of (4.8) through the median over machines",
        (0.9, "", Above),
        Prediction,
    )
    .simulated(),
    claim(
        "4.19-acceptable",
        (
            "4.3.1",
            "the system sensitivity to uncertainties is significant but acceptable",
        ),
        "what nine of ten machines stay below over what is expected, a1 = 5 fsm; (4.12) allows 2",
        (2.0, "", Below),
        Prediction,
    )
    .simulated(),
    claim(
        "4.20-error",
        (
            "4.3.2",
            "a tracking error of less than 10nm is achieved after an initial overshoot",
        ),
        "median final error of z over runs to 100 nm by (4.8)-(4.11)",
        (10.0, "nm", Below),
        Prediction,
    )
    .simulated(),
    claim(
        "4.20-factor",
        (
            "4.3.2",
            "a resolution of 10nm which is a factor of 12 better than conventional linear control",
        ),
        "resolution of z under PID over the error below which nine of ten runs end",
        (12.0, "", Factor),
        Prediction,
    ),
    claim(
        "4.20-stable",
        (
            "4.3.2",
            "The controller is asymptotically stable for 0 < kc < 2",
        ),
        "mean error of the last ten pulses with kc = 1.9",
        (10.0, "nm", Below),
        Prediction,
    )
    .simulated(),
    claim(
        "4.20-unstable",
        (
            "4.3.2",
            "The controller is asymptotically stable for 0 < kc < 2",
        ),
        "mean error of the last ten pulses with kc = 2.1",
        (10.0, "nm", Above),
        Prediction,
    )
    .simulated(),
    claim(
        "4.21-second",
        ("4.3.3", "the dead zone can be removed for a2 = 2.3 fsm"),
        "second harmonic that leaves no dead zone of the five-bar",
        (2.3, "fsm", Measured),
        Calibrated(FIVE_BAR),
    ),
    claim(
        "4.21-dead",
        ("4.3.3", "a similar pattern to the z-stage occurs"),
        "dead zone of the five-bar without second harmonic; a threshold is above fsm",
        (1.0, "fsm", Above),
        Definition(BREAKAWAY),
    ),
    claim(
        "4.21-parabola",
        (
            "4.3.3",
            "shows the parabolic relationship between a1 and displacement",
        ),
        "R2 of (4.8) on the five-bar; approximately is above 0.9",
        (0.9, "", Above),
        Prediction,
    ),
    claim(
        "4.22-settling",
        ("4.3.3", "the system has a settling time of under 3s"),
        "longest time to within 0.15 um to stay, four starts, a pulse in 250 ms",
        (3.0, "s", Below),
        Doubtful(FIVE_BAR),
    ),
    claim(
        "4.22-error",
        (
            "4.3.3",
            "a steady state error of less than 0.15um could be achieved",
        ),
        "greatest final error of four starts",
        (0.15, "um", Below),
        Doubtful(FIVE_BAR),
    ),
    claim(
        "4.22-tic",
        (
            "4.3.3",
            "This is equal to less than one tenth of an encoder tic",
        ),
        "that error over a count",
        (0.1, "", Below),
        Doubtful(FIVE_BAR),
    ),
    claim(
        "4.22-rate",
        (
            "4.3.3",
            "could not be increased much beyond 250ms without ... becoming less predictable",
        ),
        "relative spread of pulses 50 ms apart over that of pulses 250 ms apart; less predictable is by more than 20 %",
        (1.2, "", Above),
        Prediction,
    )
    .because(1.0, "Here all is at rest long before the next pulse, 50 ms apart or 250 ms: the two inertias and the friction of the model have no motion that lasts as long as the thesis saw."),
    claim(
        "4.23-consistent",
        (
            "4.3.3",
            "The position as a function of time shows consistent one directional motion",
        ),
        "share of pulses of the five-bar that move it by less than half the mean",
        (0.01, "", Below),
        Prediction,
    ),
    claim(
        "4.23-resolution",
        (
            "4.3.3",
            "It is apparent that a resolution of 0.2um is achieved",
        ),
        "largest step of pulses of 0.15 um",
        (0.2, "um", Below),
        Doubtful(FIVE_BAR_PULSE),
    ),
    claim(
        "4.23-factor",
        (
            "4.3.3",
            "This is a factor of 18 times better than that achieved using PID control",
        ),
        "resolution of the five-bar under PID over that under pulses",
        (18.0, "", Factor),
        Doubtful(FIVE_BAR_PULSE),
    )
    .on_others_because(45.2, "The resolution under PID is worse than printed on this specimen (2.26-resolution), that under pulses as printed."),
    claim(
        "4.23-order",
        (
            "5",
            "can improve the resolution of the macro manipulator by more than an order of magnitude",
        ),
        "resolution of the five-bar under PID over that under pulses",
        (10.0, "", Above),
        Doubtful(FIVE_BAR_PULSE),
    ),
    claim(
        "4.24-resolution",
        (
            "4.3.3",
            "at 20nm still represents a factor of 7 improvement over PID control",
        ),
        "largest step of pulses of 15 nm",
        (20.0, "nm", Below),
        Doubtful(Z_PULSE),
    ),
    claim(
        "4.24-factor",
        (
            "4.3.3",
            "at 20nm still represents a factor of 7 improvement over PID control",
        ),
        "resolution of z under PID over that under pulses",
        (7.0, "", Factor),
        Doubtful(Z_PULSE),
    ),
    claim(
        "4.24-uneven",
        (
            "4.3.3",
            "the impulse response is not as consistent as the five-bar",
        ),
        "relative spread of the pulses of z over that of the five-bar",
        (1.0, "", Above),
        Prediction,
    ),
    claim(
        "4.24-trend",
        (
            "4.3.3",
            "seems to decrease with time ... unclear and not predicted by the model",
        ),
        "last ten steps over the first ten: the model predicts no decrease",
        (1.0, "", Share),
        Prediction,
    ),
];

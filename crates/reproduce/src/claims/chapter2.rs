//! Chapter 2: control of the macro manipulator.

use super::Basis::{Calibrated, Definition, Doubtful, Prediction};
use super::Kind::{Above, Below, Factor, Measured, Order, Remainder, Share};
use super::{Statement, claim};

/// What set these joints: the thesis prints no parameters.
const FIVE_BAR: &str = "five_bar.joint of plant.toml and gains.five_bar of the calibration: one set that meets the \
    thesis's figures of this axis, chosen by them";
const Z_STAGE: &str = "z_stage.joint of plant.toml and gains.z of the calibration: one set that meets the thesis's \
    figures of this axis, chosen by them";
const Z_SCAN: &str =
    "z_stage.joint of plant.toml, and the speed of the scan, 15 um/s: the thesis prints none";
const HARDENING: &str =
    "transmission.cubic of five_bar.joint in plant.toml: by the halving of 2.13";
const GAP: &str = "five_bar.joint of plant.toml: its windup was fitted, and what (2.20) leaves of it was known when \
    the set was taken";
const COUPLING: &str = "friction of 0.03 N m between the links, in this experiment alone";
const SQUARES: &str = "friction of 0.03 N m between the links, and the links of measured.toml: both were taken with the \
    errors of all three squares in view";
const TWO_COUNTS: &str = "z_stage.joint of plant.toml: how even its steps of two counts are was known when the set was \
    taken";
const LINKS: &str = "five_bar of measured.toml: lengths of links by what a count is";
const ONE_COUNT: &str = "five_bar.joint of plant.toml: how even its steps of one count are was known when the set was \
    taken";
const CONTINUOUS: &str = "the equivalent reversal position (2.25) is defined by continuity; what is found is the \
    estimate's slope over a servo cycle";

pub(super) const CLAIMS: &[Statement] = &[
    claim(
        "2.2-own",
        ("2.2", "the coupling centripetal and Coriolis terms ... act as small disturbances to the motor output"),
        "greatest change of a motor's step by the mass that both joints carry while the other steps too, share of the step; \
            small is below a hundredth",
        (0.01, "", Below),
        Prediction,
    )
    .on_others_because(0.0113, "By the most that it can be: all of the load's inertia as mass at the endpoint, both joints stepping at full \
        voltage. What links and motors really weigh is not printed."),
    claim(
        "2.2-other",
        ("2.3", "the coupling between the motor actuators is negligible due to the large gear ratios"),
        "greatest motion of the other joint meanwhile, share of the step; negligible is below a hundredth",
        (0.01, "", Below),
        Prediction,
    ),
    claim(
        "2.3-iterations",
        ("2.3.1", "The convergence period was consistently less than 100 iterations"),
        "trials until the cost is within 10 % of the least of all starts, slowest start",
        (100.0, "trials", Below),
        Prediction,
    ),
    claim(
        "2.3-minutes",
        ("2.3.1", "less than 100 iterations or 10 minutes"),
        "machine time of these trials",
        (10.0, "min", Below),
        Prediction,
    ),
    claim(
        "2.3-starts",
        ("2.3.1", "It is apparent that the algorithm converges for a wide range of starting points"),
        "cost reached by the worst of three starts over that by the best",
        (1.1, "", Below),
        Prediction,
    ),
    claim(
        "2.3-averaged",
        (
            "2.3.1",
            "averaging the performance index from two different step sizes increased the convergence rate",
        ),
        "mean trials until the cost is within 10 % of the least of all starts, by one step size over that averaged over two",
        (1.0, "", Above),
        Prediction,
    )
    .because(0.9748, "Neither cost has a minimum here in which a search is trapped. It is no chance: of 100 searches of three starts (seeds 0 to \
        99) 298 of 300 come near within 100 of 150 trials by one size and 297 averaged, after 13.4 and 15.1 trials on average, 0.89 \
        (0.79 to 1.00, 95 %). Each finds its way about as soon as the other; by one size a trial \
        takes half of the time. A load that sticks near its goal costs little in the ITAE of an encoder at the motor."),
    claim(
        "2.4-rise",
        ("2.3.2", "settling time of 42ms and rise time of 11ms is achieved for the five-bar"),
        "rise of the five-bar, 10 to 90 %",
        (11.0, "ms", Measured),
        Calibrated(FIVE_BAR),
    ),
    claim(
        "2.4-settling",
        ("2.3.2", "settling time of 42ms and rise time of 11ms is achieved for the five-bar"),
        "settling of the five-bar to within one count",
        (42.0, "ms", Measured),
        Calibrated(FIVE_BAR),
    ),
    claim(
        "2.4-detuned",
        (
            "2.3.2",
            "20% smaller kd for the five-bar ... the optimal gains represent a significant improvement",
        ),
        "ITAE with kd 20 % smaller over that of tuned gains, mean of three searches; significant is above 5 %",
        (1.05, "", Above),
        Prediction,
    ),
    claim(
        "2.5-rise",
        ("2.3.2", "A settling time of 37ms and rise time of 14ms was achieved with the z-stage"),
        "rise of the z-stage, 10 to 90 %",
        (14.0, "ms", Measured),
        Calibrated(Z_STAGE),
    ),
    claim(
        "2.5-settling",
        ("2.3.2", "A settling time of 37ms and rise time of 14ms was achieved with the z-stage"),
        "settling of the z-stage to within one count",
        (37.0, "ms", Measured),
        Calibrated(Z_STAGE),
    ),
    claim(
        "2.5-detuned",
        (
            "2.3.2",
            "20% smaller ki for the z-stage ... the optimal gains represent a significant improvement",
        ),
        "ITAE with ki 20 % smaller over that of tuned gains, mean of three searches; significant is above 5 %",
        (1.05, "", Above),
        Prediction,
    )
    .because(1.006, "This stage hardly needs an integral: kp alone overcomes the motor's static friction, 0.71 V, at an error of a count, 0.83 V. Without ki it settles as soon as with it (35.6 ms), with four times that friction less of it delays settling from 46 to 50 ms."),
    claim(
        "2.6-gain",
        ("2.3.2", "the five-bar is able track at 10 Hz with no attenuation"),
        "gain of the five-bar at 10 Hz",
        (1.0, "", Share),
        Prediction,
    ),
    claim(
        "2.6-lag",
        ("2.3.2", "at 10 Hz with no attenuation and a phase lag of less than 9.9 degrees"),
        "phase lag of the five-bar at 10 Hz",
        (9.9, "deg", Below),
        Prediction,
    ),
    claim(
        "2.6-sampling",
        ("2.3.1", "Since this is more than twenty times the bandwidth of the system"),
        "servo rate over the bandwidth (-3 dB) of the five-bar",
        (20.0, "", Above),
        Prediction,
    ),
    claim(
        "2.7-gain",
        ("2.3.2", "able to track a sinusoidal trajectory of 8 Hz with no attenuation"),
        "gain of the z-stage at 8 Hz",
        (1.0, "", Share),
        Prediction,
    ),
    claim(
        "2.7-lag",
        ("2.3.2", "of 8 Hz with no attenuation and a phase lag of less than 9.5 degrees"),
        "phase lag of the z-stage at 8 Hz",
        (9.5, "deg", Below),
        Prediction,
    ),
    claim(
        "2.8-windup",
        ("2.4.1", "the reverse trajectory gradually diverges ... until a maximum value of 100um"),
        "forward path less backward path over 700 um",
        (100.0, "um", Measured),
        Calibrated(FIVE_BAR),
    ),
    claim(
        "2.8-slope",
        ("2.4.1", "it is not a completely horizontal dead zone that would occur for pure backlash"),
        "share of the input that the output follows just after a reversal; 0 for backlash",
        (0.05, "", Above),
        Prediction,
    ),
    claim(
        "2.9-grows",
        ("2.4.1", "the amount of transmission windup increases with the coefficient of friction"),
        "windup with half of the load friction over that with all of it",
        (1.0, "", Below),
        Prediction,
    )
    .simulated(),
    claim(
        "2.9-eliminated",
        ("2.4.1", "and that it can be eliminated for very small values"),
        "windup with a twentieth of the load friction over that with all of it",
        (0.1, "", Below),
        Prediction,
    )
    .simulated(),
    claim(
        "2.9-linear",
        ("2.4.1", "the simulations predict a linear transition which only approximates the actual curve"),
        "greatest departure of the transition from a straight line over the windup",
        (0.1, "", Below),
        Prediction,
    )
    .simulated(),
    claim(
        "2.10-factor",
        ("2.4.1", "windup is reduced by more than a factor of ten without frictional loading"),
        "windup with load friction over that without",
        (10.0, "", Above),
        Calibrated(FIVE_BAR),
    ),
    claim(
        "2.11-windup",
        ("2.4.1", "transmission windup also occurs ... its 0.2um magnitude is relatively small"),
        "windup of the z-stage",
        (0.2, "um", Measured),
        Calibrated(Z_SCAN),
    ),
    claim(
        "2.11-required",
        (
            "2.4.1",
            "its 0.2um magnitude is relatively small compared to the smallest increment 0.5um",
        ),
        "windup of the z-stage",
        (0.5, "um", Below),
        Calibrated(Z_SCAN),
    ),
    claim(
        "2.12-falls",
        ("2.4.2", "the transmission windup decreases with increasing preload"),
        "windup with a preload of 0.6 times the friction over that without",
        (1.0, "", Below),
        Doubtful(HARDENING),
    )
    .simulated(),
    claim(
        "2.12-above",
        ("2.4.2", "most effective when the preload is greater than the output coefficient of friction"),
        "windup with a preload of 1.2 times the friction over that with 0.6 times",
        (1.0, "", Below),
        Doubtful(HARDENING),
    )
    .simulated(),
    claim(
        "2.13-half",
        ("2.4.2", "a preload greater than the output coefficient of friction reduces windup by a factor of two"),
        "windup without preload over that with 1.2 times the friction",
        (2.0, "", Factor),
        Calibrated(HARDENING),
    ),
    claim(
        "2.13-levels",
        ("2.4.2", "increasing the preload much beyond this has little effect"),
        "windup with 2.4 times the friction over that with 1.2 times; little is less than 20 %",
        (0.8, "", Above),
        Prediction,
    )
    .because(0.1457, "So the model has it, whose spring (2.6) hardens without end. With a stiffness that rises to 3.5 times that at rest and no further (34 N m/rad, 1.8e7 N m/rad3 and a bound of 3.5, which leave 101 um without preload) preloads of 1.2 and 2.4 times the friction leave 58 um and 48 um, 0.84: the thesis's own explanation holds. But that spring, soft at rest, is not the machine's either: pulses of the five-bar then grow as it winds up, by 22 % rms, where the thesis found them alike (4.23)."),
    claim(
        "2.14-range",
        ("2.4.3", "The shape of the curve produced was found to be consistent for large scan ranges"),
        "windup over 350 um over that over 700 um",
        (1.0, "", Share),
        Prediction,
    ),
    claim(
        "2.15-fit",
        ("2.4.3", "the function is a good approximation ... and is always within 10um of the data"),
        "largest error of (2.20)",
        (10.0, "um", Below),
        Prediction,
    )
    .because(17.95, "The model's own transition is straight, as the thesis says of its simulation (2.4.1), and no curve (2.20) comes within 10 um of one so high. On the same machine with a law of load friction whose transition is curved, it holds."),
    claim(
        "2.15-robust",
        ("2.4.3", "the approximation was highly robust to variations of the fitting parameters"),
        "rms error of (2.20) with Q 20 % off over the least",
        (1.5, "", Below),
        Prediction,
    ),
    claim(
        "2.15-rate",
        ("2.4.3", "the transmission windup function is not rate or acceleration dependent"),
        "windup at twice the speed over that at the speed",
        (1.0, "", Share),
        Prediction,
    ),
    claim(
        "2.16-continuous",
        ("2.4.4", "to jump from the current curve to the opposite direction curve while preserving continuity"),
        "greatest jump of the estimate at a partial reversal over the maximum windup",
        (0.01, "", Below),
        Definition(CONTINUOUS),
    ),
    claim(
        "2.17-left",
        ("2.4.5", "the backlash has been reduced to 15um"),
        "gap between the paths over 700 um with (2.20)-(2.26)",
        (15.0, "um", Remainder),
        Doubtful(GAP),
    ),
    claim(
        "2.17-drift",
        ("2.4.4", "an open loop compensation scheme and consequently may be sensitive to ... parameter variations"),
        "gap left with 20 % more friction than was identified over that without; sensitive is by more than 20 %",
        (1.2, "", Above),
        Prediction,
    ),
    claim(
        "2.17-factor",
        ("2.4.5", "a factor of 7 times better than the uncompensated performance"),
        "gap without compensation over that with it",
        (7.0, "", Factor),
        Doubtful(GAP),
    ),
    claim(
        "2.17-abstract",
        ("abstract", "this method reduces the effects of transmission windup by an order of magnitude"),
        "gap without compensation over that with it",
        (10.0, "", Order),
        Doubtful(GAP),
    ),
    claim(
        "2.18-little",
        ("2.4.5", "with preloading ... unexpectedly show little improvement over no preloading"),
        "gap left with preload over that without; little is less than a factor of 1.5",
        (0.667, "", Above),
        Prediction,
    ),
    claim(
        "2.19-small",
        ("2.4.5", "the performance does not degrade over small ranges"),
        "gap left over 175 um over that over 700 um; to degrade is by more than 20 %",
        (1.2, "", Below),
        Prediction,
    ),
    claim(
        "2.20-repeated",
        ("2.4.5", "the performance does remain consistent over successive direction reversals"),
        "gap left over repeated scans of 175 um over that of one; consistent is within 20 %",
        (1.2, "", Below),
        Prediction,
    ),
    claim(
        "2.20-factor",
        ("5", "reduces the effects of transmission windup by a factor of 8 over a broad range"),
        "windup without compensation (2.8) over the gap left, mean of Figs. 2.17, 2.19 and 2.20",
        (8.0, "", Factor),
        Doubtful(GAP),
    ),
    claim(
        "2.21-error",
        ("2.4.5", "the position is off by as much as 120um corresponding to 40% of the range"),
        "greatest error of a 300 um square",
        (120.0, "um", Measured),
        Calibrated(COUPLING),
    ),
    claim(
        "2.21-share",
        (
            "2.4.5",
            "off by as much as 120um corresponding to 40% of the range of motion",
        ),
        "greatest error over the side of the square",
        (40.0, "%", Measured),
        Calibrated(COUPLING),
    ),
    claim(
        "2.22-error",
        ("2.4.5", "The shape of the trajectory is far more regular and the maximum error is 30um"),
        "greatest error with (2.20)-(2.26)",
        (30.0, "um", Remainder),
        Doubtful(SQUARES),
    ),
    claim(
        "2.22-factor",
        ("2.4.5", "The factor of 4 improvement, however, is somewhat less than expected"),
        "greatest error without compensation over that with it",
        (4.0, "", Factor),
        Doubtful(SQUARES),
    ),
    claim(
        "2.23-error",
        ("2.4.5", "The maximum error observed was less than 15um"),
        "greatest error with compensation and a preload of 1.2 times the output's friction",
        (15.0, "um", Below),
        Prediction,
    )
    .because(16.26, "What is left is the friction between the links, which compensation of each joint does not know, on a transmission that half of the way carries next to nothing, where it is softest. Where there is none of that friction, or the preload is twice as large, the claim holds."),
    claim(
        "2.23-factor",
        ("2.4.5", "combined with preloading improves coordinated motion performance by a factor of 8"),
        "greatest error without compensation over that with it and preload",
        (8.0, "", Factor),
        Doubtful(SQUARES),
    ),
    claim(
        "2.24-stuck",
        ("2.5", "half of the time and the other half the stage doesn't move"),
        "share of one-count steps of z that do not move the stage",
        (0.5, "", Share),
        Calibrated(Z_STAGE),
    )
    .on_others_because(0.25, "How many counts it takes to break away is a matter of friction over stiffness: with a tenth more friction of the motor the nominal machine sticks at 0.28 of its steps, with a tenth more of the load at 0.37, with a tenth less of it at 0.50."),
    claim(
        "2.24-moves",
        ("2.5", "the z-stage making increments of roughly two encoder counts (0.125um)"),
        "mean of the steps that move it",
        (0.125, "um", Measured),
        Calibrated(Z_STAGE),
    )
    .on_others_because(0.083, "As the share of those that do not: what is asked for is moved in the end, by three steps of four if a fourth of them sticks."),
    claim(
        "2.25-consistent",
        ("2.5", "consistent motion of two encoder counts is possible"),
        "share of two-count steps of z that are less than half the mean",
        (0.01, "", Below),
        Calibrated(Z_STAGE),
    ),
    claim(
        "2.25-most",
        ("2.5", "The vast majority of increments are less than 0.14um"),
        "share of increments below 0.14 um; vast is nine tenths",
        (0.9, "", Above),
        Doubtful(TWO_COUNTS),
    ),
    claim(
        "2.25-resolution",
        ("2.5", "Therefore the resolution of the z-stage is 0.14um"),
        "largest increment of consistent steps",
        (0.14, "um", Measured),
        Doubtful(TWO_COUNTS),
    ),
    claim(
        "2.25-required",
        ("2.5", "This is more than 3.5 times the required specification"),
        "0.5 um over the resolution of z",
        (3.5, "", Above),
        Doubtful(TWO_COUNTS),
    ),
    claim(
        "2.26-consistent",
        ("2.5", "consistent motion of one encoder count is possible"),
        "share of one-count steps of the five-bar that are less than half the mean",
        (0.01, "", Below),
        Calibrated(FIVE_BAR),
    )
    .on_others_because(0.219, "The integral hunts: where the motor comes to rest just short of its count, it draws it over in the midst of a later step. Of what specimens differ by it is the motor's constants that decide; on the same specimen without ki no step of 1000 sticks, and the largest is 1.9 um."),
    claim(
        "2.26-least",
        ("2.5", "one encoder tic can represent between 1um to 2um depending on the position"),
        "least endpoint displacement of a count in the workspace",
        (1.0, "um", Measured),
        Calibrated(LINKS),
    )
    .computed(),
    claim(
        "2.26-greatest",
        ("2.5", "one encoder tic can represent between 1um to 2um depending on the position"),
        "greatest endpoint displacement of a count in the workspace",
        (2.0, "um", Measured),
        Calibrated(LINKS),
    )
    .computed(),
    claim(
        "2.26-resolution",
        ("2.5", "The maximum motion that occurs is two encoder counts ... the resolution is 3.5um"),
        "largest increment of consistent steps of the five-bar",
        (3.5, "um", Measured),
        Prediction,
    )
    .because(2.49, "Better than printed. Here the motor comes to rest within half a count of the same place in every count; one that rests anywhere within its count makes increments of up to two. Neither more static friction of motor or load nor a dwell of 5 to 200 ms changes the largest by 1 %, other gains (tuned, half of kp or kd, no ki) leave it between 1.8 and 2.5 um. The thesis names gear meshing and bearing noise, which the twin leaves out.")
    .on_others_because(6.85, "The integral hunts (2.26-consistent), and steps are consistent from three counts on."),
    claim(
        "2.26-required",
        ("2.5", "This is more than 1.4 times the required value"),
        "5 um over the resolution of the five-bar",
        (1.4, "", Above),
        Doubtful(ONE_COUNT),
    )
    .on_others_because(0.73, "As the resolution."),
];

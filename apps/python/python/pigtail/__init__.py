"""Control software and a digital twin for automated fiber pigtailing.

>>> import pigtail
>>> device = pigtail.align(seed=7)
>>> print(device)

:func:`align` aligns a device on the twin that a seed draws; :func:`campaign` does it for many. :class:`Rig` names a rig
of your own; :func:`produce` takes trays in and pigtailed devices out. :func:`tune`, :func:`identify`, :func:`characterize` and :func:`commission` are experiments on a machine;
:func:`simulate_joint` is one joint alone. :class:`Twin` is a machine, cycle by cycle; :class:`BenchTwin` one that
is controlled by position, and :class:`Bench` what you implement to have :func:`align_bench` and :func:`find_peak` run on your
own. :class:`Runs` is the store. :func:`benchmark` compares your algorithms with ours, :func:`identify_servo` tells of an axis from your log.
:mod:`pigtail.gym` has environments of gymnasium, :mod:`pigtail.bluesky` devices of bluesky. What is true of a twin, :mod:`pigtail.sim` tells, and nothing else.

Names are those of the program and the book; the last letters of a name are its unit. Long calls let go of Python's
lock, show progress, and stop the machine on Ctrl-C.
"""

from ._align import CHANNELS, SIDES, Alignment, Believed, Fiber, Phase, PhaseStart, Samples, align
from ._bench import BenchRig, BenchTwin, Peak, Taught, align_bench, find_peak
from ._benchmark import HELD_OUT, Leaderboard, Probe, benchmark, raster, with_climb
from ._campaign import Campaign, campaign, campaign_folder, merge, run_shard
from ._document import Document, Experiment
from ._errors import Error, FaultError, InputError, OutcomeError, Refused
from ._jobs import Commissioning, characterize, commission, identify, simulate_joint, tune
from ._pigtail import __version__
from ._produce import Cured, Pigtail, Production, Step, Trays, produce
from ._progress import Progress
from ._records import Identified, identify_servo
from ._rig import Calibration, Rig
from ._runs import Runs
from ._twin import Command, Frame, Light, Measurement, Tip, Twin
from .bench import Bench
from . import bench, sim

__all__ = [
    "CHANNELS",
    "SIDES",
    "Alignment",
    "Believed",
    "Bench",
    "BenchRig",
    "BenchTwin",
    "Calibration",
    "Campaign",
    "Command",
    "Commissioning",
    "Cured",
    "Document",
    "Error",
    "Experiment",
    "FaultError",
    "Fiber",
    "HELD_OUT",
    "Frame",
    "Identified",
    "InputError",
    "Leaderboard",
    "Light",
    "Measurement",
    "OutcomeError",
    "Peak",
    "Phase",
    "PhaseStart",
    "Pigtail",
    "Probe",
    "Production",
    "Progress",
    "Refused",
    "Rig",
    "Runs",
    "Samples",
    "Step",
    "Taught",
    "Tip",
    "Trays",
    "Twin",
    "__version__",
    "align",
    "align_bench",
    "bench",
    "benchmark",
    "campaign",
    "campaign_folder",
    "characterize",
    "commission",
    "find_peak",
    "identify",
    "identify_servo",
    "merge",
    "produce",
    "raster",
    "run_shard",
    "sim",
    "simulate_joint",
    "tune",
    "with_climb",
]

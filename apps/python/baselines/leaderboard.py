"""The leaderboard: every baseline of this folder beside pigtail's own alignment, on seeds that none was tuned with.

    pip install "./apps/python[baselines]"
    python leaderboard.py --task peak --devices 100
    python leaderboard.py --task device --devices 20 --without bayes

A script whose library is not installed is left out, and said. Bayesian optimisation costs a second of processor a climb.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from typing import Any

import pigtail

SCRIPTS = ("nine_point", "raster_climb", "spgd", "nelder_mead", "cma_es", "bayes", "learner")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--task", choices=("peak", "device"), default="peak")
    parser.add_argument("--devices", type=int, default=20)
    parser.add_argument("--seeds", default="held-out", help="development, held-out, or the first seed")
    parser.add_argument("--without", nargs="*", default=[], metavar="SCRIPT", help=f"of {', '.join(SCRIPTS)}")
    parser.add_argument("--json", action="store_true", help="the document instead of the table")
    asked = parser.parse_args()
    entries: dict[str, Any] = {}
    for name in SCRIPTS:
        # What learned one task can do no other.
        if name in asked.without or (name, asked.task) == ("learner", "device"):
            continue
        try:
            entries[name.replace("_", "-")] = getattr(importlib.import_module(name), name)
        except ImportError as missing:
            print(f"LEFT OUT: {name}: {missing}", file=sys.stderr)
    seeds = int(asked.seeds) if asked.seeds.isdecimal() else asked.seeds
    board = pigtail.benchmark(entries, task=asked.task, devices=asked.devices, seeds=seeds)
    print(board.json() if asked.json else board)


if __name__ == "__main__":
    try:
        main()
    except pigtail.InputError as wrong:
        sys.exit(f"{wrong}")

"""Environment steps a second of the peak task: what a learner has of `pigtail.gym` on this computer.

    python apps/python/benches/steps.py

Each figure is the median of rounds, with the least and the most. By the clock is what one waits for, of a computer that does
nothing else; by the processor (seconds of all threads) is what is left of that where others work too.
"""

import statistics
import time
from collections.abc import Callable

import gymnasium
import numpy as np
import pigtail.gym

ROUNDS = 9
EPISODE = 1_000  # steps of an episode of the peak task


def measured(what: str, steps: int, prepare: Callable[[], object], once: Callable[[], object]) -> None:
    """A line of rounds of `once`, before each of which `prepare` is called, uncounted. The first round warms up."""
    rates: list[tuple[float, float]] = []
    for _ in range(ROUNDS + 1):
        prepare()
        clock, processor = time.perf_counter(), time.process_time()
        once()
        rates.append((steps / (time.perf_counter() - clock), steps / (time.process_time() - processor)))
    said = ""
    for every in zip(*rates[1:], strict=True):
        said += f"{statistics.median(every):12,.0f} ({min(every):,.0f} to {max(every):,.0f})".ljust(38)
    print(f"{what:34}{said.rstrip()}", flush=True)


def vector(environments: int) -> None:
    """`make_vec`: one call steps all, on all cores. Within an episode, and by whole episodes, each with its reset."""
    many = pigtail.gym.make_vec("Peak", num_envs=environments)
    shape = (16, *(many.action_space.shape or ()))
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, shape).astype(np.float32)

    def steps(count: int) -> None:
        for k in range(count):
            many.step(actions[k % 16])

    def begin() -> None:
        many.reset(seed=0)

    def episodes() -> None:
        begin()
        steps(EPISODE - 1)

    name = f"make_vec, {environments} environments"
    measured(name, environments * EPISODE // 2, begin, lambda: steps(EPISODE // 2))
    measured(f"{name}, resets", environments * (EPISODE - 1), lambda: None, episodes)
    many.close()


def single() -> None:
    """One environment, stepped from Python."""
    one = gymnasium.make("pigtail/Peak-v0")
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (16, 2)).astype(np.float32)

    def steps() -> None:
        for k in range(EPISODE // 2):
            one.step(actions[k % 16])

    measured("BenchEnv", EPISODE // 2, lambda: one.reset(seed=0), steps)


if __name__ == "__main__":
    print(f"{'steps a second':34}{'by the clock':>12}{'by the processor, a second of it':>58}")
    for environments in (64, 256):
        vector(environments)
    single()

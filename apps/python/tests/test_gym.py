"""Environments: equal to driving a bench by hand, and many of them equal to one."""

import multiprocessing
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import pigtail
from pigtail.bench import Line, Pose

gymnasium = pytest.importorskip("gymnasium")
gym = pytest.importorskip("pigtail.gym")
IDS = ["pigtail/FirstLight-v0", "pigtail/Peak-v0", "pigtail/Approach-v0"]


@pytest.mark.filterwarnings("ignore:.*minimum value is -infinity.*", "ignore:.*maximum value is infinity.*")
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", IDS)
def test_the_checker_is_content(name: str) -> None:
    from gymnasium.utils.env_checker import check_env

    check_env(gymnasium.make(name, limit_s=0.3).unwrapped)


@pytest.mark.parametrize("seed", [7, 2**33 + 1])
def test_an_episode_is_a_bench_driven_by_hand(seed: int) -> None:
    env = gymnasium.make("pigtail/Peak-v0")
    seen, info = env.reset(seed=seed)
    rig, twin = pigtail.BenchRig(), pigtail.BenchTwin(seed=seed)
    dark = gym.prepare(twin, rig, gym.PEAK.gap_m(rig))
    light, began, fine = twin.light(), twin.now_s, twin.caps.group("right.fine")
    assert info == {"seed": seed, "dark_v": dark}
    told = np.zeros(2)
    rng = np.random.default_rng(seed)
    for _ in range(200):
        known = twin.pose(fine, twin.now_s)
        assert known is not None
        by_hand = [light.volts[0], *told, *known.pose.xyz_um[:2], 10.0 - (twin.now_s - began)]
        np.testing.assert_array_equal(seen, np.array(by_hand, dtype=np.float32))
        action = rng.uniform(-1.0, 1.0, 2).astype(np.float32)
        told = np.clip(told + action, -10.0, 10.0)
        before = twin.now_s
        twin.play(fine, Line(Pose.um(*told)))
        light = twin.light()
        seen, reward, terminated, truncated, _ = env.step(action)
        assert reward == (light.volts[0] - dark) * ((twin.now_s - before) / 10.0)
        assert not terminated and not truncated
    assert pigtail.sim.truth(env.unwrapped.bench) == pigtail.sim.truth(twin)


@pytest.mark.parametrize("name", IDS)
def test_many_are_each_as_one_is(name: str) -> None:
    many = gymnasium.make_vec(name, num_envs=3, vectorization_mode="vector_entry_point", limit_s=0.4)
    ones = [gymnasium.make(name, limit_s=0.4, disable_env_checker=True) for _ in range(3)]
    seen, info = many.reset(seed=40)
    assert info["seed"].tolist() == [40, 41, 42]
    for k, one in enumerate(ones):
        np.testing.assert_array_equal(one.reset(seed=40 + k)[0], seen[k])
    rng = np.random.default_rng(1)
    over, ended = [False] * 3, 0
    for _ in range(100):
        actions = rng.uniform(-2.5, 2.5, many.action_space.shape).astype(np.float32)
        seen, reward, terminated, truncated, _ = many.step(actions)
        for k, one in enumerate(ones):
            if over[k]:
                told: Any = (one.reset()[0], 0.0, False, False)
            else:
                told = one.step(actions[k])[:4]
            np.testing.assert_array_equal(told[0], seen[k])
            assert told[1:] == (reward[k], terminated[k], truncated[k])
            over[k] = bool(told[2] or told[3])
            ended += over[k]
    assert ended > 3
    assert seen.dtype == np.float32 and many.observation_space.contains(seen)


def test_a_bench_of_ones_own_is_an_environment() -> None:
    from test_bench import Through

    own, ours = gym.BenchEnv("Peak", bench=Through), gym.BenchEnv("Peak")
    np.testing.assert_array_equal(own.reset(seed=5)[0], ours.reset(seed=5)[0])
    action = np.array([0.5, -0.5], dtype=np.float32)
    for _ in range(30):
        theirs = own.step(action)
        np.testing.assert_array_equal(theirs[0], ours.step(action)[0])
    own.close()


def test_whoever_approaches_blindly_touches_nothing() -> None:
    env = gym.BenchEnv("Approach", limit_s=5.0)
    for seed in range(6):
        env.reset(seed=seed)
        corner = np.array([(-1.0) ** seed, 1.0, 1.0], dtype=np.float32)
        for _ in range(250):
            seen, *_ = env.step(corner)
        truth = pigtail.sim.truth(env.bench)
        right = truth.carried[1]
        assert not truth.collision and right is not None and right.gap_um is not None
        # At the gap at which fibers are attached, which is 5 um.
        assert abs(right.gap_um - 5.0) < 1.5 and abs(seen[3] - seen[6]) < 0.5


def test_light_is_found_where_it_is() -> None:
    env = gym.BenchEnv("FirstLight")
    found = 0
    for seed in range(8):
        env.reset(seed=seed)
        truth = pigtail.sim.truth(env.bench)
        # Those who know where it is go there: this tells that the task can be done, and nobody else may ask.
        left, right = truth.carried
        assert left is not None and right is not None
        by = np.array([-left.x_um, -left.y_um, right.x_um, -right.y_um])
        told = np.zeros(4)
        for _ in range(40):
            way = np.clip(by - told, -1.0, 1.0)
            told += way
            _, reward, terminated, *_ = env.step(way.astype(np.float32))
            if terminated:
                found += 1
                assert reward > 0.9
                break
    # A peak may be out of a fine group's reach.
    assert found >= 6


def test_a_seed_may_be_numpys() -> None:
    many = gym.make_vec("Peak", 2)
    np.testing.assert_array_equal(many.reset(seed=np.int64(3))[0], many.reset(seed=3)[0])


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_process_steps_too() -> None:
    """Threads do not come along: whoever waits for them waits for ever."""
    many = gym.make_vec("Peak", 4)
    many.reset(seed=1)
    expected = many.step(np.ones((4, 2)))[0].tolist()

    def child() -> None:
        again = gym.make_vec("Peak", 4)
        again.reset(seed=1)
        sys.exit(7 if again.step(np.ones((4, 2)))[0].tolist() == expected else 1)

    forked = multiprocessing.get_context("fork").Process(target=child)
    forked.start()
    forked.join(60)
    if forked.is_alive():
        forked.kill()
        pytest.fail("it hangs")
    assert forked.exitcode == 7


def test_wrong_input_is_named() -> None:
    env = gym.BenchEnv("Peak")
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(2))
    env.reset(seed=1)
    many = gym.make_vec("Peak", 2, limit_s=0.2)
    many.reset(seed=1)
    for call, key in [
        (lambda: env.step(np.zeros(3)), "action"),
        (lambda: env.step(np.array([np.nan, 0.0])), "action"),
        (lambda: env.step("up"), "action"),
        (lambda: env.step([1e300, 0.0]), "action"),
        (lambda: many.step(np.full((2, 2), np.nan)), "actions"),
        (lambda: many.step(np.zeros(4)), "actions"),
        (lambda: many.step(np.zeros((2, 3))), "actions"),
        (lambda: gym.make_vec("Peak", 0), "num_envs"),
        (lambda: gym.BenchEnv("Sleep"), "task"),
        (lambda: gym.make_vec("Peak", 2).step(np.zeros((2, 2))), "step"),
        (lambda: many.reset(seed=[1]), "seed"),
        (lambda: gym.BenchEnv("Peak", limit_s=0.0), "limit_s"),
        (lambda: gym.make_vec("Peak", 2, limit_s=-1.0), "limit_s"),
        (lambda: gym.BenchEnv("Peak", limit_s=float("nan")), "limit_s"),
        (lambda: many.reset(seed=True), "seed"),
        (lambda: many.reset(seed=1.5), "seed"),
        (lambda: many.reset(seed=[1, -1]), "seed"),
        (lambda: many.reset(seed=2**64 - 1), "seed"),
        (lambda: gym.BenchEnv("Peak", bench=3), "bench"),
        (lambda: gym.BenchEnv("Peak", begin=3), "begin"),
        (lambda: gym.BenchEnv(np.zeros(2)), "task"),
        (lambda: gym.Axis(7, True, "x", -1.0, 1.0), "arm"),
        (lambda: gym.Axis(1, True, "q", -1.0, 1.0), "degree"),
        (lambda: gym.Axis(1, True, "x", 1.0, -1.0), "low_um"),
        (lambda: gym.Axis(1, True, "x", float("nan"), 1.0), "low_um"),
        (lambda: gym.Axis(1, True, "x", -1.0, float("inf")), "high_um"),
        (lambda: replace(gym.PEAK, axes=()), "axes"),
        (lambda: replace(gym.PEAK, gap_um=float("nan")), "gap_um"),
        (lambda: replace(gym.PEAK, most_um=0.0), "most_um"),
        (lambda: replace(gym.PEAK, limit_s=-1.0), "limit_s"),
        (lambda: replace(gym.PEAK, found_v=True), "found_v"),
        (lambda: gym.make_vec(replace(gym.PEAK, axes=(gym.Axis(1, False, "beam", 200.0, 300.0),)), 2), "low_um"),
    ]:
        made: Any = call
        with pytest.raises(pigtail.InputError) as raised:
            made()
        assert raised.value.key == key

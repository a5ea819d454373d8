"""The environments, held to Gymnasium's checker and to the runs that they are."""

import doctest
import importlib
import importlib.util
import os
import re
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")

import boresight.gym  # noqa: E402
from boresight.gym import episode, threads  # noqa: E402
from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium.vector import AutoresetMode  # noqa: E402

BLIND = ("PointErrors", "Search", "Assign")


def made(name, **more):
    return gymnasium.make(f"boresight/{name}-v0", **more).unwrapped


def same(one, other):
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    return np.array_equal(one, other)


@pytest.mark.parametrize("name", [*BLIND, "PointPixels"])
def test_gymnasiums_checker_finds_nothing(name):
    env = made(name)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env)
    env.close()


@pytest.mark.parametrize("name", BLIND)
def test_a_seed_is_an_episode(name):
    def played(seed):
        env = made(name)
        env.action_space.seed(1)
        observation, info = env.reset(seed=seed)
        seen = [observation]
        for _ in range(3):
            observation, reward, *_ = env.step(env.action_space.sample())
            seen.append(observation)
        found = info["seed"], env.run.seed, env.run.state_hash, reward
        env.close()
        return seen, found

    (one, found), (again, repeated), (_, others) = played(7), played(7), played(8)
    assert found == repeated and found[:2] == (7, 7) and found[2] != others[2]
    assert all(same(before, after) for before, after in zip(one, again, strict=True))


def test_an_episode_without_a_seed_says_which_it_was():
    env, other = made("Search"), made("Search")
    env.reset(seed=3)
    other.reset(seed=3)
    observation, info = env.reset()
    assert same(observation, other.reset()[0])
    assert info["seed"] < episode.DRAWN_SEEDS and info["seed"] != 3
    assert same(observation, other.reset(seed=info["seed"])[0])
    # The draws differ, too, and not the run's random streams alone.
    first = env.run.uavs[0].r_enu_m
    env.reset()
    assert np.linalg.norm(env.run.uavs[0].r_enu_m - first) > 1.0
    env.close()
    other.close()


@pytest.mark.parametrize("pool", [1, 3])
def test_several_over_threads_are_what_each_is_alone(pool):
    short = {"episode_s": 2 / 120}
    envs = gymnasium.make_vec(
        "boresight/PointErrors-v0", num_envs=3, vectorization_mode="vector_entry_point", threads=pool, **short
    )
    assert envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    alone = [made("PointErrors", **short) for _ in range(3)]
    envs.action_space.seed(0)
    together, infos = envs.reset(seed=40)
    apart = [env.reset(seed=40 + at) for at, env in enumerate(alone)]
    assert infos["seed"].tolist() == [40, 41, 42]
    over = [False] * 3
    for step in range(4):
        assert together.shape == (3, 18) and together.dtype == np.float32
        for at in range(3):
            assert np.array_equal(together[at], apart[at][0])
        actions = envs.action_space.sample()
        before = together
        together, rewards, ended, cut, _ = envs.step(actions)
        assert not np.shares_memory(before, together)
        for at, env in enumerate(alone):
            if over[at]:
                apart[at] = env.reset()
                reward, over[at] = 0.0, False
            else:
                observation, reward, terminated, truncated, _ = env.step(actions[at])
                apart[at] = (observation,)
                assert (ended[at], cut[at]) == (terminated, truncated)
                over[at] = terminated or truncated
            assert rewards[at] == reward
        # Two decisions, the limit; then a step that resets; then the next episode.
        assert cut.tolist() == [step == 1] * 3
    for env in [envs, *alone]:
        env.close()
    envs.close()


def test_what_is_over_may_be_reset_at_once():
    made_so = {"autoreset_mode": AutoresetMode.SAME_STEP, "episode_s": 2 / 120}
    envs = gymnasium.make_vec("boresight/PointErrors-v0", num_envs=2, **made_so)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    alone = made("PointErrors", episode_s=2 / 120)
    envs.reset(seed=8)
    alone.reset(seed=8)
    actions = np.zeros((2, 4), np.float32)
    envs.step(actions)
    alone.step(actions[0])
    together, _, _, cut, infos = envs.step(actions)
    last, *_, info = alone.step(actions[0])
    assert cut.all() and np.array_equal(infos["final_obs"][0], last)
    assert infos["final_info"]["error_rad"][0] == info["error_rad"]
    assert np.array_equal(together[0], alone.reset()[0])
    # The next step is one of the new episode.
    together, *_ = envs.step(actions)
    assert np.array_equal(together[0], alone.step(actions[0])[0])
    envs.close()
    alone.close()


@pytest.mark.parametrize("name", ["Search", "Assign"])
def test_dictionaries_come_together(name):
    envs = gymnasium.make_vec(f"boresight/{name}-v0", num_envs=2)
    assert isinstance(envs, threads.Threads)
    seen, _ = envs.reset(seed=[5, 9])
    assert seen in envs.observation_space
    env = made(name)
    for at, seed in enumerate((5, 9)):
        alone, _ = env.reset(seed=seed)
        assert all(np.array_equal(seen[key][at], alone[key]) for key in alone)
    with pytest.raises(ValueError, match="3 seeds"):
        envs.reset(seed=[1, 2, 3])
    env.close()
    envs.close()


def test_names_are_found_without_an_import(tmp_path):
    code = (
        "import gymnasium; env = gymnasium.make('boresight.gym:boresight/Search-v0'); env.reset(seed=1);"
        "print(env.unwrapped.run.seed); env.close()"
    )
    said = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, cwd=tmp_path)
    assert (said.stdout, said.stderr) == ("1\n", "")


def test_pointing_ends_as_it_should():
    env = made("PointErrors", hands_off=True, episode_s=1.0)
    env.reset(seed=1)
    rewards, over = [], False
    while not over:
        _, reward, terminated, truncated, info = env.step(np.zeros(4))
        rewards.append(reward)
        over = terminated or truncated
    # The station's own law holds the UAV to the end.
    assert truncated and not terminated and len(rewards) == 120
    assert np.mean(rewards[60:]) > 0.8 and info["error_rad"] < 100e-6
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(4))
    env.close()
    # Turned away, the station loses it.
    env = made("PointErrors")
    env.reset(seed=1)
    terminated, steps = False, 0
    while not terminated and steps < 120:
        _, reward, terminated, truncated, _ = env.step(np.array([1.0, 1.0, 0.0, 0.0]))
        steps += 1
    assert terminated and not truncated and reward == 0.0 and 5 < steps < 60
    assert env.run.station().mount.rates_radps[1] > 0.1
    env.close()


def test_the_angles_to_turn_are_the_error():
    env = made("PointErrors", hands_off=True)
    observation, info = env.reset(seed=4)
    for _ in range(60):
        observation, *_, info = env.step(np.zeros(4))
    told_rad = observation[2:4].astype(float) * 200e-6
    assert np.hypot(*told_rad) == pytest.approx(info["error_rad"], abs=40e-6)
    # A law that turns by them, told nothing else, holds the UAV, too.
    env.hands_off = False
    env.reset(seed=4)
    observation = env.observation()
    errors = []
    for _ in range(240):
        to_turn, rates, mirror = observation[0:2] * 10e-3, observation[4:6] * 0.3, observation[8:10] * 5e-3
        turn = (rates + 8.0 * (to_turn + mirror)) / np.radians(15.0)
        deflect = (mirror + 0.5 * to_turn) / 5e-3
        observation, _, terminated, _, info = env.step(np.concatenate([turn, deflect]))
        errors.append(info["error_rad"])
        assert not terminated
    assert np.median(errors[120:]) < 300e-6
    env.close()


def test_pixels_are_the_middle_of_the_picture():
    env = gymnasium.make("boresight/PointPixels-v0", size_px=64, hands_off=True, render_mode="rgb_array")
    env.reset(seed=2)
    seen = [env.step(np.zeros(4))[0] for _ in range(3)]
    whole = env.render()
    assert whole.shape == (256, 256, 3) and np.array_equal(whole[96:160, 96:160], seen[-1])
    assert not np.array_equal(seen[0], seen[1]) and not np.array_equal(seen[1], seen[2])
    # The law holds the UAV, so it is in the middle: no empty sky there.
    green = seen[-1][:, :, 1].astype(float)
    assert np.abs(green[16:48, 16:48] - np.median(green)).max() > 2.0 * np.abs(green[:8] - np.median(green)).max()
    env.close()


def test_search_looks_where_it_is_told():
    env = made("Search")
    observation, _ = env.reset(seed=6)
    assert (observation["looked"] == 1.0).any()
    for _ in range(12):
        observation, reward, terminated, *_ = env.step(np.array([0.5, 0.0], dtype=np.float32))
        assert reward == -0.25
        if terminated:
            break
    assert np.allclose(observation["look"][:2], [0.5, 0.0], atol=0.05)
    # It looks about that direction; the corner it saw long ago, or never.
    assert observation["looked"][1, 11] < 0.05 < observation["looked"][0, 0]
    env.close()
    # Told where the UAV is, the station has it within seconds; that ends the episode.
    env.reset(seed=6)
    terminated, steps = False, 0
    while not terminated and steps < 20:
        r = env.run.uavs[0].r_enu_m - env.run.station().mount.r_enu_m
        at = np.array([np.arctan2(r[0], r[1]), np.arctan2(r[2], np.hypot(r[0], r[1]))])
        off = (at - np.radians([0.0, 6.75])) / np.radians([45.0, 6.75])
        observation, _, terminated, truncated, info = env.step(off)
        steps += 1
    assert terminated and not truncated and info["acquired"]
    assert observation["seen"].max() > 0.5
    env.close()


def test_a_choice_of_a_uav_is_obeyed():
    env = made("Assign", uavs=4)
    observation, _ = env.reset(seed=11)
    there = np.flatnonzero(observation["objects"][:, 0])
    assert there.tolist() == [0, 1, 2, 3]
    # The one farthest from the beam, which the station would not take by itself.
    chosen = int(np.argmax(observation["objects"][:, 3]))
    total, steps = 0.0, 0
    while total == 0.0 and steps < 20:
        observation, reward, *_ = env.step(chosen + 1)
        total += reward
        steps += 1
    assert total == 1.0 and env.run.uavs[chosen].neutralised_s is not None
    # What is not there changes nothing, and 0 gives the choice back.
    while observation["objects"][chosen, 0]:
        observation, *_ = env.step(chosen + 1)
    given = []
    env.run.give, give = (lambda **order: given.append(order)), env.run.give
    env.step(chosen + 1)
    assert not given
    env.step(0)
    assert given == [{"station": "centre"}]
    env.run.give = give
    env.close()


def test_left_alone_it_is_the_plain_run():
    env = made("Assign", uavs=3, episode_s=90.0)
    env.reset(seed=12)
    total, over, steps = 0.0, False, 0
    while not over:
        observation, reward, terminated, truncated, info = env.step(0)
        total, over, steps = total + reward, terminated or truncated, steps + 1
    assert terminated and total == info["neutralised"] and info["neutralised"] + info["at_asset"] == 3
    changes = env.drawn(episode.draws(12))
    plain = boresight.Simulation(episode.SCENARIOS / "assign.toml", seed=12, set=changes)
    plain.step(env.run.tick)
    assert plain.state_hash == env.run.state_hash
    env.close()


@pytest.mark.parametrize(
    ("ask", "line"),
    [
        (lambda: made("Assign").step(0), "reset"),
        (lambda: made("Assign").run, "reset"),
        (lambda: made("Assign", uavs=0), "uavs: 0"),
        (lambda: made("Assign", stations=9), "stations: 9"),
        (lambda: made("Search", episode_s=-1.0), "episode_s: -1.0"),
        (lambda: made("PointErrors", decision_hz=7.0).reset(), "decision_hz: 7.0"),
        (lambda: made("PointPixels", size_px=300), "size_px: 300"),
        (lambda: made("PointPixels", decision_hz=120.0), "decision_hz: 120.0"),
        (lambda: made("PointPixels", render_mode="ansi"), "render_mode"),
        (lambda: made("Search").reset(seed=1 << 64), "seed: "),
        (lambda: gymnasium.make_vec("boresight/Search-v0", num_envs=0), "num_envs: 0"),
        (lambda: gymnasium.make_vec("boresight/Search-v0", num_envs=1, autoreset_mode="Disabled"), "autoreset_mode: DISABLED"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*render_mode")
def test_bad_input_gets_one_line(ask, line):
    with pytest.raises((ValueError, gymnasium.error.Error), match=line) as caught:
        ask()
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("name", "action"),
    [("PointErrors", [np.nan, 0, 0, 0]), ("PointErrors", [0, 0]), ("Search", "north"), ("Assign", 13), ("Assign", 0.5)],
)
def test_bad_actions_get_one_line(name, action):
    env = made(name)
    env.reset(seed=1)
    with pytest.raises(ValueError) as caught:
        env.step(action)
    assert len(str(caught.value).splitlines()) == 1
    env.close()
    env.close()


def test_the_plain_is_what_its_script_makes():
    folder = episode.SCENARIOS / "plain"
    spec = importlib.util.spec_from_file_location("plain", folder / "make.py")
    plain = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(plain)
    assert (folder / "heights.bin").read_bytes() == plain.heights()
    assert (folder / "tileset.json").read_bytes() == plain.tileset()


@pytest.mark.parametrize("name", ["geometry", "point", "search"])
def test_examples_of_the_documentation_hold(name):
    found = doctest.testmod(importlib.import_module(f"boresight.gym.{name}"), extraglobs={"np": np})
    assert found.failed == 0 and found.attempted > 0


def test_the_page_runs():
    blocks = re.findall(r"```python\n(.*?)```", Path("docs/gymnasium.md").read_text(), re.DOTALL)
    assert len(blocks) == 3
    names = {}
    for block in blocks:
        exec(block, names)


def test_the_training_example_runs():
    pytest.importorskip("stable_baselines3")
    words = [sys.executable, "examples/python/train_assign.py", "--steps", "256", "--episodes", "2", "--environments", "1"]
    said = subprocess.run(words, capture_output=True, text=True, env={**os.environ, "OMP_NUM_THREADS": "1"})
    assert said.returncode == 0, said.stderr
    assert "trained - shipped rule" in said.stdout

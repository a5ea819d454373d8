"""Steps a second of the environment of pointing, alone and several over threads, and of a peer at the same control rate.

    pip install './python[gym]'; python3 benches/environments.py
    pip install PyFlyt; python3 benches/environments.py    # in an environment of its own: an outside yardstick, no dependency

A step is one action of four numbers. Ours is steered by a law that turns by what is still to turn, so that episodes last; the
peer gets random actions about the middle. A reset, where an episode ends, is not counted, and said by itself.
"""

import argparse
import importlib.util
import os
import statistics
import time
import warnings

os.environ.setdefault("OMP_NUM_THREADS", "1")
warnings.simplefilter("ignore")

import gymnasium
import numpy as np

PARTS = 10
#: Longer than any measurement [s].
FOREVER_S = 3600.0


def turning(observations):
    """Actions that turn by the angles that are still to turn, for observations of `PointErrors`, one a row."""
    to_turn, rates, mirror = observations[:, 0:2] * 10e-3, observations[:, 4:6] * 0.3, observations[:, 8:10] * 5e-3
    turn, deflect = rates + 4.0 * (to_turn + mirror), mirror + 0.3 * to_turn
    return np.clip(np.hstack([turn / np.radians(15.0), deflect / 5e-3]), -1.0, 1.0).astype(np.float32)


def alone(env, steps, rng, choose):
    """Steps a second of an environment, and seconds of a reset: medians over ten parts, and over the resets."""
    resets, rates = [], []

    def reset():
        begun = time.perf_counter()
        observation, _ = env.reset(seed=int(rng.integers(1 << 31)))
        resets.append(time.perf_counter() - begun)
        return observation

    observation = reset()
    for _ in range(PARTS + 1):
        spent = 0.0
        for _ in range(steps // PARTS):
            action = choose(observation)
            begun = time.perf_counter()
            observation, _, terminated, truncated, _ = env.step(action)
            spent += time.perf_counter() - begun
            if terminated or truncated:
                observation = reset()
        rates.append(steps // PARTS / spent)
    # The first part warms up.
    return statistics.median(rates[1:]), statistics.median(resets)


def together(count, steps, control_hz):
    """Steps a second of so many over threads, and how many episodes ended meanwhile, whose resets are counted here."""
    envs = gymnasium.make_vec("boresight/PointErrors-v0", num_envs=count, decision_hz=control_hz, episode_s=FOREVER_S)
    observations, _ = envs.reset(seed=1)
    rates, ended = [], 0
    for _ in range(PARTS + 1):
        begun = time.perf_counter()
        for _ in range(steps // PARTS):
            observations, _, terminated, _, _ = envs.step(turning(observations))
            ended += int(terminated.sum())
        rates.append(count * (steps // PARTS) / (time.perf_counter() - begun))
    envs.close()
    return statistics.median(rates[1:]), ended


def main():
    words = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    words.add_argument("--steps", type=int, default=2000)
    words.add_argument("--control-hz", type=int, default=40, help="actions a second of simulated time, of all")
    asked = words.parse_args()
    rng = np.random.default_rng(1)
    print(f"{os.cpu_count()} cores; {asked.control_hz} actions a second of simulated time; steps a second, reset")
    ours = None
    if importlib.util.find_spec("boresight"):
        import boresight.gym  # noqa: F401

        env = gymnasium.make("boresight/PointErrors-v0", decision_hz=asked.control_hz, episode_s=FOREVER_S)
        ours, reset_s = alone(env, asked.steps, rng, lambda observation: turning(observation[None])[0])
        env.close()
        print(f"boresight/PointErrors-v0: {ours:,.0f} ({ours / asked.control_hz:,.0f} times real time), {reset_s:.3f} s")
        for count in (2, 8):
            rate, ended = together(count, asked.steps // 4, asked.control_hz)
            print(f"{count} of them over threads: {rate:,.0f}, {ended} resets among them")
    else:
        print("boresight: is not installed here; pip install './python[gym]'")
    if importlib.util.find_spec("PyFlyt"):
        import PyFlyt.gym_envs  # noqa: F401

        env = gymnasium.make("PyFlyt/QuadX-Hover-v4", agent_hz=asked.control_hz, max_duration_seconds=FOREVER_S)
        middle, half = 0.5 * (env.action_space.high + env.action_space.low), 0.5 * (env.action_space.high - env.action_space.low)
        random = lambda _: middle + 0.1 * half * rng.uniform(-1.0, 1.0, middle.shape)  # noqa: E731
        peer, reset_s = alone(env, asked.steps, rng, random)
        env.close()
        print(f"PyFlyt/QuadX-Hover-v4: {peer:,.0f} ({peer / asked.control_hz:,.0f} times real time), {reset_s:.3f} s")
        if ours is not None:
            print(f"ratio: {ours / peer:.2f}")
    else:
        print("PyFlyt: is not installed here; pip install PyFlyt in an environment of its own")
    print("gym-pybullet-drones: is not on PyPI; left out")


if __name__ == "__main__":
    main()

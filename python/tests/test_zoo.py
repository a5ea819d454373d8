"""Stations as agents, held to PettingZoo's own tests."""

import warnings

import numpy as np
import pytest

pytest.importorskip("pettingzoo")
from pettingzoo.test import parallel_api_test, parallel_seed_test  # noqa: E402

from boresight.zoo import stations_v0  # noqa: E402

SHORT = {"stations": 2, "uavs": 4, "episode_s": 6.0}


def test_pettingzoos_own_tests_pass():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        parallel_api_test(stations_v0.parallel_env(**SHORT), num_cycles=20)
        parallel_seed_test(lambda: stations_v0.parallel_env(**SHORT), num_cycles=10)


def test_a_seed_is_an_episode():
    def played():
        env = stations_v0.parallel_env(**SHORT)
        observations, infos = env.reset(seed=5)
        seen, rewards = [observations], []
        for step in range(4):
            actions = {agent: (step // 2 + at) % 5 for at, agent in enumerate(env.agents)}
            observations, reward, *_ = env.step(actions)
            seen.append(observations)
            rewards.append(reward)
        state_hash = env._all.run.state_hash
        env.close()
        return seen, rewards, infos, state_hash

    (one, rewards, infos, state_hash), (other, *rest) = played(), played()
    assert rest == [rewards, infos, state_hash]
    assert infos["centre"]["seed"] == 5 and set(infos) == {"centre", "east"}
    for before, after in zip(one, other, strict=True):
        for agent in before:
            for key in before[agent]:
                assert np.array_equal(before[agent][key], after[agent][key])
    # Each knows what it sees from where it stands.
    assert not np.array_equal(one[0]["centre"]["objects"], one[0]["east"]["objects"])


def test_agents_end_together_and_share_the_return():
    env = stations_v0.parallel_env(stations=2, uavs=2, episode_s=60.0)
    env.reset(seed=3)
    total = 0.0
    while env.agents:
        _, rewards, terminated, truncated, infos = env.step(dict.fromkeys(env.agents, 0))
        assert len(set(rewards.values())) == 1
        total += rewards["centre"]
    assert terminated == {"centre": True, "east": True} and not any(truncated.values())
    # Left to themselves, two stations bring two UAVs down.
    assert total == infos["centre"]["neutralised"] == 2.0
    with pytest.raises(Exception, match="reset"):
        env.step({"centre": 0, "east": 0})
    env.close()
    env.close()


@pytest.mark.parametrize(
    ("ask", "line"),
    [
        (lambda: stations_v0.parallel_env(stations=1), "stations: 1"),
        (lambda: stations_v0.parallel_env(stations=5), "stations: 5"),
        (lambda: stations_v0.parallel_env(uavs=0), "uavs: 0"),
        (lambda: stations_v0.parallel_env(episode_s=float("nan")), "episode_s: nan"),
    ],
)
def test_bad_sizes_get_one_line(ask, line):
    with pytest.raises(ValueError, match=line) as caught:
        ask()
    assert len(str(caught.value).splitlines()) == 1

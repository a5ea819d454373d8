"""A policy learns which UAV of a swarm to engage, and is held to the shipped rule on seeds that it never saw.

    pip install './python[gym]' stable-baselines3
    python3 examples/python/train_assign.py

Proximal policy optimisation by Stable-Baselines3. The network scores every object by the same weights, so that it knows no
order among them. Nothing is written: weights live as long as the process.
"""

import argparse
import os
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import CombinedExtractor
from stable_baselines3.common.vec_env import VecEnv, VecMonitor
from gymnasium.vector import AutoresetMode
from torch import nn

import boresight.gym  # noqa: F401 - registers the environments.

ENVIRONMENT = "boresight.gym:boresight/Assign-v0"
#: Episodes in training draw their seeds below this; those of the comparison lie above.
FRESH = 1 << 31
#: Columns of an object's row: whether it is there, and whether the station was told to engage it.
THERE, ORDERED = 0, 12
#: To begin with a policy leaves four choices of five to the station, and stays for some decisions with one of its own: a
#: UAV takes seconds to bring down.
LEAVES, STAYS = 3.9, 5.5
WIDTH = 64


class Scores(nn.Module):
    """A number for every object by the same weights, which also see the mean of all; and one for them together."""

    def __init__(self, objects, of_object, of_station, per_object):
        super().__init__()
        self.shape = (objects, of_object)
        self.each = nn.Sequential(nn.Linear(of_object + of_station, WIDTH), nn.Tanh(), nn.Linear(WIDTH, WIDTH), nn.Tanh())
        self.score = nn.Sequential(nn.Linear(2 * WIDTH, WIDTH), nn.Tanh(), nn.Linear(WIDTH, 1)) if per_object else None
        self.whole = nn.Sequential(nn.Linear(WIDTH + of_station, WIDTH), nn.Tanh(), nn.Linear(WIDTH, 1))

    def forward(self, flat):
        count, of_object = self.shape
        rows, station = flat[:, : count * of_object].view(-1, count, of_object), flat[:, count * of_object :]
        there = rows[:, :, THERE] > 0
        each = self.each(torch.cat([rows, station[:, None].expand(-1, count, -1)], dim=2))
        mean = (each * there[:, :, None]).sum(1) / there.sum(1, keepdim=True).clamp(min=1)
        whole = self.whole(torch.cat([mean, station], dim=1))
        if self.score is None:
            return whole
        scores = self.score(torch.cat([each, mean[:, None].expand(-1, count, -1)], dim=2)).squeeze(2)
        scores = (scores + STAYS * rows[:, :, ORDERED]).masked_fill(~there, -1e8)
        return torch.cat([whole + LEAVES, scores], dim=1)


class Chooser(ActorCriticPolicy):
    """Actor and critic of such scores."""

    def _build(self, lr_schedule):
        super()._build(lr_schedule)
        count, of_object = self.observation_space["objects"].shape
        sizes = (count, of_object, self.observation_space["station"].shape[0])
        self.action_net = Scores(*sizes, per_object=True)
        self.value_net = Scores(*sizes, per_object=False)
        self.optimizer = self.optimizer_class(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)


def returns(env, choose, seeds):
    """The return of an episode for each seed."""
    found = []
    for seed in seeds:
        observation, _ = env.reset(seed=seed)
        total, over = 0.0, False
        while not over:
            observation, reward, terminated, truncated, _ = env.step(choose(observation))
            total, over = total + reward, terminated or truncated
        found.append(total)
    return np.array(found)


def interval(values, rng, draws=10_000):
    """The mean of some values, and its 95 % interval by the bootstrap."""
    means = values[rng.integers(len(values), size=(draws, len(values)))].mean(axis=1)
    return values.mean(), *np.quantile(means, [0.025, 0.975])


class SideBySide(VecEnv):
    """Environments over threads, as Stable-Baselines3 wants them."""

    def __init__(self, count):
        self.envs = gymnasium.make_vec(ENVIRONMENT, num_envs=count, autoreset_mode=AutoresetMode.SAME_STEP)
        self.first_seed = None
        super().__init__(count, self.envs.single_observation_space, self.envs.single_action_space)

    def seed(self, seed=None):
        self.first_seed = seed
        return [seed] * self.num_envs

    def reset(self):
        observations, _ = self.envs.reset(seed=self.first_seed)
        self.first_seed = None
        return observations

    def step_async(self, actions):
        self.actions = actions

    def step_wait(self):
        observations, rewards, ended, cut, infos = self.envs.step(self.actions)
        of_each = [{} for _ in range(self.num_envs)]
        for at in np.flatnonzero(ended | cut):
            of_each[at] = {"terminal_observation": infos["final_obs"][at], "TimeLimit.truncated": bool(cut[at])}
        return observations, rewards.astype(np.float32), ended | cut, of_each

    def close(self):
        self.envs.close()

    def get_attr(self, attr_name, indices=None):
        return [getattr(self.envs.envs[at], attr_name) for at in self._get_indices(indices)]

    def set_attr(self, attr_name, value, indices=None):
        raise NotImplementedError("environments are not changed while they run")

    def env_method(self, method_name, *args, indices=None, **more):
        return [getattr(self.envs.envs[at], method_name)(*args, **more) for at in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class, indices=None):
        return [False for _ in self._get_indices(indices)]


def train(steps, seed, environments):
    """A trained model; the environments that it learned from are closed."""
    envs = VecMonitor(SideBySide(environments))
    rows = min(256, max(32, steps // environments))
    model = PPO(
        Chooser,
        envs,
        n_steps=rows,
        batch_size=min(256, rows * environments),
        n_epochs=8,
        learning_rate=lambda left: 1e-3 * left,
        gamma=0.99,
        gae_lambda=0.95,
        ent_coef=0.003,
        clip_range=0.2,
        policy_kwargs={"net_arch": [], "features_extractor_class": CombinedExtractor},
        seed=seed,
        device="cpu",
    )
    try:
        model.learn(steps, callback=tell, progress_bar=False)
    finally:
        envs.close()
    return model


def tell(here, _there):
    """Says how it goes, now and then."""
    model = here["self"]
    if model.num_timesteps % 2048 == 0 and model.ep_info_buffer:
        mean = np.mean([episode["r"] for episode in model.ep_info_buffer])
        print(f"{model.num_timesteps} steps: {mean:.2f} UAVs an episode", flush=True)
    return True


def main():
    words = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    words.add_argument("--steps", type=int, default=60_000, help="decisions to learn from")
    words.add_argument("--episodes", type=int, default=100, help="fresh episodes of the comparison")
    words.add_argument("--environments", type=int, default=4, help="side by side in training")
    words.add_argument("--seed", type=int, default=1)
    asked = words.parse_args()
    torch.set_num_threads(1)

    begun = time.perf_counter()
    model = train(asked.steps, asked.seed, asked.environments)
    trained_s = time.perf_counter() - begun

    env = gymnasium.make(ENVIRONMENT)
    rng = np.random.default_rng(asked.seed)
    choices = {
        "trained": lambda observation: int(model.predict(observation, deterministic=True)[0]),
        "shipped rule": lambda observation: 0,
        "random": lambda observation: int(rng.integers(env.action_space.n)),
    }
    seeds = [FRESH + at for at in range(asked.episodes)]
    found = {name: returns(env, choose, seeds) for name, choose in choices.items()}
    env.close()

    print(f"\n{asked.episodes} fresh episodes of 12 UAVs; mean number neutralised before the asset, 95 % interval")
    for name, values in found.items():
        print("{:>24}  {:5.2f}  [{:.2f}, {:.2f}]".format(name, *interval(values, rng)))
    for name in ("shipped rule", "random"):
        difference = interval(found["trained"] - found[name], rng)
        print("{:>24}  {:+5.2f}  [{:+.2f}, {:+.2f}]".format(f"trained - {name}", *difference))
    print(f"{asked.steps} steps learned from in {trained_s:.0f} s; all of it took {time.perf_counter() - begun:.0f} s")


if __name__ == "__main__":
    main()

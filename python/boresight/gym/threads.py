"""Several environments at a time, a thread each: while a run steps, the interpreter is free for the others."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, ClassVar

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space, concatenate, create_empty_array, iterate

from .assign import Assign
from .episode import Episodes
from .point import PointErrors, PointPixels
from .search import Search


class Threads(VectorEnv):
    """So many environments of a kind, stepped by a pool of threads. Results do not depend on the number of threads.

    Args:
        make: makes an environment.
        num_envs: how many.
        threads: how many run at a time; as many as there are cores without it.
        autoreset_mode: `NEXT_STEP`: what is over is reset by the next step, which gives the first observation of the new
            episode and a reward of 0. `SAME_STEP`: it is reset at once; its last observation and info are `final_obs` and
            `final_info` of the infos. `metadata["autoreset_mode"]` says which. `DISABLED` is not offered.
        of_each: arguments of every environment.

    `reset(seed=s)` gives environment i the seed s + i.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        make: Callable[..., Episodes],
        num_envs: int = 1,
        threads: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **of_each: Any,
    ) -> None:
        if num_envs < 1:
            raise ValueError(f"num_envs: {num_envs} must be 1 or more")
        if threads is not None and threads < 1:
            raise ValueError(f"threads: {threads} must be 1 or more")
        mode = AutoresetMode(autoreset_mode)
        if mode is AutoresetMode.DISABLED:
            raise ValueError("autoreset_mode: DISABLED is not offered; give NEXT_STEP or SAME_STEP")
        self.num_envs = num_envs
        self.envs = [make(**of_each) for _ in range(num_envs)]
        self.render_mode = self.envs[0].render_mode
        self.metadata = {**self.envs[0].metadata, "autoreset_mode": mode}
        self.single_action_space = self.envs[0].action_space
        self.single_observation_space = self.envs[0].observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._over = np.zeros(num_envs, dtype=bool)
        self._pool = ThreadPoolExecutor(min(num_envs, threads or os.cpu_count() or 1), thread_name_prefix="boresight")

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Resets all; seeds of each may be given as a list."""
        if seed is None or isinstance(seed, (int, np.integer)):
            super().reset(seed=None if seed is None else int(seed))
            seeds = [None if seed is None else int(seed) + at for at in range(self.num_envs)]
        else:
            seeds = list(seed)
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed: {len(seeds)} seeds were given for {self.num_envs} environments")
        done = self._pool.map(lambda env, seed: env.reset(seed=seed, options=options), self.envs, seeds)
        observations, infos = zip(*done, strict=True)
        self._over[:] = False
        return self._together(observations), self._infos(infos)

    def step(self, actions: Any) -> tuple[Any, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Steps all, or resets those whose episodes are over."""

        same_step = self.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP

        def one(env: Episodes, action: Any, over: bool) -> tuple[Any, float, bool, bool, dict[str, Any]]:
            if over:
                observation, info = env.reset()
                return observation, 0.0, False, False, info
            observation, reward, terminated, truncated, info = env.step(action)
            if same_step and (terminated or truncated):
                last = {"final_obs": observation, "final_info": info}
                observation, info = env.reset()
                info = {**info, **last}
            return observation, reward, terminated, truncated, info

        done = self._pool.map(one, self.envs, iterate(self.action_space, actions), self._over.tolist())
        observations, rewards, terminated, truncated, infos = zip(*done, strict=True)
        ended, cut = np.array(terminated, dtype=bool), np.array(truncated, dtype=bool)
        self._over = np.zeros_like(ended) if same_step else ended | cut
        return self._together(observations), np.array(rewards, dtype=np.float64), ended, cut, self._infos(infos)

    def render(self) -> tuple[Any, ...]:
        """The picture of each."""
        return tuple(env.render() for env in self.envs)

    def close_extras(self, **_: Any) -> None:
        """Finishes all runs."""
        for env in self.envs:
            env.close()
        self._pool.shutdown()

    def _together(self, observations: Sequence[Any]) -> Any:
        empty = create_empty_array(self.single_observation_space, self.num_envs)
        return concatenate(self.single_observation_space, observations, empty)

    def _infos(self, infos: Sequence[dict[str, Any]]) -> dict[str, Any]:
        together: dict[str, Any] = {}
        for at, info in enumerate(infos):
            together = self._add_info(together, info, at)
        return together


def point_errors(num_envs: int = 1, **of_each: Any) -> Threads:
    """`PointErrors`, several at a time."""
    return Threads(PointErrors, num_envs, **of_each)


def point_pixels(num_envs: int = 1, **of_each: Any) -> Threads:
    """`PointPixels`, several at a time."""
    return Threads(PointPixels, num_envs, **of_each)


def search(num_envs: int = 1, **of_each: Any) -> Threads:
    """`Search`, several at a time."""
    return Threads(Search, num_envs, **of_each)


def assign(num_envs: int = 1, **of_each: Any) -> Threads:
    """`Assign`, several at a time."""
    return Threads(Assign, num_envs, **of_each)

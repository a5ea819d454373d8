"""Several stations against a swarm: each chooses which UAV it engages."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from ..gym.assign import Assign
from ..gym.defence import NAMES, OF_OBJECT, OF_STATION


class parallel_env(ParallelEnv[str, dict[str, NDArray[np.float32]], int]):  # noqa: N801 - PettingZoo's own name.
    """Stations that share a return: every agent's reward is the number of UAVs neutralised before they came to the asset.

    Observation and action of an agent are those of `boresight/Assign-v0` with one station: what this station knows, and
    which object it engages, 0 for its own choice. All agents stay until the episode ends, for all at once.

    Args:
        stations: how many agents, 2 to 4.
        uavs: how many UAVs come, 1 to 64.
        episode_s: longest episode [s].
        decision_hz: actions a second.
    """

    metadata: ClassVar[dict[str, Any]] = {"name": "stations_v0", "render_modes": []}

    def __init__(self, stations: int = 3, uavs: int = 12, episode_s: float = 75.0, decision_hz: float = 2.0) -> None:
        if not 2 <= stations <= len(NAMES):
            raise ValueError(f"stations: {stations} must be from 2 to {len(NAMES)}")
        self._all = Assign(uavs=uavs, stations=stations, episode_s=episode_s, decision_hz=decision_hz)
        self.render_mode = None
        self.possible_agents = list(NAMES[:stations])
        self.agents: list[str] = []
        one = {
            "objects": spaces.Box(-1.0, 1.0, (uavs, OF_OBJECT), np.float32),
            "station": spaces.Box(-1.0, 1.0, (OF_STATION,), np.float32),
        }
        self.observation_spaces = {agent: spaces.Dict(one) for agent in self.possible_agents}
        self.action_spaces: dict[str, spaces.Space] = {agent: spaces.Discrete(uavs + 1) for agent in self.possible_agents}

    def observation_space(self, agent: str) -> spaces.Space:
        """The space of an agent's observations, always the same object."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space:
        """The space of an agent's actions, always the same object."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, dict[str, NDArray[np.float32]]], dict[str, dict[str, Any]]]:
        """Opens the next episode: the same for the same seed, bit for bit. There are no options."""
        observation, info = self._all.reset(seed=seed)
        self.agents = list(self.possible_agents)
        return self._apart(observation), {agent: dict(info) for agent in self.agents}

    def step(
        self, actions: dict[str, int]
    ) -> tuple[
        dict[str, dict[str, NDArray[np.float32]]],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """Carries out the action of every agent, and lets time pass until the next decision."""
        if not self.agents:
            raise gymnasium.error.ResetNeeded("the episode is over, or none was begun; call reset() first")
        missing = [agent for agent in self.agents if agent not in actions]
        if missing:
            raise ValueError(f"actions: '{missing[0]}' has none; give one for each of {', '.join(self.agents)}")
        wanted = np.array([actions[agent] for agent in self.agents])
        observation, reward, terminated, truncated, info = self._all.step(wanted)
        stepped = (
            self._apart(observation),
            dict.fromkeys(self.agents, reward),
            dict.fromkeys(self.agents, terminated),
            dict.fromkeys(self.agents, truncated),
            {agent: dict(info) for agent in self.agents},
        )
        if terminated or truncated:
            self.agents = []
        return stepped

    def render(self) -> None:
        """Shows nothing: a run is looked at in the program's window, or in its recording."""

    def close(self) -> None:
        """Finishes the run; may be called again."""
        self._all.close()

    def _apart(self, observation: dict[str, NDArray[np.float32]]) -> dict[str, dict[str, NDArray[np.float32]]]:
        """Every agent's part of the observations."""
        return {
            agent: {key: of[at].copy() for key, of in observation.items()} for at, agent in enumerate(self.possible_agents)
        }

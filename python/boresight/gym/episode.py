"""Episodes: each is a run of its own, drawn from its seed."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np

from ..simulation import Simulation

#: The scenarios of the environments.
SCENARIOS = Path(__file__).parent / "scenarios"
#: Episodes without a seed of the caller's draw theirs below this; from here on seeds are never drawn.
DRAWN_SEEDS = 1 << 31
#: The program's seeds lie below this.
MOST_SEEDS = 1 << 64


def draws(seed: int) -> np.random.Generator:
    """What an episode's scenario is drawn from; the run has random streams of its own from the same seed."""
    return np.random.default_rng([seed & 0xFFFF_FFFF, seed >> 32, 0xB0])


def checked_seed(seed: int) -> int:
    """A caller's seed, as long as the program can take it."""
    if not 0 <= seed < MOST_SEEDS:
        raise ValueError(f"seed: {seed} must be a whole number from 0 to 2^64 - 1")
    return seed


class Episodes(gymnasium.Env):
    """The base of the environments: opens a run at each reset, steps it by decisions, and finishes it.

    `reset(seed=s)` gives the same episode, bit for bit, every time; without a seed the environment's own generator draws
    one. `info["seed"]` says which it was.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}
    #: Whether cameras render.
    pictures = False

    def __init__(self, scenario: str, episode_s: float, decision_hz: float) -> None:
        for name, value in (("episode_s", episode_s), ("decision_hz", decision_hz)):
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{name}: {value} must be a number above 0")
        self.episode_s = episode_s
        self.decision_hz = decision_hz
        self._scenario = SCENARIOS / scenario
        self._run: Simulation | None = None
        self._running = False
        self._steps = 0

    @property
    def run(self) -> Simulation:
        """The run of the episode: the whole simulation, truth included."""
        if self._run is None:
            raise gymnasium.error.ResetNeeded("there is no episode; call reset() first")
        return self._run

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Opens the next episode; there are no options."""
        super().reset(seed=seed)
        episode = int(self.np_random.integers(DRAWN_SEEDS)) if seed is None else checked_seed(seed)
        self._finish()
        self._open(episode, self.drawn(draws(episode)))
        self._steps = 0
        self._running = True
        self.begin()
        return self.observation(), {"seed": episode, **self.info()}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Carries an action out and lets time pass until the next decision."""
        if not self._running:
            raise gymnasium.error.ResetNeeded("the episode is over, or none was begun; call reset() first")
        run = self.run
        self.act(action)
        self._steps += 1
        run.step(self._ticks)
        reward, terminated = self.outcome()
        truncated = not terminated and (run.over or self._steps >= self._most_steps)
        self._running = not (terminated or truncated)
        return self.observation(), reward, terminated, truncated, self.info()

    def close(self) -> None:
        """Finishes the run; may be called again."""
        self._finish()

    def _open(self, seed: int, changes: dict[str, Any]) -> None:
        """Opens the run. Worker threads of its own would change nothing and stand in the way of runs beside it."""
        self._run = Simulation(self._scenario, seed=seed, set=changes, pictures=self.pictures, threads=1)
        tick_hz = self._run.tick_hz
        ticks = tick_hz / self.decision_hz
        self._ticks = round(ticks)
        if self._ticks < 1 or abs(ticks - self._ticks) > 1e-9:
            self._finish()
            raise ValueError(f"decision_hz: {self.decision_hz} must divide the {tick_hz} ticks a second")
        self._most_steps = max(1, round(self.episode_s * self.decision_hz))

    def _finish(self) -> None:
        run, self._run, self._running = self._run, None, False
        if run is not None:
            run.finish()

    # What an environment says for itself.

    def drawn(self, rng: np.random.Generator) -> dict[str, Any]:
        """The changes to the scenario that make the episode."""
        raise NotImplementedError

    def begin(self) -> None:
        """What happens before the first observation."""

    def act(self, action: Any) -> None:
        """Gives the orders of an action."""
        raise NotImplementedError

    def outcome(self) -> tuple[float, bool]:
        """The reward of the time that passed, and whether the episode has come to its end."""
        raise NotImplementedError

    def observation(self) -> Any:
        """The present as the station knows it, in fresh arrays."""
        raise NotImplementedError

    def info(self) -> dict[str, Any]:
        """What is worth knowing besides: truth, for evaluation only."""
        return {}

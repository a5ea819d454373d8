"""Environments for learning, by Gymnasium's interface; importing this registers them by name.

    import boresight.gym, gymnasium

    env = gymnasium.make("boresight/Assign-v0")
    envs = gymnasium.make_vec("boresight/Assign-v0", num_envs=8)  # over threads

Without the import `gymnasium.make("boresight.gym:boresight/Assign-v0")` does the same.
"""

from __future__ import annotations

try:
    import gymnasium
except ModuleNotFoundError as error:
    raise ModuleNotFoundError("boresight.gym needs Gymnasium: pip install 'boresight[gym]'", name="gymnasium") from error

from .assign import Assign
from .point import PointErrors, PointPixels
from .search import Search
from .threads import Threads

__all__ = ["Assign", "PointErrors", "PointPixels", "Search", "Threads", "register_envs"]

#: The environments: name, module and class, and the function that makes several.
ENVIRONMENTS = (
    ("boresight/PointErrors-v0", "point:PointErrors", "point_errors"),
    ("boresight/PointPixels-v0", "point:PointPixels", "point_pixels"),
    ("boresight/Search-v0", "search:Search", "search"),
    ("boresight/Assign-v0", "assign:Assign", "assign"),
)


def register_envs() -> None:
    """Registers the environments that are not yet registered."""
    for name, of_one, of_several in ENVIRONMENTS:
        if name not in gymnasium.registry:
            gymnasium.register(
                name, entry_point=f"boresight.gym.{of_one}", vector_entry_point=f"boresight.gym.threads:{of_several}"
            )


register_envs()

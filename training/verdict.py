"""UAV or not: how a detector's classes become one label and one score.

The first `UAVS` classes are UAVs, the others are not. What looks half like a bird and half like a quadcopter must not
score as if it were surely a UAV, and a quadcopter that might be a hexacopter is no less of a UAV.
"""

import torch
from torch import Tensor

UAVS = 3  # classes of `models.CLASSES` that are UAVs
# Share of UAVs from which on something is called one: who reads the score can refuse it, a bird's label hides it. Chosen on
# the development half of the real frames, where 0.5 keeps a tenth of the UAVs from every threshold.
BAR = 0.3


def verdict(shares: Tensor) -> tuple[Tensor, Tensor]:
    """Labels int64 [...] and shares [...] of classes' shares [...,C] of one object: UAVs from `BAR`
    on and otherwise the others, the group's share, and its likeliest class. With UAVs alone the share is 1."""
    uav, other = shares[..., :UAVS], shares[..., UAVS:]
    if other.shape[-1] == 0:
        return uav.argmax(-1), torch.ones_like(shares[..., 0])
    is_uav = uav.sum(-1) >= BAR * shares.sum(-1)
    label = torch.where(is_uav, uav.argmax(-1), other.argmax(-1) + UAVS)
    return label, torch.where(is_uav, uav.sum(-1), other.sum(-1))


def any_of(chances: Tensor) -> tuple[Tensor, Tensor]:
    """Labels int64 [...] and scores [...] of classes' independent chances [...,C]: the likelier group, the chance that
    any of its classes is there, and its likeliest class."""
    group = lambda p: 1 - (1 - p).prod(-1)  # noqa: E731
    uav, other = chances[..., :UAVS], chances[..., UAVS:]
    if other.shape[-1] == 0:
        return uav.argmax(-1), group(uav)
    is_uav = group(uav) >= group(other)
    label = torch.where(is_uav, uav.argmax(-1), other.argmax(-1) + UAVS)
    return label, torch.maximum(group(uav), group(other))

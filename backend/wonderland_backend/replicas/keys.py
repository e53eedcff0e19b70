"""Where on the bus backends of one database speak: below ``wonderland/backends/``, which is theirs alone."""

from __future__ import annotations


def frames(instance: str) -> str:
    """Where the one on duty puts its frames."""
    return f"wonderland/backends/{instance}/frames"


def state(instance: str, epoch: str) -> str:
    """Where the one that began its duty with this epoch is asked for its state."""
    return f"wonderland/backends/{instance}/on-duty/{epoch}/state"


def requests(instance: str, epoch: str) -> str:
    """Where it is asked to do what only it can do: by its epoch, so that nobody else does it."""
    return f"wonderland/backends/{instance}/on-duty/{epoch}/requests"

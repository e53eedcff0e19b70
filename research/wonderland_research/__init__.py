"""What judges the verdict: the attack lab, the paper's figures anew, and recorded ranges of whoever has some.

``attack_lab`` plays liars against the contract's own decision; ``reproduction`` repeats the paper and its successors;
``evaluate`` judges recordings, and ``judge`` what is in memory already.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from wonderland_research.judging import InputError, Window, judge

__all__ = ["InputError", "Window", "judge"]


def __getattr__(name: str) -> Any:
    """On first use: a command's --help must not load the world."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from wonderland_research import judging  # noqa: PLC0415

    return getattr(judging, name)

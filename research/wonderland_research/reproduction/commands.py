"""``wonderland reproduce``: published experiments and stated goals, repeated here."""

from __future__ import annotations

import os

import click

from wonderland.lazy_commands import LazyGroup

# Before any command brings gRPC along: processes are started while its threads run, and its own fork handlers would
# only complain about it.
os.environ.setdefault("GRPC_ENABLE_FORK_SUPPORT", "0")


@click.group(
    cls=LazyGroup,
    lazy={
        "all": (
            "wonderland_research.reproduction.experiments:everything",
            "The goals, the paper's experiment, real recordings and attacks: one report.",
        ),
        "hyu": (
            "wonderland_research.reproduction.experiments:hyu",
            "Real ranges with truth: how often the verdict is right.",
        ),
        "paper": (
            "wonderland_research.reproduction.experiments:paper",
            "The paper's four points, each sent the whole way.",
        ),
    },
)
def reproduce() -> None:
    """Repeat published experiments and the goals of the verdict with this implementation.

    \b
    wonderland reproduce paper                 the paper's four points, the whole way
    wonderland reproduce hyu --data DIR        real ranges with truth
    wonderland reproduce all --data DIR        everything in one report (HTML)
    """  # noqa: D301 - \b is click's mark for "do not wrap"

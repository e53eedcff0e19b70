"""A router of the bus as a process of its own: `python -m kit.bus_router SETTINGS`; prints a line when it is up."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path

from wonderland_bus.session import open_router
from wonderland_bus.settings import Router, Tls


def written(router):
    """Settings as an argument of this program."""
    found = asdict(router)
    return json.dumps(found, default=str)


def main():
    found = json.loads(sys.argv[1])
    tls = Tls(**{name: Path(file) for name, file in found.pop("tls").items()})
    with open_router(Router(tls=tls, **found)):
        print("up", flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    main()

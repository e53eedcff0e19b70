"""``wonderland registry``: pads, drones and what is said of them, on the ledger, without a browser."""

from __future__ import annotations

import click

from wonderland.lazy_commands import LazyGroup

_KINDS = {
    "pads": "Landing pads: register, edit, retire; lists.",
    "drones": "Drones: register, suspend, retire, reinstate; lists.",
    "maintenance": "What was done to drones, and until when it is good.",
    "authorisations": "Which drone may do what at which pad, and when.",
    "operators": "Who operates how many pads and drones.",
    "policies": "What a pad asks of a proof: in force, proposed, approved by a second person.",
    "closures": "When zones close a pad.",
}


_GROUPS = {name: (f"wonderland.registry.groups:{name}", text) for name, text in _KINDS.items()}
_MOVE = ("wonderland.registry.move_command:move", "Register here what holds on a former ledger.")


@click.group(cls=LazyGroup, lazy=_GROUPS | {"move": _MOVE})
def registry() -> None:
    """Pads, drones, maintenance, authorisations and policies on the ledger, without a browser.

    Everything is read from the blocks of your peer; no backend is asked. A change is a transaction signed by an
    identity of connection.json, whose key may be in a hardware module (docs/operate/hsm.md).

    \b
      wonderland registry drones list --connection connection.json --identity fleet_operator
      wonderland registry drones import drones.csv --dry-run …
      wonderland registry authorisations export --format json … > authorisations.json
    """  # noqa: D301 - \b is click's mark for "do not wrap"

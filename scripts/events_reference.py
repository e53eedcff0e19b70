"""Writes the reference of everything that is told by itself, and of the audit log's acts (``make docs``)."""

from __future__ import annotations

import inspect
from typing import Any

from pages import prose, table, write

from wonderland import messages
from wonderland.proofs.records.transactions import TRANSACTIONS
from wonderland_backend.alerts.kinds import SEVERITIES, plain_text
from wonderland_backend.audit.acts import ACTS
from wonderland_backend.description import openapi
from wonderland_backend.outputs.items import Item
from wonderland_backend.outputs.mqtt import status_topic, topic
from wonderland_backend.reference.asyncapi import asyncapi
from wonderland_backend.routes import new_app
from wonderland_backend.settings import Settings
from wonderland_backend.settings.outputs import KINDS, MqttSettings

CHOSEN = {"code": "zone_active", "drones": 100}
"""Facts by which alerts choose their words."""


def page() -> str:
    """The whole page in Markdown."""
    pushed = asyncapi("localhost")
    description = openapi(new_app(Settings(), frozenset(), None))
    prefix = MqttSettings.model_fields["prefix"].default
    lines = [
        "# Events, alerts and acts",
        "",
        "Made by `make docs` from their own definitions; do not edit. More may come at any time: pass over what you do",
        "not know.",
        "",
        "## Events of the ledger",
        "",
        "Each committed transaction that changes something has one event; it carries the record as it is stored then.",
        "They come in the event stream and in webhooks, too ([events and webhooks](../api/webhooks.md)).",
        "",
        *table(
            ("Event", "Transaction, and its form", "What happened"),
            [
                (f"`{each.event}`", f"[{each.name}](records.md#{each.name.lower()})", prose(_said(each.argument)))
                for each in TRANSACTIONS.values()
                if each.event
            ],
        ),
        "",
        "## Pushed by the server",
        "",
        "Each form is in `/api/v1/asyncapi.json` of a running server.",
        "",
        *table(("Address", "Message", ""), _pushed(pushed)),
        "",
        "## Webhooks",
        "",
        "Their `type`; each form is in the section `webhooks` of `/api/v1/openapi.json`, and how to check them in",
        "[events and webhooks](../api/webhooks.md). Of type `event` the `type` is that of the ledger’s event.",
        "",
        *table(
            ("Type", ""),
            [
                (f"`{name}`", prose(told["post"]["description"].split("\n\n")[0]))
                for name, told in description["webhooks"].items()
            ],
        ),
        "",
        "## MQTT",
        "",
        f"Topics, where `prefix` is `{prefix}` as it comes; what they carry is in [outputs](../outputs.md#mqtt).",
        "",
        *table(
            ("Topic", "From"),
            [
                *((f"`{topic(prefix, Item(kind, 'SERIAL', 0, {}))}`", kind) for kind in KINDS),
                (f"`{status_topic(prefix)}`", "the server: `online` or `offline`"),
            ],
        ),
        "",
        "## Alerts",
        "",
        "Their form is `Alert` in `/api/v1/openapi.json`. `…` stands for what the facts of one say; where they choose",
        "the words, one of the choices is shown.",
        "",
        *table(
            ("Kind", "Severity", "Title", "Says"),
            [
                (f"`{kind}`", severity, prose(messages.text("alert-titles", kind, {})), prose(_alert(kind)))
                for kind, severity in SEVERITIES.items()
            ],
        ),
        "",
        "## Acts in the audit log",
        "",
        "As `act` in `GET /api/v1/audit`, behind the name of who did it ([people and the audit",
        "log](../operate/people.md)).",
        "",
        *table(("Act", "In the console"), [(f"`{act}`", prose(_act(act))) for act in sorted(ACTS)]),
    ]
    return "\n".join(lines) + "\n"


def _said(kind: type) -> str:
    return inspect.cleandoc(kind.__doc__ or "").split("\n\n")[0]


def _pushed(document: dict[str, Any]) -> list[tuple[str, str, str]]:
    known = document["components"]["messages"]
    return [
        (f"`{channel['address']}`", f"`{name}`", prose(known[name]["summary"]))
        for channel in document["channels"].values()
        for name in channel["messages"]
    ]


def _alert(kind: str) -> str:
    return plain_text(kind, "PAD", "DRONE", CHOSEN).replace("?", "…").replace("….", "…")


def _act(act: str) -> str:
    """As the console says it. Raises ValueError where it has no words."""
    text = messages.text("console/audit", "name", {"act": act, "plain": ""})
    if not text.strip():
        raise ValueError(f"the console has no words for the act {act}")
    return text


if __name__ == "__main__":
    write(page)

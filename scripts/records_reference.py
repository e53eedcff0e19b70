"""Writes the reference of records and transactions from their definitions (``make docs``)."""

from __future__ import annotations

from typing import Any

from pages import table, write

from wonderland.proofs.records import assets, changes, closures, pads, policies, sessions, uavs, verdicts
from wonderland.proofs.records.schema import Record
from wonderland.proofs.records.transactions import ROLES, TRANSACTIONS
from wonderland.proofs.transcript import Transcript

RECORDS: tuple[type[Record], ...] = (
    pads.Pad, pads.Commissioning, pads.Frame, pads.Anchor, pads.BiasPoint, pads.Prekey, uavs.Uav, uavs.Maintenance,
    uavs.Authorisation, policies.Policy, changes.ProposedChange, changes.PolicyChange, changes.Reinstatement,
    changes.Signatory, closures.Closures, closures.Closure,
    sessions.Session, sessions.Claim, sessions.Evidence, sessions.RangeTable,
    sessions.AnchorRanges, sessions.TimeStamps, sessions.AnchorTicks, sessions.ClockReading, sessions.BroadcastClaim,
    sessions.Radio, sessions.Witness, sessions.LastRequest, sessions.Party, sessions.Testimony, verdicts.Verdict,
    verdicts.Judgement, verdicts.BroadcastFinding, verdicts.TimeDifferences,
    verdicts.DroneClock, verdicts.Position, verdicts.Covariance,
    verdicts.Reason, assets.Asset, assets.AssetChange, Transcript,
)  # fmt: skip


def page() -> str:
    """The whole page in Markdown."""
    lines = [
        "# Records and transactions",
        "",
        "Made by `make docs` from `libraries/core/wonderland/proofs/records/`; do not edit.",
        "One canonical encoding for all: RFC 8785 JSON of objects, arrays, strings, booleans and integers.",
        "Units are in the names.",
        "",
        "## Transactions",
        "",
        *table(
            ("Transaction", "Who", "Event"),
            [
                (
                    f"[{entry.name}](#{entry.name.lower()})",
                    ", ".join(entry.roles) if len(entry.roles) < len(ROLES) else "every role",
                    entry.event or "(query)",
                )
                for entry in TRANSACTIONS.values()
            ],
        ),
    ]
    for entry in TRANSACTIONS.values():
        schema = entry.argument.json_schema()
        lines += ["", f"### {entry.name}", "", schema["description"], "", *_table(schema)]
    lines += ["", "## Records"]
    for record in RECORDS:
        schema = record.json_schema()
        lines += ["", f"### {record.__name__}", "", " ".join(schema["description"].split()), "", *_table(schema)]
    return "\n".join(lines) + "\n"


def _table(schema: dict[str, Any]) -> list[str]:
    rows = []
    for name, field in schema["properties"].items():
        needed = "" if name in schema["required"] else "optional"
        said = "" if "properties" in field else field.get("description", "")
        rows.append((f"`{name}`", _type(field), needed, said))
    return table(("Field", "Type", "", ""), rows)


def _type(field: dict[str, Any]) -> str:
    if "enum" in field:
        return " | ".join(f"`{option}`" for option in field["enum"])
    if field["type"] == "integer":
        return f"integer {field['minimum']} … {field['maximum']}"
    if field["type"] == "array":
        return f"list of {field['minItems']}–{field['maxItems']} {_type(field['items'])}"
    if "contentEncoding" in field:
        return "base64url"
    if field["type"] == "string":
        return f"text ≤ {field['maxLength']}"
    return field.get("title", field["type"])


if __name__ == "__main__":
    write(page)

"""Writes the reference of ``wonderland-ingest/1`` from its structs (``make docs``)."""

from __future__ import annotations

from typing import Any, get_args

import msgspec
from pages import table, write

from wonderland import telemetry
from wonderland.telemetry.frames import FromAgent, FromServer

PARTS = (
    telemetry.Drip, telemetry.Signature, telemetry.EndStep, telemetry.AnchorHealth, telemetry.SpoolHealth,
    telemetry.ReceiverHealth, telemetry.Drift,
)  # fmt: skip
EVIDENCE = (telemetry.Step, telemetry.SessionEnd)


def page() -> str:
    """The whole page in Markdown."""
    lines = [
        "# What agents report: `wonderland-ingest/1`",
        "",
        "Made by `make docs` from `libraries/core/wonderland/telemetry/`; do not edit. Who says what when is in",
        "[seams](../seams.md#agents--backend-ingest). JSON texts; integers only, no floats; units are in the names.",
        "What has no value is left out. Agents may say what is listed here and nothing else; what the server says",
        "besides is passed over. Agents' texts have no control characters, but for the lines of `certificate`. All of",
        "it is unverified.",
        "",
        "## From agents",
    ]
    for message in get_args(FromAgent):
        lines += _section(message, f"`{message.__struct_config__.tag}`")
    lines += ["", "## From the server"]
    for message in get_args(FromServer):
        lines += _section(message, f"`{message.__struct_config__.tag}`")
    lines += ["", "## Records", ""]
    kinds = []
    for kind, body in telemetry.BODIES.items():
        lost = "evidence: never dropped" if body in EVIDENCE else "telemetry"
        lost = "the spool's own" if body is telemetry.Dropped else lost
        kinds.append((f"`{kind}`", f"[{body.__name__}](#{body.__name__.lower()})", lost))
    lines += table(("Kind", "Body", ""), kinds)
    lines += _section(telemetry.Record, "Record")
    for body in telemetry.BODIES.values():
        lines += _section(body, body.__name__)
    for part in PARTS:
        lines += _section(part, part.__name__)
    return "\n".join(lines) + "\n"


def _section(struct: Any, title: str) -> list[str]:
    (schema,), parts = msgspec.json.schema_components([struct], ref_template="{name}")
    properties = parts[schema["$ref"]]["properties"]
    required = parts[schema["$ref"]].get("required", [])
    rows = []
    for name, field in properties.items():
        said = " ".join(_said(field).split())
        if struct is telemetry.Track and name in telemetry.FOR_USPACE:
            said = f"{said}. For U-space, never stored".removeprefix(". ")
        rows.append((f"`{name}`", _type(field), "" if name in required else "optional", said))
    return [
        "",
        f"### {title}",
        "",
        " ".join((struct.__doc__ or "").split()),
        "",
        *table(("Field", "Type", "", ""), rows),
    ]


def _only(field: dict[str, Any]) -> dict[str, Any]:
    """The field's schema without the null that stands for "left out"."""
    options = [each for each in field.get("anyOf", [field]) if each.get("type") != "null"]
    found: dict[str, Any] = options[0]
    return found


def _said(field: dict[str, Any]) -> str:
    text = field.get("description") or _only(field).get("description", "")
    return str(text)


def _type(field: dict[str, Any]) -> str:
    field = _only(field)
    if "$ref" in field:
        name = field["$ref"]
        return f"[{name}](#{name.lower()})"
    if "allOf" in field:
        return _type(field["allOf"][0])
    if "enum" in field:
        return " | ".join(f"`{option}`" for option in field["enum"] if option is not None)
    kind = field.get("type", "object")
    if kind == "integer":
        return f"integer {field['minimum']} … {field['maximum']}" if "minimum" in field else "integer"
    if kind == "array":
        most = f" of at most {field['maxItems']}" if "maxItems" in field else ""
        return f"list{most}: {_type(field['items'])}"
    if kind == "string":
        return f"text ≤ {field['maxLength']}" if "maxLength" in field else "text"
    if kind == "object" and "additionalProperties" in field:
        return f"object of at most {field['maxProperties']}: {_type(field['additionalProperties'])}"
    return str(kind)


if __name__ == "__main__":
    write(page)

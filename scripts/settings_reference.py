"""Writes the reference of every setting of every part from its definition (``make docs``).

The backend's settings say what they are in their fields; those of agents in the sentence below each field; a drone's
are its options, and say the same.
"""

from __future__ import annotations

import ast
import inspect
import json
from collections.abc import Iterator
from typing import Any

import click
import msgspec
from pages import table, write

from wonderland.toml_settings import Address, Table
from wonderland_backend.bus_commands import RouterSettings
from wonderland_backend.settings import PREFIX
from wonderland_backend.settings import Settings as BackendSettings
from wonderland_edge_agent.settings import PadSettings
from wonderland_ros_bridge.ros2.settings import Settings as Ros2Settings
from wonderland_ros_bridge.settings import Settings as Ros1Settings
from wonderland_uav_agent.commands import uav
from wonderland_uav_agent.settings import OPTIONS, UavSettings

AGENTS: tuple[tuple[str, str, str, type[Table]], ...] = (
    ("Pad", "pad.toml", "`wonderland pad run --config pad.toml`; `--check` says how it is understood.", PadSettings),
    (
        "Drone",
        "uav.toml",
        "`wonderland uav serve --config uav.toml`. What is no table is an option, too, which wins.",
        UavSettings,
    ),
    (
        "Router of the bus",
        "router.toml",
        "`wonderland bus serve --config router.toml`; `--check` says what it allows.",
        RouterSettings,
    ),
    ("ROS 1", "ros1.toml", "`wonderland ros1 run --config ros1.toml`.", Ros1Settings),
    ("ROS 2", "ros2.toml", "`wonderland ros2 run --config ros2.toml`.", Ros2Settings),
)
Row = tuple[str, str, str, str]
"""Key, type, default, what it is."""


def page() -> str:
    """The whole page in Markdown. Raises ValueError for a setting that nobody describes."""
    lines = [
        "# Settings",
        "",
        "Made by `make docs` from the settings’ own definitions; do not edit. Whatever is not listed here is refused",
        "by name. Units are in the names. `[]` behind a key: a list of tables (`[[…]]`). Paths in files of agents are",
        "relative to the file.",
        "",
        "## Backend (`backend.toml`)",
        "",
        "`wonderland backend serve --config backend.toml`. Each may come from the environment instead, which wins over",
        f"the file: `{PREFIX}` and the key in capitals, `__` in place of a dot; a list or table as JSON",
        f"(`{PREFIX}USPACE__DSS='[\"https://…\"]'`). Options of the command win over both.",
        "",
        *_table(rows(BackendSettings.model_json_schema(), {})),
    ]
    for part, file, how, kind in AGENTS:
        (schema,), components = msgspec.json.schema_components(
            [kind], schema_hook=_custom, ref_template="#/$defs/{name}"
        )
        top = components[schema["$ref"].rpartition("/")[2]]
        lines += ["", f"## {part} (`{file}`)", "", how, ""]
        lines += _table(rows(top | {"$defs": components}, _sentences(kind)))
    return "\n".join(lines) + "\n"


def rows(schema: dict[str, Any], said: dict[tuple[str, str], str]) -> Iterator[Row]:
    """Every key of a JSON schema with ``$defs``; ``said`` has sentences by (class, field) where the schema has none."""
    yield from _rows(schema, schema.get("title", ""), "", schema.get("$defs", {}), said)


def _rows(
    table: dict[str, Any], name: str, prefix: str, parts: dict[str, Any], said: dict[tuple[str, str], str]
) -> Iterator[Row]:
    for key, field in table["properties"].items():
        only = _only(field)
        is_list = only.get("type") == "array" and "$ref" in (only.get("items") or {})
        inner = only["items"] if is_list else only
        below = inner.get("$ref", "").rpartition("/")[2]
        if below and "properties" in parts[below]:
            yield from _rows(parts[below], below, f"{prefix}{key}{'[]' if is_list else ''}.", parts, said)
            continue
        text = said.get((name, key)) or field.get("description") or only.get("description")
        if not text:
            raise ValueError(f"{name}.{key} has no sentence that says what it is")
        needed = key in table.get("required", ())
        default = "**needed**" if needed else _value(field.get("default", only.get("default")))
        yield prefix + key, _type(only, parts), default, " ".join(text.replace("``", "`").split())


def _table(found: Iterator[Row]) -> list[str]:
    return table(
        ("Key", "Type", "Default", ""), [(f"`{key}`", kind, default, text) for key, kind, default, text in found]
    )


def _only(field: dict[str, Any]) -> dict[str, Any]:
    """Without the null that stands for "left out"."""
    options = [each for each in field.get("anyOf", field.get("allOf", [field])) if each.get("type") != "null"]
    found: dict[str, Any] = options[0]
    return found


def _value(default: Any) -> str:
    if default is None or (not default and default is not False and default != 0):
        return "–"
    return f"`{default if isinstance(default, str) else json.dumps(default)}`"


def _type(field: dict[str, Any], parts: dict[str, Any]) -> str:
    field = _only(field)
    if "$ref" in field:
        field = parts[field["$ref"].rpartition("/")[2]]
    if "enum" in field or "const" in field:
        return " | ".join(f"`{option}`" for option in field.get("enum", [field.get("const")]) if option is not None)
    kind = field.get("type", "text")
    if kind in {"integer", "number"}:
        words = {"minimum": "from", "exclusiveMinimum": "over", "maximum": "to", "exclusiveMaximum": "under"}
        bounds = [f" {word} {field[name]}" for name, word in words.items() if name in field]
        return ("whole number" if kind == "integer" else "number") + "".join(bounds)
    if kind == "array":
        items = field.get("items") or field["prefixItems"][0]
        return f"list of {_type(items, parts)}"
    if kind == "object":
        return "table"
    if kind == "boolean":
        return "`true` | `false`"
    return {"path": "path", "host:port": "host:port"}.get(field.get("format", ""), "text")


def _custom(kind: type) -> dict[str, Any]:
    return {"type": "string", "format": "host:port" if kind is Address else "path"}


def _sentences(kind: type[Table]) -> dict[tuple[str, str], str]:
    """What stands below each field of a table and of the tables in it; of a drone's the help of its options."""
    found: dict[tuple[str, str], str] = {}
    for each in _tables(kind):
        body = ast.parse(inspect.getsource(each)).body[0]
        assert isinstance(body, ast.ClassDef)
        for field, below in zip(body.body, body.body[1:], strict=False):
            match field, below:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(text))):
                    found[each.__name__, name] = text
    if kind is UavSettings:
        serve = uav.get_command(click.Context(uav), "serve")
        assert serve is not None
        options = {option.name: option for option in serve.params if isinstance(option, click.Option)}
        for name in kind.__struct_fields__:
            if option := options.get(OPTIONS.get(name, name)):
                found.setdefault((kind.__name__, name), option.help or "")
    return found


def _tables(kind: Any) -> Iterator[type[Table]]:
    """A table and those within it, each once."""
    seen: set[type] = set()
    waiting = [msgspec.inspect.type_info(kind)]
    while waiting:
        one = waiting.pop()
        if isinstance(one, msgspec.inspect.StructType) and one.cls not in seen:
            seen.add(one.cls)
            yield one.cls
            waiting += [field.type for field in one.fields]
        waiting += getattr(one, "types", ())
        if isinstance(item := getattr(one, "item_type", None), msgspec.inspect.Type):
            waiting.append(item)


if __name__ == "__main__":
    write(page)

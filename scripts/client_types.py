"""Write libraries/core/wonderland/client/types.py from the backend's OpenAPI: ``python scripts/client_types.py``."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

from wonderland_backend.description import openapi
from wonderland_backend.routes import new_app
from wonderland_backend.settings import Settings

TARGET = Path(__file__).parents[1] / "libraries" / "core" / "wonderland" / "client" / "types.py"
ROOTS = (
    "Alert", "Authorisation", "Conformance", "Drone", "Export", "Flight", "LedgerEvent", "Pad", "Proof", "ProofRequest",
    "SessionSummary", "Subscription", "SubscriptionCreated", "Track", "WebhookDelivery",
)  # fmt: skip
HEAD = '''"""What the API answers. Made by scripts/client_types.py from the OpenAPI description; do not edit."""

from __future__ import annotations

from typing import Any, Literal, NotRequired, TypedDict

'''
PLAIN = {"integer": "int", "number": "float", "string": "str", "boolean": "bool", "null": "None"}


def main() -> None:
    """Write the file, formatted as all others."""
    ruff = Path(sys.executable).with_name("ruff")
    done = subprocess.run([ruff, "format", "-"], input=text(), capture_output=True, text=True, check=True)
    TARGET.write_text(done.stdout)


def text() -> str:
    """The module's source before formatting."""
    schemas = openapi(new_app(Settings(), frozenset(), None))["components"]["schemas"]
    found: dict[str, str] = {}
    waiting = [name for name in ROOTS if name in schemas]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found[name] = class_of(name, schemas[name])
            waiting += re.findall(r'"#/components/schemas/(\w+)"', str(schemas[name]).replace("'", '"'))
    return HEAD + "\n\n".join(found[name] for name in sorted(found))


def class_of(name: str, schema: dict[str, Any]) -> str:
    """A TypedDict, or an alias for what is no object."""
    if "properties" not in schema:
        return f"{name} = {annotation(schema)}\n"
    doc = " ".join(str(schema.get("description", name)).split())
    lines = [f"class {name}(TypedDict):", f'    """{shortened(doc)}"""', ""]
    required = set(schema.get("required", ()))
    for field, each in schema["properties"].items():
        kind = annotation(each)
        lines.append(f"    {field}: {kind if field in required else f'NotRequired[{kind}]'}")
    return "\n".join(lines) + "\n"


def shortened(doc: str) -> str:
    """The first sentence, where the whole does not fit into a line."""
    if len(doc) <= 105:
        return doc
    first = doc.partition(". ")[0].rstrip(".") + "."
    return first if len(first) <= 105 else f"{doc[:100].rpartition(' ')[0].rstrip(',;:')} and so on."


def annotation(schema: dict[str, Any]) -> str:
    """The Python type of a schema."""
    if "$ref" in schema:
        return str(schema["$ref"]).rpartition("/")[2]
    if "const" in schema:
        return f"Literal[{schema['const']!r}]"
    if "enum" in schema:
        return f"Literal[{', '.join(map(repr, schema['enum']))}]"
    for several in ("anyOf", "oneOf"):
        if several in schema:
            return " | ".join(dict.fromkeys(annotation(each) for each in schema[several]))
    if schema.get("type") == "array":
        return f"list[{annotation(schema.get('items', {}))}]"
    if schema.get("type") == "object":
        values = schema.get("additionalProperties")
        return f"dict[str, {annotation(values) if isinstance(values, dict) else 'Any'}]"
    return PLAIN.get(str(schema.get("type")), "Any")


if __name__ == "__main__":
    main()

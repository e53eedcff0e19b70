"""The description as a page: plain HTML, made here, so that it asks nobody else for anything and runs no script."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from functools import lru_cache
from html import escape
from importlib.resources import files
from typing import Any, Final

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse

from wonderland_backend.clients.scopes import SCOPES
from wonderland_backend.deprecation import INSTEAD, SUNSET
from wonderland_backend.reference.openapi import Document, operations

router = APIRouter()
_CODE: Final = re.compile(r"`([^`]+)`")
_GOOD: Final = "23"
_MUST: Final = ' <span class="must">required</span>'
FIRST: Final = ("tokens", "conformance", "proofs", "proof requests", "events", "subscriptions")
"""What this page is read for, in this order; then what else machines may use, then what is for people alone."""
DEPTH: Final = 3
"""So deep the fields of a body are listed."""
_INTRODUCTION: Final = """\
<h1>Wonderland API</h1>
<p class="quiet">Version {version} · OpenAPI 3.1: <a href="openapi.json">openapi.json</a></p>
{description}
<h3>A token</h3>
<p>An administrator registers a client: in the console at <em>People → Machines</em>, or by
<code>wonderland backend client add</code> on the server. It gets tokens for an hour:</p>
<pre>curl -u "$CLIENT_ID:$CLIENT_SECRET" -d grant_type=client_credentials {server}/oauth/token</pre>
<p>and sends them with each request:</p>
<pre>curl -H "Authorization: Bearer $TOKEN" '{server}/api/v1/conformance?serial=OH-DRN-0417'</pre>
<h3>Scopes</h3>
<table>{scopes}</table>
"""


@router.get("/reference", include_in_schema=False)
def read_reference(request: Request) -> HTMLResponse:
    """All operations with their parameters, answers and examples, for people."""
    server = f"{request.url.scheme}://{request.url.netloc}"
    html = rendered(json.dumps(request.app.openapi()), server)
    return HTMLResponse(html, headers={"Cache-Control": "public, max-age=300"})


@lru_cache(maxsize=4)
def rendered(document_json: str, server: str) -> str:
    """The whole page."""
    document: Document = json.loads(document_json)
    by_tag: dict[str, list[tuple[str, str, dict[str, Any]]]] = {}
    for path, method, operation in operations(document):
        by_tag.setdefault(str((operation.get("tags") or ["other"])[0]), []).append((path, method, operation))
    of_machines = {tag for tag, found in by_tag.items() if tag in FIRST or any(map(_open_to_machines, found))}
    by_tag = dict(sorted(by_tag.items(), key=lambda each: (_rank(each[0]), each[0] not in of_machines)))
    links = _links("For machines", [tag for tag in by_tag if tag in of_machines])
    links += _links("For people", [tag for tag in by_tag if tag not in of_machines])
    schemas = document["components"]["schemas"]
    sections = "".join(
        f'<section><h2 id="{_anchor(tag)}">{_title(tag)}</h2>'
        f"{''.join(_operation(*each, schemas) for each in found)}</section>"
        for tag, found in by_tag.items()
    )
    introduction = _INTRODUCTION.format(
        version=escape(document["info"]["version"]),
        description="".join(f"<p>{_text(part)}</p>" for part in document["info"]["description"].split("\n\n")),
        server=escape(server),
        scopes="".join(_row(f"<code>{scope}</code>", _text(text)) for scope, text in SCOPES.items()),
    )
    style = files("wonderland_backend.reference").joinpath("page.css").read_text()
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1"><title>Wonderland API</title>'
        '<link rel="icon" href="data:,">'
        f"<style>{style}</style></head><body><div class='frame'>"
        f"<nav aria-label='Parts'><strong>Wonderland API</strong>{links}</nav>"
        f"<main>{introduction}{sections}</main></div></body></html>"
    )


def _rank(tag: str) -> int:
    return FIRST.index(tag) if tag in FIRST else len(FIRST)


def _links(title: str, tags: Iterable[str]) -> str:
    items = "".join(f'<li><a href="#{_anchor(tag)}">{_title(tag)}</a></li>' for tag in tags)
    return f"<p class='part'>{title}</p><ul>{items}</ul>"


def _open_to_machines(each: tuple[str, str, dict[str, Any]]) -> bool:
    return any("client" in way for way in each[2].get("security", ()))


def _operation(path: str, method: str, operation: Mapping[str, Any], schemas: Mapping[str, Any]) -> str:
    summary = str(operation.get("description") or operation.get("summary", ""))
    parts = [f"<p>{_text(part)}</p>" for part in summary.split("\n\n")]
    mark = ""
    if operation.get("deprecated"):
        mark = ' <span class="must">deprecated</span>'
        until, instead = escape(str(operation[SUNSET])), escape(str(operation[INSTEAD]))
        parts.insert(0, f'<p class="must">Deprecated: works until {until}. <a href="{instead}">What to use</a></p>')
    scopes = [scope for each in operation.get("security", ()) for scope in each.get("client", ())]
    if scopes:
        parts.append("<h3>Scope</h3>" + "".join(f'<span class="scope">{escape(scope)}</span>' for scope in scopes))
    parameters = operation.get("parameters", ())
    if parameters:
        parts.append(f"<h3>Parameters</h3><table>{''.join(map(_parameter, parameters))}</table>")
    for kind, media in operation.get("requestBody", {}).get("content", {}).items():
        parts.append(f"<h3>Body · {escape(kind)}</h3>{_fields(media.get('schema', {}), schemas)}{_example(media)}")
    parts.append("<h3>Answers</h3>")
    answers = sorted((status, told) for status, told in operation["responses"].items() if "$ref" not in told)
    parts += [_answer(status, told) for status, told in answers]
    return (
        f'<details class="operation" id="{escape(str(operation["operationId"]))}"><summary>'
        f'<span class="method {method}">{method}</span><code>{escape(path)}</code>{mark}'
        f'<span class="quiet">{_text(summary.partition(".")[0])}</span></summary>'
        f'<div class="body">{"".join(parts)}</div></details>'
    )


def _fields(schema: Mapping[str, Any], schemas: Mapping[str, Any]) -> str:
    """The fields of a body, those of objects within it by their whole name."""
    rows = "".join(_row(name, text) for name, text in _listed(schema, schemas, "", DEPTH))
    return f"<table>{rows}</table>" if rows else ""


def _listed(
    schema: Mapping[str, Any], schemas: Mapping[str, Any], within: str, depth: int
) -> Iterable[tuple[str, str]]:
    schema = _resolved(schema, schemas)
    required = schema.get("required", ())
    for name, field in schema.get("properties", {}).items():
        must = _MUST if name in required else ""
        yield f"<code>{escape(within + name)}</code>{must}", _facts(field, str(field.get("description", "")))
        inner = next((each for each in (field, *field.get("anyOf", ())) if "$ref" in each), None)
        if inner is not None and depth > 1:
            yield from _listed(inner, schemas, f"{within}{name}.", depth - 1)


def _resolved(schema: Mapping[str, Any], schemas: Mapping[str, Any]) -> Mapping[str, Any]:
    found: Mapping[str, Any] = schemas[schema["$ref"].rpartition("/")[2]] if "$ref" in schema else schema
    return found


def _parameter(parameter: Mapping[str, Any]) -> str:
    schema = parameter.get("schema", {})
    where = "" if parameter["in"] == "query" else f' <span class="quiet">{parameter["in"]}</span>'
    name = f"<code>{escape(parameter['name'])}</code>{where}{_MUST if parameter.get('required') else ''}"
    return _row(name, _facts(schema, str(parameter.get("description") or schema.get("description") or "")))


def _facts(schema: Mapping[str, Any], description: str) -> str:
    facts = [_text(description)]
    facts += [
        f"one of {', '.join(f'<code>{escape(str(each))}</code>' for each in values)}" for values in _enums(schema)
    ]
    if "default" in schema and schema["default"] not in (None, []):
        facts.append(f"default <code>{escape(json.dumps(schema['default']))}</code>")
    return "; ".join(fact for fact in facts if fact)


def _enums(schema: Mapping[str, Any]) -> Iterable[list[Any]]:
    for each in (schema, schema.get("items", {}), *schema.get("anyOf", ())):
        if "enum" in each:
            yield each["enum"]


def _answer(status: str, response: Mapping[str, Any]) -> str:
    kind = "status" if status[0] in _GOOD else "status bad"
    head = f'<span class="{kind}">{escape(status)}</span> {_text(response.get("description", ""))}'
    examples = "".join(
        f'<p class="quiet"><code>{escape(media_type)}</code></p>{_example(media)}'
        for media_type, media in response.get("content", {}).items()
    )
    names = ", ".join(f"<code>{escape(name)}</code>" for name in response.get("headers", ()))
    headers = f'<p class="quiet">Headers: {names}</p>' if names else ""
    return f'<details class="answer"><summary>{head}</summary>{headers}{examples}</details>'


def _example(media: Mapping[str, Any]) -> str:
    several = [each["value"] for each in media.get("examples", {}).values()]
    texts = [
        each if isinstance(each, str) else json.dumps(each, indent=2, ensure_ascii=False)
        for each in (several or [media.get("example")])
        if each is not None
    ]
    return "".join(f'<pre tabindex="0">{escape(text)}</pre>' for text in texts)


def _row(name: str, text: str) -> str:
    return f"<tr><td>{name}</td><td>{text}</td></tr>"


def _text(text: str) -> str:
    return _CODE.sub(r"<code>\1</code>", escape(text))


def _title(tag: str) -> str:
    return escape(tag[:1].upper() + tag[1:]).replace("remote id", "Remote ID")


def _anchor(tag: str) -> str:
    return escape(tag.replace(" ", "-"))

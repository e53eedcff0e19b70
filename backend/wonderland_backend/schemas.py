"""Shapes of what the REST and live interfaces send, built on the records' one definition.

Responses are written as JSON straight from what the database holds; these models document them (OpenAPI, and from it
the console's TypeScript types), and tests check that what is sent conforms.
"""

from __future__ import annotations

import typing
from dataclasses import fields
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Final

from pydantic import BaseModel, ConfigDict, Field, WithJsonSchema, create_model

from wonderland.proofs.records.schema import Binary, Choice, Facts, Flag, Integer, Items, Record, Text

_CHECKS: Final = (Integer, Text, Choice, Flag, Binary, Facts)
_PLAIN_TYPES: Final[dict[type, Any]] = {
    Integer: int,
    Text: str,
    Choice: str,
    Flag: bool,
    Binary: str,
    Facts: dict[str, int | str],
}


def _without_null(schema: dict[str, Any], model: type[BaseModel]) -> None:
    """An optional field is left out, never null: say so in its schema."""
    properties = schema.get("properties", {})
    for name, field in model.model_fields.items():
        if field.is_required() or field.default is not None:
            continue
        spec = properties.get(name)
        if spec is None:
            continue
        spec.pop("default", None)
        options = [option for option in spec.get("anyOf", []) if option != {"type": "null"}]
        if len(options) == 1:
            del spec["anyOf"]
            spec.update(options[0])
        elif options:
            spec["anyOf"] = options
    for spec in properties.values():
        spec.pop("title", None)


class ApiModel(BaseModel):
    """Base of every documented shape. A field with the default None is left out where it has no value."""

    model_config = ConfigDict(json_schema_extra=_without_null)


def model_of(record: type[Record], name: str = "") -> type[ApiModel]:
    """The documented shape of a record, nested records included; `name` where its own is that of an `extended` one."""
    # Seen as Any: mypy holds a class whose instances compare by value for unhashable.
    key: Any = record
    return _model_of(key, name)


@cache
def _model_of(record: Any, name: str) -> type[ApiModel]:
    hints = typing.get_type_hints(record, include_extras=True)
    definitions: dict[str, Any] = {
        field.name: _field_of(hints[field.name], optional=field.default is None) for field in fields(record)
    }
    doc = (record.__doc__ or "").strip().split("\n\n", maxsplit=1)[0]
    return create_model(name or record.RECORD or record.__name__, __base__=ApiModel, __doc__=doc, **definitions)


def extended(
    name: str, record: type[Record], doc: str, *, without: tuple[str, ...] = (), **more: Any
) -> type[ApiModel]:
    """A record's shape under a new name with further fields, as for `pydantic.create_model`."""
    base = model_of(record)
    definitions: dict[str, Any] = {
        field: (info.annotation if not info.metadata else Annotated[info.annotation, *info.metadata], info)
        for field, info in base.model_fields.items()
        if field not in without
    }
    return create_model(name, __base__=ApiModel, __doc__=doc, **definitions, **more)


def page_of(name: str, item: Any) -> type[ApiModel]:
    """A page of a list: the items, and the cursor of the next page where there is one."""
    doc = "One page of a list."
    definitions: dict[str, Any] = {
        "items": (list[item], ...),
        "next": (str | None, Field(default=None, description="Pass it as `cursor` to get the next page")),
    }
    return create_model(name, __base__=ApiModel, __doc__=doc, **definitions)


def _field_of(hint: Any, *, optional: bool) -> tuple[Any, Any]:
    kind, annotations = _parts(hint)
    bounds = next((each for each in annotations if isinstance(each, Items)), None)
    check = next((each for each in annotations if isinstance(each, _CHECKS)), None)
    options: dict[str, Any] = {"default": None} if optional else {}
    if bounds is not None:
        element = typing.get_args(kind)[0]
        inner: Any = _leaf(bounds.of) if bounds.of is not None else model_of(element)
        options |= {"min_length": bounds.minimum, "max_length": bounds.maximum}
        if bounds.description:
            options["description"] = bounds.description
        annotation: Any = list[inner]
    elif check is not None:
        annotation = _leaf(check)
    elif isinstance(kind, type) and issubclass(kind, Record):
        annotation = model_of(kind)
    else:
        annotation = bool
    return (annotation | None if optional else annotation), Field(**options)


def _leaf(check: Any) -> Any:
    return Annotated[_PLAIN_TYPES[type(check)], WithJsonSchema(check.schema())]


def _parts(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    """(type, annotations) of a record's field, with ``| None`` taken off."""
    annotations: tuple[Any, ...] = ()
    if typing.get_origin(hint) is Annotated:
        hint, *extra = typing.get_args(hint)
        annotations = tuple(extra)
    if typing.get_origin(hint) in {UnionType, typing.Union}:
        (hint,) = [part for part in typing.get_args(hint) if part is not NoneType]
        if typing.get_origin(hint) is Annotated:
            return _parts(hint)
    return hint, annotations

"""What is wrong with a field of a request, from the validating library's code and facts, in every language."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from wonderland.problems import Said, SaidError, said

PREFIX: Final = "field_"
KINDS: Final[Mapping[str, str]] = {
    "bool_parsing": "bool",
    "bool_type": "bool",
    "dict_type": "object",
    "enum": "one_of",
    "extra_forbidden": "unknown",
    "finite_number": "finite",
    "float_parsing": "number",
    "float_type": "number",
    "greater_than": "above",
    "greater_than_equal": "at_least",
    "int_from_float": "whole_number",
    "int_parsing": "whole_number",
    "int_parsing_size": "too_large",
    "int_type": "whole_number",
    "json_invalid": "no_json",
    "less_than": "below",
    "less_than_equal": "at_most",
    "list_type": "list",
    "literal_error": "one_of",
    "missing": "missing",
    "model_attributes_type": "object",
    "model_type": "object",
    "none_required": "null",
    "set_type": "list",
    "string_pattern_mismatch": "pattern",
    "string_too_long": "long_text",
    "string_too_short": "short_text",
    "string_type": "text",
    "string_unicode": "unicode",
    "too_long": "long_list",
    "too_short": "short_list",
    "tuple_type": "list",
    "union_tag_invalid": "tag",
    "union_tag_not_found": "tag_missing",
}
"""pydantic's types of errors, and the message (``field_…``) that says each."""


class FieldRefused(SaidError, ValueError):  # noqa: N818 - as `Problem`, a refusal
    """A value or several that do not go together; for validators, which pydantic lets raise ValueErrors."""


def field_text(error: Mapping[str, Any]) -> Said | str:
    """One error of pydantic's list. What it has no message for is said in pydantic's own words, without its prefix."""
    facts: dict[str, Any] = error.get("ctx", {})
    cause = facts.get("error")
    if isinstance(cause, SaidError):
        return cause.said
    if error["type"] in KINDS:
        return Said(PREFIX + KINDS[error["type"]], {name: _fact(name, value) for name, value in facts.items()})
    return str(cause or error["msg"])


def first_error(errors: list[Any]) -> Said:
    """The first of pydantic's errors, with the field that it is about."""
    return said("field_at", where=".".join(str(part) for part in errors[0]["loc"]), what=field_text(errors[0]))


def _fact(name: str, value: object) -> int | str:
    """Lengths stay numbers, which choose between singular and plural; limits are shown as they are to be written."""
    if name.endswith("_length") and isinstance(value, int):
        return value
    if isinstance(value, float):
        return f"{value:g}"
    return str(value).replace(" or ", ", ")

from __future__ import annotations

from collections import OrderedDict
from dataclasses import fields, is_dataclass


def message_to_ordereddict(message):
    return OrderedDict(
        (each.name, _plain(getattr(message, each.name))) for each in fields(message) if not each.name.startswith("__")
    )


def _plain(value):
    if is_dataclass(value):
        return message_to_ordereddict(value)
    return [_plain(each) for each in value] if isinstance(value, list) else value

"""What one says about a frame that was heard: a JSON object with the messages, or with what was wrong."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from wonderland_remote_id.decoding import decode
from wonderland_remote_id.errors import FieldError, PackError, RemoteIdError
from wonderland_remote_id.json_form import to_json
from wonderland_remote_id.messages import Message, Pack
from wonderland_remote_id.profiles import Profile, check_message, check_set
from wonderland_remote_id.tolerant import Problem, decode_tolerant

if TYPE_CHECKING:
    from wonderland_remote_id.framings.framed import Framed


def describe(framed: Framed, *, tolerant: bool = False, profile: Profile | None = None) -> dict[str, Any]:
    """What a frame says, for people and programs; never raises.

    Keys: ``transport``, ``address``, ``rssi_dbm``, ``counter``, ``t_ms`` where they are known; then ``pack`` and
    ``messages``, or ``error``. ``tolerant`` adds ``problems``, ``profile`` adds ``violations``. What a profile asks for
    and no message says is only missed in a pack: a single message never says everything.
    """
    facts = {
        "transport": framed.transport,
        "address": framed.address,
        "rssi_dbm": framed.rssi_dbm,
        "counter": framed.counter,
        "t_ms": framed.t_ms,
    }
    document: dict[str, Any] = {name: value for name, value in facts.items() if value is not None}
    messages: tuple[Message, ...]
    problems: tuple[Problem, ...] = ()
    if tolerant:
        read = decode_tolerant(framed.frame)
        is_pack, messages, problems = read.is_pack, read.messages, read.problems
    else:
        try:
            decoded = decode(framed.frame)
        except RemoteIdError as error:
            return document | {"error": error_json(error)}
        is_pack = isinstance(decoded, Pack)
        messages = decoded.messages if isinstance(decoded, Pack) else (decoded,)
    document["pack"] = is_pack
    document["messages"] = [to_json(message) for message in messages]
    if tolerant:
        document["problems"] = problems_json(problems)
    if profile is not None:
        found = (
            check_set(messages, profile)
            if is_pack
            else [violation for message in messages for violation in check_message(message, profile)]
        )
        document["violations"] = [
            {"rule": violation.rule, "severity": violation.severity.value, "message": violation.message}
            for violation in found
        ]
    return document


def error_json(error: RemoteIdError) -> dict[str, Any]:
    """An error as a JSON object: its kind, text, byte and field, and the place in a pack."""
    document: dict[str, Any] = {"kind": type(error).__name__, "message": error.message}
    if error.offset is not None:
        document["offset"] = error.offset
    if isinstance(error, FieldError):
        document["field"] = error.field
    if isinstance(error, PackError) and error.index >= 0:
        document["index"] = error.index
    return document


def problems_json(problems: Iterable[Problem]) -> list[dict[str, Any]]:
    """Faults that were passed over, as JSON objects."""
    return [
        {"kind": problem.kind, "message": problem.message}
        | ({"offset": problem.offset} if problem.offset is not None else {})
        | ({"field": problem.field} if problem.field is not None else {})
        | ({"index": problem.index} if problem.index >= 0 else {})
        for problem in problems
    ]

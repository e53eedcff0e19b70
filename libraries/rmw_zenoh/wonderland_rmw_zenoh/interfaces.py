"""Which types are known: those of directories that are named, and the standard ones of ROS 2 from `rosbags`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from wonderland_rmw_zenoh.definitions import MAX_CHARACTERS, Codec, Definition, gathered, parse
from wonderland_rmw_zenoh.errors import DefinitionError
from wonderland_rmw_zenoh.standard import SERVICES
from wonderland_rmw_zenoh.type_hash import service_hash, type_hash
from wonderland_rmw_zenoh.wire import is_type

SHARE: Final = Path(__file__).parent / "share"
"""Where the definitions of ``wonderland_msgs`` are, which colcon builds."""
_STORES: Final = (Stores.ROS2_JAZZY, Stores.ROS2_KILTED, Stores.ROS2_LYRICAL, Stores.ROS2_IRON)
"""Releases whose peers have type hashes, the one that most run first."""
_DIVIDER: Final = re.compile(r"^---\s*$", re.MULTILINE)
_EVENT_INFO: Final = "service_msgs/msg/ServiceEventInfo"
_UUID: Final = "unique_identifier_msgs/UUID goal_id\n"


@dataclass(frozen=True, slots=True)
class MessageType:
    """A type of messages, ready for use."""

    name: str
    hash: str
    codec: Codec


@dataclass(frozen=True, slots=True)
class ServiceType:
    """A type of services."""

    name: str
    hash: str
    request: Codec
    response: Codec


@dataclass(frozen=True, slots=True)
class ActionType:
    """A type of actions: two services of its own and a message; goals are cancelled and listed by standard types."""

    name: str
    send_goal: ServiceType
    get_result: ServiceType
    feedback: MessageType
    cancel: ServiceType
    status: MessageType


class Interfaces:
    """Types by name. ``directories``: as ROS 2 installs them (``…/share``), or single packages."""

    def __init__(self, directories: Sequence[Path] = ()) -> None:
        self._directories = tuple(directories)
        self._definitions: dict[str, Definition] = {}
        self._types: dict[tuple[str, str], MessageType] = {}

    def message(self, kind: str) -> MessageType:
        """A type as it is known here. Raises DefinitionError."""
        if kind not in self._definitions:
            self._definitions[kind] = gathered(kind, self._find)
        return self._made(self._definitions[kind])

    def of_hash(self, kind: str, wanted: str) -> MessageType:
        """The type with that hash, from whichever release it is. Raises DefinitionError."""
        if (kind, wanted) in self._types:
            return self._types[kind, wanted]
        known = []
        for definition in self._candidates(kind):
            made = self._made(definition)
            if made.hash == wanted:
                return made
            known.append(made.hash)
        if not known:
            raise DefinitionError(
                f"{kind}: nobody here says what it is; name the directory of its .msg file in the settings (interfaces)"
            )
        raise DefinitionError(
            f"{kind}: the peer's has type hash {wanted or '(none)'}, those known here have {', '.join(known)}; name "
            "the directory of the .msg files that the peer was built with in the settings (interfaces)"
        )

    def service(self, kind: str) -> ServiceType:
        """A type of services. Raises DefinitionError."""
        text = self._text(kind, "srv") or SERVICES.get(kind)
        if text is None:
            raise DefinitionError(f"{kind}: nobody here says what it is (no .srv file)")
        request, response = self._parts(kind, text, 2)
        return self._service(kind, request, response)

    def action(self, kind: str) -> ActionType:
        """A type of actions. Raises DefinitionError."""
        text = self._text(kind, "action")
        if text is None:
            raise DefinitionError(f"{kind}: nobody here says what it is (no .action file)")
        goal, result, feedback = self._parts(kind, text, 3)
        own = {f"{kind}_Goal": goal, f"{kind}_Result": result, f"{kind}_Feedback": feedback}
        stamp = "builtin_interfaces/Time stamp\n"
        feedback_texts = {**own, f"{kind}_FeedbackMessage": f"{_UUID}{kind}_Feedback feedback\n"}
        said = gathered(f"{kind}_FeedbackMessage", lambda name: self._of(feedback_texts, name))
        return ActionType(
            kind,
            self._service(f"{kind}_SendGoal", f"{_UUID}{kind}_Goal goal\n", f"bool accepted\n{stamp}", own),
            self._service(f"{kind}_GetResult", _UUID, f"int8 status\n{kind}_Result result\n", own),
            self._made(said),
            self.service("action_msgs/srv/CancelGoal"),
            self.message("action_msgs/msg/GoalStatusArray"),
        )

    def _service(self, kind: str, request: str, response: str, own: dict[str, str] | None = None) -> ServiceType:
        texts = {**(own or {}), f"{kind}_Request": request, f"{kind}_Response": response}
        asked, answered = (gathered(f"{kind}_{part}", lambda name: self._of(texts, name)) for part in _ENDS)
        event_info = gathered(_EVENT_INFO, self._find)
        return ServiceType(kind, service_hash(kind, asked, answered, event_info), Codec(asked), Codec(answered))

    def _of(self, texts: dict[str, str], name: str) -> str | None:
        return texts.get(name) if name in texts else self._find(name)

    def _parts(self, kind: str, text: str, count: int) -> list[str]:
        parts = _DIVIDER.split(text)
        if len(parts) != count:
            raise DefinitionError(f"{kind}: {len(parts)} parts between lines of ---, where {count} are needed")
        return parts

    def _made(self, definition: Definition) -> MessageType:
        made = MessageType(definition.type, type_hash(definition), Codec(definition))
        return self._types.setdefault((made.name, made.hash), made)

    def _find(self, kind: str) -> str | None:
        text = self._text(kind, "msg")
        if text is not None:
            return text
        return next((found for each in _STORES if (found := _standard(each, kind)) is not None), None)

    def _candidates(self, kind: str) -> Iterator[Definition]:
        if self._text(kind, "msg") is not None:
            yield gathered(kind, self._find)
        for store in _STORES:
            if _standard(store, kind) is not None:
                yield gathered(kind, lambda name, store=store: _standard(store, name))  # type: ignore[misc]

    def _text(self, kind: str, group: str) -> str | None:
        """The file of a type, where a directory has it. Raises DefinitionError."""
        if not is_type(kind):
            raise DefinitionError(f"{kind[:100]!r} is no type of ROS 2 (package/{group}/Type)")
        package, of, name = kind.split("/")
        for root in self._directories if of == group else ():
            for base in (root / package, root / "share" / package, *([root] if root.name == package else [])):
                path = base / group / f"{name}.{group}"
                try:
                    with path.open("rb") as file:
                        data = file.read(MAX_CHARACTERS + 1)
                    return data.decode()
                except FileNotFoundError:
                    continue
                except (OSError, UnicodeDecodeError) as cause:
                    raise DefinitionError(f"{path}: cannot be read ({cause})") from cause
        return None


_ENDS: Final = ("Request", "Response")


def of_text(kind: str, wanted: str, text: str) -> MessageType:
    """A type as somebody else stored it, if it has the hash that it should have. Raises DefinitionError."""
    definition = parse(kind, text)
    found = type_hash(definition)
    if found != wanted:
        raise DefinitionError(f"{kind}: its definition has type hash {found}, not {wanted[:80]}; one of them is wrong")
    return MessageType(kind, found, Codec(definition))


@lru_cache(maxsize=4)
def _store(of: Stores) -> Typestore:
    return get_typestore(of)


@lru_cache(maxsize=1_024)
def _standard(of: Stores, kind: str) -> str | None:
    """The own fields of a standard type, as a release has it."""
    store = _store(of)
    return store.gendefhash(kind, {}, ros_version=2)[0] if kind in store.fielddefs else None

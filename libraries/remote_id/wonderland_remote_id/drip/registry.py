"""Whose keys are believed: registries from a file, and what they endorse over the air."""

from __future__ import annotations

import json
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from wonderland_remote_id.drip.det import Det, DripError
from wonderland_remote_id.drip.formats import Link, verify

MAX_FILE_BYTES: Final = 1 << 20
MAX_LEARNED: Final = 4_096
CLOCK_SKEW_MS: Final = 60_000


@dataclass(frozen=True, slots=True)
class Identity:
    """A public key that is believed, until when, and what it is called."""

    host_identity: bytes
    name: str
    valid_until_ms: int | None = None
    is_authority: bool = False
    """Whether it may endorse others."""


class Registry:
    """Identities by entity tag. Those of the file are roots; what roots endorse is learned, in bounded memory."""

    def __init__(self, roots: Mapping[Det, Identity]) -> None:
        self._roots = dict(roots)
        self._learned: OrderedDict[Det, Identity] = OrderedDict()

    @classmethod
    def load(cls, path: Path) -> Registry:
        """From a JSON file: ``{"registries": [{"det", "host_identity" (hex), "name"}, …]}``. Raises `DripError`."""
        try:
            with path.open("rb") as file:
                data = file.read(MAX_FILE_BYTES + 1)
        except OSError as cause:
            raise DripError(f"{path}: cannot be read ({cause.strerror or cause})") from cause
        if len(data) > MAX_FILE_BYTES:
            raise DripError(f"{path}: larger than {MAX_FILE_BYTES} bytes; is it the right file?")
        try:
            document = json.loads(data)
        except (ValueError, RecursionError) as cause:
            raise DripError(f"{path}: no JSON: {cause}") from cause
        try:
            return cls.parse(document)
        except DripError as error:
            raise DripError(f"{path}: {error.message}") from error

    @classmethod
    def parse(cls, document: Any) -> Registry:
        """From a decoded document. Raises `DripError` naming the entry."""
        entries = document.get("registries") if isinstance(document, dict) else None
        if not isinstance(entries, list):
            raise DripError('is no list of registries: {"registries": [{"det", "host_identity", "name"}]}')
        roots = {}
        for number, entry in enumerate(entries):
            place = f"registries[{number}]"
            if not isinstance(entry, dict) or set(entry) - {"det", "host_identity", "name"}:
                raise DripError(f"{place} is not an object of det, host_identity and name")
            det_text, key_text, name = entry.get("det"), entry.get("host_identity"), entry.get("name", "")
            if (
                not (isinstance(det_text, str) and isinstance(key_text, str) and isinstance(name, str))
                or len(name) > 64
            ):
                raise DripError(f"{place}: det, host_identity and name (at most 64 characters) are texts")
            try:
                det, key = Det.parse(det_text), bytes.fromhex(key_text)
            except (DripError, ValueError) as cause:
                raise DripError(f"{place}: {getattr(cause, 'message', 'host_identity is no hexadecimal')}") from cause
            if not det.belongs_to(key):
                raise DripError(f"{place}: the entity tag is not the hash of this host_identity")
            roots[det] = Identity(key, name or str(det), is_authority=True)
        return cls(roots)

    def find_identity(self, det: Det, now_ms: int) -> Identity | None:
        """The identity of an entity tag, if it is believed now."""
        found = self._roots.get(det) or self._learned.get(det)
        if found is None or (found.valid_until_ms is not None and now_ms > found.valid_until_ms + CLOCK_SKEW_MS):
            return None
        return found

    def learn(self, link: Link, now_ms: int) -> Identity | None:
        """Believe the key that a Link endorses; None where its parent is not known. Raises `DripError` when it lies."""
        parent = self.find_identity(link.parent, now_ms)
        if parent is None:
            return None
        if not parent.is_authority:
            raise DripError("the endorsement is by a drone's key; only registries may endorse")
        if not link.child.is_below(link.parent):
            raise DripError(f"{parent.name} endorses an entity tag of another registry (RAA, HDA) than its own")
        if not verify(parent.host_identity, link.signature, link.signed()):
            raise DripError(f"the signature of {parent.name} over the endorsement is wrong")
        if not link.child.belongs_to(link.child_host_identity):
            raise DripError("the endorsed entity tag is not the hash of the endorsed key")
        if not link.valid_from_ms - CLOCK_SKEW_MS <= now_ms <= link.valid_until_ms + CLOCK_SKEW_MS:
            raise DripError("the endorsement is not valid at this time")
        limits = [until_ms for until_ms in (link.valid_until_ms, parent.valid_until_ms) if until_ms is not None]
        is_authority = link.child in self._roots or link.child.is_authority_under(link.parent)
        identity = Identity(link.child_host_identity, parent.name, min(limits), is_authority)
        if link.child not in self._roots:
            self._learned[link.child] = identity
            self._learned.move_to_end(link.child)
            if len(self._learned) > MAX_LEARNED:
                self._learned.popitem(last=False)
        return identity

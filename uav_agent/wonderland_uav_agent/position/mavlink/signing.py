"""MAVLink 2 signing: with a key, nothing unsigned is heard, and all that is said is signed.

Times in signatures are tens of microseconds since 2015. A sender's have to rise, so that nothing is replayed; a sender
that is new may be a minute behind this computer's clock, so that nothing older is.
"""

from __future__ import annotations

import stat
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from wonderland.clock import Clock
from wonderland_uav_agent.position.source import PositionError

KEY_OCTETS: Final = 32
SINCE_MS: Final = 1_420_070_400_000
"""2015, where its time begins."""
LINK_ID: Final = 9
"""Ours; ground stations take small ones."""


def read_key(path: Path) -> bytes:
    """32 octets as 64 hexadecimal digits. Raises PositionError, which says what is wrong."""
    try:
        if path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
            raise PositionError(f"{path}: others may read or write it; chmod 600 {path}")
        text = path.read_text("ascii").strip()
        key = bytes.fromhex(text)
    except OSError as cause:
        raise PositionError(f"{path}: cannot be read ({cause.strerror or cause})") from cause
    except ValueError as cause:
        raise PositionError(f"{path}: no MAVLink key; it has 64 hexadecimal digits (openssl rand -hex 32)") from cause
    if len(key) != KEY_OCTETS:
        raise PositionError(f"{path}: a MAVLink key has 64 hexadecimal digits, not {len(text)}")
    return key


class Signing:
    """Of one link, whatever parsers it has: the times that were seen last are remembered for all of them."""

    def __init__(self, key: bytes, clock: Clock, dialect: ModuleType) -> None:
        self._clock = clock
        self._state = dialect.MAVLinkSigning()
        self._state.secret_key = key
        self._state.sign_outgoing = True
        self._state.link_id = LINK_ID
        self.refused = 0
        """How often something came that is not signed with the key."""
        self.renew()

    def renew(self) -> None:
        """Before something is sent or heard: its time is now, or later."""
        self._state.timestamp = max(self._state.timestamp, 100 * (self._clock() - SINCE_MS))

    def sign(self, writer: Any) -> None:
        """Let a writer of pymavlink sign."""
        writer.signing = self._state

    def check(self, parser: Any) -> None:
        """Let a parser of pymavlink refuse what is not signed with the key."""
        parser.signing = self._state
        theirs = parser.check_signature
        seen = self._state.stream_timestamps

        def check_signature(packet: bytearray, system: int, component: int) -> bool:
            # pymavlink notes the time before it has looked at the signature: one forged packet from the far future
            # would have it refuse everything that comes after.
            stream = (packet[-13], system, component)
            before = seen.get(stream)
            good = bool(theirs(packet, system, component))
            if not good and before is None:
                seen.pop(stream, None)
            elif not good:
                seen[stream] = before
            return good

        parser.check_signature = check_signature

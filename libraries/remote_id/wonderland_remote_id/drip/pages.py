"""Authentication messages out of their pages and back (ASTM F3411-22a, RFC 9575 section 5).

Bluetooth 4 sends each page by itself, and pages get lost. DRIP may append a page of parity, from which one lost page is
restored. Pages of one message belong together by their type and by coming soon after each other.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from wonderland_remote_id.decoding import EPOCH_2019_MS, FIRST_PAGE_BYTES, PAGE_BYTES
from wonderland_remote_id.drip.det import DripError
from wonderland_remote_id.encoding import encode
from wonderland_remote_id.enums import AuthenticationType
from wonderland_remote_id.messages import Authentication

MAX_DATA_BYTES: Final = 201
"""SAM type and data: what fits into nine pages, as the tightest transport demands."""
COLLECT_MS: Final = 12_000
"""Pages of one message come within this: each at least every three seconds, up to sixteen of them in turn."""
_HEADER_BYTES: Final = 2


@dataclass(frozen=True, slots=True)
class AuthenticationMessage:
    """A whole authentication message: ``pages`` are its 25-byte frames in order, ``data`` what they carry."""

    authentication_type: AuthenticationType
    data: bytes
    pages: tuple[bytes, ...]
    restored: bool = False
    """Whether a lost page was restored from the parity."""


def paginate(
    data: bytes,
    t_ms: int,
    *,
    parity: bool = False,
    authentication_type: AuthenticationType = AuthenticationType.SPECIFIC_AUTHENTICATION,
) -> tuple[Authentication, ...]:
    """The pages of a message. Raises `DripError` for more than 201 bytes, as DRIP limits them."""
    if not 1 <= len(data) <= MAX_DATA_BYTES:
        raise DripError(f"{len(data)} bytes of authentication data; DRIP allows 1 to {MAX_DATA_BYTES}")
    last = _last_page(len(data))
    body = data.ljust(FIRST_PAGE_BYTES + last * PAGE_BYTES, b"\0")
    if parity:
        if len(data) == len(body):  # the length of the additional data needs a place, and thereby a page
            last += 1
            body += bytes(PAGE_BYTES)
        body = body[: len(data)] + bytes((len(body) - len(data) - 1 + PAGE_BYTES,)) + body[len(data) + 1 :]
        last += 1
    pages = [
        Authentication(
            authentication_type=authentication_type,
            page=0,
            data=body[:FIRST_PAGE_BYTES],
            last_page=last,
            length=len(data),
            t_ms=t_ms,
        )
    ]
    rest = body[FIRST_PAGE_BYTES:]
    for start in range(0, len(rest), PAGE_BYTES):
        piece = rest[start : start + PAGE_BYTES]
        pages.append(Authentication(authentication_type=authentication_type, page=len(pages), data=piece))
    if parity:
        check = _parity(encode(page)[_HEADER_BYTES:] for page in pages)
        pages.append(Authentication(authentication_type=authentication_type, page=last, data=check))
    return tuple(pages)


class PageAssembler:
    """Collects the pages of one transmitter; bounded: at most sixteen pages of one message at a time."""

    def __init__(self) -> None:
        self._pages: dict[int, bytes] = {}
        self._type: AuthenticationType | None = None
        self._since_ms = 0

    def feed(self, page: Authentication, now_ms: int) -> AuthenticationMessage | None:
        """The message that this page completes, if it does. Pages that contradict each other begin anew."""
        frame = encode(page)
        known = self._pages.get(page.page)
        if (
            page.authentication_type is not self._type
            or not 0 <= now_ms - self._since_ms <= COLLECT_MS
            or (known is not None and known != frame)
        ):
            self._pages.clear()
            self._type, self._since_ms = page.authentication_type, now_ms
        self._pages[page.page] = frame
        message = self._complete()
        if message is not None:
            self._pages.clear()
        return message

    def _complete(self) -> AuthenticationMessage | None:
        pages, restored = dict(self._pages), False
        last = pages[0][2] if 0 in pages else max(pages)
        missing = [number for number in range(last + 1) if number not in pages]
        if missing:
            if len(missing) > 1 or last < 1 or (0 in pages and missing[0] == last):
                if missing != [last] or not _has_parity(pages[0]):
                    return None
                return self._made(pages, last - 1, restored=False)  # a lost parity page is no loss
            pages = _restore(pages, missing[0], last)
            if not pages:
                return None
            restored = True
        return self._made(pages, last, restored=restored)

    def _made(self, pages: dict[int, bytes], last: int, *, restored: bool) -> AuthenticationMessage | None:
        assert self._type is not None
        length = pages[0][3]
        body = pages[0][8:] + b"".join(pages[number][_HEADER_BYTES:] for number in range(1, last + 1))
        if length > len(body):
            return None
        ordered = tuple(pages[number] for number in sorted(pages))
        return AuthenticationMessage(self._type, body[:length], ordered, restored)


def _last_page(length: int) -> int:
    return 0 if length <= FIRST_PAGE_BYTES else -(-(length - FIRST_PAGE_BYTES) // PAGE_BYTES)


def _has_parity(first: bytes) -> bool:
    """Whether the first page announces more pages than its data needs."""
    return first[2] > _last_page(first[3])


def _parity(payloads: Iterable[bytes]) -> bytes:
    check = bytes(PAGE_BYTES)
    for payload in payloads:
        check = bytes(one ^ other for one, other in zip(check, payload, strict=True))
    return check


def _restore(pages: dict[int, bytes], missing: int, last: int) -> dict[int, bytes]:
    """All pages, the missing one from the parity; empty where there is none or what comes out is no page."""
    if last not in pages or (0 in pages and not _has_parity(pages[0])):
        return {}
    header = bytes((pages[last][0], pages[last][1] & 0xF0 | missing))
    restored = header + _parity(frame[_HEADER_BYTES:] for frame in pages.values())
    if missing == 0 and (restored[2] != last or restored[3] > MAX_DATA_BYTES or not _has_parity(restored)):
        return {}
    return dict(sorted({**pages, missing: restored}.items()))


def time_ms(seconds: int) -> int:
    """Unix milliseconds of a time of F3411 (seconds since 2019)."""
    return EPOCH_2019_MS + seconds * 1000

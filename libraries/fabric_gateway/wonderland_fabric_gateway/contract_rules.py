"""What every ledger asks of a contract's reads and writes, in place and as a service: the same limits, the same texts.

A contract that passes here passes on the embedded ledger and on Fabric. Where Fabric itself would do something else
with a value than its writer meant (an empty value deletes the key), it is refused here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from wonderland_fabric_gateway.errors import ContractFailedError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

BAD_REQUEST: Final = 400
TOO_MUCH: Final = 413
FAULT: Final = 500
MAX_ARGUMENT_BYTES: Final = 4 << 20
"""A function's name and its arguments together; the bound of a proposal."""
MAX_RESULT_BYTES: Final = 8 << 20
MAX_EVENT_BYTES: Final = 8 << 20
MAX_EVENT_NAME_CHARACTERS: Final = 256
MAX_KEY_BYTES: Final = 4096
MAX_VALUE_BYTES: Final = 1_000_000
"""A peer hands over a key's history in pages of 100 values, in messages of up to 100 MiB. A page that is larger breaks
its stream to the contract, and with it every transaction under way there (seen on Fabric 3.1.5)."""
MAX_WRITES: Final = 10_000
MAX_WRITTEN_BYTES: Final = 8 << 20
"""Keys and values of one transaction together, each write counted; a transaction may have 10 MiB in all."""
MAX_ENDORSERS: Final = 50
"""Organisations that one key may need; a network has up to 50."""
MAX_READS: Final = 100_000
"""Keys that one transaction may read, ranges included; Fabric's totalQueryLimit."""


def check_key(key: object) -> None:
    """Raise `ContractFailedError` unless it is text that a ledger can keep as a key."""
    if not isinstance(key, str) or not key:
        raise ContractFailedError(BAD_REQUEST, "a key is text that is not empty")
    try:
        size = len(key.encode())
    except UnicodeEncodeError as cause:
        raise ContractFailedError(BAD_REQUEST, f"key {key!r} is no Unicode text") from cause
    if size > MAX_KEY_BYTES:
        raise ContractFailedError(TOO_MUCH, f"a key of {size} bytes; the limit is {MAX_KEY_BYTES}")


def check_value(key: str, value: object) -> None:
    """Raise `ContractFailedError` unless these are bytes to be kept; on Fabric an empty value deletes its key."""
    if not isinstance(value, bytes):
        raise ContractFailedError(BAD_REQUEST, f"key {key!r}: a value is bytes, not {type(value).__name__}")
    if not value:
        raise ContractFailedError(BAD_REQUEST, f"key {key!r}: an empty value would delete the key; delete it instead")
    if len(value) > MAX_VALUE_BYTES:
        raise ContractFailedError(TOO_MUCH, f"key {key!r}: {len(value)} bytes; the limit is {MAX_VALUE_BYTES}")


def check_endorsers(key: str, msp_ids: object, writes: Mapping[str, bytes | None]) -> Sequence[str]:
    """The organisations that a key is to need. Raises `ContractFailedError`.

    Only a key that this transaction has put can be given them: on Fabric they would else go without a word.
    """
    check_key(key)
    if not isinstance(msp_ids, (list, tuple)) or not 1 <= len(msp_ids) <= MAX_ENDORSERS:
        raise ContractFailedError(BAD_REQUEST, f"key {key!r}: 1 to {MAX_ENDORSERS} organisations must be named")
    if any(not isinstance(each, str) or not each for each in msp_ids):
        raise ContractFailedError(BAD_REQUEST, f"key {key!r}: an organisation is named by its MSP id, a text")
    if writes.get(key) is None:
        raise ContractFailedError(BAD_REQUEST, f"key {key!r}: put it before saying who must endorse its changes")
    return msp_ids


def check_event(name: object, payload: object) -> None:
    """Raise `ContractFailedError` unless this is an event that a ledger can carry."""
    if not (isinstance(name, str) and name and isinstance(payload, bytes)):
        raise ContractFailedError(BAD_REQUEST, "an event has a name that is not empty, and bytes for payload")
    if len(name) > MAX_EVENT_NAME_CHARACTERS or not name.isprintable():
        raise ContractFailedError(BAD_REQUEST, f"event {name[:40]!r}: a name has up to 256 printable characters")
    if len(payload) > MAX_EVENT_BYTES:
        raise ContractFailedError(TOO_MUCH, f"event {name}: {len(payload)} bytes; the limit is {MAX_EVENT_BYTES}")


def check_result(result: object) -> bytes:
    """The contract's result itself. Raises `ContractFailedError` for one too large, TypeError for one of no bytes."""
    if not isinstance(result, bytes):
        raise TypeError(f"the contract returned {type(result).__name__}, not bytes")
    if len(result) > MAX_RESULT_BYTES:
        raise ContractFailedError(TOO_MUCH, f"a result of {len(result)} bytes; the limit is {MAX_RESULT_BYTES}")
    return result


def function_name(args: tuple[bytes, ...] | list[bytes]) -> str:
    """The function that a call names by its first argument. Raises `ContractFailedError`."""
    if not args:
        raise ContractFailedError(BAD_REQUEST, "the proposal names no function; the first argument is its name")
    try:
        return args[0].decode()
    except UnicodeDecodeError as cause:
        raise ContractFailedError(BAD_REQUEST, "the function's name is no UTF-8 text") from cause


class Budget:
    """Counts what one transaction writes, and what it reads."""

    __slots__ = ("_read", "_written_bytes")

    def __init__(self) -> None:
        self._read = 0
        self._written_bytes = 0

    def count_read(self) -> None:
        """One key was read. Raises `ContractFailedError` at the limit."""
        self._read += 1
        if self._read > MAX_READS:
            raise ContractFailedError(TOO_MUCH, f"more than {MAX_READS} keys read in one transaction")

    def count_write(self, key: str, value: bytes | None, keys_written: int) -> None:
        """One key was written, and is one of ``keys_written``. Raises `ContractFailedError` at the limit."""
        self._written_bytes += len(key) + len(value or b"")
        if self._written_bytes > MAX_WRITTEN_BYTES:
            raise ContractFailedError(TOO_MUCH, f"more than {MAX_WRITTEN_BYTES} bytes written in one transaction")
        if keys_written > MAX_WRITES:
            raise ContractFailedError(TOO_MUCH, f"more than {MAX_WRITES} keys written in one transaction")

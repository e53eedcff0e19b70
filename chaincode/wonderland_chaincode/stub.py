"""What the contract sees of a ledger during one transaction; a ledger runs it in place or as a service behind this.

Reads show committed state only, never the transaction's own writes, as on Fabric. The time is the transaction's (the
client's word, which a ledger bounds), never a clock's: every endorser must compute the same.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping, Sequence
from typing import Protocol


class Creator(Protocol):
    """Who signed the transaction; the ledger has checked the certificate and the signature."""

    @property
    def msp_id(self) -> str:
        """Organisation (membership service provider)."""

    @property
    def role(self) -> str:
        """Certificate attribute ``pol.role``; empty without one."""

    @property
    def pol_id(self) -> str:
        """Certificate attribute ``pol.id``: the pad or the drone itself; empty without one."""

    @property
    def common_name(self) -> str:
        """Common name of the certificate's subject."""

    @property
    def attributes(self) -> Mapping[str, str]:
        """All attributes of the certificate."""

    @property
    def certificate_sha256(self) -> str:
        """SHA-256 of the certificate's DER encoding, lower-case hexadecimal."""

    @property
    def public_key(self) -> bytes:
        """P-256 key of the certificate (65 B, SEC 1 uncompressed)."""

    @property
    def node_ou(self) -> str:
        """Fabric's node unit: client, peer, admin or orderer; empty without one."""


class Modification(Protocol):
    """One committed change of a key."""

    @property
    def tx_id(self) -> str:
        """Transaction that made it."""

    @property
    def timestamp_ms(self) -> int:
        """That transaction's time, milliseconds since the Unix epoch."""

    @property
    def value(self) -> bytes:
        """What was written; empty for a deletion."""

    @property
    def is_delete(self) -> bool:
        """Whether the key was deleted."""


class Stub(Protocol):
    """One transaction. Its calls are awaited one after the other: Fabric drops a second request in flight."""

    @property
    def channel(self) -> str:
        """Name of the channel."""

    @property
    def tx_id(self) -> str:
        """Transaction id, 64 lower-case hexadecimal digits."""

    @property
    def timestamp_ms(self) -> int:
        """The transaction's time, milliseconds since the Unix epoch."""

    @property
    def creator(self) -> Creator:
        """Who signed the proposal: organisation, role and id from the certificate."""

    async def get(self, key: str) -> bytes | None:
        """The committed value of a key, or None."""

    async def get_many(self, keys: Sequence[str]) -> list[bytes | None]:
        """The committed values of these keys, in their order; one round trip where the ledger offers it."""

    async def put(self, key: str, value: bytes) -> None:
        """Write a key when the transaction is committed."""

    async def require_endorsement(self, key: str, msp_ids: Sequence[str]) -> None:
        """Let changes of a key that this transaction has put need peers of all these organisations from then on.

        That is Fabric's key-level endorsement: it takes the place of the contract's policy for this key, until the
        key is deleted. The key's first value is still under the contract's policy.
        """

    async def delete(self, key: str) -> None:
        """Delete a key when the transaction is committed."""

    def range(self, start: str, end: str) -> AsyncIterator[tuple[str, bytes]]:
        """Committed keys and values from ``start`` (included) to ``end`` (excluded), in the keys' UTF-8 order."""

    def history(self, key: str) -> AsyncIterator[Modification]:
        """Committed changes of a key, newest first."""

    def set_event(self, name: str, payload: bytes) -> None:
        """The one event of the transaction."""

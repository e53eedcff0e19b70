"""The pad's one-time keys: enough of them on the ledger, their private halves in the spool, each taken once.

A private half is durable before its public half is published, so that no request can name a key that the pad lost by
a power cut. Taking it removes it durably before it is used: no session's keys can be derived a second time.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
from typing import TYPE_CHECKING, Final, Protocol

from cryptography.hazmat.primitives.asymmetric import ec

from wonderland.proof_contract import AwayError, Committed, RefusedError
from wonderland.proofs import keys
from wonderland.proofs.encoding import to_base64url
from wonderland.proofs.records.pads import OfferedPrekey, Prekey

if TYPE_CHECKING:
    from collections.abc import Mapping

    from wonderland.clock import Clock

_log = logging.getLogger(__name__)

_PREFIX: Final = "prekey/"
_SCALAR_BYTES: Final = 32
LIST_LIMIT: Final = 100
ORPHAN_AGE_MS: Final = 24 * 3_600_000
"""A key that the ledger does not offer may still be named by a request on its way, but not for a day."""
ORPHANS_AT_ONCE: Final = 20


class Vault(Protocol):
    """Where private halves are kept (``wonderland_edge_agent.spool.Spool``)."""

    async def put_secrets(self, secrets: Mapping[str, bytes]) -> None:
        """Keep several, all or none."""

    async def take_secret(self, name: str) -> bytes | None:
        """One, once; None when it was taken or never there."""

    async def secret_names(self) -> list[str]:
        """Names of those that are left."""
        ...


class PrekeyLedger(Protocol):
    """The ledger, as far as prekeys go."""

    async def publish_prekeys(self, pad_id: str, prekeys: tuple[OfferedPrekey, ...]) -> Committed:
        """Publish one-time keys on the ledger."""
        ...

    async def list_prekeys(self, pad_id: str, limit: int = 10) -> tuple[Prekey, ...]:
        """Keys that are offered and unused."""
        ...


class PrekeyKeeper:
    """Keeps ``target`` prekeys offered, publishing when half of them are used up."""

    def __init__(self, pad_id: str, vault: Vault, ledger: PrekeyLedger, clock: Clock, target: int) -> None:
        self._pad_id = pad_id
        self._vault = vault
        self._ledger = ledger
        self._clock = clock
        self._target = target
        self._lock = asyncio.Lock()
        self.available: int | None = None
        """How many are offered and usable, as far as this agent knows; None before the ledger has said it."""

    @property
    def low(self) -> bool:
        """Whether it is time to publish."""
        return (self.available or 0) * 2 <= self._target

    async def ensure(self) -> None:
        """Compare what is offered with what is kept, and publish what is missing. Raises AwayError, RefusedError."""
        async with self._lock:
            kept = {name[len(_PREFIX) :] for name in await self._vault.secret_names() if name.startswith(_PREFIX)}
            offered = {prekey.prekey_id for prekey in await self._ledger.list_prekeys(self._pad_id, LIST_LIMIT)}
            self.available = len(kept & offered)
            await self._drop_orphans(kept - offered)
            missing = self._target - self.available
            if missing > 0 and self.low:
                await self._publish(missing)

    async def take_key(self, prekey_id: str) -> ec.EllipticCurvePrivateKey | None:
        """The private half of a prekey, once; None where it was taken before or never was this pad's."""
        secret = await self._vault.take_secret(_PREFIX + prekey_id)
        if secret is None:
            return None
        self.available = max(0, (self.available or 0) - 1)
        return ec.derive_private_key(int.from_bytes(secret, "big"), ec.SECP256R1())

    async def _publish(self, count: int) -> None:
        fresh: dict[str, bytes] = {}
        offers: list[OfferedPrekey] = []
        for _ in range(count):
            key = keys.new_key()
            # The time in front lets an orphan's age be told from its name.
            prekey_id = f"{self._clock():012x}-{secrets.token_hex(6)}"
            fresh[_PREFIX + prekey_id] = key.private_numbers().private_value.to_bytes(_SCALAR_BYTES, "big")
            offers.append(OfferedPrekey(prekey_id=prekey_id, public_key=to_base64url(keys.public_bytes(key))))
        await self._vault.put_secrets(fresh)
        try:
            await self._ledger.publish_prekeys(self._pad_id, tuple(offers))
        except RefusedError:
            for name in fresh:
                await self._vault.take_secret(name)
            raise
        except AwayError:
            _log.warning("prekeys: %d may or may not have been published; the next look will tell", count)
            raise
        self.available = (self.available or 0) + count
        _log.info("prekeys: %d published, %d offered", count, self.available)

    async def _drop_orphans(self, orphans: set[str]) -> None:
        oldest_ms = self._clock() - ORPHAN_AGE_MS
        for prekey_id in sorted(orphans)[:ORPHANS_AT_ONCE]:
            born, _, _ = prekey_id.partition("-")
            try:
                age_known_ms = int(born, 16)
            except ValueError:
                continue
            if age_known_ms < oldest_ms:
                await self._vault.take_secret(_PREFIX + prekey_id)

"""Webhooks' secrets as the database keeps them: encrypted, with a key that is not in it.

A dump of the database, or a look into it, is not enough to sign what a receiver believes. AES-256-GCM; a secret is
bound to its subscription, so that one cannot be put into another's row.
"""

from __future__ import annotations

import binascii
from base64 import urlsafe_b64decode, urlsafe_b64encode
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Final

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from sqlalchemy.engine import URL

from wonderland_backend.context import part
from wonderland_backend.db.engine import Database
from wonderland_backend.db.passwords import BYTES, new_key
from wonderland_backend.errors import BackendError, SettingsError
from wonderland_backend.webhooks import store
from wonderland_fabric_gateway.errors import FileWriteError
from wonderland_fabric_gateway.files import write_atomic

PREFIX: Final = "sealed:"
_NONCE_BYTES: Final = 12


def beside(url: URL) -> Path | None:
    """Where the keys are that no setting names: beside a SQLite database, else nowhere."""
    return Path(f"{url.database}.webhooks.key") if url.get_backend_name() == "sqlite" else None


class SealError(BackendError):
    """A secret that no key here opens."""


class Sealing:
    """Keys that encrypt secrets: the first one seals, all of them open, so that a key can be changed."""

    def __init__(self, keys: Sequence[bytes], randomness: Callable[[int], bytes]) -> None:
        self._keys = [AESGCM(key) for key in keys]
        self._randomness = randomness

    @classmethod
    def load(cls, path: Path | None, database: Database, randomness: Callable[[int], bytes]) -> Sealing:
        """From a file with a key a line (base64 of 32 bytes), which is made where there is none.

        Without a path: beside a SQLite database; with another database there is no key, and no webhook. Raises
        `SettingsError`.
        """
        path = path or beside(database.url)
        if path is None:
            return cls([], randomness)
        try:
            if not path.exists():
                write_atomic(path, new_key(randomness))
            keys = [urlsafe_b64decode(line) for line in path.read_bytes().split()]
        except (OSError, FileWriteError, binascii.Error) as cause:
            raise SettingsError(f"webhook_key_file: {path} cannot be read as keys, or made ({cause})") from None
        if not keys or any(len(key) != BYTES for key in keys):
            raise SettingsError(f"webhook_key_file: {path} needs keys of {BYTES} bytes in base64, one a line")
        return cls(keys, randomness)

    @property
    def is_possible(self) -> bool:
        """Whether there is a key."""
        return bool(self._keys)

    async def seal_all(self, database: Database) -> None:
        """Seal the secrets of before there was a key."""
        if not self._keys:
            return
        async with database.write() as connection:
            for subscription_id, secret in await store.plain_secrets(connection):
                await store.set_secret(connection, subscription_id, self.seal(secret, subscription_id))

    def seal(self, secret: str, subscription_id: str) -> str:
        """What the database keeps."""
        nonce = self._randomness(_NONCE_BYTES)
        sealed = nonce + self._keys[0].encrypt(nonce, secret.encode(), subscription_id.encode())
        return PREFIX + urlsafe_b64encode(sealed).decode()

    def open(self, kept: str, subscription_id: str) -> str:
        """The secret. Raises `SealError`."""
        try:
            sealed = urlsafe_b64decode(kept.removeprefix(PREFIX))
        except binascii.Error:
            sealed = b""
        for key in self._keys:
            try:
                opened = key.decrypt(sealed[:_NONCE_BYTES], sealed[_NONCE_BYTES:], subscription_id.encode())
                return opened.decode()
            except (InvalidTag, ValueError):
                continue
        raise SealError("its secret cannot be decrypted: webhook_key_file has another key; make the webhook anew")


SealingDep = Annotated[Sealing, part(Sealing)]

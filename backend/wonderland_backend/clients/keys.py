"""The keys that sign access tokens: from a file that all replicas share, or made anew at each start."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, Final

from joserfc.errors import JoseError
from joserfc.jwk import ECKey, KeySet

from wonderland_backend.errors import SettingsError

ALGORITHM: Final = "ES256"
CURVE: Final = "P-256"
_PEM: Final = re.compile(rb"-----BEGIN [A-Z ]*PRIVATE KEY-----.*?-----END [A-Z ]*PRIVATE KEY-----", re.DOTALL)


class TokenKeys:
    """P-256 keys. The first one signs; tokens of all of them are good, so that a key can be changed without a gap."""

    def __init__(self, keys: list[ECKey]) -> None:
        assert keys
        for key in keys:
            key.ensure_kid()
        self.signing = keys[0]
        self.all = KeySet([*keys])

    @classmethod
    def load(cls, path: Path | None) -> TokenKeys:
        """From a file with PEM private keys; without a file a key that lives as long as the process.

        Raises `SettingsError`.
        """
        if path is None:
            return cls([ECKey.generate_key(CURVE, private=True)])
        try:
            found = [ECKey.import_key(text) for text in _PEM.findall(path.read_bytes())]
        except (OSError, JoseError, ValueError) as cause:
            raise SettingsError(f"token_key_file: {path} cannot be read as PEM private keys ({cause})") from None
        if not found or any(key.curve_name != CURVE for key in found):
            raise SettingsError(f"token_key_file: {path} needs P-256 private keys in PEM, the signing one first")
        return cls(found)

    def public(self) -> dict[str, Any]:
        """The JSON Web Key Set for whoever checks our tokens."""
        keys = [key.as_dict(private=False) | {"use": "sig", "alg": ALGORITHM} for key in self.all.keys]
        return {"keys": keys}

"""Keys that never leave a hardware security module: signing by PKCS#11.

Where connection.json names a key file, that file may hold, instead of a key, one line that says where the key is:

    pkcs11:token=wonderland;object=pad-7?module-path=/usr/lib/softhsm/libsofthsm2.so&pin-source=file:/etc/wonderland/pin

Sources: RFC 7512 (the URI), PKCS #11 v2.40 (CKM_ECDSA: r ‖ s over a digest). Needs the extra ``hsm``.
"""

from __future__ import annotations

import hashlib
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import unquote_to_bytes

from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import load_der_public_key

from wonderland_fabric_gateway.errors import SignatureError
from wonderland_fabric_gateway.files import read_bounded
from wonderland_fabric_gateway.signing import der_from_raw, require_p256

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.serialization import Encoding, KeySerializationEncryption, PrivateFormat
    from cryptography.utils import Buffer

SCHEME: Final = "pkcs11:"
MAX_URI: Final = 4_096
_PATH_ATTRIBUTES: Final = frozenset({"token", "object", "id", "type", "serial", "manufacturer", "model"})
_QUERY_ATTRIBUTES: Final = frozenset({"module-path", "pin-source"})
_EXAMPLE: Final = "pkcs11:token=NAME;object=KEY?module-path=/path/lib.so&pin-source=file:/path/pin"


@dataclass(frozen=True)
class HsmKey:
    """Where a key is: the library of the module, the token, the key's label or id, and the file with the PIN."""

    module: Path
    token: str
    label: str | None
    key_id: bytes | None
    pin_file: Path

    @classmethod
    def parse(cls, text: str) -> HsmKey:
        """From a PKCS#11 URI. Raises `SignatureError`, which names the attribute."""
        if not text.startswith(SCHEME) or len(text) > MAX_URI:
            raise SignatureError(f"a PKCS#11 URI looks like {_EXAMPLE}")
        path, _, query = text.removeprefix(SCHEME).partition("?")
        found = _attributes(path, ";", _PATH_ATTRIBUTES) | _attributes(query, "&", _QUERY_ATTRIBUTES)
        for needed in ("token", "module-path", "pin-source"):
            if needed not in found:
                raise SignatureError(f"the PKCS#11 URI has no {needed}; it looks like {_EXAMPLE}")
        if "object" not in found and "id" not in found:
            raise SignatureError("the PKCS#11 URI names no key: object=LABEL or id=%01%02 is missing")
        module, pin_file = Path(_text(found, "module-path")), Path(_text(found, "pin-source").removeprefix("file:"))
        if not module.is_absolute() or not pin_file.is_absolute():
            raise SignatureError("module-path and pin-source of the PKCS#11 URI must be absolute paths")
        return cls(
            module,
            _text(found, "token"),
            _text(found, "object") if "object" in found else None,
            found.get("id"),
            pin_file,
        )


class HsmPrivateKey(ec.EllipticCurvePrivateKey):
    """A P-256 key of a module, which signs and cannot be read; `cryptography` takes it as it takes others.

    The session is opened at once, and again when the token was away. Calls from several threads wait for each other.
    Raises `SignatureError`.
    """

    def __init__(self, key: HsmKey) -> None:
        self._key = key
        self._lock = threading.Lock()
        self._private: Any = None
        self._session: Any = None
        with self._lock:
            self._open()

    @property
    def curve(self) -> ec.EllipticCurve:
        """P-256: no other is used here, and a signature of another is too long."""
        return ec.SECP256R1()

    @property
    def key_size(self) -> int:
        """Bits."""
        return self.curve.key_size

    def sign(self, data: Buffer, signature_algorithm: ec.EllipticCurveSignatureAlgorithm) -> bytes:
        """DER signature over the SHA-256 of the data."""
        if not isinstance(signature_algorithm.algorithm, hashes.SHA256):
            raise SignatureError(f"{self._where}: keys in a module sign SHA-256 only here")
        return der_from_raw(self._raw(bytes(data)))

    def public_key(self) -> ec.EllipticCurvePublicKey:
        """The public key, which the token must have beside the private one."""
        pkcs11 = _library()
        from pkcs11.util.ec import encode_ec_public_key  # noqa: PLC0415 - an extra of its own

        with self._lock:
            try:
                found = self._session.get_key(
                    object_class=pkcs11.ObjectClass.PUBLIC_KEY,
                    key_type=pkcs11.KeyType.EC,
                    label=self._key.label,
                    id=self._key.key_id,
                )
                return require_p256(load_der_public_key(encode_ec_public_key(found)))
            except (pkcs11.exceptions.PKCS11Error, ValueError, UnsupportedAlgorithm) as cause:
                raise SignatureError(
                    f"{self._where}: there is no single public key {self._key.label or self._key.key_id!r} on P-256 "
                    f"({_why(cause)})"
                ) from cause

    def exchange(self, algorithm: ec.ECDH, peer_public_key: ec.EllipticCurvePublicKey) -> bytes:
        """Not with keys of identities."""
        del algorithm, peer_public_key
        raise SignatureError(f"{self._where}: the key of an identity signs, and agrees on nothing")

    def private_numbers(self) -> ec.EllipticCurvePrivateNumbers:
        """They stay in the module."""
        raise SignatureError(f"{self._where}: the key cannot be read")

    def private_bytes(
        self,
        encoding: Encoding,
        format: PrivateFormat,  # noqa: A002 - cryptography's name
        encryption_algorithm: KeySerializationEncryption,
    ) -> bytes:
        """They stay in the module."""
        del encoding, format, encryption_algorithm
        raise SignatureError(f"{self._where}: the key cannot be read")

    def __copy__(self) -> HsmPrivateKey:
        return self

    def __deepcopy__(self, memo: dict[Any, Any]) -> HsmPrivateKey:
        return self

    def _raw(self, message: bytes) -> bytes:
        digest = hashlib.sha256(message).digest()
        pkcs11 = _library()
        with self._lock:
            try:
                return self._sign(digest)
            except pkcs11.exceptions.PKCS11Error:
                self._open()  # the token was taken out, or its session ended
            try:
                return self._sign(digest)
            except pkcs11.exceptions.PKCS11Error as cause:
                raise SignatureError(f"{self._where}: the module does not sign ({_why(cause)})") from cause

    def _sign(self, digest: bytes) -> bytes:
        return bytes(self._private.sign(digest, mechanism=_library().Mechanism.ECDSA))

    @property
    def _where(self) -> str:
        return f"token {self._key.token!r}"

    def _open(self) -> None:
        pkcs11 = _library()
        key = self._key
        pin = read_bounded(key.pin_file, SignatureError, "PIN of the token", 1024).decode(errors="replace").strip()
        try:
            token = pkcs11.lib(str(key.module)).get_token(token_label=key.token)
            try:
                session = token.open(user_pin=pin)
            except pkcs11.exceptions.UserAlreadyLoggedIn:
                session = token.open()  # a process logs in to a token once, for all its sessions
            self._session = session
            self._private = session.get_key(
                object_class=pkcs11.ObjectClass.PRIVATE_KEY,
                key_type=pkcs11.KeyType.EC,
                label=key.label,
                id=key.key_id,
            )
        except pkcs11.exceptions.PinIncorrect as cause:
            raise SignatureError(
                f"{self._where}: the PIN in {key.pin_file} is wrong; a token locks itself after a few attempts"
            ) from cause
        except (pkcs11.exceptions.NoSuchKey, pkcs11.exceptions.MultipleObjectsReturned) as cause:
            raise SignatureError(f"{self._where}: there is no single key {key.label or key.key_id!r} on it") from cause
        except (pkcs11.exceptions.PKCS11Error, RuntimeError, OSError) as cause:
            raise SignatureError(
                f"{self._where}: cannot be used by {key.module} ({_why(cause)}); is the module there, the token in it?"
            ) from cause


def _library() -> Any:
    try:
        import pkcs11  # noqa: PLC0415 - an extra of its own
        import pkcs11.exceptions  # noqa: PLC0415
    except ImportError as cause:
        raise SignatureError(
            "keys in a hardware module need the extra hsm: pip install 'wonderland-fabric-gateway[hsm]'"
        ) from cause
    return pkcs11


def _attributes(text: str, separator: str, known: frozenset[str]) -> dict[str, bytes]:
    found: dict[str, bytes] = {}
    for part in filter(None, text.split(separator)):
        name, equals, value = part.partition("=")
        if not equals or name in found:
            raise SignatureError(f"the PKCS#11 URI has {name!r} {'twice' if equals else 'without a value'}")
        if name == "pin-value":
            raise SignatureError("a PIN has no place in a PKCS#11 URI; use pin-source=file:/path")
        if name not in known:
            raise SignatureError(f"the PKCS#11 URI has an unknown attribute {name[:40]!r}")
        found[name] = unquote_to_bytes(value)
    return found


def _text(found: dict[str, bytes], name: str) -> str:
    try:
        return found[name].decode()
    except UnicodeDecodeError as cause:
        raise SignatureError(f"{name} of the PKCS#11 URI is no text") from cause


def _why(cause: BaseException) -> str:
    return str(cause) or type(cause).__name__

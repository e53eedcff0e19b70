"""Invitations: a name, its attributes and a one-time secret, for whoever makes the private key elsewhere.

What Fabric CA calls registering and enrolling, for a local CA: an administrator invites, the invited sends a
certificate request with the secret. Only the secret's hash is kept, guessing ends the invitation, and no certificate
is issued twice for one secret.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import os
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Final

from wonderland_fabric_gateway.ca.application import VALIDITY, Application
from wonderland_fabric_gateway.ca.errors import NotInvitedError
from wonderland_fabric_gateway.ca.register import Invitation, milliseconds, open_register

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from wonderland_fabric_gateway.ca.local import Enrolment, LocalCa
    from wonderland_fabric_gateway.ca.random import RandomBytes
    from wonderland_fabric_gateway.ca.requests import CertificateRequest

INVITATION_VALIDITY: Final = timedelta(days=3)
MAX_FAILURES: Final = 10
"""After so many wrong secrets an invitation is void."""
_SECRET_BYTES: Final = 18


@dataclass(frozen=True, slots=True)
class Invited:
    """A name that may enrol itself, and the secret that it needs, which is kept nowhere."""

    name: str
    msp_id: str
    role: str
    secret: str


class Invitations:
    """The invitations of one CA. `now` gives the time (aware UTC)."""

    def __init__(
        self,
        ca: LocalCa,
        *,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
        random_bytes: RandomBytes = os.urandom,
    ) -> None:
        self._ca = ca
        self._now = now
        self._random_bytes = random_bytes
        self._register = ca.directory / "register.db"

    def invite(
        self,
        name: str,
        attributes: Mapping[str, str],
        *,
        validity: timedelta = VALIDITY,
        good_for: timedelta = INVITATION_VALIDITY,
    ) -> str:
        """The one-time secret, which nobody can read again; an earlier one to this name is void then.

        Raises `CaRequestError`, and what the register raises.
        """
        Application(name, attributes=attributes, validity=validity).check()
        secret = base64.urlsafe_b64encode(self._random_bytes(_SECRET_BYTES)).decode()
        expires_ms = milliseconds(self._now() + good_for)
        with open_register(self._register, write=True) as register:
            register.invite(
                Invitation(name, _sha256(secret), dict(attributes), int(validity.total_seconds()), expires_ms)
            )
        return secret

    def enrol(self, request: CertificateRequest, secret: str) -> Enrolment:
        """A certificate for the request's key; the secret is spent.

        Raises `NotInvitedError`, `AlreadyEnrolledError`, and what the register raises.
        """
        invitation = self._checked(request.name, secret)
        if invitation is None:
            raise NotInvitedError(
                f"{request.name[:64]!r} and this secret do not fit, or no longer: a secret serves once, and not for "
                "ever. Ask whoever runs the CA for another one"
            )
        # Whoever is second with the same secret finds that the name holds a certificate.
        enrolment = self._ca.enrol(
            invitation.name,
            attributes=invitation.attributes,
            validity=timedelta(seconds=invitation.validity_s),
            public_key=request.public_key,
        )
        with open_register(self._register, write=True) as register:
            register.end_invitation(invitation.name)
        return enrolment

    def _checked(self, name: str, secret: str) -> Invitation | None:
        with open_register(self._register, write=True) as register:
            found = register.invitation(name)
            if found is None:
                return None
            if found.expires_ms <= milliseconds(self._now()) or found.failures >= MAX_FAILURES:
                register.end_invitation(name)
                return None
            if not hmac.compare_digest(_sha256(secret), found.secret_sha256):
                register.invite(replace(found, failures=found.failures + 1))
                return None
            return found


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "replace")).hexdigest()

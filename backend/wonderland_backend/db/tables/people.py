"""People, how they prove who they are, and where they are signed in. Of secrets only hashes are kept."""

from __future__ import annotations

from sqlalchemy import ForeignKey, String, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from wonderland_backend.db.tables.base import Base, Hash, Identifier

PersonId = String(32)


class PersonRow(Base):
    """Somebody who may sign in."""

    __tablename__ = "people"
    __table_args__ = (UniqueConstraint("issuer", "subject"),)

    person_id: Mapped[str] = mapped_column(PersonId, primary_key=True)
    name: Mapped[str] = mapped_column(Identifier)
    email: Mapped[str | None] = mapped_column(String(254), unique=True)
    """In lower case."""
    roles: Mapped[str]
    """Separated by spaces."""
    msp_id: Mapped[str] = mapped_column(Identifier)
    """The organisation on the ledger whose pads or drones are theirs; empty: none."""
    state: Mapped[str] = mapped_column(String(16))
    """``invited``, ``active`` or ``suspended``."""
    issuer: Mapped[str | None] = mapped_column(String(512))
    """The OpenID provider that vouches for them, and its name for them."""
    subject: Mapped[str | None] = mapped_column(String(255))
    created_ms: Mapped[int]
    changed_ms: Mapped[int]
    revision: Mapped[int]
    """Rises with each change; who changes a person names the one that he has seen."""


class PasskeyRow(Base):
    """A WebAuthn credential."""

    __tablename__ = "passkeys"

    credential_id: Mapped[str] = mapped_column(String(1400), primary_key=True)
    person_id: Mapped[str] = mapped_column(PersonId, ForeignKey("people.person_id", ondelete="CASCADE"), index=True)
    public_key: Mapped[str]
    """COSE key, base64url."""
    sign_count: Mapped[int]
    transports: Mapped[str]
    name: Mapped[str] = mapped_column(Identifier)
    created_ms: Mapped[int]
    last_used_ms: Mapped[int | None]


class LinkRow(Base):
    """A link that serves once: to set the server up, to accept an invitation, to come back, to sign in."""

    __tablename__ = "links"

    token_sha256: Mapped[str] = mapped_column(Hash, primary_key=True)
    kind: Mapped[str] = mapped_column(String(16))
    person_id: Mapped[str | None] = mapped_column(
        PersonId, ForeignKey("people.person_id", ondelete="CASCADE"), index=True
    )
    created_ms: Mapped[int]
    expires_ms: Mapped[int]
    used_ms: Mapped[int | None]


class SignInRow(Base):
    """A signed-in browser."""

    __tablename__ = "sign_ins"

    cookie_sha256: Mapped[str] = mapped_column(Hash, primary_key=True)
    sign_in_id: Mapped[str] = mapped_column(String(32), unique=True)
    """What others may know of it, so that it can be ended."""
    person_id: Mapped[str] = mapped_column(PersonId, ForeignKey("people.person_id", ondelete="CASCADE"), index=True)
    method: Mapped[str] = mapped_column(String(16))
    browser: Mapped[str] = mapped_column(String(256))
    """The User-Agent that it named."""
    created_ms: Mapped[int]
    expires_ms: Mapped[int] = mapped_column(index=True)
    last_seen_ms: Mapped[int]
    verified_ms: Mapped[int] = mapped_column(server_default="0")
    """When its person last proved to be there (step-up)."""


class CeremonyRow(Base):
    """A sign-in or registration under way: what was asked of the browser, until it answers once."""

    __tablename__ = "ceremonies"

    ceremony_sha256: Mapped[str] = mapped_column(Hash, primary_key=True)
    kind: Mapped[str] = mapped_column(String(16))
    content: Mapped[str]
    """JSON: the challenge, or state, nonce and code verifier; whose it is."""
    expires_ms: Mapped[int] = mapped_column(index=True)

"""Machines that read the API: OAuth clients, the assertions they have spent, the answers to writes sent twice."""

from __future__ import annotations

from sqlalchemy import String
from sqlalchemy.orm import Mapped, mapped_column

from wonderland_backend.db.tables.base import Base, Hash, Identifier


class ClientRow(Base):
    """A registered OAuth client. Of a secret only the hash is kept; a public key needs no secret at all."""

    __tablename__ = "clients"

    client_id: Mapped[str] = mapped_column(String(64), primary_key=True)
    name: Mapped[str] = mapped_column(Identifier)
    scopes: Mapped[str]
    """Those it may ask for, separated by spaces."""
    role: Mapped[str] = mapped_column(String(32))
    msp_id: Mapped[str] = mapped_column(Identifier)
    """The organisation whose things it sees, where its role is limited to one; else empty."""
    secret_sha256: Mapped[str | None] = mapped_column(Hash)
    jwks: Mapped[str | None]
    """Public keys (JSON) by which it signs assertions (``private_key_jwt``)."""
    tls: Mapped[str | None]
    """By which certificate it authenticates (RFC 8705): JSON of one name, or of the certificate's SHA-256."""
    created_ms: Mapped[int]
    created_by: Mapped[str] = mapped_column(Identifier)
    owner_id: Mapped[str] = mapped_column(String(32), server_default="")
    """The person who registered it, and beyond whom it never goes; empty: the server's own command line."""
    revoked_ms: Mapped[int | None]
    last_token_ms: Mapped[int | None]


class AssertionRow(Base):
    """A client's assertion that was spent: the same one buys no second token."""

    __tablename__ = "client_assertions"

    jti_sha256: Mapped[str] = mapped_column(Hash, primary_key=True)
    expires_ms: Mapped[int] = mapped_column(index=True)


class IdempotencyRow(Base):
    """A write that bore an Idempotency-Key, and what was answered to it."""

    __tablename__ = "idempotency_keys"

    principal: Mapped[str] = mapped_column(Identifier, primary_key=True)
    key: Mapped[str] = mapped_column(Identifier, primary_key=True)
    request_sha256: Mapped[str] = mapped_column(Hash)
    created_ms: Mapped[int] = mapped_column(index=True)
    status: Mapped[int | None]
    """None while the first request is under way."""
    location: Mapped[str | None]
    body: Mapped[str | None]

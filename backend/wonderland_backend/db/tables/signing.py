"""Keys that people sign with, and the transactions that they are about to sign or have signed."""

from __future__ import annotations

from sqlalchemy import ForeignKey, Index, LargeBinary, String
from sqlalchemy.orm import Mapped, mapped_column

from wonderland_backend.db.tables.base import Base, Hash, Identifier
from wonderland_backend.db.tables.people import PersonId


class SigningKeyRow(Base):
    """A ledger certificate that belongs to somebody's account. The private key never leaves their browser."""

    __tablename__ = "signing_keys"

    certificate_sha256: Mapped[str] = mapped_column(Hash, primary_key=True)
    person_id: Mapped[str] = mapped_column(PersonId, ForeignKey("people.person_id", ondelete="CASCADE"), index=True)
    msp_id: Mapped[str] = mapped_column(Identifier)
    name: Mapped[str] = mapped_column(Identifier)
    role: Mapped[str] = mapped_column(Identifier)
    not_after_ms: Mapped[int]
    certificate: Mapped[str]
    """PEM."""
    bound_ms: Mapped[int]
    ended_ms: Mapped[int | None]


class SignedTransactionRow(Base):
    """A transaction on its way from a form to the ledger. What counts in the end is the ledger's own word."""

    __tablename__ = "signed_transactions"
    __table_args__ = (Index(None, "person_id", "created_ms"), Index(None, "state", "changed_ms"))

    tx_id: Mapped[str] = mapped_column(Hash, primary_key=True)
    person_id: Mapped[str] = mapped_column(PersonId)
    person: Mapped[str] = mapped_column(Identifier)
    certificate_sha256: Mapped[str] = mapped_column(Hash)
    function: Mapped[str] = mapped_column(String(32))
    subject: Mapped[str] = mapped_column(String(256))
    """``kind/id``, as the audit log names it."""
    argument: Mapped[str]
    """Canonical JSON, as it is signed."""
    seen_block: Mapped[int | None]
    """The version of the record that the person had before their eyes; block -1: there was none."""
    seen_tx_index: Mapped[int | None]
    state: Mapped[str] = mapped_column(String(16))
    proposal: Mapped[bytes] = mapped_column(LargeBinary)
    transaction: Mapped[bytes | None] = mapped_column(LargeBinary)
    """What the peers endorsed; once submitted with the person's signature."""
    endorsers: Mapped[str]
    """MSP ids, comma-separated."""
    block: Mapped[int | None]
    validation: Mapped[str | None] = mapped_column(String(40))
    problem: Mapped[str | None]
    """JSON: why it came to nothing."""
    created_ms: Mapped[int]
    changed_ms: Mapped[int]

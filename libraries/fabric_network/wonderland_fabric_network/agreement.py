"""contract.json: what the organisations of this network agreed on, and which of their two servers runs it."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from wonderland_fabric_gateway.files import PUBLIC, read_bounded, write_atomic
from wonderland_fabric_network.contract import SLOTS, InstalledContract
from wonderland_fabric_network.errors import DirectoryStateError, NetworkError

if TYPE_CHECKING:
    from pathlib import Path


class ContractDiffersError(NetworkError):
    """The installed contract is not the one that the organisations agreed on."""


@dataclass(frozen=True)
class Agreement:
    """Sequence and version on the channel; the digest of the contract's source; the servers' slot; the package."""

    sequence: int
    version: str
    sha256: str
    slot: str
    package_id: str

    def fits(self, contract: InstalledContract) -> bool:
        """Whether this very contract is installed here."""
        return (self.version, self.sha256) == (contract.version, contract.sha256)


def load_agreement(path: Path) -> Agreement | None:
    """The note, or None when there is none. Raises `DirectoryStateError`."""
    if not path.exists():
        return None
    damaged = f"{path}: cannot be read; delete it, and `up` asks the channel"
    try:
        document = json.loads(read_bounded(path, DirectoryStateError, "contract note"))
        agreement = Agreement(
            int(document["sequence"]), *(str(document[name]) for name in ("version", "sha256", "slot", "package_id"))
        )
    except (ValueError, TypeError, KeyError) as cause:
        raise DirectoryStateError(f"{damaged} ({cause})") from cause
    if agreement.slot not in SLOTS:
        raise DirectoryStateError(damaged)
    return agreement


def save_agreement(path: Path, agreement: Agreement) -> None:
    """Write the note. Raises `FileWriteError`."""
    write_atomic(path, json.dumps(asdict(agreement), indent=1).encode() + b"\n", PUBLIC)


def require_installed(agreement: Agreement, contract: InstalledContract) -> None:
    """Raise `ContractDiffersError` unless the installed contract is the agreed one: no organisation runs another."""
    if not agreement.fits(contract):
        raise ContractDiffersError(
            f"the organisations agreed on contract version {agreement.version} (source {agreement.sha256[:12]}); "
            f"installed here is {contract.version} (source {contract.sha256[:12]}). Next: install the "
            "agreed version, or agree on this one by `wonderland network upgrade`"
        )

"""Finding the contract that the ledger runs: by entry point, never by import, so that nothing depends upwards."""

from __future__ import annotations

import inspect
from importlib.metadata import entry_points
from typing import Any, Final, Protocol, cast

from wonderland_fabric_gateway.embedded.errors import ContractLoadError

GROUP: Final = "wonderland.contracts"


class Contract(Protocol):
    """What the ledger asks of a contract. `stub` is a `wonderland_fabric_gateway.embedded.stub.TransactionStub`.

    A failure is an exception with a `status` (400 to 599) whose text is for the caller. Anything else that escapes is
    taken for a fault of the contract: the caller gets a reference number and no details.
    """

    @property
    def version(self) -> str:
        """The version that goes into each transaction."""

    async def invoke(self, stub: Any, function: str, args: list[bytes]) -> bytes:
        """Run one function; the result is the transaction's response."""


def load_contract(name: str) -> Contract:
    """The installed contract of that name. Raises `ContractLoadError`, saying which there are."""
    found = {entry.name: entry for entry in entry_points(group=GROUP)}
    if name not in found:
        there = ", ".join(sorted(found)) or "none"
        raise ContractLoadError(f"no contract {name!r} is installed (installed: {there}); install the chaincode extra")
    try:
        contract = found[name].load()
    except Exception as cause:  # whatever a foreign module raises while it is imported
        raise ContractLoadError(f"contract {name!r} cannot be loaded: {cause}") from cause
    return check_contract(name, contract)


def check_contract(name: str, contract: object) -> Contract:
    """The object itself, seen to have what the ledger calls. Raises `ContractLoadError`."""
    if not isinstance(getattr(contract, "version", None), str) or not inspect.iscoroutinefunction(
        getattr(contract, "invoke", None)
    ):
        raise ContractLoadError(f"contract {name!r} lacks a text `version` or an async `invoke(stub, function, args)`")
    return cast("Contract", contract)

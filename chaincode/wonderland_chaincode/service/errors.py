"""What can go wrong between a peer and the contract service; catch `ServiceError` to catch all of it."""

from __future__ import annotations

from wonderland_fabric_gateway.errors import LedgerError


class ServiceError(LedgerError):
    """Base of the service's own errors."""


class SettingsError(ServiceError):
    """The service cannot start as it was told to: an option, a certificate or an address; the text says which."""


class StreamProtocolError(ServiceError):
    """A peer's bytes or the order of its messages are not the protocol; its stream ends, others go on."""


class BadTransactionError(ServiceError):
    """A transaction message that contradicts its own proposal, or lacks one."""


class UnavailableError(ServiceError):
    """This service cannot run a transaction now. A peer tells its client to try another one."""


class PeerRefusedError(ServiceError):
    """The peer refused a read or a write of a transaction, most often because it gave the transaction up."""


class ContractFaultError(ServiceError):
    """The contract did what no contract may: its own exception, a foreign wait, a result that is no bytes."""

"""What can go wrong with a network; each text says what, and the next step."""

from __future__ import annotations

from wonderland_fabric_gateway.errors import LedgerError


class NetworkError(LedgerError):
    """Base of the errors of ``wonderland network``."""


class DescriptionError(NetworkError):
    """network.yaml cannot be used; the text names the file and the field."""


class BinaryError(NetworkError):
    """One of Fabric's servers is missing, or of a version that does not do."""


class PortInUseError(NetworkError):
    """A port that a component was given is taken by somebody else."""


class DirectoryStateError(NetworkError):
    """The network's directory is not in the state that this needs: no network, another description, somebody at it."""


class ComponentError(NetworkError):
    """A component did not do what it should: which, why, the end of its log, and the remedy."""

    def __init__(self, component: str, reason: str, *, log_tail: str = "", remedy: str = "") -> None:
        parts = [f"{component}: {reason}"]
        if remedy:
            parts.append(f"Next: {remedy}")
        if log_tail:
            parts.append(f"The end of its log:\n{log_tail}")
        super().__init__("\n".join(parts))
        self.component = component
        self.reason = reason
        self.log_tail = log_tail
        self.remedy = remedy


class RefusedError(NetworkError):
    """A peer or an orderer answered, and said no. `status` is its status code (0 when it has none)."""

    def __init__(self, text: str, status: int = 0) -> None:
        super().__init__(text)
        self.status = status


class UnreachableError(NetworkError):
    """A peer or an orderer did not answer in time."""


class ChannelUpdateError(NetworkError):
    """A change of the channel's configuration that cannot be made, or that would do harm."""


class CertificateStateError(NetworkError):
    """A certificate is expired, not yet valid, foreign, or does not belong to its key."""

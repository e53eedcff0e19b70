"""At which host each component is, and where it listens: all on this machine, or each on its own."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from wonderland_fabric_network.contract import SLOTS
from wonderland_fabric_network.description import EACH

if TYPE_CHECKING:
    from collections.abc import Mapping

    from wonderland_fabric_network.description import NetworkDescription

CONTRACT: Final = "contract"
LOCAL: Final = ("localhost", "127.0.0.1")
"""Every server may also be asked from its own machine."""
_EVERYWHERE: Final = "0.0.0.0"  # noqa: S104 - a host of its own, reached by the other components


class Hosts:
    """The hosts of one description. Names are those of nodes: peer0, orderer0, ca, contract-a."""

    def __init__(self, description: NetworkDescription, others: Mapping[str, str] = MappingProxyType({})) -> None:
        """`others`: where the components of organisations are whose servers run on another machine."""
        self.each: Final = description.hosts == EACH
        self._one = description.host
        self._others = others

    @property
    def bind(self) -> str:
        """The address on which components listen."""
        return _EVERYWHERE if self.each else self._one

    def of(self, msp_id: str, name: str) -> str:
        """Where others find a component."""
        return f"{name}.{msp_id.lower()}" if self.each else self._others.get(msp_id, self._one)

    def names(self, msp_id: str, name: str) -> tuple[str, ...]:
        """What a TLS certificate of that name is for."""
        own = [f"{CONTRACT}-{slot}" for slot in SLOTS] if name == CONTRACT else [name]
        return tuple(dict.fromkeys((*(self.of(msp_id, each) for each in own), *LOCAL)))

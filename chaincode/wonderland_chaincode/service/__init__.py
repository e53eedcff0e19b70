"""The contract as a service: dialled by the peers of a Hyperledger Fabric network.

It runs the same contract that the embedded ledger runs in place.
Rooms: ``server`` gRPC and TLS · ``stream`` one peer's messages · ``invocation`` one transaction · ``facts`` who sent it
· ``stub`` reads and writes by the peer · ``settings``, ``tls``, ``metrics``, ``operations``, ``logs`` for who runs it.
"""

from wonderland_chaincode.service.errors import ServiceError
from wonderland_chaincode.service.server import ContractServer
from wonderland_chaincode.service.settings import Limits
from wonderland_chaincode.service.tls import Tls

__all__ = ["ContractServer", "Limits", "ServiceError", "Tls"]

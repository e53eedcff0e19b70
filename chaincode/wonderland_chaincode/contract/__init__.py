"""The proof-of-location contract: claim against measurement, decided the same on every endorser.

Pure: it sees the ledger through ``stub`` and imports the core, the standard library and the check of an
ECDSA signature, nothing else. Rooms: ``dispatch`` from name and JSON to a transaction · ``access`` who may ·
``pads``, ``uavs``, ``policies``, ``sessions``, ``assets`` the transactions · ``survey`` whether a frame can be true ·
``signatures`` · ``call`` typed records in and out of the state · ``errors``.
"""

from wonderland_chaincode.contract.dispatch import CONTRACT, Contract
from wonderland_chaincode.contract.errors import ContractError

__all__ = ["CONTRACT", "Contract", "ContractError"]

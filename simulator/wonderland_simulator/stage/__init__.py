"""Everything that has to run around a world: ledger, backend and pads as processes, and what the ledger must know.

Used by the demo, by recordings and by the reproduction of the paper, so that all three go the whole way.
"""

from wonderland_simulator.stage.processes import PortClaims, Process, ProcessError, Processes
from wonderland_simulator.stage.stage import Stage, StageSettings

__all__ = ["PortClaims", "Process", "ProcessError", "Processes", "Stage", "StageSettings"]

"""The attack lab: documented classes of attack, played many thousand times against the contract's own decision.

``run(LabSettings(…)) -> LabResult`` plays them on the core; ``wire`` plays a sample of them through real agents, radio
bytes and a ledger; ``report`` prints tables and draws plots. The command is ``wonderland attack``.
"""

from wonderland_research.attack_lab.attacks import ATTACKS
from wonderland_research.attack_lab.judge import LabError
from wonderland_research.attack_lab.model import Attack, AttackResult, Family, LabResult, LevelResult
from wonderland_research.attack_lab.run import LabSettings, UnknownAttackError, run, total_tries

__all__ = [
    "ATTACKS",
    "Attack",
    "AttackResult",
    "Family",
    "LabError",
    "LabResult",
    "LabSettings",
    "LevelResult",
    "UnknownAttackError",
    "run",
    "total_tries",
]

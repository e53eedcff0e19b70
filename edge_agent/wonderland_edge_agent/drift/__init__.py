"""Does a pad still stand as it was commissioned? Its anchors range each other when no drone is there, and it compares.

``baseline``: what they measured when they were commissioned; ``watch``: sequential change detection; ``residuals``:
what verified sessions left over; ``keeper``: when to measure. No numerics library: a running pad carries this.
"""

from wonderland_edge_agent.drift.baseline import Baseline, BaselineError, PairBaseline
from wonderland_edge_agent.drift.watch import DriftState, DriftWatch

__all__ = ["Baseline", "BaselineError", "DriftState", "DriftWatch", "PairBaseline"]

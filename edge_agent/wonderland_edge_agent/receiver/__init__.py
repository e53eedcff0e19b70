"""The pad's Remote ID receiver: frames from any source → who broadcasts which position, and what is odd, unverified."""

from wonderland_edge_agent.receiver.assembler import Assembler
from wonderland_edge_agent.receiver.errors import ReceiverError
from wonderland_edge_agent.receiver.findings import Finding
from wonderland_edge_agent.receiver.heard import Heard, ReceiverCounts
from wonderland_edge_agent.receiver.limits import ReceiverLimits
from wonderland_edge_agent.receiver.receiver import RemoteIdReceiver

__all__ = ["Assembler", "Finding", "Heard", "ReceiverCounts", "ReceiverError", "ReceiverLimits", "RemoteIdReceiver"]

"""The pad's Remote ID receiver: frames by UDP or serial line → who broadcasts which position, unverified."""

from edge_agent.receiver.assembler import Assembler
from edge_agent.receiver.heard import Heard, ReceiverCounts
from edge_agent.receiver.limits import ReceiverLimits
from edge_agent.receiver.receiver import ReceiverError, RemoteIdReceiver

__all__ = ["Assembler", "Heard", "ReceiverCounts", "ReceiverError", "ReceiverLimits", "RemoteIdReceiver"]

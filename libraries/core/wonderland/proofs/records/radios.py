"""What UWB nodes can do, as far as a session's radio plan depends on it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from wonderland.proofs.errors import RecordError
from wonderland.proofs.records.schema import Choice, Integer, Items, Record


@dataclass(frozen=True, kw_only=True, slots=True)
class NodeAbility(Record):
    """Of the weakest of a pad's nodes, or of a drone's. The plan of a session is a function of both sides'."""

    words: Annotated[
        str, Choice(("both_ways", "initiator"), "Who carries data in a ranging session: all, or the initiator alone")
    ]
    word_octets: Annotated[int, Integer(48, 97, "Data that one frame takes, of its 127 octets")]
    slot_us: Annotated[int, Integer(300, 20_000, "The shortest slot that the node keeps up with")]
    channels: Annotated[tuple[int, ...], Items(1, 8, of=Integer(5, 14))]
    sts: Annotated[str, Choice(("static", "provisioned"), "How the scrambled time-stamp sequence can be keyed")]
    blinks: Annotated[str, Choice(("none", "scheduled"), "Whether it sends and time-stamps frames one way (UL-TDoA)")]

    def validate(self, path: str) -> None:
        """Channels rise, so that equal abilities are equal bytes."""
        if list(self.channels) != sorted(set(self.channels)):
            raise RecordError(f"{path}.channels" if path else "channels", "must rise")

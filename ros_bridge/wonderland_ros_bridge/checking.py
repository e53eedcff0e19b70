"""What settings mean, in words: ``wonderland ros1 run --check``."""

from __future__ import annotations

from collections.abc import Iterator

from wonderland_fabric_gateway.connection import Connection
from wonderland_ros_bridge.ledger.listener import Choice
from wonderland_ros_bridge.ledger.policy import Rule
from wonderland_ros_bridge.ros1.hosts import LOOPBACK
from wonderland_ros_bridge.settings import LedgerSettings, Settings


def explained(settings: Settings) -> Iterator[str]:
    """Lines for people. Raises LedgerError for a connection file that says not enough."""
    ros1 = settings.ros1
    yield f"Bridge {settings.bridge}: the settings can be read."
    yield who_in_words(settings.ledger)
    yield f"It is node {ros1.node} of the master at {ros1.master}, and listens on {ros1.host}."
    if tuple(ros1.networks) == LOOPBACK:
        yield "It speaks with nodes of this machine alone (ros1.networks)."
    else:
        yield f"It speaks with nodes in {', '.join(ros1.networks)}: ROS 1 protects nothing of that."
    yield f"Up to {settings.max_spool_bytes / 2**20:g} MiB wait for the ledger in {settings.spool}."
    for rule in settings.to_ledger:
        yield f"To the ledger: {rule_in_words(rule)}"
    for choice in settings.from_ledger:
        yield f"From the ledger: {choice_in_words(choice)}"
    if settings.orders is not None:
        yield f"Whoever publishes on {settings.orders} changes assets under ros1/{settings.bridge}/."


def who_in_words(ledger: LedgerSettings) -> str:
    """As whom it speaks with which ledger. Raises LedgerError."""
    where = Connection.load(ledger.connection)
    where.signer(ledger.identity)
    msp_id = where.identity(ledger.identity).msp_id
    return f"On the ledger at {where.gateway.address} it is {ledger.identity} of {msp_id}."


def rule_in_words(rule: Rule) -> str:
    """What goes to the ledger."""
    what = f"{rule.topic}, {rule.type or 'any type'}"
    sample = f", one message of {rule.every}" if rule.every > 1 else ""
    if rule.max_hz is not None:
        sample += f", at most {rule.max_hz:g} a second"
    if rule.payload == "digest":
        how = "by digest alone: keep the recording, or nothing is left of it"
    else:
        how = f"whole up to {rule.inline_bytes} bytes, larger ones by digest"
    return f"{what}{sample or ', all messages'}; {how}."


def choice_in_words(choice: Choice) -> str:
    """What comes from it."""
    what = f"{', '.join(choice.events)} signed by {', '.join(choice.senders)}, as {choice.give}, on {choice.topic}"
    if any(each in {"*", "*/*"} for each in choice.senders):
        return f"{what}. Every member of the channel may publish that."
    return f"{what}."

"""Changes of a channel's configuration: what differs, who signs it, and that everybody has it.

A change names what it reads (with versions) and what it writes (versions one higher); the orderer takes it when what
it reads is still so and the signatures meet the policies of what it writes. Sources: Fabric "Channel configuration
updates", ``common/configtx/update.go``.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from fabric_protos.common import common_pb2, configtx_pb2

from wonderland_fabric_gateway.channel_groups import serialise
from wonderland_fabric_network.concurrency import together
from wonderland_fabric_network.errors import ChannelUpdateError, RefusedError, UnreachableError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wonderland_fabric_gateway.identity import SigningIdentity
    from wonderland_fabric_network.network import Network
    from wonderland_fabric_network.peers import PeerAdmin

Change: TypeAlias = Callable[[Any], None]
"""Changes a ``common.ConfigGroup``, the channel's, in place."""
NONCE_BYTES: Final = 24
ATTEMPTS: Final = 5
SETTLE_S: Final = 30.0
_POLL_S: Final = 0.02
_CONFLICTS: Final = ("but key is at version", "config update is based on", "no mod_policy")
_LEADERLESS: Final = ("no Raft leader", "no leader", "SERVICE_UNAVAILABLE")


def compute_update(channel: str, old: Any, new: Any) -> Any | None:
    """``common.ConfigUpdate`` from one channel group to another; None when they say the same."""
    difference = _difference(old, new)
    if difference is None:
        return None
    read_set, write_set = difference
    return configtx_pb2.ConfigUpdate(channel_id=channel, read_set=read_set, write_set=write_set)


def signature_over(update: bytes, signer: SigningIdentity, random_bytes: Callable[[int], bytes]) -> Any:
    """``common.ConfigSignature`` of one administrator over a ``common.ConfigUpdate``."""
    header = serialise(common_pb2.SignatureHeader(creator=signer.creator, nonce=random_bytes(NONCE_BYTES)))
    return configtx_pb2.ConfigSignature(signature_header=header, signature=signer.sign(header + update))


def enveloped(
    channel: str,
    update: bytes,
    signatures: Sequence[Any],
    submitter: SigningIdentity,
    *,
    now_ns: int,
    random_bytes: Callable[[int], bytes],
) -> bytes:
    """The envelope for an orderer: the update, the signatures over it, and the submitter's around it all.

    The signature around it does not count towards any policy, so that who submits signs twice.
    """
    envelope = configtx_pb2.ConfigUpdateEnvelope(config_update=update, signatures=signatures)
    channel_header = common_pb2.ChannelHeader(type=common_pb2.CONFIG_UPDATE, channel_id=channel)
    channel_header.timestamp.seconds, channel_header.timestamp.nanos = divmod(now_ns, 1_000_000_000)
    header = common_pb2.Header(
        channel_header=serialise(channel_header),
        signature_header=serialise(
            common_pb2.SignatureHeader(creator=submitter.creator, nonce=random_bytes(NONCE_BYTES))
        ),
    )
    payload = serialise(common_pb2.Payload(header=header, data=serialise(envelope)))
    return serialise(common_pb2.Envelope(payload=payload, signature=submitter.sign(payload)))


async def update_channel(
    network: Network, peers: Sequence[PeerAdmin], change: Change, signers: Sequence[SigningIdentity]
) -> int | None:
    """Make a change and wait until all these peers have it; the number of its block, None when there is nothing to do.

    When somebody else's change comes between, it is computed afresh. Raises `ChannelUpdateError` with the orderer's
    reason, `UnreachableError`, and whatever `change` raises.
    """
    for attempt in range(ATTEMPTS):
        state = await peers[0].channel_state(network.channel)
        new = configtx_pb2.ConfigGroup()
        new.CopyFrom(state.config.channel_group)
        change(new)
        update = compute_update(network.channel, state.config.channel_group, new)
        if update is None:
            return None
        data = serialise(update)
        signatures = [signature_over(data, signer, network.random_bytes) for signer in signers]
        try:
            return await submit_update(network, peers, data, signatures, signers[0], after=state.block_number)
        except RefusedError as error:
            if attempt + 1 < ATTEMPTS and any(sign in str(error) for sign in _CONFLICTS):
                continue
            raise ChannelUpdateError(f"the ordering service refused the change: {error}") from error
    raise ChannelUpdateError("other changes of the channel kept coming between; try again")


async def submit_update(
    network: Network,
    peers: Sequence[PeerAdmin],
    update: bytes,
    signatures: Sequence[Any],
    submitter: SigningIdentity,
    *,
    after: int,
) -> int:
    """Have a signed update made, and wait until these peers have a configuration block later than `after`; its number.

    Raises `RefusedError` with the orderer's reason, `UnreachableError`.
    """
    envelope = enveloped(
        network.channel,
        update,
        signatures,
        submitter,
        now_ns=int(network.now().timestamp() * 1e9),
        random_bytes=network.random_bytes,
    )
    await _send(network, envelope)
    return min(await together(_settled(peer, network.channel, after) for peer in peers))


async def _send(network: Network, envelope: bytes) -> None:
    """To whichever orderer takes it, those that run here first."""
    deadline = time.monotonic() + SETTLE_S
    while True:
        last: Exception | None = None
        for member in dict.fromkeys((*network.orderers, *network.every_orderer)):
            try:
                async with network.broadcast(member) as orderer:
                    await orderer.send(envelope)
            except UnreachableError as error:
                last = error
            except RefusedError as error:
                if not any(sign in str(error) for sign in _LEADERLESS):
                    raise
                last = error
            else:
                return
        if time.monotonic() > deadline:
            raise UnreachableError(f"no orderer takes the change: {last}")
        await asyncio.sleep(10 * _POLL_S)


async def _settled(peer: PeerAdmin, channel: str, before: int) -> int:
    deadline = time.monotonic() + SETTLE_S
    while True:
        number = (await peer.channel_state(channel)).block_number
        if number > before:
            return number
        if time.monotonic() > deadline:
            raise UnreachableError(
                f"{peer.component}: has not seen the change after {SETTLE_S:g} s; see `wonderland network status`"
            )
        await asyncio.sleep(_POLL_S)


def _difference(old: Any, new: Any) -> tuple[Any, Any] | None:
    """Read set and write set of one group, or None when nothing in it differs."""
    read, write = configtx_pb2.ConfigGroup(version=old.version), configtx_pb2.ConfigGroup(version=old.version)
    # A group's own version changes with the names in it, not with what stands under them.
    renamed = old.mod_policy != new.mod_policy or any(
        set(getattr(old, kind)) != set(getattr(new, kind)) for kind in ("values", "policies", "groups")
    )
    for kind in ("values", "policies"):
        _elements(getattr(old, kind), getattr(new, kind), getattr(read, kind), getattr(write, kind), list_all=renamed)
    for name in sorted(new.groups):
        if name not in old.groups:
            write.groups[name].CopyFrom(new.groups[name])
            _start_over(write.groups[name])
            continue
        inner = _difference(old.groups[name], new.groups[name])
        if inner is not None:
            read.groups[name].CopyFrom(inner[0])
            write.groups[name].CopyFrom(inner[1])
        elif renamed:
            read.groups[name].version = old.groups[name].version
            write.groups[name].version = old.groups[name].version
    if renamed:
        write.version = old.version + 1
        write.mod_policy = new.mod_policy
    elif not (write.values or write.policies or write.groups):
        return None
    return read, write


def _elements(old: Any, new: Any, read: Any, write: Any, *, list_all: bool) -> None:
    for name in sorted(new):
        if name not in old:
            write[name].CopyFrom(new[name])
            write[name].version = 0
        elif _without_version(old[name]) != _without_version(new[name]):
            write[name].CopyFrom(new[name])
            write[name].version = old[name].version + 1
        elif list_all:
            read[name].version = old[name].version
            write[name].version = old[name].version


def _without_version(element: Any) -> Any:
    copy = type(element)()
    copy.CopyFrom(element)
    copy.version = 0
    return copy


def _start_over(group: Any) -> None:
    """Versions of something new begin at 0, all the way down."""
    group.version = 0
    for kind in ("values", "policies"):
        for element in getattr(group, kind).values():
            element.version = 0
    for inner in group.groups.values():
        _start_over(inner)

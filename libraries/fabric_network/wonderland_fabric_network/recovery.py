"""Servers that have lost their ledger: what they may do by themselves, and what they have to be given again."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING, Final

from wonderland_fabric_network import lifecycle
from wonderland_fabric_network.errors import ComponentError, NetworkError

if TYPE_CHECKING:
    from collections.abc import Callable

    from wonderland_fabric_network.agreement import Agreement
    from wonderland_fabric_network.contract import ContractPackage
    from wonderland_fabric_network.network import Member, Network
    from wonderland_fabric_network.peers import PeerAdmin

EQUAL_S: Final = 15.0
_POLL_S: Final = 0.2


async def require_others_agree(network: Network, member: Member, report: Callable[[str, str], None]) -> None:
    """Whether an orderer that has lost its ledger may join again with its old name. Raises `ComponentError`.

    What it has voted on is lost with it. Only when all others have the same blocks can no block be missing that was
    committed with its vote.
    """
    others = [each for each in network.orderers if each != member]
    data = network.node(member).data
    if not others:
        raise ComponentError(
            member.component,
            "it has lost its ledger, and it is the only orderer: nobody else can order what comes next",
            remedy=f"put {data} back from a backup",
        )
    deadline = time.monotonic() + EQUAL_S
    while True:
        heights = [await _height(network, each) for each in others]
        if 0 not in heights and len(set(heights)) == 1:
            break
        if time.monotonic() > deadline:
            told = ", ".join(f"{each.component} {height}" for each, height in zip(others, heights, strict=True))
            raise ComponentError(
                member.component,
                f"it has lost its ledger, and may join again only while all others have the same blocks ({told})",
                remedy=f"start the others and try again, or put {data} back from a backup",
            )
        await asyncio.sleep(_POLL_S)
    report("channel", f"{member.component} has lost its ledger; the others have {heights[0]} blocks for it")


async def has_contract(
    network: Network,
    peer: PeerAdmin,
    package: ContractPackage,
    agreement: Agreement,
    report: Callable[[str, str], None],
) -> bool:
    """Whether a peer has the package and its organisation's approval; a package that was lost is installed.

    The approval is private to the organisation: when its last peer has lost its ledger, nobody has it any more, and
    Fabric takes it again only with another sequence. Raises `NetworkError`.
    """
    if package.package_id in await peer.installed():
        return True
    name = network.description.contract.name
    report("contract", f"{peer.component} has lost {package.label}: installing it")
    await lifecycle.wait_definition(peer, network.channel, name, agreement.sequence)
    await lifecycle.install(peer, package)
    return await lifecycle.approved_package(peer, network.channel, name, agreement.sequence) == package.package_id


async def _height(network: Network, member: Member) -> int:
    """An orderer's blocks; 0 when it does not answer or does not take part."""
    try:
        async with network.orderer_admin(member) as admin:
            part = await admin.status(network.channel)
    except NetworkError:
        return 0
    return 0 if part is None else part.height

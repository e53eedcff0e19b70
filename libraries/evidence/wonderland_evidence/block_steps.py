"""Steps 1 to 5: the blocks. From the pinned first one, by chain and orderers' signatures, to the session's own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from wonderland_evidence.errors import StepError
from wonderland_evidence.places import one_process, within
from wonderland_evidence.trust import root_sha256
from wonderland_fabric_gateway.blocks import data_hash
from wonderland_fabric_gateway.verification.block_checks import last_config, orderers, require_orderers

if TYPE_CHECKING:
    from wonderland_evidence.case import Case
    from wonderland_evidence.trust import Pins

MAX_GAPS: Final = 20


def check_trust(case: Case, pins: Pins) -> str:
    """1: the channel is the pinned one, from its first block on; so are all organisations' root certificates."""
    genesis = case.genesis
    if genesis.header.hash != pins.genesis_hash:
        raise StepError(
            f"the first block is {genesis.header.hash.hex()[:16]}…, pinned is {pins.genesis_hash.hex()[:16]}…"
        )
    if not case.trusts or case.trusts[0].number != 0:
        raise StepError("the first block carries no configuration")
    first = case.trusts[0]
    for sequence, trust in enumerate(case.trusts):
        if trust.config.sequence != first.config.sequence + sequence:
            raise StepError(f"config block {trust.number} has sequence {trust.config.sequence}: one is left out")
        if trust.channel != pins.channel or case.bundle.channel != pins.channel:
            raise StepError(
                f"the channel is {trust.channel!r} in config block {trust.number} and {case.bundle.channel!r} in the "
                f"file, pinned is {pins.channel!r}"
            )
        for msp_id, organisation in trust.config.organisations.items():
            for pem in organisation.root_certs:
                if root_sha256(pem) not in pins.roots.get(msp_id, frozenset()):
                    raise StepError(f"config block {trust.number}: a root certificate of {msp_id} is not pinned")
    return f"channel {pins.channel}, {len(case.trusts)} configurations, {len(first.config.organisations)} organisations"


def check_chain(case: Case, pins: Pins) -> str:
    """2: blocks that follow one another are chained, and those of the session stand between their neighbours."""
    del pins
    links = 0
    for number, block in case.blocks.items():
        before = case.blocks.get(number - 1)
        if before is not None:
            if block.header.previous_hash != before.header.hash:
                raise StepError(f"block {number} does not follow block {number - 1}: its previous_hash is another one")
            links += 1
    newest = max(case.blocks)
    last = ""
    for place in case.session:
        if place.block - 1 not in case.blocks:
            raise StepError(f"block {place.block - 1}, the neighbour of the session's block {place.block}, is missing")
        if place.block + 1 not in case.blocks:
            if place.block != newest:
                raise StepError(f"block {place.block + 1}, the neighbour of the session's block, is missing")
            last = f"; the file ends with block {newest} of the session: nothing in it shows what came after"
    return f"{links} links between {len(case.blocks)} blocks{last}{_gaps(case)}"


def _gaps(case: Case) -> str:
    """Which blocks between the first and the last one are not in the file."""
    if not case.gaps:
        return ""
    shown = ", ".join(f"{first}" if first == last else f"{first} to {last}" for first, last in case.gaps[:MAX_GAPS])
    more = f" and {len(case.gaps) - MAX_GAPS} gaps more" if len(case.gaps) > MAX_GAPS else ""
    return f"; blocks not in the file: {shown}{more}"


def check_data(case: Case, pins: Pins) -> str:
    """3: a block's transactions are those that its header's hash is of."""
    del pins
    whole = 0
    for block in case.bundle.blocks:
        if block.data is None:
            continue
        whole += 1
        if data_hash(block.data) != block.header.data_hash:
            raise StepError(f"block {block.number}: its transactions are not those that its data_hash is of")
    return f"{whole} whole blocks"


def check_orderers(case: Case, pins: Pins) -> str:
    """4: every orderer's signature holds, by a certificate of the configuration in force; so does that one's number."""
    del pins
    count = 0
    for block in case.signed_blocks:
        trust = case.trust_before(block.number)
        with within(f"block {block.number}"):
            count += len(orderers(trust, block.block_signatures(), case.time_ms(block.number)))
            named = last_config(block.value)
        brings = any(each.number == block.number for each in case.trusts)
        if named != (block.number if brings else trust.number):
            raise StepError(
                f"block {block.number}: its orderers name config block {named}, in the file {trust.number} is in "
                "force: one is left out"
            )
    return f"{count} signatures"


def check_ordering_policy(case: Case, pins: Pins) -> str:
    """5: enough orderers signed: one on Raft, a quorum of ⌈(n + f + 1) / 2⌉ on BFT."""
    del pins
    said = ""
    for block in case.signed_blocks:
        trust = case.trust_before(block.number)
        with within(f"block {block.number}"):
            said = require_orderers(trust, orderers(trust, block.block_signatures(), case.time_ms(block.number)))
    return f"{case.trusts[-1].consensus}: {said}{one_process(case)}"

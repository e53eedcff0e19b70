"""Shapes of blocks, transactions and the status."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from wonderland_backend.schemas import ApiModel, page_of
from wonderland_backend.settings.outputs import Format


class Creator(ApiModel):
    """Who signed a transaction."""

    msp_id: str
    name: str = Field(description="Common name of the certificate")
    certificate_sha256: str


class LedgerTransaction(ApiModel):
    """A transaction of a block, valid or not."""

    tx_id: str
    block: int
    tx_index: int
    type: Literal["endorser", "config", "unsupported", "malformed"]
    valid: bool
    validation: str = Field(description="Fabric's name of the validation code, for example VALID")
    t_ms: int = Field(description="The sender's word")
    chaincode: str | None = None
    function: str | None = None
    creator: Creator | None = None
    endorsers: list[str] = Field(description="Organisations that endorsed")
    event: str | None = Field(default=None, description="Name of the event; only of valid transactions")


class LedgerTransactionDetail(LedgerTransaction):
    """A transaction with its event."""

    event_payload: str | None = Field(default=None, description="As the contract set it: canonical JSON")


class Value(ApiModel):
    """Bytes as people can read them: text where they are text, else base64url; cut where they are long."""

    bytes: int = Field(description="Length of the whole")
    text: str | None = None
    base64: str | None = None
    masked: bool | None = Field(default=None, description="Operators' numbers are shown in part: it is not the bytes")


class Signer(ApiModel):
    """A certificate that signed."""

    msp_id: str
    name: str
    certificate_sha256: str
    problem: str | None = None


class Endorser(Signer):
    """A peer that endorsed, with its signature."""

    signature: str = Field(description="DER, base64url")


class Ordered(ApiModel):
    """An orderer's signature on the block: by identity, or (BFT) by number of consenter."""

    msp_id: str | None = None
    name: str | None = None
    certificate_sha256: str | None = None
    consenter_id: int | None = None
    problem: str | None = None


class KeyRead(ApiModel):
    """A key that the contract read, and the transaction that had written it."""

    key: str
    block: int | None = Field(default=None, description="None: the key was not there")
    tx_index: int | None = None


class KeyWrite(ApiModel):
    """A key that the contract wrote or deleted."""

    key: str
    value: Value | None = None
    deleted: bool | None = None


class KeyRange(ApiModel):
    """A range of keys that the contract looked at."""

    start: str
    end: str


class Access(ApiModel):
    """What the contract read and wrote in one namespace."""

    namespace: str
    reads: list[KeyRead]
    writes: list[KeyWrite]
    range_queries: list[KeyRange]


class ContractResponse(ApiModel):
    """The contract's status and message."""

    status: int
    message: str


class ContractEvent(ApiModel):
    """The contract's event."""

    name: str
    payload: Value


class ConfigContents(ApiModel):
    """What a configuration transaction says."""

    sequence: int
    organisations: list[str]


class TransactionContents(ApiModel):
    """A transaction in full, as the ledger itself has it."""

    tx_id: str
    block: int
    tx_index: int
    envelope_bytes: int
    ordered_by: list[Ordered]
    problem: str | None = None
    chaincode: str | None = None
    chaincode_version: str | None = None
    arguments: list[Value] | None = Field(default=None, description="The function's name, then its arguments")
    response: ContractResponse | None = None
    result: Value | None = None
    endorsements: list[Endorser] | None = None
    proposal_sha256: str | None = None
    accesses: list[Access] | None = None
    event: ContractEvent | None = None
    config: ConfigContents | None = None


class LedgerBlock(ApiModel):
    """A block."""

    number: int
    header_hash: str
    previous_hash: str = Field(description="Empty for block 0")
    data_hash: str
    t_ms: int = Field(description="Latest time that one of its transactions names")
    transactions: int
    valid: int
    size_bytes: int


class LedgerBlockDetail(LedgerBlock):
    """A block with its transactions."""

    items: list[LedgerTransaction]


class LedgerStatus(ApiModel):
    """Which ledger this is, and how far its mirror has come."""

    kind: Literal["embedded", "fabric", "unknown"]
    notice: str = Field(description="To be shown wherever the ledger is; empty for none")
    channel: str
    height: int = Field(description="Number of blocks that the ledger is known to have")
    mirrored: int = Field(description="Number of blocks mirrored")
    lag_ms: int = Field(description="Since when the mirror has not been level with the ledger; 0 when it is")
    connected: bool
    halted: str | None = Field(description="Why the mirror stopped until somebody looks; null while it runs")
    halted_since_ms: int | None = None
    problem: str | None = Field(default=None, description="Why it is not connected just now")
    organisations: list[str] = Field(description="MSP ids of the channel's member organisations")
    alone_since_ms: int | None = Field(
        description="Since when no other organisation's peer confirms which transactions are valid; null while one does"
    )
    rows_checked_ms: int | None = Field(
        description="When all rows were last derived anew and compared; null before the first time"
    )
    rows_differ: list[str] = Field(description="Rows that were not what the ledger says, 20 at most")


class Outputs(ApiModel):
    """What goes out to other systems: which switches are on."""

    tak: bool = Field(description="Cursor-on-Target")
    mqtt: bool
    live_geojson: bool = Field(description="`GET /picture`")
    exports: list[Format] = Field(description="Formats of exports; empty: none can be made")


class ServerStatus(ApiModel):
    """What runs here, since which start, and what of it is switched on."""

    version: str
    epoch: str = Field(description="Changes with each start; see the live interface's resume")
    demo: bool
    outputs: Outputs | None = Field(default=None, description="Left out in live frames")
    stale_since_ms: int | None = Field(
        default=None, description="Since when this backend has heard nothing of the one on duty: the picture is as old"
    )


class Counts(ApiModel):
    """How much of each kind there is, and of the sessions how many came out how."""

    pads: int
    pads_connected: int
    drones: int
    tracks: int = Field(description="Drones heard within the last minute")
    sessions: int
    verdicts: int
    verified: int
    refuted: int
    inconclusive: int
    agents: int
    viewers: int


class Status(ApiModel):
    """The ledger, this server, and counts."""

    ledger: LedgerStatus
    server: ServerStatus
    counts: Counts | None = Field(default=None, description="Left out for those who see their own only")


class Alive(ApiModel):
    """Says that the server answers, and nothing else."""

    status: Literal["ok"]


BlockPage = page_of("BlockPage", LedgerBlock)

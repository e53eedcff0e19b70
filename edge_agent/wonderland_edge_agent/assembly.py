"""A pad's agent put together from its settings, every part opened and closed in order."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncIterator
from functools import partial
from typing import TYPE_CHECKING

from wonderland import telemetry
from wonderland.clock import SteadyClock
from wonderland.proof_contract import ProofContract
from wonderland_edge_agent.agent import PadAgent
from wonderland_edge_agent.drift.baseline import hear_each_other
from wonderland_edge_agent.drift.keeper import DriftKeeper
from wonderland_edge_agent.local_reports import LocalReports
from wonderland_edge_agent.permission import CommandPermission, LogPermission, Permissions
from wonderland_edge_agent.ports import AgentError, PadRadiosPort
from wonderland_edge_agent.radios import AnchorPort, PadRadios, RadiosError
from wonderland_edge_agent.radios.power import cycle_power
from wonderland_edge_agent.receiver import Finding, Heard, ReceiverError, RemoteIdReceiver
from wonderland_edge_agent.receiver.configured import sources_of
from wonderland_edge_agent.receiver.settings import NOT_TRUSTWORTHY, registry_of, trust
from wonderland_edge_agent.reporting import SpoolReporter
from wonderland_edge_agent.spool import Spool, SpoolError
from wonderland_fabric_gateway.checkpoints import FileCheckpointer
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_fabric_gateway.gateway import Gateway

if TYPE_CHECKING:
    from wonderland_edge_agent.references.live import LiveTruth
    from wonderland_edge_agent.session.timing import PadTiming
    from wonderland_edge_agent.settings import PadSettings, TruthSettings
    from wonderland_edge_agent.uplink import Uplink
    from wonderland_fabric_gateway.identity import Identity
    from wonderland_fabric_gateway.signing import Signer

_log = logging.getLogger(__name__)


@contextlib.asynccontextmanager
async def open_pad(settings: PadSettings, *, timing: PadTiming | None = None) -> AsyncIterator[PadAgent]:
    """The agent of these settings; ``run`` it inside. Raises AgentError with what is wrong and what to do."""
    async with contextlib.AsyncExitStack() as stack:
        try:
            yield await _open(settings, stack, timing)
        except (LedgerError, SpoolError, ReceiverError) as cause:
            raise AgentError(str(cause)) from cause


async def _open(settings: PadSettings, stack: contextlib.AsyncExitStack, timing: PadTiming | None) -> PadAgent:
    clock = SteadyClock()
    connection = Connection.load(settings.connection)
    identity, signer = connection.identity(settings.identity), connection.signer(settings.identity)
    if identity.pol_id != settings.pad_id or identity.role != "pad":
        raise AgentError(
            f"identity {settings.identity}: its certificate is for {identity.role or 'no role'} "
            f"{identity.pol_id or '(no id)'}, not for pad {settings.pad_id}; "
            f"enrol one for it (wonderland ledger ca enrol {settings.pad_id} --role pad)"
        )
    spool = await stack.enter_async_context(
        await Spool.open(settings.spool, owner=settings.pad_id, quota_bytes=settings.quota_bytes)
    )
    channel = await stack.enter_async_context(connection.open_channel())
    ledger = ProofContract(Gateway(channel, identity, signer).network(connection.channel), connection.chaincode)
    local = None if settings.local_reports is None else LocalReports(settings.local_reports)
    if local is not None:
        stack.callback(local.close)
    tracks = SpoolReporter(spool, local=local)
    for source in trust(settings.remote_id):
        if NOT_TRUSTWORTHY in source:
            _log.warning("%s", source)
    receiver = RemoteIdReceiver(
        listen=settings.remote_id.listen,
        serial_ports=settings.remote_id.serial,
        sources=sources_of(settings.remote_id),
        drip=registry_of(settings.remote_id),
        on_heard=lambda heard: _tell(tracks, heard),
        on_finding=lambda finding: _tell_finding(tracks, finding),
        clock_ms=clock,
    )
    await receiver.start()
    stack.push_async_callback(receiver.close)
    uplink = _uplink(settings, connection, identity, signer, spool)
    if uplink is not None:
        await uplink.start()
        stack.push_async_callback(uplink.close)
    radios = await _radios(settings, stack, clock)
    drift = None
    if settings.drift.every_s and isinstance(radios, PadRadios):
        drift = DriftKeeper(radios, settings.baseline_file, clock, settings.drift.every_s)
    command = [CommandPermission(settings.permission_command)] if settings.permission_command else []
    return PadAgent(
        settings.pad_id,
        ledger=ledger,
        identity=identity,
        radios=radios,
        receiver=receiver,
        spool=spool,
        permission=Permissions(LogPermission(), *command),
        checkpointer=FileCheckpointer(settings.checkpoint_file),
        clock=clock,
        prekeys=settings.prekeys,
        timing=timing,
        whole_certificate=settings.whole_certificate,
        status_file=settings.status_file,
        drift=drift,
        metrics_file=settings.metrics_file,
        roll_call_every_s=settings.drift.roll_call_every_s if settings.anchors else 0,
        hear_each_other=partial(hear_each_other, settings.baseline_file),
        region=settings.uwb.region if isinstance(radios, PadRadios) else None,
        local=local,
        truth=await _truth(settings.truth, stack, clock),
    )


async def _truth(settings: TruthSettings, stack: contextlib.AsyncExitStack, clock: SteadyClock) -> LiveTruth | None:
    """The reference, followed beside everything else; None where there is none."""
    if settings.reference is None:
        return None
    # For trials: other pads need not carry what commissioning has.
    from wonderland_edge_agent.references.live import LiveTruth, follow  # noqa: PLC0415
    from wonderland_edge_agent.references.sources import parse_source  # noqa: PLC0415

    source = parse_source(settings.reference)
    assert source is not None  # by the settings' own check
    try:
        truth = LiveTruth(settings.delay_ms, settings.record, settings.uav_id)
    except OSError as cause:
        raise AgentError(f"truth.record: {settings.record} cannot be written ({cause.strerror or cause})") from cause
    stack.callback(truth.close)
    stack.push_async_callback(_ended, asyncio.create_task(follow(source, truth, clock)))
    return truth


async def _radios(settings: PadSettings, stack: contextlib.AsyncExitStack, clock: SteadyClock) -> PadRadiosPort:
    if settings.uwb.listen is None:
        ports = [AnchorPort.of(anchor) for anchor in settings.anchors]
        own = await stack.enter_async_context(PadRadios(ports, clock, region=settings.uwb.region))
        commands = {anchor.anchor_id: anchor.power_cycle for anchor in settings.anchors if anchor.power_cycle}
        if commands:
            cycling = asyncio.create_task(cycle_power(own.states, commands, clock))
            stack.push_async_callback(_ended, cycling)
        return own
    # Few pads are of this kind; the others need not carry the driver.
    from wonderland_edge_agent.radios.reported import ReportedRadios, TagRadios  # noqa: PLC0415

    ports = [AnchorPort.of(anchor) for anchor in settings.anchors]
    radios = TagRadios(ports, settings.uwb.listen, clock) if ports else ReportedRadios(settings.uwb.listen, clock)
    try:
        return await stack.enter_async_context(radios)
    except RadiosError as cause:
        raise AgentError(str(cause)) from cause


async def _ended(task: asyncio.Task[None]) -> None:
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await task


def _tell(tracks: SpoolReporter, heard: Heard) -> None:
    tracks.offer(heard.t_ms, heard.track)


def _tell_finding(tracks: SpoolReporter, finding: Finding) -> None:
    tracks.offer(finding.t_ms, finding.body)


def _uplink(
    settings: PadSettings, connection: Connection, identity: Identity, signer: Signer, spool: Spool
) -> Uplink | None:
    to = settings.backend
    if not to.url:
        return None
    # A pad without a backend need not carry a WebSocket client's memory.
    from wonderland_edge_agent.uplink import Uplink, UplinkError, way_to  # noqa: PLC0415

    client = connection.client_files(settings.identity)
    try:
        way = way_to(to.url, ca=to.tls_ca, client=client, allow_plaintext=to.plaintext)
        return Uplink(way, telemetry.Credentials.of("pad", settings.pad_id, identity, signer), spool)
    except UplinkError as cause:
        raise AgentError(f"backend: {cause}") from cause

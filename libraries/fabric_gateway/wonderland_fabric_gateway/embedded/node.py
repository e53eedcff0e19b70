"""The embedded ledger as one thing that is started and stopped: directory, chain, server, connection.json."""

from __future__ import annotations

import asyncio
import datetime as dt
import os
import socket
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Self

from wonderland_fabric_gateway.addresses import bracketed, split_address
from wonderland_fabric_gateway.ca import CaRequestError, Kind
from wonderland_fabric_gateway.ca.application import is_address
from wonderland_fabric_gateway.connection import Connection, GatewayAddress, LedgerKind
from wonderland_fabric_gateway.embedded import NOTICE
from wonderland_fabric_gateway.embedded import organisations as orgs
from wonderland_fabric_gateway.embedded.chain import Chain, ChainSettings, initialise
from wonderland_fabric_gateway.embedded.contracts import check_contract
from wonderland_fabric_gateway.embedded.directory import LedgerDirectory
from wonderland_fabric_gateway.embedded.errors import DirectoryError
from wonderland_fabric_gateway.embedded.genesis import ChannelDescription, OrganisationDescription, genesis_block
from wonderland_fabric_gateway.embedded.orderer import BatchLimits
from wonderland_fabric_gateway.embedded.seal import KEY_BYTES
from wonderland_fabric_gateway.embedded.server import LedgerServer
from wonderland_fabric_gateway.embedded.system import KIND
from wonderland_fabric_gateway.embedded.watchdog import DEFAULT_LIMIT_S
from wonderland_fabric_gateway.revocation import check_revocation_list

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from wonderland_fabric_gateway.blocks import BlockHeader
    from wonderland_fabric_gateway.ca import CertificateRequest, LocalCa
    from wonderland_fabric_gateway.embedded.contracts import Contract

LOCAL_HOSTS: Final = ("localhost", "127.0.0.1", "::1")
_WILDCARDS: Final = frozenset({"0.0.0.0", "::"})  # noqa: S104 - compared with, not bound to
_NONCE_BYTES: Final = 24


@dataclass(frozen=True)
class LedgerSettings:
    """How a ledger runs. `advertise` is the host that other machines reach it by; `clock` is an aware UTC time."""

    listen: str = "127.0.0.1:0"
    channel: str = orgs.DEFAULT_CHANNEL
    chaincode: str = orgs.DEFAULT_CHAINCODE
    advertise: str = ""
    pad_operators: tuple[str, ...] = ()
    """MSP ids of operators of pads besides `PadMSP`; only a ledger's first start can give it them."""
    limits: BatchLimits = field(default_factory=BatchLimits)
    execute_limit_s: float = DEFAULT_LIMIT_S
    """How long a contract may take for one transaction."""
    clock: Callable[[], dt.datetime] = lambda: dt.datetime.now(dt.UTC)
    random: Callable[[int], bytes] = os.urandom


class EmbeddedLedger:
    """One ledger. ``async with EmbeddedLedger(path, contracts, settings) as ledger`` serves while inside."""

    def __init__(
        self, directory: Path, contracts: Mapping[str, Contract], settings: LedgerSettings | None = None
    ) -> None:
        """`contracts` goes by chaincode name. Raises `ContractLoadError` for what is no contract."""
        self.settings: Final = settings or LedgerSettings()
        self.directory: Final = LedgerDirectory(directory, self.settings.clock)
        self._contracts = {name: check_contract(name, contract) for name, contract in contracts.items()}
        self._stack = AsyncExitStack()
        self._chain: Chain | None = None
        self._connection: Connection | None = None
        self._cas: dict[str, LocalCa] = {}

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.stop()

    @property
    def chain(self) -> Chain:
        """The chain. Raises `DirectoryError` while the ledger does not run."""
        if self._chain is None:
            raise DirectoryError("the ledger is not running")
        return self._chain

    @property
    def connection(self) -> Connection:
        """What is in connection.json."""
        if self._connection is None:
            raise DirectoryError("the ledger is not running")
        return self._connection

    async def start(self) -> Connection:
        """Prepare the directory, open the chain, serve, write connection.json.

        Raises `LedgerError` with what was wrong; then nothing runs.
        """
        settings = self.settings
        host, _ = split_address(settings.listen)
        async with AsyncExitStack() as stack:
            self.directory.prepare()
            stack.enter_context(self.directory.lock())
            self._cas = self.directory.ensure_cas(settings.pad_operators)
            node = self.directory.ensure_node(self._cas)
            reachable = settings.advertise or ("127.0.0.1" if host in _WILDCARDS else host)
            hosts = [*LOCAL_HOSTS, reachable]
            if host in _WILDCARDS:
                hosts.append(socket.gethostname())
            tls = self.directory.ensure_tls(self._cas[orgs.AUTHORITY], hosts)
            began = initialise(self.directory.database, self._genesis)
            kept = self.directory.seal_key()
            seal_key = kept or settings.random(KEY_BYTES)
            chain = Chain(
                self.directory.database,
                ChainSettings(
                    channel=settings.channel,
                    signers=node.signers,
                    limits=settings.limits,
                    clock=self._clock_ms,
                    random=settings.random,
                    seal_key=seal_key,
                    adopt=began or not kept,
                ),
            )
            self._chain = await stack.enter_async_context(chain)
            if not kept:
                self.directory.keep_seal_key(seal_key)
            await self.refresh_revocations()
            server = LedgerServer(
                chain,
                self._contracts,
                node.peers,
                tls,
                self.refresh_revocations,
                settings.execute_limit_s,
                self.enrol_invited,
            )
            address = await server.start(settings.listen)
            stack.push_async_callback(server.stop)
            # Streams and waiting calls end when the chain says so; only then can the server stop at once.
            stack.push_async_callback(chain.close)
            _, port = split_address(address)
            # A TLS server name is a name (RFC 6066): for addresses the certificate's "localhost" stands.
            name = "localhost" if is_address(reachable) else reachable
            self._connection = self._write_connection(f"{bracketed(reachable)}:{port}", name)
            self._stack = stack.pop_all()
        return self._connection

    async def stop(self) -> None:
        """Commit what was taken, end all streams, release the directory."""
        await self._stack.aclose()
        self._chain = None

    async def refresh_revocations(self) -> int | None:
        """Put the CAs' revocations onto the channel, if it does not have them; the config block's number or None."""
        lists: dict[str, list[bytes]] = {}
        for trust in self.chain.membership.organisations:
            ca = self._cas.get(trust.msp_id)
            if ca is None:
                continue
            revoked = {int(each.serial, 16) for each in ca.certificates(kind=Kind.IDENTITY) if each.revoked_ms}
            known = {
                entry.serial_number
                for pem in trust.revocation_lists
                for entry in check_revocation_list(pem, trust.root_certs)
            }
            if revoked - known:
                lists[trust.msp_id] = [ca.revocation_list_pem()]
        return await self.chain.set_revocation_lists(lists) if lists else None

    async def enrol_invited(self, msp_id: str, request: CertificateRequest, secret: str) -> bytes:
        """A certificate (PEM) for a name that an organisation's CA invited. Raises `CaError`."""
        if msp_id not in self._cas:
            raise CaRequestError(f"{msp_id[:80]!r} is no organisation of this ledger")
        # The register is written durably: the ledger goes on meanwhile.
        enrolment = await asyncio.to_thread(self.directory.invitations(msp_id).enrol, request, secret)
        return enrolment.certificate_pem

    def _genesis(self) -> tuple[BlockHeader, bytes]:
        settings = self.settings

        def organisation(msp_id: str, endpoints: tuple[str, ...] = ()) -> OrganisationDescription:
            ca = self._cas[msp_id]
            return OrganisationDescription(msp_id, ca.root_pem(), ca.root_pem(Kind.TLS), endpoints)

        description = ChannelDescription(
            channel=settings.channel,
            applications=tuple(organisation(msp_id) for msp_id in (*orgs.APPLICATIONS, *self.directory.pad_operators)),
            orderer=organisation(orgs.ORDERER, (settings.listen,)),
            endorsing=orgs.endorsing(self.directory.pad_operators),
            batch_ms=settings.limits.time_ms,
            batch_count=settings.limits.count,
        )
        return genesis_block(description, self._clock_ms() // 1000, settings.random(_NONCE_BYTES))

    def _write_connection(self, address: str, server_name: str) -> Connection:
        gateway = GatewayAddress(address, self.directory.tls_root, server_name)
        kind = LedgerKind(KIND, NOTICE)

        def change(current: Connection | None) -> Connection:
            identities = self.directory.ensure_roles(self._cas) if current is None else current.identities
            return Connection(self.settings.channel, self.settings.chaincode, gateway, identities, kind)

        return self.directory.update_connection(change)

    def _clock_ms(self) -> int:
        return int(self.settings.clock().timestamp() * 1000)

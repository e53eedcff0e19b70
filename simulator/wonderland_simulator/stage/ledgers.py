"""The ledgers that a stage can stand on: the embedded one, a real Hyperledger Fabric network, one that runs already."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.embedded.administration import DirectoryAdministration
from wonderland_fabric_gateway.embedded.directory import LedgerDirectory
from wonderland_fabric_gateway.errors import LedgerError
from wonderland_simulator.scenario import DroneSpec, PadSite
from wonderland_simulator.stage.processes import ProcessError, Processes


class StageLedger(Protocol):
    """A ledger for one run."""

    @property
    def authorities(self) -> Path | None:
        """Directory with its certificate authorities, where it is the stage's own."""
        ...

    async def start(self, pads: Sequence[PadSite], drones: Sequence[DroneSpec]) -> Path:
        """Bring it up, enrol pads and drones; returns the path of connection.json. Raises ProcessError."""
        ...

    async def stop(self) -> None:
        """End the ledger's processes; what was written stays."""


class RunningStageLedger:
    """A ledger that somebody else runs; pads and drones were enrolled before."""

    authorities: Path | None = None

    def __init__(self, connection: Path) -> None:
        self._connection = connection

    async def start(self, pads: Sequence[PadSite], drones: Sequence[DroneSpec]) -> Path:
        """See ``StageLedger``."""
        try:
            known = Connection.load(self._connection)
            for name in (*(pad.pad_id for pad in pads), *(drone.uav_id for drone in drones)):
                known.files(name)
        except LedgerError as error:
            raise ProcessError(f"{error}. `wonderland world enrol` makes the identities") from error
        return self._connection

    async def stop(self) -> None:
        """Nothing: it is not ours."""


class EmbeddedStageLedger:
    """One process of this project; it ends with the stage's processes."""

    def __init__(self, directory: Path, processes: Processes) -> None:
        self._directory = self.authorities = directory
        self._processes = processes

    async def start(self, pads: Sequence[PadSite], drones: Sequence[DroneSpec]) -> Path:
        """See ``StageLedger``."""
        arguments = ["ledger", "start", "--data", str(self._directory), "--listen", "127.0.0.1:0", "--json"]
        await self._processes.start("ledger", *arguments)
        administration = DirectoryAdministration(LedgerDirectory(self._directory))
        for pad in pads:
            administration.enrol(pad.pad_id, role="pad", pol_id=pad.pad_id, msp_id=None, days=30)
        for drone in drones:
            administration.enrol(drone.uav_id, role="uav", pol_id=drone.uav_id, msp_id=None, days=30)
        return self._directory / "connection.json"

    async def stop(self) -> None:
        """Nothing: the process is the stage's."""


class FabricStageLedger:
    """Fabric's own servers from FABRIC_BIN or PATH, brought up from nothing by ``wonderland_fabric_network``."""

    def __init__(self, directory: Path, say: Callable[[str], None]) -> None:
        self._directory = self.authorities = directory
        self._say = say
        self._up = False

    async def start(self, pads: Sequence[PadSite], drones: Sequence[DroneSpec]) -> Path:
        """See ``StageLedger``."""
        from wonderland_fabric_network import binaries, bringing_up, enrolment  # noqa: PLC0415 - an extra of its own
        from wonderland_fabric_network.layout import NetworkDirectory  # noqa: PLC0415

        places = NetworkDirectory(self._directory)
        requests = [enrolment.Request(pad.pad_id, "pad", pad.pad_id) for pad in pads]
        requests += [enrolment.Request(drone.uav_id, "uav", drone.uav_id) for drone in drones]
        try:
            found = await binaries.check_binaries()
            places.prepare()
            self._up = True
            with places.lock():
                network = bringing_up.new_network(places, None)
                await bringing_up.bring_up(network, found, lambda _, text: self._say(text.capitalize()))
                await enrolment.enrol(network, requests)
        except LedgerError as error:
            raise ProcessError(f"The Fabric network did not come up: {error}") from error
        return places.connection_file

    async def stop(self) -> None:
        """Take the network down."""
        if not self._up:
            return
        from wonderland_fabric_network import bringing_up, taking_down  # noqa: PLC0415
        from wonderland_fabric_network.layout import NetworkDirectory  # noqa: PLC0415

        places = NetworkDirectory(self._directory)
        with places.lock():
            await taking_down.take_down(bringing_up.open_network(places), lambda *_: None)

"""The same signing flow on real Fabric: enrolled by Fabric CA, endorsed by two organisations, ordered by Raft."""

from __future__ import annotations

import asyncio
import hashlib
import json
import subprocess
import sys
from pathlib import Path

import pytest
from kit.openings import fresh
from kit.registry_house import House, request_pem
from playwright.sync_api import expect

from wonderland_backend.transactions.registrar import registrar_of
from wonderland_fabric_gateway.connection import Connection
from wonderland_fabric_gateway.gateway import GatewayError
from wonderland_fabric_network import binaries, bringing_up, enrolment, taking_down
from wonderland_fabric_network.errors import BinaryError
from wonderland_fabric_network.layout import NetworkDirectory

pytestmark = [pytest.mark.fabric, pytest.mark.timeout(300)]
DRONE = "OH-DRN-0417"
WONDERLAND = Path(sys.executable).with_name("wonderland")


class FabricHouse(House):
    """A backend on a network of Fabric's own servers."""

    network = None

    async def _start_ledger(self):
        places = NetworkDirectory(self.directory / "network")
        places.prepare()
        self.network = bringing_up.new_network(places, None)
        self.stack.push_async_callback(taking_down.take_down, self.network, lambda *_: None)
        await bringing_up.bring_up(self.network, await binaries.check_binaries(), lambda *_: None)
        self.connection = Connection.load(places.connection_file)
        self.channel = await self.stack.enter_async_context(self.connection.open_channel())

    def registrar(self):
        return registrar_of(self.directory / "network", embedded=False)

    def run(self, coroutine, timeout_s=200):
        return super().run(coroutine, timeout_s)


@pytest.fixture(scope="module")
def fabric_house(tmp_path_factory, built_console):
    try:
        binaries.find_binaries()
    except BinaryError as error:
        pytest.skip(f"Fabric's servers are needed: {error}")
    house = FabricHouse(tmp_path_factory.mktemp("fabric"), console=built_console, demo=True)
    try:
        house.start()
        drone = {"uav_id": DRONE, "operator_id": "arctic-air", "model": "Falcon 4"}
        house.send("fleet_operator", "RegisterUav", drone)
        yield house
    finally:
        house.close()


def test_enrolled_by_fabric_ca_and_signed_to_a_valid_block(fabric_house):
    house = fabric_house
    anna = house.person("Anna", "admin")
    place = anna.get("/signing-keys").json()
    assert {"AuthorityMSP", "PadMSP", "FleetMSP"} <= set(place["organisations"])
    invited = house.run(enrolment.invite(house.network, enrolment.Request("anna", "inspector", "anna")))
    body = {"msp_id": invited.msp_id, "request": request_pem("anna", anna.key), "secret": "a guess"}
    assert anna.post("/signing-keys/enrol", body).status_code == 403
    answer = anna.post("/signing-keys/enrol", body | {"secret": invited.secret})
    assert answer.status_code == 201, answer.text
    assert (answer.json()["role"], answer.json()["msp_id"]) == ("inspector", "AuthorityMSP")
    anna.certificate_sha256 = answer.json()["certificate_sha256"]
    assert anna.post("/signing-keys/enrol", body | {"secret": invited.secret}).status_code == 403
    change = {"uav_id": DRONE, "status": "suspended", "reason": "Flew where it did not say"}
    house.run(asyncio.sleep(1))
    seen = anna.get(f"/registry/drones/{DRONE}").json()["drone"]["version"]
    done = anna.change("SetUavStatus", change, seen)
    assert (done["state"], done["validation"], done["endorsers"]) == ("valid", "VALID", ["AuthorityMSP", "PadMSP"])
    again = anna.change("SetUavStatus", change | {"reason": "on what is no longer there"}, seen)
    assert (again["state"], again["problem"]["kind"]) == ("refused", "changed")


def test_the_demos_click_works_here_too_and_roles_hold(fabric_house):
    visitor = fabric_house.person("Visitor", "admin")
    answer = visitor.post("/signing-keys/demo", {"role": "fleet_operator", "request": request_pem("v1", visitor.key)})
    assert answer.status_code == 201, answer.text
    visitor.certificate_sha256 = answer.json()["certificate_sha256"]
    lifted = visitor.change("SetUavStatus", {"uav_id": DRONE, "status": "active", "reason": "please"})
    assert (lifted["state"], lifted["problem"]["code"]) == ("refused", "OPERATOR_MAY_ONLY_RETIRE")


def test_a_registered_drones_number_is_here_and_no_peer_has_it(fabric_house):
    """By two organisations' peers, in the order of a real orderer; also after all blocks were read anew."""
    house = fabric_house
    frida = house.person("Frida", "admin")
    answer = frida.post("/signing-keys/demo", {"role": "fleet_operator", "request": request_pem("f1", frida.key)})
    frida.certificate_sha256 = answer.json()["certificate_sha256"]
    opening = fresh("OH-NUMBER-1", "SWE01abcdefghij2")
    argument = {
        "uav_id": opening.uav_id,
        "operator_id": "arctic-air",
        "model": "Falcon 4",
        "registration_commitment": opening.commitment,
    }
    in_clear = {name: value for name, value in argument.items() if name != "registration_commitment"}
    with pytest.raises(GatewayError, match="registration_commitment") as caught:
        house.send("fleet_operator", "RegisterUav", in_clear | {"registration": opening.registration})
    assert opening.registration not in str(caught.value)
    done = frida.change("RegisterUav", argument, opening=opening)
    assert (done["state"], done["endorsers"]) == ("valid", ["AuthorityMSP", "PadMSP"])
    house.run(asyncio.sleep(1))
    wanted = {"uav_id": opening.uav_id, "field": "registration", "reason": "Collision at Aurajoki"}
    assert frida.post("/unmask", wanted).json()["value"] == opening.registration
    on_disk = b"".join(path.read_bytes() for path in (house.directory / "network").rglob("*") if path.is_file())
    assert opening.commitment.encode() in on_disk
    for secret in (opening.registration.encode(), opening.salt.encode(), bytes.fromhex(opening.salt)):
        assert secret not in on_disk, "blocks, states and logs of peers, orderers and contract servers"


def test_the_browser_signs_what_fabrics_peers_made(fabric_house, open_page):
    """The bytes that real peers and a real gateway give are those that the console's check knows."""
    page = open_page(fabric_house.link(), room="registry")
    expect(page.get_by_role("link", name="Registry")).to_be_visible()
    page.evaluate("location.hash = '#/registry/key'")
    page.get_by_role("button", name="Use the demo’s administrator key").click()
    expect(page.get_by_text("in use")).to_be_visible()
    page.evaluate(f"location.hash = '#/registry/drones/{DRONE}/grant'")
    page.get_by_label("Identifier").fill("summer")
    page.get_by_role("button", name="Check and sign").click()
    page.get_by_role("button", name="Sign and send").click()
    expect(page.get_by_text("It is on the ledger, signed by you.")).to_be_visible()
    expect(page.get_by_text("Endorsed by AuthorityMSP, PadMSP")).to_be_visible()


def test_the_registry_without_a_browser_reads_and_changes_the_same(fabric_house, tmp_path):
    """`wonderland registry` over the Gateway of an organisation's peer, from the network's own connection.json."""
    connection = NetworkDirectory(fabric_house.directory / "network").connection_file
    drones = tmp_path / "drones.csv"
    drones.write_text("uav_id,model,operator_id,registration\n" + "".join(f"CLI-{n},Owl,op-7,\n" for n in range(20)))

    def registry(identity, *arguments):
        options = ("--connection", connection, "--identity", identity)
        command = [WONDERLAND, "registry", *arguments, *options]
        done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        return done

    assert "20 done" in registry("fleet_operator", "drones", "import", drones).stderr
    assert "20 there already" in registry("fleet_operator", "drones", "import", drones).stderr
    listed = json.loads(registry("pad_operator", "drones", "list", "--format", "json").stdout)
    assert {f"CLI-{n}" for n in range(20)} | {DRONE} <= {row["uav_id"] for row in listed}
    registry("admin", "drones", "suspend", "CLI-3", "--reason", "lost")
    assert json.loads(registry("pad_operator", "drones", "show", "CLI-3").stdout)["status"] == "suspended"


def test_what_was_begun_on_the_embedded_ledger_goes_on_here(fabric_house, tmp_path):
    """`wonderland registry move`, by Fabric's peers: whose it was, his it stays."""
    former, shared = tmp_path / "former", fabric_house.directory / "network" / "connection.json"

    def wonderland(*arguments):
        done = subprocess.run(
            [WONDERLAND, "registry", *arguments], capture_output=True, text=True, timeout=60, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout + done.stderr

    command = [WONDERLAND, "ledger", "start", "--data", former, "--listen", "127.0.0.1:0", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as ledger:
        try:
            ledger.stdout.readline()
            drone = (
                "--uav-id",
                "MOVED-1",
                "--model",
                "Owl",
                "--operator-id",
                "air",
                "--openings",
                tmp_path / "openings",
            )
            there = ("--connection", former / "connection.json", "--identity", "fleet_operator")
            wonderland("drones", "add", *drone, "--registration", "FIN87astrdge12k8", *there)
            to = ("move", "--from", former / "connection.json", "--connection", shared, "--identity")
            assert "left for admin or fleet_operator of FleetMSP: 1" in wonderland(*to, "admin")
            assert "1 done" in wonderland(*to, "fleet_operator")
            assert "1 there already" in wonderland(*to, "fleet_operator")
        finally:
            ledger.terminate()
    here = ("--connection", shared, "--identity", "mirror")
    moved = json.loads(wonderland("drones", "show", "MOVED-1", *here))
    opening = tmp_path / "openings" / "MOVED-1.json"
    assert moved["registration_commitment"] == hashlib.sha256(opening.read_bytes()).hexdigest()
    assert moved["msp_id"] == "FleetMSP"

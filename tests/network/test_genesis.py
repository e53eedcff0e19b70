"""The channel's first block, beside what configtxgen makes of the same description."""

import os
import shutil
import subprocess

import pytest
import yaml
from fabric_protos.common import common_pb2, configtx_pb2, configuration_pb2, policies_pb2
from fabric_protos.msp import identities_pb2
from fabric_protos.orderer import configuration_pb2 as orderer_pb2
from fabric_protos.orderer.etcdraft import configuration_pb2 as raft_pb2
from fabric_protos.orderer.smartbft import configuration_pb2 as bft_pb2

from wonderland_fabric_gateway.blocks import parse_block
from wonderland_fabric_gateway.ca import Kind, LocalCa
from wonderland_fabric_gateway.channel_groups import OrganisationDescription
from wonderland_fabric_network import settings
from wonderland_fabric_network.description import NetworkDescription
from wonderland_fabric_network.genesis import ChannelPlan, Consenter, bft_options, first_block

APPLICATIONS = ("AuthorityMSP", "PadMSP", "FleetMSP")


@pytest.fixture
def plan(tmp_path):
    """A plan, with the MSP directories that configtxgen reads."""

    def make(consensus, orderers):
        described = NetworkDescription().with_ordering(consensus, orderers)
        cas = {name: LocalCa.create(tmp_path / "ca" / name, name) for name in (*APPLICATIONS, "OrdererMSP")}
        consenters = []
        for number in range(1, orderers + 1):
            host = f"orderer{number}.example.org"
            tls = cas["OrdererMSP"].enrol(f"o{number}", node_ou="orderer", kind=Kind.TLS, hosts=(host,))
            identity = cas["OrdererMSP"].enrol(f"o{number}", node_ou="orderer")
            consenters.append(
                Consenter(number, "OrdererMSP", host, 7050, tls.certificate_pem, identity.certificate_pem)
            )
        for name, ca in cas.items():
            msp = tmp_path / "msp" / name
            for part, data in (
                ("cacerts/ca.pem", ca.root_pem(Kind.IDENTITY)),
                ("tlscacerts/tls.pem", ca.root_pem(Kind.TLS)),
                ("config.yaml", yaml.safe_dump(settings.NODE_OUS).encode()),
            ):
                (msp / part).parent.mkdir(parents=True, exist_ok=True)
                (msp / part).write_bytes(data)

        def organisation(name, **more):
            return OrganisationDescription(
                name, cas[name].root_pem(Kind.IDENTITY), cas[name].root_pem(Kind.TLS), **more
            )

        return ChannelPlan(
            channel="wonderland",
            applications=tuple(
                organisation(name, anchor_peers=((f"peer0.{name.lower()}.example.org", 7051),)) for name in APPLICATIONS
            ),
            orderers=(organisation("OrdererMSP", endpoints=tuple(each.address for each in consenters)),),
            consenters=tuple(consenters),
            ordering=described.ordering,
        )

    return make


def _group(block):
    envelope = common_pb2.Envelope.FromString(common_pb2.Block.FromString(block).data.data[0])
    payload = common_pb2.Payload.FromString(envelope.payload)
    return configtx_pb2.ConfigEnvelope.FromString(payload.data).config.channel_group


def test_the_block_is_one_that_our_own_reader_takes(plan):
    block = parse_block(first_block(plan("raft", 3), 1_700_000_000, bytes(24)))
    assert block.number == 0
    assert sorted(block.config.organisations) == sorted((*APPLICATIONS, "OrdererMSP"))
    assert block.config.organisations["PadMSP"].node_ous["peer"] == "peer"


def test_equal_plans_give_equal_blocks(plan):
    one = plan("bft", 4)
    assert first_block(one, 1, bytes(24)) == first_block(one, 1, bytes(24))
    assert first_block(one, 1, bytes(24)) != first_block(one, 2, bytes(24))


def test_raft_elects_within_a_second(plan):
    orderer = _group(first_block(plan("raft", 3), 1, bytes(24))).groups["Orderer"]
    consensus = orderer_pb2.ConsensusType.FromString(orderer.values["ConsensusType"].value)
    metadata = raft_pb2.ConfigMetadata.FromString(consensus.metadata)
    assert consensus.type == "etcdraft"
    assert len(metadata.consenters) == 3
    assert (metadata.options.tick_interval, metadata.options.election_tick) == ("100ms", 10)


@pytest.mark.parametrize(("orderers", "quorum"), [(4, 3), (5, 4), (6, 4), (7, 5), (10, 7)])
def test_a_bft_block_needs_a_quorum_of_these_very_orderers(plan, orderers, quorum):
    one = plan("bft", orderers)
    group = _group(first_block(one, 1, bytes(24))).groups["Orderer"]
    envelope = policies_pb2.SignaturePolicyEnvelope.FromString(group.policies["BlockValidation"].policy.value)
    assert envelope.rule.n_out_of.n == quorum
    assert len(envelope.rule.n_out_of.rules) == orderers
    named = [identities_pb2.SerializedIdentity.FromString(each.principal) for each in envelope.identities]
    assert [each.id_bytes for each in named] == [each.identity for each in one.consenters]
    mapping = configuration_pb2.Orderers.FromString(group.values["Orderers"].value).consenter_mapping
    assert [each.id for each in mapping] == list(range(1, orderers + 1))


def test_the_times_of_bft_are_those_that_bear_a_dead_leader(description):
    options = bft_options(description.with_ordering("bft").ordering)
    assert options.request_complain_timeout == "2s"
    assert options.leader_heartbeat_timeout == "3s"
    assert options.request_batch_max_interval == "20ms"
    assert options.request_max_bytes <= options.request_batch_max_bytes
    assert options.leader_rotation != bft_pb2.Options.ROTATION_ON
    assert options.decisions_per_leader == 0


# --- beside configtxgen


def _configtx(plan, msp):
    rwa = {
        "Readers": {"Type": "ImplicitMeta", "Rule": "ANY Readers"},
        "Writers": {"Type": "ImplicitMeta", "Rule": "ANY Writers"},
        "Admins": {"Type": "ImplicitMeta", "Rule": "MAJORITY Admins"},
    }

    def organisation(name, *, orderer):
        policies = {kind: {"Type": "Signature", "Rule": f"OR('{name}.member')"} for kind in ("Readers", "Writers")}
        policies["Admins"] = {"Type": "Signature", "Rule": f"OR('{name}.admin')"}
        made = {"Name": name, "ID": name, "MSPDir": str(msp / name), "Policies": policies}
        if orderer:
            made["OrdererEndpoints"] = [each.address for each in plan.consenters]
        else:
            policies["Endorsement"] = {"Type": "Signature", "Rule": f"OR('{name}.peer')"}
            made["AnchorPeers"] = [{"Host": f"peer0.{name.lower()}.example.org", "Port": 7051}]
        return made

    orderer = {
        "BatchTimeout": f"{plan.ordering.batch_timeout_ms}ms",
        "BatchSize": {"MaxMessageCount": 500, "AbsoluteMaxBytes": "10 MB", "PreferredMaxBytes": "2 MB"},
        "Organizations": [organisation("OrdererMSP", orderer=True)],
        "Policies": {**rwa, "BlockValidation": {"Type": "ImplicitMeta", "Rule": "ANY Writers"}},
        "Capabilities": {"V2_0": True},
    }
    files = msp.parent / "consenters"
    files.mkdir()
    for each in plan.consenters:
        (files / f"tls{each.number}.pem").write_bytes(each.tls_certificate)
        (files / f"id{each.number}.pem").write_bytes(each.identity)
    if plan.ordering.consensus == "raft":
        orderer["OrdererType"] = "etcdraft"
        orderer["EtcdRaft"] = {
            "Consenters": [
                {
                    "Host": each.host,
                    "Port": each.port,
                    "ClientTLSCert": str(files / f"tls{each.number}.pem"),
                    "ServerTLSCert": str(files / f"tls{each.number}.pem"),
                }
                for each in plan.consenters
            ],
            "Options": {
                "TickInterval": "100ms",
                "ElectionTick": 10,
                "HeartbeatTick": 1,
                "MaxInflightBlocks": 5,
                "SnapshotIntervalSize": "16 MB",
            },
        }
    else:
        options = bft_options(plan.ordering)
        orderer["OrdererType"] = "BFT"
        orderer["SmartBFT"] = {
            "".join(part.capitalize() for part in field.name.split("_")): getattr(options, field.name)
            for field in options.DESCRIPTOR.fields
            if field.name not in {"leader_rotation", "decisions_per_leader"}
        }
        orderer["ConsenterMapping"] = [
            {
                "ID": each.number,
                "Host": each.host,
                "Port": each.port,
                "MSPID": each.msp_id,
                "Identity": str(files / f"id{each.number}.pem"),
                "ClientTLSCert": str(files / f"tls{each.number}.pem"),
                "ServerTLSCert": str(files / f"tls{each.number}.pem"),
            }
            for each in plan.consenters
        ]
    endorsement = {
        name: {"Type": "ImplicitMeta", "Rule": "MAJORITY Endorsement"}
        for name in ("Endorsement", "LifecycleEndorsement")
    }
    application = {
        "Organizations": [organisation(name, orderer=False) for name in APPLICATIONS],
        "Policies": {**rwa, **endorsement},
        "Capabilities": {"V2_5": True},
    }
    profile = {"Policies": rwa, "Capabilities": {"V3_0": True}, "Orderer": orderer, "Application": application}
    return yaml.safe_dump({"Profiles": {"Ours": profile}})


@pytest.mark.fabric
@pytest.mark.parametrize(("consensus", "orderers"), [("raft", 1), ("raft", 3), ("bft", 4)])
def test_configtxgen_makes_the_same_content(plan, tmp_path, consensus, orderers):
    directory = os.environ.get("FABRIC_BIN", "")
    configtxgen = shutil.which("configtxgen", path=os.pathsep.join([directory, os.environ["PATH"]]))
    if configtxgen is None:
        pytest.skip("configtxgen is needed for the comparison: neither in FABRIC_BIN nor on PATH")
    one = plan(consensus, orderers)
    (tmp_path / "configtx.yaml").write_text(_configtx(one, tmp_path / "msp"))
    out = tmp_path / "theirs.block"
    command = [configtxgen, "-profile", "Ours", "-channelID", "wonderland", "-outputBlock", out]
    done = subprocess.run(
        command,
        env={"FABRIC_CFG_PATH": str(tmp_path), "PATH": os.environ["PATH"], "HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    theirs, ours = _unpacked(_group(out.read_bytes())), _unpacked(_group(first_block(one, 1, bytes(24))))
    for section in ("Orderer", "Application"):
        for kind in ("values", "policies", "groups"):
            assert theirs["groups"][section][kind] == ours["groups"][section][kind]
    assert theirs == ours


def _unpacked(group):
    """A group with what its values and policies carry, decoded where bytes may be written in more than one way."""
    values = {}
    for name, value in group.values.items():
        content = value.value
        if name == "ConsensusType":
            consensus = orderer_pb2.ConsensusType.FromString(content)
            kind = raft_pb2.ConfigMetadata if consensus.type == "etcdraft" else bft_pb2.Options
            content = (consensus.type, str(kind.FromString(consensus.metadata)))
        elif name == "Capabilities":
            content = sorted(configuration_pb2.Capabilities.FromString(content).capabilities)
        values[name] = (content, value.version, value.mod_policy)
    policies = {
        name: (policy.policy.type, policy.policy.value, policy.version, policy.mod_policy)
        for name, policy in group.policies.items()
    }
    inner = {name: _unpacked(each) for name, each in group.groups.items()}
    return {"values": values, "policies": policies, "groups": inner, "version": group.version, "mod": group.mod_policy}

"""Changes of a channel's configuration, against the rules by which Fabric applies them."""

import pytest
from fabric_protos.common import common_pb2, configtx_pb2
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland_fabric_gateway.ca import LocalCa
from wonderland_fabric_gateway.channel_groups import serialise
from wonderland_fabric_gateway.identity import SigningIdentity
from wonderland_fabric_gateway.signing import key_file_signer, verify
from wonderland_fabric_network.config_update import compute_update, enveloped, signature_over


def group(version=0, mod="Admins", values=None, policies=None, groups=None):
    made = configtx_pb2.ConfigGroup(version=version, mod_policy=mod)
    for name, (number, data) in (values or {}).items():
        made.values[name].CopyFrom(configtx_pb2.ConfigValue(version=number, value=data, mod_policy="Admins"))
    for name, (number, data) in (policies or {}).items():
        made.policies[name].version = number
        made.policies[name].policy.value = data
        made.policies[name].mod_policy = "Admins"
    for name, inner in (groups or {}).items():
        made.groups[name].CopyFrom(inner)
    return made


class FabricRules:
    """What a channel does with an update (``common/configtx/update.go``), told by the specification, element by element."""

    def __init__(self, old):
        self.old = dict(self._flat("", old))

    def apply(self, update):
        read, write = (dict(self._flat("", each)) for each in (update.read_set, update.write_set))
        for path, (version, *_) in read.items():
            assert self.old[path][0] == version, f"read set: {path}"
        changed = {path: element for path, element in write.items() if self._is_change(path, element)}
        assert changed, "an update that changes nothing"
        for path, (version, *_) in changed.items():
            expected = self.old[path][0] + 1 if path in self.old else 0
            assert version == expected, f"{path} to version {version}, expected {expected}"
        # The proposed configuration holds exactly what the write set reaches; a group that the write set does not
        # renew keeps its members.
        result = dict(self.old)
        for path, (version, kind, content) in changed.items():
            if kind == "group" and path in self.old:
                for other in list(result):
                    if other != path and self._parent(other) == path and other not in write:
                        for below in [each for each in result if each == other or each.startswith(f"{other}/")]:
                            del result[below]
            result[path] = (version, kind, content)
        return result

    def _is_change(self, path, element):
        return path not in self.old or element[0] != self.old[path][0]

    @staticmethod
    def _parent(path):
        return path.rsplit("/", 1)[0]

    def _flat(self, path, one):
        yield path, (one.version, "group", one.mod_policy)
        for name, value in one.values.items():
            yield f"{path}/v:{name}", (value.version, "value", (value.value, value.mod_policy))
        for name, policy in one.policies.items():
            yield f"{path}/p:{name}", (policy.version, "policy", (policy.policy.value, policy.mod_policy))
        for name, inner in one.groups.items():
            yield from self._flat(f"{path}/g:{name}", inner)


def content(flat):
    return {path: element[1:] for path, element in flat.items()}


def test_equal_configurations_need_no_update():
    one = group(3, values={"a": (2, b"x")}, groups={"g": group(1)})
    assert compute_update("c", one, one) is None


def test_a_changed_value_reads_the_groups_above_it_and_writes_only_itself():
    old = group(3, groups={"Orderer": group(1, values={"BatchTimeout": (4, b"1s"), "Other": (0, b"y")})})
    new = group(3, groups={"Orderer": group(1, values={"BatchTimeout": (4, b"2s"), "Other": (0, b"y")})})
    update = compute_update("c", old, new)
    assert update.channel_id == "c"
    assert update.read_set.version == 3
    assert update.read_set.groups["Orderer"].version == 1
    assert not update.read_set.groups["Orderer"].values
    written = update.write_set.groups["Orderer"]
    assert (written.version, list(written.values)) == (1, ["BatchTimeout"])
    assert (written.values["BatchTimeout"].version, written.values["BatchTimeout"].value) == (5, b"2s")


def test_a_new_organisation_renews_the_group_that_names_it():
    old = group(groups={"Application": group(7, groups={"A": group(2)}, policies={"Admins": (1, b"p")})})
    new = configtx_pb2.ConfigGroup()
    new.CopyFrom(old)
    new.groups["Application"].groups["B"].CopyFrom(group(9, values={"MSP": (9, b"m")}))
    update = compute_update("c", old, new)
    written = update.write_set.groups["Application"]
    assert (written.version, written.mod_policy) == (8, "Admins")
    assert (written.groups["A"].version, written.policies["Admins"].version) == (2, 1)
    assert (written.groups["B"].version, written.groups["B"].values["MSP"].version) == (0, 0)


_elements = st.dictionaries(st.sampled_from("abc"), st.tuples(st.just(0), st.binary(max_size=1)), max_size=3)
_groups = st.recursive(
    st.builds(group, mod=st.sampled_from(["Admins", "Other"]), values=_elements, policies=_elements),
    lambda inner: st.builds(
        group,
        mod=st.sampled_from(["Admins", "Other"]),
        values=_elements,
        policies=_elements,
        groups=st.dictionaries(st.sampled_from("xy"), inner, max_size=2),
    ),
    max_leaves=5,
)


@settings(deadline=None, max_examples=150)
@given(_groups, _groups, st.integers(0, 5))
def test_applying_the_update_gives_the_new_content(old, new, version):
    def number(one):
        one.version = version
        for each in (*one.values.values(), *one.policies.values()):
            each.version = version
        for inner in one.groups.values():
            number(inner)

    number(old)
    update = compute_update("c", old, new)
    rules = FabricRules(old)
    wanted = content(dict(rules._flat("", new)))
    if update is None:
        assert content(rules.old) == wanted
        return
    assert content(rules.apply(update)) == wanted


@pytest.fixture
def administrators(tmp_path):
    made = []
    for msp_id in ("AuthorityMSP", "PadMSP"):
        ca = LocalCa.create(tmp_path / msp_id, msp_id)
        enrolment = ca.enrol("msp-admin", node_ou="admin")
        enrolment.write(tmp_path, msp_id)
        made.append(SigningIdentity(enrolment.identity, key_file_signer(tmp_path / f"{msp_id}.key")))
    return made


def test_each_signer_signs_header_and_update(administrators):
    update = compute_update("c", group(), group(values={"a": (0, b"x")}))
    signatures = [signature_over(serialise(update), each, bytes) for each in administrators]
    data = enveloped(
        "c",
        serialise(update),
        signatures,
        administrators[0],
        now_ns=1_500_000_000_000_000_123,
        random_bytes=bytes,
    )
    envelope = common_pb2.Envelope.FromString(data)
    payload = common_pb2.Payload.FromString(envelope.payload)
    header = common_pb2.ChannelHeader.FromString(payload.header.channel_header)
    assert (header.type, header.channel_id) == (common_pb2.CONFIG_UPDATE, "c")
    assert (header.timestamp.seconds, header.timestamp.nanos) == (1_500_000_000, 123)
    verify(administrators[0].identity.public_key, envelope.payload, envelope.signature)
    inner = configtx_pb2.ConfigUpdateEnvelope.FromString(payload.data)
    assert configtx_pb2.ConfigUpdate.FromString(inner.config_update) == update
    assert len(inner.signatures) == 2
    for signature, signer in zip(inner.signatures, administrators, strict=True):
        verify(signer.identity.public_key, signature.signature_header + inner.config_update, signature.signature)
        assert common_pb2.SignatureHeader.FromString(signature.signature_header).creator == signer.creator

"""Read versions and phantoms: the validation against a naive model, and the read-write set's encoding."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland_fabric_gateway.embedded.committer import Candidate, validate_block
from wonderland_fabric_gateway.embedded.errors import MalformedRequestError
from wonderland_fabric_gateway.embedded.rwset import (
    KeyPolicy,
    RangeRead,
    Read,
    ReadWriteSet,
    Write,
    encode,
    from_accesses,
)
from wonderland_fabric_gateway.embedded.state import CommittedTx, StateReader, StateWriter, create
from wonderland_fabric_gateway.signature_policies import PEER, Signer, key_policy, one_of_each
from wonderland_fabric_gateway.transactions import NamespaceAccess, RangeQuery, ValidationCode, parse_accesses

NS = "pol"
BOTH = (Signer("AuthorityMSP"), Signer("PadMSP"))
OTHER = (Signer("AuthorityMSP"), Signer("Pad2MSP"))
POLICY = one_of_each(PEER, ["AuthorityMSP"], ["PadMSP", "Pad2MSP"])
KEYS = st.sampled_from(["a", "b", "c", "d", "é"])
VERSIONS = st.tuples(st.integers(0, 2**63 - 1), st.integers(0, 2**31))
TEXT = st.text(min_size=1, max_size=8).filter(lambda text: text.isprintable() or "\0" in text)


@pytest.fixture
def store(tmp_path):
    path = tmp_path / "store.sqlite3"
    create(path)
    writer, reader = StateWriter(path), StateReader(path)
    yield writer, reader
    reader.close()
    writer.close()


def candidate(tx_id, *, reads=(), ranges=(), writes=(), policies=(), code=0, signers=BOTH):
    rwset = ReadWriteSet(tuple(reads), tuple(ranges), tuple(writes), tuple(policies))
    return Candidate(tx_id, b"envelope", b"creator", 0, code, 0, rwset, signers)


def put(key, value=b"1"):
    return Write(NS, key, value)


def guarded(key, *msp_ids):
    return KeyPolicy(NS, key, key_policy(msp_ids or ("AuthorityMSP", "PadMSP")))


def commit(writer, number, *candidates):
    """Validate and store a block; the names of the codes."""
    results = validate_block(writer, number, candidates, POLICY)
    writer.stage_block(number, number.to_bytes(32, "big"), b"raw", results)
    writer.commit(number)
    return [ValidationCode(each.code).name for each in results]


def test_a_read_of_another_version_conflicts(store):
    writer, _ = store
    assert commit(writer, 1, candidate("t1", writes=[Write(NS, "k", b"1")])) == ["VALID"]
    assert commit(
        writer,
        2,
        candidate("t2", reads=[Read(NS, "k", (1, 0))], writes=[Write(NS, "k", b"2")]),
        candidate("t3", reads=[Read(NS, "k", (1, 0))], writes=[Write(NS, "k", b"3")]),
        candidate("t4", reads=[Read(NS, "k", None)]),
        candidate("t5", reads=[Read("other", "k", None)]),
    ) == ["VALID", "MVCC_READ_CONFLICT", "MVCC_READ_CONFLICT", "VALID"]
    assert commit(writer, 3, candidate("t6", reads=[Read(NS, "k", (2, 0))])) == ["VALID"]


def test_a_conflicting_transaction_writes_nothing_and_blocks_nobody(store):
    writer, reader = store
    assert commit(
        writer,
        1,
        candidate("t1", reads=[Read(NS, "k", (9, 9))], writes=[Write(NS, "k", b"bad")]),
        candidate("t2", reads=[Read(NS, "k", None)], writes=[Write(NS, "k", b"good")]),
    ) == ["MVCC_READ_CONFLICT", "VALID"]
    assert reader.get(NS, "k") == (b"good", (1, 1))
    assert [each.value for each in reader.history(NS, "k")] == [b"good"]


def test_deleting_in_the_same_block_conflicts_too(store):
    writer, _ = store
    commit(writer, 1, candidate("t1", writes=[Write(NS, "k", b"1")]))
    assert commit(
        writer,
        2,
        candidate("t2", writes=[Write(NS, "k", None)]),
        candidate("t3", reads=[Read(NS, "k", None)]),
    ) == ["VALID", "MVCC_READ_CONFLICT"]


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (Write(NS, "c", b"new"), "PHANTOM_READ_CONFLICT"),
        (Write(NS, "b", None), "PHANTOM_READ_CONFLICT"),
        (Write(NS, "b", b"changed"), "PHANTOM_READ_CONFLICT"),
        (Write(NS, "d", b"outside"), "VALID"),
        (Write(NS, "A", b"outside"), "VALID"),
        (Write("other", "c", b"elsewhere"), "VALID"),
    ],
)
@pytest.mark.parametrize("same_block", [True, False])
def test_phantoms(store, change, code, same_block):
    writer, _ = store
    commit(writer, 1, candidate("t1", writes=[Write(NS, "a", b"1"), Write(NS, "b", b"1")]))
    changer = candidate("t2", writes=[change])
    ranger = candidate("t3", ranges=[RangeRead(NS, "a", "d", True, (("a", (1, 0)), ("b", (1, 0))))])
    if same_block:
        assert commit(writer, 2, changer, ranger)[1] == code
    else:
        commit(writer, 2, changer)
        assert commit(writer, 3, ranger) == [code]


@pytest.mark.parametrize(
    ("key", "code"), [("a0", "PHANTOM_READ_CONFLICT"), ("b", "PHANTOM_READ_CONFLICT"), ("b0", "VALID")]
)
def test_a_range_left_early_relies_only_on_what_it_saw(store, key, code):
    writer, _ = store
    commit(writer, 1, candidate("t1", writes=[Write(NS, each, b"1") for each in ("a", "b", "c")]))
    early = RangeRead(NS, "a", "b", False, (("a", (1, 0)), ("b", (1, 0))))
    assert commit(writer, 2, candidate("t2", writes=[Write(NS, key, b"x")]), candidate("t3", ranges=[early]))[1] == code


def test_repeated_ids_in_one_block_and_over_blocks(store):
    writer, reader = store
    assert commit(
        writer,
        1,
        candidate("t1", writes=[Write(NS, "k", b"1")]),
        candidate("t1", writes=[Write(NS, "k", b"2")]),
        candidate("t2", code=ValidationCode.ENDORSEMENT_POLICY_FAILURE, writes=[Write(NS, "k", b"forged")]),
    ) == ["VALID", "DUPLICATE_TXID", "ENDORSEMENT_POLICY_FAILURE"]
    assert commit(writer, 2, candidate("t1"), candidate("t2")) == ["DUPLICATE_TXID", "DUPLICATE_TXID"]
    assert reader.get(NS, "k") == (b"1", (1, 0))
    assert (reader.transaction("t1").block, reader.transaction("t1").position) == (1, 0)


@pytest.mark.parametrize("count", [50, 51, 52, 102, 103, 2601, 2652, 2653])
def test_a_long_range_is_checked_by_its_summary(store, count):
    """As it comes back from a client: with a list up to fifty keys, beyond with the top of a Merkle tree."""
    writer, reader = store
    assert commit(writer, 1, candidate("t1", writes=[put(f"k{index:05}") for index in range(count)])) == ["VALID"]
    seen = tuple((key, version) for key, _, version in reader.range(NS, "k", "l"))
    (back,) = from_accesses(parse_accesses(encode(ReadWriteSet((), (RangeRead(NS, "k", "l", True, seen),)), NS))).ranges
    assert (back.summary is None) == (count <= 50)
    assert commit(writer, 2, candidate("t2", ranges=[back])) == ["VALID"]
    changed = candidate("t3", writes=[put("k00025", b"2")])
    assert commit(writer, 3, changed, candidate("t4", ranges=[back]))[1] == "PHANTOM_READ_CONFLICT"
    assert commit(writer, 4, candidate("t5", ranges=[back])) == ["PHANTOM_READ_CONFLICT"]


FAILS = "ENDORSEMENT_POLICY_FAILURE"


def test_the_contracts_policy_holds_for_keys_without_one_of_their_own(store):
    writer, _ = store
    alone, none = (Signer("AuthorityMSP"),), ()
    assert commit(
        writer,
        1,
        candidate("t1", writes=[put("k")]),
        candidate("t2", writes=[put("k")], signers=OTHER),
        candidate("t3", writes=[put("k")], signers=alone),
        candidate("t4", signers=alone),  # also one that writes nothing
        candidate("t5", signers=none),
        candidate("t6", signers=(Signer("AuthorityMSP", "CLIENT"), Signer("PadMSP"))),
    ) == ["VALID", "VALID", FAILS, FAILS, FAILS, FAILS]


def test_a_keys_own_policy_takes_the_contracts_place(store):
    writer, reader = store
    first = candidate("t1", writes=[put("k"), put("free")], policies=[guarded("k")], signers=OTHER)
    assert commit(writer, 1, first) == ["VALID"]  # the first value is under the contract's policy
    assert writer.policy(NS, "k") == key_policy(["PadMSP", "AuthorityMSP"])
    assert writer.policy(NS, "free") is None
    assert commit(
        writer,
        2,
        candidate("t2", writes=[put("k", b"2")], signers=OTHER),
        candidate("t3", writes=[put("free", b"2")], signers=OTHER),
        candidate("t4", writes=[put("free", b"3"), put("k", b"3")], signers=OTHER),
        candidate("t5", writes=[put("k", None)], signers=OTHER),
        candidate("t6", writes=[put("k")], policies=[guarded("k", "Pad2MSP")], signers=OTHER),
        candidate("t7", reads=[Read(NS, "k", (1, 0))], signers=OTHER),  # reading needs nobody's leave
        candidate("t8", writes=[put("k", b"8")]),
    ) == [FAILS, "VALID", FAILS, FAILS, FAILS, "VALID", "VALID"]
    assert reader.get(NS, "k") == (b"8", (2, 6))
    assert commit(writer, 3, candidate("t9", writes=[put("k", b"9")], signers=OTHER)) == [FAILS]  # it is kept
    assert commit(writer, 4, candidate("t10", writes=[put("k", None)])) == ["VALID"]
    assert writer.policy(NS, "k") is None
    assert commit(writer, 5, candidate("t11", writes=[put("k")], signers=OTHER)) == ["VALID"]  # gone with its key


def test_a_policy_that_is_set_in_the_same_block_invalidates_later_writes(store):
    """Fabric cannot know yet whether the first is valid in the end, and lets the later one fail."""
    writer, _ = store
    assert commit(
        writer,
        1,
        candidate("t1", writes=[put("k")], policies=[guarded("k")]),
        candidate("t2", writes=[put("k")]),
        candidate("t3", writes=[put("other")]),
    ) == ["VALID", FAILS, "VALID"]
    assert commit(
        writer,
        2,
        candidate("t4", reads=[Read(NS, "k", None)], writes=[put("n")], policies=[guarded("n")]),
        candidate("t5", writes=[put("n")]),
        candidate("t6", writes=[put("m")], policies=[guarded("m")], signers=(Signer("PadMSP"),)),
        candidate("t7", writes=[put("m")]),
    ) == ["MVCC_READ_CONFLICT", FAILS, FAILS, "VALID"]


def test_a_policy_that_nobody_can_read_is_met_by_nobody(store):
    writer, _ = store
    commit(writer, 1, candidate("t1", writes=[put("k")], policies=[KeyPolicy(NS, "k", b"\xff\xff")]))
    assert commit(writer, 2, candidate("t2", writes=[put("k")])) == [FAILS]


OPERATIONS = st.lists(
    st.tuples(st.sampled_from(["read", "range", "early", "write", "delete"]), KEYS, st.sampled_from(["", "c", "é"])),
    max_size=4,
)


@given(blocks=st.lists(st.lists(OPERATIONS, min_size=1, max_size=5), min_size=1, max_size=6))
@settings(max_examples=80, deadline=None)
def test_valid_transactions_are_serialisable(tmp_path_factory, blocks):
    """Whatever is VALID reads, at its place in the order, exactly what it read when it was simulated.

    The model is a dictionary that runs the valid transactions one after another.
    """
    path = tmp_path_factory.mktemp("model") / "s.sqlite3"
    create(path)
    writer, reader = StateWriter(path), StateReader(path)
    model = {}
    try:
        for number, transactions in enumerate(blocks, start=1):
            candidates, seen = [], []
            for position, operations in enumerate(transactions):
                rwset, saw = simulate(reader, operations, f"{number}.{position}".encode())
                candidates.append(replace(candidate(f"{number}.{position}"), rwset=rwset))
                seen.append(saw)
            codes = commit(writer, number, *candidates)
            for code, saw, each in zip(codes, seen, candidates, strict=True):
                again = [look(model, *question) for question, _ in saw]
                if code == "VALID":
                    assert again == [answer for _, answer in saw]
                    for write in each.rwset.writes:
                        model.pop(write.key, None)
                        if write.value is not None:
                            model[write.key] = write.value
                else:
                    assert code in {"MVCC_READ_CONFLICT", "PHANTOM_READ_CONFLICT"}
            assert {key: value for key, value, _ in reader.range(NS, "", "")} == model
    finally:
        reader.close()
        writer.close()


def simulate(reader, operations, value):
    """A read-write set as the stub records it, and what was asked and seen."""
    reads, ranges, writes, saw = {}, [], {}, []
    for kind, key, end in operations:
        if kind == "read":
            found = reader.get(NS, key)
            reads[key] = found[1] if found else None
            saw.append((("read", key, ""), found[0] if found else None))
        elif kind in {"range", "early"}:
            rows = list(reader.range(NS, key, end))
            shown = rows if kind == "range" else rows[:1]
            if kind == "early" and not rows:
                continue
            last = end if kind == "range" else shown[-1][0]
            ranges.append(RangeRead(NS, key, last, kind == "range", tuple((k, v) for k, _, v in shown)))
            saw.append(((kind, key, end), [(k, val) for k, val, _ in shown]))
        else:
            writes[key] = value if kind == "write" else None
    return (
        ReadWriteSet(
            tuple(Read(NS, k, v) for k, v in reads.items()),
            tuple(ranges),
            tuple(Write(NS, k, v) for k, v in writes.items()),
        ),
        saw,
    )


def look(model, kind, key, end):
    if kind == "read":
        return model.get(key)
    rows = sorted(
        ((k, v) for k, v in model.items() if k.encode() >= key.encode() and (not end or k.encode() < end.encode())),
        key=lambda row: row[0].encode(),
    )
    return rows if kind == "range" else rows[:1]


@given(
    reads=st.dictionaries(TEXT, st.none() | VERSIONS, max_size=5),
    writes=st.dictionaries(TEXT, st.none() | st.binary(max_size=20), max_size=5),
    ranges=st.lists(st.tuples(TEXT, TEXT, st.booleans(), st.lists(st.tuples(TEXT, VERSIONS), max_size=4)), max_size=3),
    policies=st.dictionaries(TEXT, st.binary(max_size=20), max_size=3),
)
@settings(max_examples=100, deadline=None)
def test_encoding_and_parsing_give_the_same_set(reads, writes, ranges, policies):
    rwset = ReadWriteSet(
        tuple(Read(NS, key, reads[key]) for key in sorted(reads, key=str.encode)),
        tuple(RangeRead(NS, start, end, done, tuple(rows)) for start, end, done, rows in ranges),
        tuple(Write(NS, key, writes[key]) for key in sorted(writes, key=str.encode)),
        tuple(KeyPolicy(NS, key, policies[key]) for key in sorted(policies, key=str.encode)),
    )
    assert from_accesses(parse_accesses(encode(rwset, NS))) == rwset


def test_a_range_without_versions_is_refused():
    from wonderland_fabric_gateway.transactions import Read as ParsedRead

    unversioned = NamespaceAccess(NS, (), (RangeQuery("a", "b", True, (ParsedRead("a", None),)),), ())
    with pytest.raises(MalformedRequestError, match="without its version"):
        from_accesses([unversioned])


def test_committed_transactions_without_an_id_are_not_indexed(store):
    writer, reader = store
    writer.stage_block(0, b"h", b"raw", [CommittedTx("", 2, 0, ())])
    writer.commit(0)
    assert reader.transaction("") is None

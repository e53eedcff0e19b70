from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wonderland.proofs.records.sessions import NO_RANGE, AnchorRanges, RangeTable
from wonderland.proofs.rounds import RoundsError, pack, unpack, usable

TABLES = st.integers(0, 60).flatmap(
    lambda n: st.builds(
        lambda start, gaps, columns: RangeTable(
            t_ms=tuple(start + sum(gaps[: i + 1]) for i in range(n)),
            anchors=tuple(AnchorRanges(anchor_id=f"A{i}", range_mm=tuple(column)) for i, column in enumerate(columns)),
        ),
        st.integers(10**12, 2 * 10**12),
        st.lists(st.integers(0, 60_000), min_size=n, max_size=n),
        st.lists(
            st.lists(st.sampled_from([NO_RANGE, 10, 5_000, 655_340]), min_size=n, max_size=n), min_size=4, max_size=4
        ),
    )
)


@given(TABLES)
@settings(deadline=None)
def test_compact_form_round_trip(table):
    ids = ["A0", "A1", "A2", "A3"]
    unpacked = unpack(pack(table), ids)
    assert unpacked == table
    assert len(pack(table)) == 8 + 10 * len(table.t_ms)


@given(st.binary(max_size=100))
def test_any_bytes_give_a_table_or_a_typed_error(data):
    try:
        unpack(data, ["A0", "A1"])
    except RoundsError:
        return


def test_what_the_compact_form_cannot_hold_is_refused():
    with pytest.raises(RoundsError, match="no whole centimetre"):
        pack(RangeTable(t_ms=(1,), anchors=(AnchorRanges(anchor_id="A", range_mm=(5,)),)))
    with pytest.raises(RoundsError, match="ms after"):
        pack(RangeTable(t_ms=(5, 1), anchors=()))


def test_rounds_are_usable_with_three_plausible_unobstructed_anchors():
    table = RangeTable(
        t_ms=(3, 1, 2, 4),
        anchors=(
            AnchorRanges(anchor_id="A", range_mm=(10, 11, 12, 13), nlos=(2,)),
            AnchorRanges(anchor_id="B", range_mm=(20, 21, 22, NO_RANGE)),
            AnchorRanges(anchor_id="C", range_mm=(30, 31, 32, 33)),
            AnchorRanges(anchor_id="stranger", range_mm=(1, 1, 1, 1)),
        ),
    )
    rounds = usable(table, ["C", "B", "A"], 1_000)
    assert rounds.t_ms == (1, 3)
    assert rounds.range_mm == ((31, 30), (21, 20), (11, 10))
    assert (rounds.discarded, rounds.obstructed) == (2, 1)
    assert usable(table, ["A", "B", "C"], 25).t_ms == ()

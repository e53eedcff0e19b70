"""What the backend makes of records is what it made of them when pydantic read them (golden_batches.json)."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest
from msgspec import Raw

from wonderland_backend.agents.connected import Agent
from wonderland_backend.ingest.batch import Batch, read

T0 = 1_760_000_400_000
CASES = json.loads((Path(__file__).parent / "golden_batches.json").read_text())


def shown(batch: Batch) -> dict[str, Any]:
    """A batch in plain values; bodies, which are JSON texts, by what they say."""
    named = {each.name: getattr(batch, each.name) for each in dataclasses.fields(batch)}
    for name in ("agent", "tell", "heard", "networked"):
        del named[name]
    named["rejected"] = [[seq, code] for seq, code, _ in batch.rejected]
    named["irregular"] = [{name: value for name, value in row.items() if name != "message"} for row in batch.irregular]
    plain = json.loads(json.dumps(named))
    rows = [row for value in plain.values() if isinstance(value, list) for row in value if isinstance(row, dict)]
    for row in [*rows, plain["health"] or {}]:
        if "body" in row:
            row["body"] = json.loads(row["body"]) if row["body"] else None
    plain["records"] = len(batch.tell)
    plain["heard"] = [[t_ms, each.uav_id, each.operator_id, each.operator_lat_e7] for t_ms, each in batch.heard]
    plain["networked"] = [
        [t_ms, each.uav_id, each.transport, each.height_accuracy_mm] for t_ms, each in batch.networked
    ]
    return plain


@pytest.mark.parametrize("name", CASES)
def test_the_backend_makes_the_same_of_records_as_before(name: str) -> None:
    case = CASES[name]
    agent = Agent(case["kind"], case["id"], "0" * 32)
    records = [Raw(json.dumps(each)) for each in case["records"]]
    assert shown(read(agent, records, acknowledged=0, now_ms=T0)) == case["batch"]

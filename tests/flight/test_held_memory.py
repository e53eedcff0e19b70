"""What the drone's agent remembers of its hold, after its computer went out at once."""

from __future__ import annotations

from wonderland_uav_agent.flight.memory import HeldMemory

NOW = 1_760_000_400_000


def test_a_hold_is_known_after_an_outage_and_so_is_its_end(outage):
    path = outage.directory / "flight.json"
    HeldMemory(path).note("pad-1", NOW)
    outage.strike()
    outage.back()
    memory = HeldMemory(path)
    assert memory.held_at(NOW + 1_000) == "pad-1"
    memory.note("pad-2", NOW + 2_000)
    outage.strike()
    outage.back()
    memory = HeldMemory(path)
    assert memory.held_at(NOW + 3_000) == "pad-2"
    memory.note(None, NOW + 4_000)
    outage.strike()
    outage.back()
    assert HeldMemory(path).held_at(NOW + 5_000) is None

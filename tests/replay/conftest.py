"""A client of the live interface that keeps what it is told."""

from __future__ import annotations

import asyncio
import json

import pytest

KEYS = {
    "pads": "pad_id",
    "tracks": "uav_id",
    "estimates": "uav_id",
    "sessions": "session_id",
    "verdicts": "session_id",
    "alerts": "alert_id",
}


class Shown:
    """What a client shows after some frames of the live interface, as the console's store does."""

    def __init__(self):
        self.items = {kind: {} for kind in KEYS}
        self.t_ms = 0

    def take(self, frame):
        self.t_ms = frame.get("t_ms", self.t_ms)
        for kind, key in KEYS.items():
            for item in frame.get(kind, []):
                self.items[kind][item[key]] = item
        alerts = self.items["alerts"]
        for alert_id in [each for each in alerts if alerts[each]["state"] not in {"open", "returned"}]:
            del alerts[alert_id]
        for session in frame.get("sessions", []):
            known = self.items["estimates"].get(session["uav_id"])
            if session["state"] != "requested" and known and known["session_id"] == session["session_id"]:
                del self.items["estimates"][session["uav_id"]]

    def text(self):
        return shown_text(self.items)


def shown_text(items):
    """Everything that is shown, as one text to compare byte by byte; but for queues, which the past does not show."""
    without = {key: {name: each[name] for name in each if name != "queue"} for key, each in items["pads"].items()}
    return json.dumps({kind: items[kind] for kind in KEYS} | {"pads": without}, sort_keys=True, indent=1)


def state_text(state):
    """The same of a state, or snapshot."""
    items = {}
    for kind, key in KEYS.items():
        items[kind] = {item[key]: item for item in state.get(kind, [])}
        assert len(items[kind]) == len(state.get(kind, [])), f"{kind}: one of each"
    return shown_text(items)


class Recorder:
    """A live connection whose frames are kept."""

    def __init__(self, socket):
        self.socket = socket
        self.shown = Shown()
        self.frames = []

    async def settle(self, quiet_s=0.25):
        """Take in frames until none has come for so long (ticks come every 20 ms)."""
        while True:
            try:
                frame = json.loads(await asyncio.wait_for(self.socket.recv(), quiet_s))
            except TimeoutError:
                return
            self.frames.append(frame)
            self.shown.take(frame)


@pytest.fixture(name="recorder")
def _recorder():
    return Recorder


@pytest.fixture(name="texts")
def _texts():
    return shown_text, state_text


@pytest.fixture(name="new_shown")
def _new_shown():
    return Shown

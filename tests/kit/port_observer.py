"""What a serial port told whoever uses it."""

from __future__ import annotations


class Observer:
    def __init__(self) -> None:
        self.log: list[str] = []
        self.data = b""

    def port_up(self) -> None:
        self.log.append("up")

    def port_down(self, detail: str) -> None:
        self.log.append(f"down: {detail}")

    def data_received(self, data: bytes) -> None:
        self.data += data

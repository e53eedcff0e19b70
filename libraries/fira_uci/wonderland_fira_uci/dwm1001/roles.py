"""Put a DWM1001 with its factory firmware into a role, by its shell, and check that it took it.

The network may stand either way round. With the *anchor* (initiator) on the drone and *tags* on the pad, each tag has a
serial port of its own and measures its own range to the drone. Source: Decawave, *DWM1001 Firmware API Guide* 2.2,
"UART shell mode": ``si`` shows the node, ``nis 0xHEX`` sets the network, ``aurs N S`` the rates in tenths of a second,
``nmt`` and ``nmi`` the mode (tag, initiating anchor); a mode is taken with a restart. Without ``0x`` the firmware reads
a network's number as a decimal one.
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from enum import Enum
from typing import Final

from wonderland_fira_uci.dwm1001 import shell
from wonderland_fira_uci.errors import NodeError, NodeUnavailableError
from wonderland_fira_uci.serial_port import Opener, ReconnectingPort

PROMPT_S: Final = 1.5
TRIES: Final = 4
BOOT_S: Final = 1.2
"""A board takes about a second to start."""
TENTHS: Final = 10
_NETWORK: Final = re.compile(r"\bpanid=x([0-9A-Fa-f]{1,4})\b")
_ADDRESS: Final = re.compile(r"\buwb0:.*\baddr=x([0-9A-Fa-f]{16})\b")
_MODE: Final = re.compile(r"\bmode: ([a-z]+)")
_RATE: Final = re.compile(r"\bupd_rate_norm=(\d+)\b")
_RESTING_RATE: Final = re.compile(r"\bupd_rate_stat=(\d+)\b")
_FIRMWARE: Final = re.compile(r"\bfw_ver=x([0-9A-Fa-f]{8})\b")
_KEYED: Final = re.compile(r"\benc: (\w+)")


class Role(Enum):
    """What a board does in the network, with the command for it and how ``si`` spells it."""

    TAG = "nmt"
    """On the pad: measures its ranges and tells its host."""
    INITIATOR = "nmi"
    """On the drone: the anchor whose clock the network goes by."""

    @property
    def modes(self) -> frozenset[str]:
        """In ``si``."""
        return frozenset({"tn"}) if self is Role.TAG else frozenset({"ain", "ani"})


@dataclass(frozen=True, slots=True)
class BoardInfo:
    """What ``si`` says. ``rate_tenths``: tenths of a second between rounds, moving and at rest."""

    address: int
    """Short: the low 16 bits of its own number, which nobody can change."""
    network: int
    mode: str
    rate_tenths: int | None
    resting_tenths: int | None
    firmware: str
    encrypted: bool
    """Whether a network key is in use."""


def parse_info(text: str) -> BoardInfo:
    """The answer to ``si``. Raises NodeError where it is none."""
    network, address, mode = (pattern.search(text) for pattern in (_NETWORK, _ADDRESS, _MODE))
    if network is None or address is None or mode is None:
        raise NodeError(f"the board does not say what it is: {text.strip()[:120]!r}")
    rate, resting, firmware, keyed = (p.search(text) for p in (_RATE, _RESTING_RATE, _FIRMWARE, _KEYED))
    return BoardInfo(
        int(address[1], 16) & 0xFFFF,
        int(network[1], 16),
        mode[1],
        None if rate is None else int(rate[1]),
        None if resting is None else int(resting[1]),
        "not told" if firmware is None else f"0x{firmware[1].lower()}",
        keyed is not None and keyed[1] != "off",
    )


async def prepare(port: Opener, role: Role, network: int, *, name: str = "DWM1001", tenths: int = 1) -> BoardInfo:
    """Put the board into its role and check it; what it says afterwards. ``tenths``: of a second, between two rounds.

    What is so already is left alone (each change wears the board's flash). Raises NodeError, and
    NodeUnavailableError where no shell answers.
    """
    async with _shell(port, name) as talk:
        await talk.enter()
        before = parse_info(await talk.ask("si"))
        changed = False
        if before.network != network:
            await talk.ask(f"nis 0x{network:04X}")
            changed = True
        if role is Role.TAG and (before.rate_tenths, before.resting_tenths) != (tenths, tenths):
            await talk.ask(f"aurs {tenths} {tenths}")
            changed = True
        if before.mode not in role.modes:
            await talk.restart(role.value)
        elif changed:
            await talk.restart("reset")
        after = parse_info(await talk.ask("si"))
        talk.leave()
    _check(after, role, network, tenths, name)
    return after


def _check(info: BoardInfo, role: Role, network: int, tenths: int, name: str) -> None:
    wrong: list[str] = []
    if info.network != network:
        wrong.append(f"network 0x{info.network:04X} in place of 0x{network:04X}")
    if info.mode not in role.modes:
        wrong.append(f"mode {info.mode} in place of {'/'.join(sorted(role.modes))}")
    if role is Role.TAG:
        for when, rate in (("moving", info.rate_tenths), ("at rest", info.resting_tenths)):
            if rate not in {None, tenths}:  # at rest is what a tag on a pad always is
                wrong.append(f"{when} a round every {rate} tenths of a second in place of {tenths}")
    if wrong:
        raise NodeError(f"{name}: the board did not take its role: {'; '.join(wrong)}")


class _Shell:
    """A dialogue with the shell of one board; its port's observer."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._text = bytearray()
        self._changed = asyncio.Event()
        self._up = False
        self.port: ReconnectingPort | None = None

    # wonderland_fira_uci.serial_port.port.PortObserver

    def port_up(self) -> None:
        """The board is there."""
        self._up = True
        self._changed.set()

    def port_down(self, detail: str) -> None:
        """The board is away; it may be restarting."""
        del detail
        self._up = False
        self._changed.set()

    def data_received(self, data: bytes) -> None:
        """Text."""
        self._text += data
        del self._text[:-16_384]
        self._changed.set()

    async def enter(self) -> None:
        """Until the prompt shows. In generic mode two ends of line do it, in the shell they repeat the last command."""
        for _ in range(TRIES):
            self._write(shell.ENTER_SHELL)
            if await self._prompt():
                self._write(b"quit\r")  # begin from the same place, whoever was in the shell before
                await asyncio.sleep(0.2)
                self._write(shell.ENTER_SHELL)
                if await self._prompt():
                    return
            await asyncio.sleep(PROMPT_S)
        error = "" if self.port is None else self.port.last_error
        raise NodeUnavailableError(f"{self._name}: no shell answers: {error or 'is it a DWM1001 with PANS?'}")

    async def ask(self, command: str) -> str:
        """What a command answers, up to the next prompt."""
        self._write(command.encode("ascii") + b"\r")
        if not await self._prompt():
            raise NodeUnavailableError(f"{self._name}: {command} was not answered")
        return self._text.decode("ascii", "replace").replace("\0", "")

    async def restart(self, command: str) -> None:
        """A command that restarts the board, and its shell again."""
        self._write(command.encode("ascii") + b"\r")
        await asyncio.sleep(BOOT_S)
        await self.enter()

    def leave(self) -> None:
        """Back to the generic mode."""
        self._write(b"quit\r")

    def _write(self, data: bytes) -> None:
        self._text.clear()
        if self.port is not None and self._up:
            self.port.write(data)

    async def _prompt(self) -> bool:
        try:
            async with asyncio.timeout(PROMPT_S):
                while shell.PROMPT not in bytes(self._text).rstrip()[-len(shell.PROMPT) :]:
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError:
            return False
        return True


@asynccontextmanager
async def _shell(opener: Opener, name: str) -> AsyncIterator[_Shell]:
    talk = _Shell(name)
    talk.port = ReconnectingPort(opener, talk)
    talk.port.start()
    try:
        yield talk
        await asyncio.sleep(0.05)  # the last octets
    finally:
        talk.port.close()

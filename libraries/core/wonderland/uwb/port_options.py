"""Options of commands that open a board's port."""

from __future__ import annotations

from typing import Final

import click


class PortName(click.ParamType[str]):
    """A device, or a line over the network; what can never be one is refused before anything waits for it."""

    name = "port"

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The name itself. Raises BadParameter."""
        from wonderland_fira_uci.serial_port import url_problem  # noqa: PLC0415 - `--help` needs no pyserial

        problem = url_problem(value)
        if problem:
            self.fail(f"{value!r}: {problem}", param, ctx)
        return value


PORT: Final = PortName()
baud_rate = click.option(
    "--baud-rate", type=click.IntRange(1_200, 12_000_000), default=115_200, show_default=True, help="Of the port."
)
rtscts = click.option("--rtscts", is_flag=True, help="Flow control by RTS and CTS.")

"""The parameters of a node: read by anybody, set by nobody. Pure but for the services that it declares."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from wonderland_rmw_zenoh.interfaces import Interfaces
from wonderland_rmw_zenoh.node import Node

Value = bool | int | float | str
_TYPES: Final[tuple[tuple[type, int, str], ...]] = (
    (bool, 1, "bool_value"),
    (int, 2, "integer_value"),
    (float, 3, "double_value"),
    (str, 4, "string_value"),
)
_NOT_SET: Final = "read-only: it follows from the settings and from the ledger"
MAX_NAMES: Final = 1_000


class Parameters:
    """Values by name, as ``ros2 param`` shows them."""

    def __init__(self) -> None:
        self.values: dict[str, Value] = {"use_sim_time": False}

    def serve(self, node: Node, types: Interfaces) -> None:
        """Declare the six services."""
        for name, serve in (
            ("ListParameters", self._list),
            ("GetParameters", self._get),
            ("GetParameterTypes", self._types),
            ("DescribeParameters", self._describe),
            ("SetParameters", self._set),
            ("SetParametersAtomically", self._set_all),
        ):
            own = "".join(f"_{each.lower()}" if each.isupper() else each for each in name).lstrip("_")
            node.serve(f"{node.name}/{own}", types.service(f"rcl_interfaces/srv/{name}"), serve)

    async def _list(self, asked: Any) -> Mapping[str, Any]:
        prefixes = list(asked.prefixes)[:MAX_NAMES]
        names = [each for each in self.values if not prefixes or any(each.startswith(one) for one in prefixes)]
        return {"result": {"names": names}}

    async def _get(self, asked: Any) -> Mapping[str, Any]:
        return {"values": [self._value(each) for each in asked.names[:MAX_NAMES]]}

    async def _types(self, asked: Any) -> Mapping[str, Any]:
        return {"types": [self._value(each).get("type", 0) for each in asked.names[:MAX_NAMES]]}

    async def _describe(self, asked: Any) -> Mapping[str, Any]:
        return {
            "descriptors": [
                {"name": each, "type": self._value(each).get("type", 0), "read_only": True}
                for each in asked.names[:MAX_NAMES]
            ]
        }

    async def _set(self, asked: Any) -> Mapping[str, Any]:
        return {"results": [{"successful": False, "reason": _NOT_SET} for _ in asked.parameters[:MAX_NAMES]]}

    async def _set_all(self, _: Any) -> Mapping[str, Any]:
        return {"result": {"successful": False, "reason": _NOT_SET}}

    def _value(self, name: str) -> Mapping[str, Any]:
        value = self.values.get(name)
        for kind, number, field in _TYPES:
            if type(value) is kind:
                return {"type": number, field: value}
        return {}

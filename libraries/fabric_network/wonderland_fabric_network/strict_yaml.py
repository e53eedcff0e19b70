"""YAML without its traps, and the line on which each field stands."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any

import yaml


class YamlError(Exception):
    """What is no YAML, or more than is read; the text has the line where there is one."""


@dataclass(frozen=True)
class StrictYaml:
    """A document, and where its parts stand."""

    document: Any
    _root: yaml.Node | None

    def line(self, place: Sequence[str | int]) -> int:
        """Line (from 1) of a field by its way from the root; of the nearest that is there, where it is missing."""
        node, line = self._root, 1
        for step in place:
            if isinstance(node, yaml.MappingNode):
                found = [(key, value) for key, value in node.value if key.value == str(step)]
                if not found:
                    break
                line, node = found[0][0].start_mark.line + 1, found[0][1]
            elif isinstance(node, yaml.SequenceNode) and isinstance(step, int) and step < len(node.value):
                node = node.value[step]
                line = node.start_mark.line + 1
            else:
                break
        return line


def read_yaml(data: bytes) -> StrictYaml:
    """Parse one document; bound its size before. Raises YamlError."""
    loader = None
    try:
        loader = _Loader(data)
        root = loader.get_single_node()
        return StrictYaml(None if root is None else loader.construct_document(root), root)
    except yaml.MarkedYAMLError as cause:
        mark = cause.problem_mark or cause.context_mark
        where = "" if mark is None else f", line {mark.line + 1}, column {mark.column + 1}"
        raise YamlError(f"no YAML{where}: {cause.problem or cause.context}"[:300]) from cause
    except (yaml.YAMLError, UnicodeError, RecursionError, ValueError) as cause:
        raise YamlError(f"no YAML ({' '.join(str(cause).split())[:300]})") from cause
    finally:
        if loader is not None:
            loader.dispose()


class _Loader(yaml.SafeLoader):
    """No doubled keys (the last would win silently), no aliases (they can grow without end)."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            raise yaml.constructor.ConstructorError(problem="aliases are not allowed", problem_mark=self.get_mark())
        node: yaml.Node | None = super().compose_node(parent, index)
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[Hashable] = set()
        for key, _ in node.value:
            if isinstance(key.value, Hashable) and key.value in seen:
                raise yaml.constructor.ConstructorError(
                    problem=f"the field {key.value!r} stands twice", problem_mark=key.start_mark
                )
            if isinstance(key.value, Hashable):
                seen.add(key.value)
        return super().construct_mapping(node, deep=deep)

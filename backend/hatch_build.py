"""Puts into wheel and sdist what stands beside this folder: alembic's migrations and the built console."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

BESIDE: Final = {"alembic": "wonderland_backend/db/migrations", "frontend/dist": "wonderland_backend/static"}
"""Where each of them is in a wheel. In an sdist they are beside the package, as they are here."""


class BesideHook(BuildHookInterface):  # type: ignore[type-arg]
    """A wheel without its console, or without its tables, would install and then fail."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Refuses to build where one of them is missing; an editable install finds both where they are."""
        if version == "editable":
            return
        for name, where in BESIDE.items():
            path = self._found(name)
            build_data["force_include"][str(path)] = name if self.target_name == "sdist" else where

    def _found(self, name: str) -> Path:
        project = Path(self.root)
        for directory in (project, project.parent):
            path = directory / name
            if path.exists() and (path.name != "dist" or (path / "index.html").exists()):
                return path
        raise FileNotFoundError(f"{project.parent / name} is missing; `make setup` in {project.parent} builds it")

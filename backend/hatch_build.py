"""Puts into the wheel what stands beside this folder: alembic's migrations and the built console."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class BesideHook(BuildHookInterface):  # type: ignore[type-arg]
    """A wheel without its console, or without its tables, would install and then fail."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Refuses to build where one of them is missing; an editable install finds both where they are."""
        if version == "editable":
            return
        project = Path(self.root).parent
        beside = {
            project / "alembic": "wonderland_backend/db/migrations",
            project / "frontend" / "dist": "wonderland_backend/static",
        }
        for path in (*beside, project / "frontend" / "dist" / "index.html"):
            if not path.exists():
                raise FileNotFoundError(f"{path} is missing; `make setup` in {project} builds it")
        build_data["force_include"].update({str(path): where for path, where in beside.items()})

"""The base maps of one backend: what there is, and what is missing."""

from __future__ import annotations

import logging
from dataclasses import asdict
from typing import Annotated, Any, Final

import httpx

from wonderland_backend.context import part
from wonderland_backend.maps.archive import Archive, ArchiveError, MapError, credits_of
from wonderland_backend.maps.imagery import Imagery
from wonderland_backend.settings.maps import MapSettings

logger = logging.getLogger(__name__)
SETTING: Final = "WONDERLAND_BACKEND_MAP__"


class Maps:
    """The archives and the WMTS that the settings name."""

    def __init__(self, settings: MapSettings, client: httpx.AsyncClient) -> None:
        self.settings = settings
        self.archive = None if settings.archive is None else Archive(settings.archive, vector=True)
        self.terrain = None if settings.terrain is None else Archive(settings.terrain, vector=False)
        self.images = None if settings.imagery is None else Archive(settings.imagery, vector=False)
        self.wmts = None if settings.wmts is None else Imagery(settings, client)

    def check(self) -> None:
        """At the start: a map that cannot be drawn stops nobody, but the log says so. Blocks on the disk."""
        for each in self.describe("")["missing"]:
            logger.warning("No %s: %s (set by %s)", each["what"], each["why"], each["setting"])

    def describe(self, prefix: str) -> dict[str, Any]:
        """For the console; ``prefix`` is where the interface lies. Blocks on the disk."""
        missing: list[dict[str, Any]] = []
        result: dict[str, Any] = {"missing": missing}
        for what, archive in (("archive", self.archive), ("terrain", self.terrain), ("imagery", self.images)):
            if archive is None:
                continue
            try:
                found = archive.describe()
            except ArchiveError as error:
                missing.append(_missing(what, error, what.upper()))
                continue
            told = credits_of(self.settings.imagery_attribution) if what == "imagery" else ()
            result[what] = {
                "url": f"{prefix}/map/{what}?v={found.tag}",
                "version": found.tag,
                "kind": found.kind,
                "size_bytes": found.size_bytes,
                "bounds": found.bounds,
                "min_zoom": found.min_zoom,
                "max_zoom": found.max_zoom,
                "layers": found.layers,
                "attribution": [asdict(each) for each in told or found.attribution],
            }
            if what == "terrain":
                result[what]["encoding"] = self.settings.terrain_encoding
        if self.wmts is not None:
            if self.wmts.failure is not None:
                missing.append(_missing("imagery", self.wmts.failure, "WMTS"))
            result["imagery"] = {
                "url": f"{prefix}/map/imagery/{{z}}/{{x}}/{{y}}",
                "version": "wmts",
                "kind": "wmts",
                "size_bytes": 0,
                "bounds": (-180.0, -85.0, 180.0, 85.0),
                "min_zoom": 0,
                "max_zoom": 19,
                "layers": (),
                "attribution": [asdict(each) for each in credits_of(self.settings.imagery_attribution)],
            }
        return result


def _missing(what: str, error: MapError, setting: str) -> dict[str, Any]:
    why = {"code": error.code, "facts": error.facts, "why": str(error)}
    return {"what": what, **why, "setting": f"{SETTING}{setting}"}


MapsDep = Annotated[Maps, part(Maps)]

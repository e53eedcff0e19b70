"""Whether agents come by a bus, too: an extra, imported where it is set up."""

from __future__ import annotations

from typing import TYPE_CHECKING

from wonderland_backend.auth.store.sign_ins import SignIns
from wonderland_backend.errors import SettingsError
from wonderland_backend.ingest.serving import Ingest
from wonderland_backend.settings.bus import BusSettings

if TYPE_CHECKING:
    from wonderland_backend.ingest.bus import BusIngest


def bus_ingest(settings: BusSettings | None, ingest: Ingest, sign_ins: SignIns) -> BusIngest | None:
    """None where there is no bus. Raises `SettingsError`."""
    if settings is None:
        return None
    try:
        from wonderland_backend.ingest.bus import BusIngest  # noqa: PLC0415 - an extra
    except ImportError as cause:
        raise SettingsError(
            f'bus needs what is not installed: pip install "wonderland-backend[zenoh]" ({cause})'
        ) from cause
    return BusIngest(settings, ingest, sign_ins)

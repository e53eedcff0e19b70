"""Why an agent, or one of its records, is refused."""

from __future__ import annotations

from wonderland.telemetry import TelemetryError


class IngestError(TelemetryError):
    """Well said, but refused all the same: by who says it, or when. `code` is for machines.

    Of agents: ``no_hello``, ``unknown_organisation``, ``not_authenticated``, ``wrong_role``, ``wrong_organisation``,
    ``too_many_agents``, ``duplicate_agent``. Of frames: ``bad_frame``, ``bad_order``. Of records: ``not_allowed``,
    ``clock``, ``bad_body``.
    """

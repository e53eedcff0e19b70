"""What the spool raises: one tree, so that the agent catches one type."""

from __future__ import annotations


class SpoolError(Exception):
    """Base of everything that the spool raises on purpose; by itself: the storage does not work, the text says how."""


class SpoolLockedError(SpoolError):
    """Another process uses this spool: a second agent for the same pad."""


class SpoolFull(SpoolError):  # noqa: N818 - a state that passes, not a mistake
    """No room for evidence: the quota is used up by evidence alone, or the disk is full.

    Nothing that was stored is lost. The pad must refuse new sessions until `Spool.accepts_sessions` holds again.
    """


class SpoolCorruptError(SpoolError):
    """The file is no spool, or a damaged one."""


class SpoolClosedError(SpoolError):
    """The spool has been closed."""


class RecordRefusedError(SpoolError):
    """A record that could never be sent: an unknown form of kind, no canonical JSON, or too large."""

"""What keeps a pad from being commissioned; each text says what was wrong and what to do next."""

from __future__ import annotations


class CommissioningError(Exception):
    """The base of all: nothing was committed."""


class RecordingError(CommissioningError):
    """A file that is no recording, or no list of anchors; the text names file, line and column."""


class SurveyError(CommissioningError):
    """Anchors where no pad can have them: coincident, too few, too far apart, or contradicting their own ranges."""


class TruthError(CommissioningError):
    """The reference (truth) of a calibration run is missing, broken, or from another time."""


class CalibrationError(CommissioningError):
    """A run from which nothing can be learnt: too short, without movement, or of ranges that are none."""


class ClockError(CalibrationError):
    """Time stamps from which no common clock can be learnt; ranges may be calibrated all the same."""


class RadioError(CommissioningError):
    """The pad's nodes, or the drone's, do not range; the text says which and why."""


class StateError(CommissioningError):
    """The directory of an interrupted commissioning holds something that does not fit; the text says what to remove."""


class PublishError(CommissioningError):
    """The ledger did not take the commissioning; the text says why, and what is on the ledger now."""

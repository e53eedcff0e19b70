"""What a DSS, or another provider, can refuse."""

from __future__ import annotations

from wonderland_backend.http.transfer import TransferError


class DssError(TransferError):
    """Base of what goes wrong with a DSS."""


class DssAway(DssError):  # noqa: N818 - a state that passes
    """No instance of the DSS answered as it should; try again later."""


class DssRefused(DssError):  # noqa: N818 - an answer
    """The DSS understood and said no; the text has its words."""

    def __init__(self, status: int, message: str) -> None:
        super().__init__(f"the DSS answered {status}: {message}")
        self.status = status


class NotThere(DssRefused):
    """404: there is no such area or subscription, or no longer."""


class VersionConflict(DssRefused):
    """409: it was changed meanwhile, exists already, or is somebody else's. Look, then try again."""


class AreaTooLarge(DssRefused):
    """413: the area is larger than this DSS takes."""


class TooMany(DssRefused):
    """429: too many subscriptions in the area, or requests; `retry_s` is when to try again."""

    def __init__(self, status: int, message: str, retry_s: float) -> None:
        super().__init__(status, message)
        self.retry_s = retry_s

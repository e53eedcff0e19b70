"""What an autopilot is told to broadcast about itself: the ``[open_drone_id]`` table of ``uav.toml``."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from msgspec import Meta

from wonderland.toml_settings import FieldError, Table
from wonderland_remote_id import FieldError as RemoteIdFieldError
from wonderland_remote_id import check_operator_id

_EU_PUBLIC: Final = 16
"""Characters of a European operator number without its secret."""


class OperatorPlace(Table, frozen=True):
    """Where the operator stands, in degrees (WGS-84) and metres above the ellipsoid."""

    lat: Annotated[float, Meta(ge=-90, le=90)]
    """Latitude, in degrees (WGS-84)."""
    lon: Annotated[float, Meta(ge=-180, le=180)]
    """Longitude, in degrees."""
    height_m: Annotated[float, Meta(ge=-500, le=9_000)]
    """Height above the ellipsoid."""


class OpenDroneIdSettings(Table, frozen=True, kw_only=True):
    """Raises FieldError for an operator number that was typed wrong."""

    operator_id: Annotated[str, Meta(min_length=1, max_length=20, pattern=r"^[ -~]+$")] | None = None
    """The operator's registration. The three secret characters of a European one are checked, and not broadcast."""
    aircraft: Literal["aeroplane", "helicopter_or_multirotor", "hybrid_lift", "other"] = "helicopter_or_multirotor"
    """What it is."""
    category: Literal["undeclared", "open", "specific", "certified"] = "undeclared"
    """Of the EU's rules."""
    class_eu: Annotated[int, Meta(ge=0, le=6)] | None = None
    """C0 to C6."""
    description: Annotated[str, Meta(min_length=1, max_length=23, pattern=r"^[ -~]+$")] | None = None
    """What the flight is for, to be broadcast."""
    operator: OperatorPlace | None = None
    """Where the operator stands, where that is fixed; left out: the place of the take-off."""

    def __post_init__(self) -> None:
        if self.class_eu is not None and self.category == "undeclared":
            raise FieldError("class_eu: give the category, too")
        try:
            _ = self.public_operator_id
        except RemoteIdFieldError as error:
            raise FieldError(f"operator_id: {error}") from None

    @property
    def public_operator_id(self) -> str | None:
        """What is broadcast of it. Raises wonderland_remote_id.FieldError."""
        text = self.operator_id
        european = text is not None and len(text) > _EU_PUBLIC and text[_EU_PUBLIC] == "-" and text[:3].isupper()
        return check_operator_id(text) if european and text is not None else text

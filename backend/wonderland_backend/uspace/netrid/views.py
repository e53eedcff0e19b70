"""The parameter `view`: what it means, and how large it may be."""

from __future__ import annotations

import math
from http import HTTPStatus
from typing import Final

from uas_standards.astm.f3411.v22a import constants

from wonderland.problems import said
from wonderland_backend.errors import Problem
from wonderland_backend.uspace.geo import Box

MAX_DIAGONAL_M: Final = constants.NetMaxDisplayAreaDiagonalKm * 1000
MAX_DETAILS_DIAGONAL_M: Final = constants.NetDetailsMaxDisplayAreaDiagonalKm * 1000
MAX_TEXT: Final = 200


class BadView(Problem):
    """`view` is not four coordinates: lat1,lng1,lat2,lng2."""

    status, code = HTTPStatus.BAD_REQUEST, "bad-view"
    example = said("bad_view")


class ViewTooLarge(Problem):
    """The view is larger than the standard allows."""

    status, code = HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "view-too-large"
    example = said("view_too_large", diagonal_km="12.4", most_km="7")


def parse_view(text: str) -> Box:
    """The smallest box with these corners. Raises `BadView`, `ViewTooLarge`."""
    parts = text.split(",") if len(text) <= MAX_TEXT else []
    try:
        lat_1, lng_1, lat_2, lng_2 = (float(part) for part in parts)
    except ValueError:
        raise BadView(said("bad_view")) from None
    if not all(math.isfinite(each) for each in (lat_1, lng_1, lat_2, lng_2)):
        raise BadView(said("bad_view_number"))
    if max(abs(lat_1), abs(lat_2)) > 90 or max(abs(lng_1), abs(lng_2)) > 180:
        raise BadView(said("bad_view_place"))
    box = Box.between(lat_1, lng_1, lat_2, lng_2)
    diagonal_m = box.diagonal_m()
    if diagonal_m > MAX_DIAGONAL_M:
        raise ViewTooLarge(
            said("view_too_large", diagonal_km=f"{diagonal_m / 1000:.1f}", most_km=f"{MAX_DIAGONAL_M / 1000:g}")
        )
    return box

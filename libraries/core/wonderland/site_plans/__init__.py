"""Site plans: what stands and is marked around a landing pad, as its operator drew it. ``parse`` checks one."""

from wonderland.site_plans.plan import (
    KINDS,
    MAX_BYTES,
    MAX_PROBLEMS,
    Feature,
    Image,
    Problem,
    SitePlan,
    SitePlanError,
    parse,
)

__all__ = [
    "KINDS",
    "MAX_BYTES",
    "MAX_PROBLEMS",
    "Feature",
    "Image",
    "Problem",
    "SitePlan",
    "SitePlanError",
    "parse",
]

"""A pad's commissioning as it holds for a drone whose own node was calibrated there."""

from __future__ import annotations

from dataclasses import replace

from wonderland.proofs.records.calibrations import DroneOffset
from wonderland.proofs.records.pads import Commissioning


def calibrated(commissioning: Commissioning, drone: DroneOffset | None) -> Commissioning:
    """Each anchor's bias with the drone's offset; what is left in common is as well known as that offset is.

    None: judged with the prior, which is the commissioning as it stands.
    """
    if drone is None:
        return commissioning
    return replace(
        commissioning,
        anchors=tuple(
            replace(
                anchor,
                bias=tuple(replace(point, bias_mm=point.bias_mm + drone.offset_mm) for point in anchor.bias),
            )
            for anchor in commissioning.anchors
        ),
        installation_sigma_mm=drone.sigma_mm,
    )

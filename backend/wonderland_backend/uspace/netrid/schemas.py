"""What F3411-22a has us answer, for the description."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from wonderland_backend.schemas import ApiModel

TIME = "2027-01-15T08:00:00.000Z"
FLIGHT_ID = "0198f2a4-7c31-4b5e-9d20-6a1f8e3c5b74"


class RidTime(ApiModel):
    """`Time`."""

    value: str = Field(description="RFC 3339, UTC", examples=[TIME])
    format: Literal["RFC3339"]


class RidHeight(ApiModel):
    """`RIDHeight`."""

    distance: float = Field(description="Metres", examples=[12.0])
    reference: Literal["TakeoffLocation", "GroundLevel"]


class RidPosition(ApiModel):
    """`RIDAircraftPosition`, as the drone claims it."""

    lat: float = Field(examples=[60.4518])
    lng: float = Field(examples=[22.2666])
    alt: float = Field(description="Metres above the WGS-84 ellipsoid; -1000: unknown", examples=[40.0])
    accuracy_h: str = Field(examples=["HA3m"])
    accuracy_v: str = Field(examples=["VA10m"])
    extrapolated: bool = Field(examples=[False])
    pressure_altitude: float = Field(description="Metres; -1000: unknown", examples=[-1000.0])
    height: RidHeight | None = None


class RidState(ApiModel):
    """`RIDAircraftState`."""

    timestamp: RidTime
    timestamp_accuracy: float = Field(description="Seconds", examples=[0.1])
    operational_status: Literal["Undeclared", "Ground", "Airborne", "Emergency", "RemoteIDSystemFailure"] = Field(
        examples=["Airborne"]
    )
    position: RidPosition
    track: float = Field(description="Degrees clockwise from true north; 361: unknown", examples=[90.0])
    speed: float = Field(description="Metres per second; 255: unknown", examples=[5.25])
    speed_accuracy: str = Field(examples=["SA1mps"])
    vertical_speed: float = Field(description="Metres per second; 63: unknown", examples=[-0.5])


class RidRecentPosition(ApiModel):
    """`RIDRecentAircraftPosition`."""

    time: RidTime
    position: RidPosition


class RidFlight(ApiModel):
    """`RIDFlight`."""

    id: str = Field(examples=[FLIGHT_ID])
    aircraft_type: str = Field(examples=["Helicopter"])
    current_state: RidState
    simulated: bool = Field(examples=[False])
    recent_positions: list[RidRecentPosition] | None = None


class RidFlights(ApiModel):
    """`GetFlightsResponse`."""

    timestamp: RidTime
    flights: list[RidFlight]
    no_isas_present: bool = Field(description="No area of ours meets the view", examples=[False])


class RidUasId(ApiModel):
    """`UASID`: one or more of these."""

    serial_number: str | None = Field(default=None, examples=["1581F5FKD229400A1234"])
    registration_id: str | None = Field(default=None, examples=["N.AB1234"])
    utm_id: str | None = Field(default=None, examples=[FLIGHT_ID])
    specific_session_id: str | None = Field(default=None, examples=["01-00112233445566778899aabbccddeeff001122"])


class RidFlightDetails(ApiModel):
    """`RIDFlightDetails`: what the drone said of itself, and nothing else."""

    id: str = Field(examples=[FLIGHT_ID])
    uas_id: RidUasId = Field(examples=[{"serial_number": "1581F5FKD229400A1234"}])
    operator_id: str | None = Field(default=None, examples=["FIN87astrdge12k8"])
    operator_location: dict[str, Any] | None = Field(
        default=None, examples=[{"position": {"lat": 60.452, "lng": 22.267}, "altitude_type": "Takeoff"}]
    )
    eu_classification: dict[str, str] | None = Field(default=None, examples=[{"category": "Open", "class": "Class2"}])
    operation_description: str | None = Field(default=None, examples=["A survey"])
    auth_data: dict[str, Any] | None = Field(default=None, examples=[{"format": 0, "data": ""}])


class RidDetails(ApiModel):
    """`GetFlightDetailsResponse`."""

    details: RidFlightDetails


class RidArea(ApiModel):
    """`GetIdentificationServiceAreaDetailsResponse`."""

    extents: dict[str, Any] = Field(
        description="`Volume4D`",
        examples=[
            {
                "volume": {
                    "outline_polygon": {
                        "vertices": [
                            {"lat": 60.44, "lng": 22.25},
                            {"lat": 60.44, "lng": 22.29},
                            {"lat": 60.46, "lng": 22.29},
                            {"lat": 60.46, "lng": 22.25},
                        ]
                    }
                },
                "time_end": {"value": TIME, "format": "RFC3339"},
            }
        ],
    )

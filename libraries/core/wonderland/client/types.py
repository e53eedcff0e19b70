"""What the API answers. Made by scripts/client_types.py from the OpenAPI description; do not edit."""

from __future__ import annotations

from typing import Any, Literal, NotRequired, TypedDict


class Alert(TypedDict):
    """Something that an officer must not miss, and what has become of it."""

    alert_id: str
    kind: Literal[
        "refuted",
        "broadcast_contradicts",
        "broadcast_unattributed",
        "stamps_contradict",
        "leaving",
        "permission_unmatched",
        "landed_unpermitted",
        "ledger_halted",
        "rows_differ",
        "unauthorised",
        "zone_closed",
        "closures_ending",
        "closures_differ",
        "identity_odd",
        "broadcast_odd",
        "broadcasts_flooded",
        "pad_silent",
        "pad_drifting",
        "certificate_expiring",
        "ledger_away",
        "ledger_alone",
    ]
    severity: Literal["critical", "warning", "notice"]
    t_ms: int
    pad_id: NotRequired[str]
    uav_id: NotRequired[str]
    session_id: NotRequired[str]
    tx_id: NotRequired[str]
    facts: dict[str, Any]
    text: NotRequired[str]
    state: Literal["open", "acknowledged", "returned", "over"]
    revision: int
    changed_ms: int
    acknowledged_by: NotRequired[str]
    assigned_to: NotRequired[str]
    snoozed_until_ms: NotRequired[int]
    over_ms: NotRequired[int]


class Anchor(TypedDict):
    """One UWB node of a pad, surveyed in the pad's frame."""

    anchor_id: str
    mac: int
    east_mm: int
    north_mm: int
    up_mm: int
    survey_sigma_mm: int
    bias: list[BiasPoint]
    clock_offset_mm: NotRequired[int]
    clock_sigma_mm: NotRequired[int]


class AnchorHealth(TypedDict):
    """How an anchor does."""

    anchor_id: str
    state: Literal["up", "down", "silent"]
    firmware: NotRequired[str]
    detail: NotRequired[str]


class AnchorPosition(TypedDict):
    """Where an anchor stands: in the pad's frame, and on the globe (computed from the commissioning)."""

    anchor_id: str
    lat_e7: int
    lon_e7: int
    east_mm: int
    north_mm: int
    up_mm: int


class Authorisation(TypedDict):
    """What a drone may do at a pad, and when."""

    authorisation_id: str
    uav_id: str
    pad_id: str
    actions: list[Literal["land", "takeoff", "dock"]]
    valid_from_ms: int
    valid_until_ms: int
    granted_by: str
    granted_ms: int
    revoked: bool
    revoked_reason: NotRequired[str]
    revoked_ms: NotRequired[int]


class BiasPoint(TypedDict):
    """Mean error of an anchor's ranges at a distance, and how well it is known."""

    range_mm: int
    bias_mm: int
    sigma_mm: int


class BroadcastFinding(TypedDict):
    """What was heard under the drone's serial number on Remote ID, against what was measured."""

    outcome: Literal["supported", "contradicted", "own_contradicted", "undecided", "not_heard"]
    messages: int
    attributed: int
    supported: bool
    claim: NotRequired[Position]
    error_mm: NotRequired[int]
    likelihood_ppm: NotRequired[int]
    tolerance_mm: NotRequired[int]


class BroadcastHeard(TypedDict):
    """What was heard under the drone's serial number on Remote ID."""

    outcome: Literal["supported", "contradicted", "own_contradicted", "undecided", "not_heard"]
    messages: int
    attributed: int
    supported: bool
    place: NotRequired[Place]
    error_mm: NotRequired[int]
    likelihood_ppm: NotRequired[int]
    tolerance_mm: NotRequired[int]


class BroadcastUsed(TypedDict):
    """The broadcast that was judged."""

    lat_e7: int
    lon_e7: int
    t_ms: int
    accuracy_mm: int
    source: Literal["heard", "asked"]
    verified: Literal[False]


class Calibration(TypedDict):
    """The offset of a drone's ranges at one pad."""

    pad_id: str
    commissioning_sha256: str
    offset_mm: int
    sigma_mm: int
    sessions: int
    rounds: int
    measured_ms: int
    valid_until_ms: int
    registered_ms: int
    registered_by: str
    msp_id: str
    node: NotRequired[str]
    withdrawn: NotRequired[str]


class Commissioning(TypedDict):
    """What a survey and a calibration established about a pad: the ground on which its verdicts stand."""

    frame: Frame
    anchors: list[Anchor]
    range_sigma_mm: int
    installation_sigma_mm: int
    max_range_mm: int
    valid_from_ms: int
    valid_until_ms: int
    method: str
    correlation_ppm: NotRequired[int]
    timestamp_sigma_mm: NotRequired[int]
    bias_length_mm: NotRequired[int]
    bias_fixed_ppm: NotRequired[int]
    nodes: NotRequired[NodeAbility]


class Conformance(TypedDict):
    """Whether a proof supports where a drone says it is."""

    serial: str
    status: Literal["supported", "contradicted", "unproven", "unknown"]
    text: str
    t_ms: int
    limits: list[ConformanceLimit]
    broadcast: NotRequired[BroadcastUsed]
    proof: NotRequired[Proof]
    signature: NotRequired[SessionSignature]
    measured_ms: NotRequired[int]
    age_ms: NotRequired[int]
    assurance: NotRequired[int]
    distance_mm: NotRequired[int]
    proven_within_mm: NotRequired[int]
    proven_beyond_mm: NotRequired[int]
    supported_until_ms: NotRequired[int]


class ConformanceLimit(TypedDict):
    """What keeps the answer from being better."""

    code: Literal[
        "not_registered",
        "never_heard",
        "broadcast_stale",
        "no_proof",
        "no_measured_place",
        "assurance_too_low",
        "too_far_or_too_long_ago",
        "last_proof_refuted",
        "last_proof_inconclusive",
        "broadcast_refuted",
        "broadcast_unattributed",
        "speed_impossible",
    ]
    text: str


class Covariance(TypedDict):
    """Of the estimate, horizontal: east-east, east-north, north-north."""

    ee_mm2: int
    en_mm2: int
    nn_mm2: int


class DriftHealth(TypedDict):
    """Whether the anchors stand as they were commissioned, by the ranges that they measure to each other."""

    state: Literal["ok", "drifting", "moved"]
    checked_ms: int
    looks: int
    since_ms: NotRequired[int]
    anchor_id: NotRequired[str]
    off_mm: NotRequired[int]
    sigma_mm: NotRequired[int]
    common_mm: NotRequired[int]
    extra_sigma_mm: NotRequired[int]


class Drip(TypedDict):
    """Who signed a drone's broadcasts (RFC 9575). It says nothing about whether its position is true."""

    state: Literal["verified", "endorsed", "unknown_signer", "refused"]
    det: str
    format: Literal["link", "wrapper", "manifest", "frame"]
    t_ms: int
    signer: NotRequired[str]
    reason: NotRequired[str]
    covers_location: NotRequired[bool]
    bound: NotRequired[bool]


class Drone(TypedDict):
    """A drone: the ledger's record, its operator's number, its authorisations, its last verdict, and its and so on."""

    uav_id: str
    operator_id: str
    msp_id: str
    model: str
    status: Literal["active", "suspended", "retired"]
    registered_ms: int
    updated_ms: int
    registration_commitment: NotRequired[str]
    status_reason: NotRequired[str]
    maintenance: NotRequired[Maintenance]
    calibrations: NotRequired[list[Calibration]]
    registration: RegistrationNumber
    authorisations: list[Authorisation]
    track: NotRequired[Track]
    verdict: NotRequired[VerdictSummary]


class DroneClock(TypedDict):
    """The drone's clock against the pad's: how far ahead it is, and how well the echoes tell."""

    offset_ms: int
    sigma_ms: int
    readings: int


class Export(TypedDict):
    """An export, and how far it has come."""

    export_id: str
    created_ms: int
    expires_ms: int
    expected: int
    state: Literal["prepared", "running", "done", "broken"]
    rows: int
    bytes: int
    sha256: NotRequired[str]


class Extent(TypedDict):
    """The box that holds all of its positions."""

    west_e7: int
    south_e7: int
    east_e7: int
    north_e7: int


class Flight(TypedDict):
    """Positions that one drone broadcast without a pause of more than five minutes. Unverified."""

    flight_id: str
    uav_id: str
    start_ms: int
    end_ms: int
    active: bool
    positions: int
    first: Spot
    last: Spot
    extent: Extent
    proofs: NotRequired[list[str]]
    verified: Literal[False]


class Frame(TypedDict):
    """A pad's local frame: its origin and the integer coefficients that turn WGS-84 differences into and so on."""

    lat_e7: int
    lon_e7: int
    height_mm: int
    e1: int
    e2: int
    e3: int
    n1: int
    n2: int
    n3: int
    n4: int
    u2: int
    u3: int


class Health(TypedDict):
    """The agent's last report of itself. Not from the ledger."""

    t_ms: int
    connected: bool
    anchors: list[AnchorHealth]
    spool: NotRequired[SpoolHealth]
    receiver: NotRequired[ReceiverHealth]
    prekeys: NotRequired[int]
    version: NotRequired[str]
    drift: NotRequired[DriftHealth]
    verified: Literal[False]


class HeightFinding(TypedDict):
    """What the ranges say of the claimed height; where their geometry says nothing of it there is no finding."""

    outcome: Literal["proved", "contradicted", "claimed"]
    claimed_mm: int
    measured_mm: int
    lowest_mm: int
    highest_mm: int
    tolerance_mm: int
    likelihood_ppm: int
    uu_mm2: int
    eu_mm2: int
    nu_mm2: int
    chi2_milli: int


class HeightFound(TypedDict):
    """Whether the height is measured, or the drone's word."""

    outcome: Literal["proved", "contradicted", "claimed"]
    claimed_mm: int
    measured_mm: int
    lowest_mm: int
    highest_mm: int
    tolerance_mm: int
    likelihood_ppm: int
    uu_mm2: int
    eu_mm2: int
    nu_mm2: int


class JudgedClaim(TypedDict):
    """A claim of the drone, and what the measurement says about it."""

    outcome: Literal["verified", "refuted", "inconclusive"]
    place: Place
    error_mm: int
    likelihood_ppm: int
    reasons: list[ProofReason]


class Judgement(TypedDict):
    """One claim, judged: where it is, how far the estimate lies from it, how likely it holds."""

    outcome: Literal["verified", "refuted", "inconclusive"]
    claim: Position
    error_mm: int
    likelihood_ppm: int
    paper_rule: bool
    reasons: list[Reason]


class LedgerEvent(TypedDict):
    """Something that was committed to the ledger."""

    id: str
    type: str
    t_ms: int
    tx_id: str
    block: int
    tx_index: int
    record: dict[str, Any]


class Maintenance(TypedDict):
    """The last recorded maintenance."""

    performed_ms: int
    valid_until_ms: int
    work: str
    recorded_by: str


class NodeAbility(TypedDict):
    """Of the weakest of a pad's nodes, or of a drone's. The plan of a session is a function of both sides'."""

    words: Literal["both_ways", "initiator"]
    word_octets: int
    slot_us: int
    channels: list[int]
    sts: Literal["static", "provisioned"]
    blinks: Literal["none", "scheduled"]


class Pad(TypedDict):
    """A landing pad: the ledger's record, the anchors' positions and the agent's own word on its health."""

    pad_id: str
    name: str
    operator_id: str
    msp_id: str
    status: Literal["registered", "commissioned", "retired"]
    lat_e7: int
    lon_e7: int
    height_mm: int
    registered_ms: int
    updated_ms: int
    commissioning: NotRequired[Commissioning]
    commissioning_sha256: NotRequired[str]
    site_plan_sha256: NotRequired[str]
    note: NotRequired[str]
    anchors: list[AnchorPosition]
    health: NotRequired[Health]
    queue: NotRequired[QueueSummary]


class Place(TypedDict):
    """A place on the globe."""

    lat_e7: int
    lon_e7: int
    height_mm: int


class Position(TypedDict):
    """A point in the pad's frame and on the globe."""

    east_mm: int
    north_mm: int
    up_mm: int
    lat_e7: int
    lon_e7: int
    height_mm: int


class Proof(TypedDict):
    """What the contract decided about a drone's place."""

    proof_id: str
    uav_id: str
    pad_id: str
    action: Literal["land", "takeoff", "dock"]
    decided_ms: int
    outcome: Literal["verified", "refuted", "inconclusive"]
    permission: Literal["granted", "refused"]
    authorised: bool
    assurance: int
    rounds: int
    buffer_mm: int
    measured: NotRequired[Place]
    covariance: NotRequired[Uncertainty]
    signed: NotRequired[JudgedClaim]
    height: NotRequired[HeightFound]
    broadcast: NotRequired[BroadcastHeard]
    reasons: list[ProofReason]
    evidence_sha256: str
    tx_id: str
    block: int
    tx_index: int


class ProofReason(TypedDict):
    """Why: a code and its facts for machines, and a sentence for people, in the language that was asked for."""

    code: str
    facts: dict[str, int | str]
    text: str


class ProofRequest(TypedDict):
    """A request, and what has become of it."""

    request_id: str
    uav_id: str
    pad_id: str
    action: Literal["land", "takeoff", "dock"]
    state: Literal["pending", "asked", "decided", "ended", "declined", "expired", "cancelled"]
    requested_by: str
    note: str
    created_ms: int
    expires_ms: int
    told_ms: NotRequired[int]
    accepted: NotRequired[bool]
    answer: NotRequired[str]
    cancelled_ms: NotRequired[int]
    session_id: NotRequired[str]
    outcome: NotRequired[Literal["verified", "refuted", "inconclusive"]]


class QueueOccupant(TypedDict):
    """The drone that has the pad: it stands there, or is permitted to act."""

    session_id: str
    uav_id: str
    action: Literal["land", "takeoff", "dock"]
    landed: bool
    since_ms: int
    until_ms: int


class QueueSummary(TypedDict):
    """A pad's queue on the live map; `/pads/{pad_id}/queue` tells all of it."""

    waiting: int
    occupant: NotRequired[QueueOccupant]
    reservation: NotRequired[Reservation]


class Reason(TypedDict):
    """Why: a code, and the facts that belong to it (`wonderland.proofs.reasons`); words for it are at the and so on."""

    code: str
    facts: dict[str, int | str]


class ReceiverHealth(TypedDict):
    """Remote ID frames heard since the agent's start."""

    frames: int
    bad: int


class RegistrationNumber(TypedDict):
    """The operator's registration number, as far as this server has it and this person may see it."""

    state: Literal["none", "here", "elsewhere", "altered"]
    number: NotRequired[str]
    held_by: NotRequired[str]


class Reservation(TypedDict):
    """A span of time in which a pad is kept for a drone."""

    reservation_id: str
    uav_id: str
    msp_id: str
    from_ms: int
    until_ms: int
    reserved_by: str
    reserved_ms: int


class SessionSignature(TypedDict):
    """Who signed a drone's broadcasts during a session, as its pad heard them."""

    state: Literal["verified", "endorsed", "unknown_signer", "refused"]
    det: str
    format: Literal["link", "wrapper", "manifest", "frame"]
    t_ms: int
    signer: NotRequired[str]
    reason: NotRequired[str]
    covers_location: NotRequired[bool]
    bound: NotRequired[bool]
    refused: NotRequired[int]


class SessionSummary(TypedDict):
    """A session as lists and the live map show it."""

    session_id: str
    pad_id: str
    uav_id: str
    action: Literal["land", "takeoff", "dock"]
    state: Literal["requested", "decided", "completed", "cancelled"]
    requested_ms: int
    expires_ms: int
    decided_ms: NotRequired[int]
    ended_ms: NotRequired[int]
    steps: list[Step]
    request_tx: str
    verdict_tx: NotRequired[str]
    complete_tx: NotRequired[str]
    outcome: NotRequired[Literal["verified", "refuted", "inconclusive"]]
    permission: NotRequired[Literal["granted", "refused"]]
    rounds: NotRequired[int]
    end: NotRequired[str]


class SpoolHealth(TypedDict):
    """What waits on the agent's disk to be taken in here."""

    records: int
    bytes: int
    dropped: int


class Spot(TypedDict):
    """A position that the drone broadcast."""

    lat_e7: int
    lon_e7: int


class Step(TypedDict):
    """One of the eight steps. Those of source `ledger` are committed; the others are an agent's word."""

    step: Literal["request", "poll", "match", "reply", "range", "confirm", "verdict", "permission"]
    t_ms: int
    ok: bool
    detail: NotRequired[str]
    source: Literal["ledger", "pad", "uav"]


class Subscription(TypedDict):
    """A webhook."""

    subscription_id: str
    owner: str
    name: str
    url: str
    types: list[str]
    pads: list[str]
    drones: list[str]
    outcomes: list[Literal["verified", "refuted", "inconclusive"]]
    state: Literal["active", "paused"]
    after: str
    created_ms: int


class SubscriptionCreated(TypedDict):
    """A new webhook, and the secret that signs what it gets: shown this once."""

    subscription: Subscription
    secret: str


class TimeDifferences(TypedDict):
    """What the time stamps of the drone's frames prove without any word of its clock."""

    pad_id: str
    frames: int
    finding: Literal["inside", "outside", "vague", "inconsistent"]
    agrees: bool
    more_frames: int
    error_mm: NotRequired[int]
    likelihood_ppm: NotRequired[int]
    covariance: NotRequired[Covariance]
    chi2_milli: NotRequired[int]


class Track(TypedDict):
    """A Remote ID position of a drone, as a pad heard it. Unverified."""

    uav_id: str
    lat_e7: int
    lon_e7: int
    height_mm: NotRequired[int]
    accuracy_mm: NotRequired[int]
    speed_mm_s: NotRequired[int]
    track_cdeg: NotRequired[int]
    vertical_mm_s: NotRequired[int]
    status: NotRequired[str]
    operator_id: NotRequired[str]
    claim_t_ms: NotRequired[int]
    rssi: NotRequired[int]
    latency_ms: NotRequired[int]
    lost: NotRequired[int]
    duplicates: NotRequired[int]
    transports: NotRequired[list[str]]
    drip: NotRequired[Drip]
    description: NotRequired[str]
    description_type: NotRequired[Literal["text", "emergency", "extended_status", "private"]]
    area_count: NotRequired[int]
    area_radius_mm: NotRequired[int]
    area_ceiling_mm: NotRequired[int]
    area_floor_mm: NotRequired[int]
    ua_type: NotRequired[int]
    height_accuracy_mm: NotRequired[int]
    t_ms: int
    pad_id: str
    transport: str
    verified: Literal[False]


class Uncertainty(TypedDict):
    """Of the measured place, horizontal: east-east, east-north, north-north."""

    ee_mm2: int
    en_mm2: int
    nn_mm2: int


class VerdictSummary(TypedDict):
    """The contract's verdict, and the transaction that it stands in."""

    session_id: str
    pad_id: str
    uav_id: str
    action: Literal["land", "takeoff", "dock"]
    outcome: Literal["verified", "refuted", "inconclusive"]
    permission: Literal["granted", "refused"]
    authorised: bool
    assurance: int
    rounds: int
    buffer_mm: int
    decided_ms: int
    evidence_sha256: str
    reasons: list[Reason]
    more_rounds: int
    signed: NotRequired[Judgement]
    broadcast: NotRequired[BroadcastFinding]
    estimate: NotRequired[Position]
    estimate_ms: NotRequired[int]
    covariance: NotRequired[Covariance]
    height: NotRequired[HeightFinding]
    chi2_milli: NotRequired[int]
    chi2_claim_milli: NotRequired[int]
    within_mm: NotRequired[int]
    time_differences: NotRequired[TimeDifferences]
    witness: NotRequired[TimeDifferences]
    clock: NotRequired[DroneClock]
    tx_id: str
    block: int
    tx_index: int


class WebhookDelivery(TypedDict):
    """A message to a subscriber."""

    delivery_id: str
    event_id: str
    type: str
    state: Literal["waiting", "delivered", "dead"]
    created_ms: int
    attempts: int
    next_ms: NotRequired[int]
    delivered_ms: NotRequired[int]
    status: NotRequired[int]
    problem: NotRequired[str]

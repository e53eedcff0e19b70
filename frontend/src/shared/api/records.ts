/**
 * The records that the console reads, named as on the ledger (docs/seams.md, wonderland/proofs/records).
 *
 * Units are in the names: `_mm`, `_ms` (since the Unix epoch), `_ppm`, `_e7` (degrees × 10⁷, WGS-84).
 */

export type Outcome = "verified" | "refuted" | "inconclusive";
export type Action = "land" | "takeoff" | "dock";
export type SessionStatus = "requested" | "decided" | "completed" | "cancelled";

export const STEP_NAMES = ["request", "poll", "match", "reply", "range", "confirm", "verdict", "permission"] as const;
/** The paper's eight steps, in order. */
export type StepName = (typeof STEP_NAMES)[number];

export type Frame = {
  lat_e7: number;
  lon_e7: number;
  height_mm: number;
  e1: number;
  e2: number;
  e3: number;
  n1: number;
  n2: number;
  n3: number;
  n4: number;
  u2: number;
  u3: number;
};

export type Anchor = {
  anchor_id: string;
  east_mm: number;
  north_mm: number;
  up_mm: number;
};

/** An anchor with its place on the globe, which the backend computes. */
export type PlacedAnchor = Anchor & { lat_e7: number; lon_e7: number };

export type Commissioning = {
  frame: Frame;
  anchors: Anchor[];
  range_sigma_mm: number;
  max_range_mm: number;
  valid_from_ms: number;
  valid_until_ms: number;
};

export type PadHealth = {
  t_ms?: number;
  connected?: boolean;
  anchors?: { anchor_id: string; state: "up" | "down" | "silent"; firmware?: string }[];
  prekeys?: number;
  version?: string;
};

export type Pad = {
  pad_id: string;
  name: string;
  operator_id: string;
  msp_id: string;
  status: "registered" | "commissioned" | "retired";
  lat_e7: number;
  lon_e7: number;
  height_mm: number;
  commissioning?: Commissioning;
  anchors?: PlacedAnchor[];
  health?: PadHealth;
};

/** A position that a drone broadcast and a pad heard. Never verified. */
export type Track = {
  uav_id: string;
  lat_e7: number;
  lon_e7: number;
  height_mm?: number;
  accuracy_mm?: number;
  speed_mm_s?: number;
  track_cdeg?: number;
  t_ms: number;
  pad_id: string;
  transport: string;
  verified: false;
};

/** A pad's running estimate while it ranges. Never verified: only the contract's verdict is. */
export type Estimate = {
  session_id: string;
  uav_id: string;
  pad_id: string;
  lat_e7: number;
  lon_e7: number;
  east_mm: number;
  north_mm: number;
  ee_mm2: number;
  en_mm2: number;
  nn_mm2: number;
  rounds: number;
  likelihood_ppm: number;
  ranges: Record<string, number>;
  t_ms: number;
  verified: false;
};

export type Step = {
  step: StepName;
  t_ms: number;
  ok: boolean;
  detail?: string;
  source: "ledger" | "pad" | "uav";
};

export type SessionState = {
  session_id: string;
  pad_id: string;
  uav_id: string;
  action: Action;
  state: SessionStatus;
  requested_ms: number;
  expires_ms?: number;
  decided_ms?: number;
  ended_ms?: number;
  steps: Step[];
  request_tx: string;
  verdict_tx?: string;
  complete_tx?: string;
  outcome?: Outcome;
  permission?: "granted" | "refused";
  rounds?: number;
  end?: string;
};

export type Reason = { code: string; text: string };

export type Position = {
  east_mm: number;
  north_mm: number;
  up_mm: number;
  lat_e7: number;
  lon_e7: number;
  height_mm: number;
};

export type Judgement = {
  outcome: Outcome;
  claim: Position;
  error_mm: number;
  likelihood_ppm: number;
  paper_rule: boolean;
  reasons: Reason[];
};

export type Covariance = { ee_mm2: number; en_mm2: number; nn_mm2: number };

/** The contract's decision, with the place of its transaction on the ledger. */
export type VerdictSummary = {
  session_id: string;
  pad_id: string;
  uav_id: string;
  action: Action;
  outcome: Outcome;
  permission: "granted" | "refused";
  authorised: boolean;
  assurance: number;
  rounds: number;
  buffer_mm: number;
  decided_ms: number;
  evidence_sha256: string;
  reasons: Reason[];
  more_rounds: number;
  signed?: Judgement;
  broadcast?: Judgement;
  estimate?: Position;
  covariance?: Covariance;
  chi2_milli?: number;
  chi2_claim_milli?: number;
  within_mm?: number;
  tx_id: string;
  block: number;
  tx_index: number;
};

export type Status = {
  ledger: {
    kind: "embedded" | "fabric" | "unknown";
    notice: string;
    channel: string;
    height: number;
    mirrored: number;
    lag_ms: number;
    connected?: boolean;
    problem?: string | null;
    halted?: string | null;
    organisations: string[];
  };
  server: { version: string; epoch: string; demo?: boolean };
  counts?: Record<string, number>;
};

export type SignedIn = { name: string; roles: string[]; signed_in_ms: number; expires_ms: number };

export type Claim = {
  lat_e7: number;
  lon_e7: number;
  height_mm: number;
  accuracy_mm: number;
  height_accuracy_mm: number;
  t_ms: number;
};

export type Policy = { buffer_mm: number; verify_ppm: number; refute_ppm: number; max_rounds: number };

export type Party = { msp_id: string; certificate_sha256: string };

export type LedgerSession = {
  session_id: string;
  claim: Claim;
  policy: Policy;
  pad: Party;
  uav: Party;
  transcript_sha256: string;
  expires_ms: number;
  note?: string | null;
};

export type Evidence = {
  ranges: { t_ms: number[]; anchors: { anchor_id: string; range_mm: number[]; nlos?: number[] | null }[] };
  claims: Claim[];
  radio: { measured_by: "pad" | "uav"; sts: "static" | "provisioned"; firmware?: string | null };
};

export type LedgerTransaction = {
  tx_id: string;
  block: number;
  tx_index: number;
  valid: boolean;
  validation: string;
  t_ms: number;
  function?: string | null;
  creator?: { msp_id: string; name: string } | null;
  endorsers: string[];
  event?: string | null;
};

/** All that is known of a session. */
export type SessionDetail = {
  summary: SessionState;
  session: LedgerSession;
  verdict?: VerdictSummary | null;
  evidence?: Evidence | null;
  transactions: LedgerTransaction[];
};

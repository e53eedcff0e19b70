/**
 * The records that the console reads, by the names of the backend's OpenAPI document (`schema.d.ts` is generated).
 *
 * Units are in the names: `_mm`, `_ms` (since the Unix epoch), `_ppm`, `_e7` (degrees × 10⁷, WGS-84).
 */
import type { components } from "./schema";

type Schemas = components["schemas"];

export type Alert = Schemas["Alert"];
export type AlertAct = Schemas["AlertAct"];
export type AlertDetail = Schemas["AlertDetail"];
export type Anchor = Schemas["Anchor"];
export type AnchorResiduals = Schemas["AnchorResiduals"];
export type BroadcastFinding = Schemas["BroadcastFinding"];
export type HeightFinding = Schemas["HeightFinding"];
export type Course = Schemas["Course"];
export type Covariance = Schemas["Covariance"];
export type Estimate = Schemas["Estimate"];
export type Evidence = Schemas["Evidence"];
export type Frame = Schemas["Frame"];
export type Hit = Schemas["Hit"];
export type Judgement = Schemas["Judgement"];
export type LedgerBlock = Schemas["LedgerBlock"];
export type LedgerBlockDetail = Schemas["LedgerBlockDetail"];
export type LedgerTransaction = Schemas["LedgerTransaction"];
export type LedgerTransactionDetail = Schemas["LedgerTransactionDetail"];
export type LedgerValue = Schemas["Value"];
export type LiveDelta = Schemas["LiveDelta"];
export type LiveHello = Schemas["LiveHello"];
export type LiveSnapshot = Schemas["LiveSnapshot"];
export type Pad = Schemas["Pad"];
export type PastMark = Schemas["PastMark"];
export type PastMarks = Schemas["PastMarks"];
export type Position = Schemas["Position"];
export type Reason = Schemas["Reason"];
export type SessionDetail = Schemas["SessionDetail"];
export type SessionSummary = Schemas["SessionSummary"];
export type SignedIn = Schemas["SignedIn"];
export type Statistics = Schemas["Statistics"];
export type Status = Schemas["Status"];
export type Step = Schemas["Step"];
export type Track = Schemas["Track"];
export type TransactionContents = Schemas["TransactionContents"];
export type VerdictSummary = Schemas["VerdictSummary"];

export type Outcome = VerdictSummary["outcome"];
export type Action = VerdictSummary["action"];
export type StepName = Step["step"];

/** The paper's eight steps, in order. */
export const STEP_NAMES = [
  "request",
  "poll",
  "match",
  "reply",
  "range",
  "confirm",
  "verdict",
  "permission",
] as const satisfies readonly StepName[];

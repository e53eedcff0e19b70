import type { LedgerTransaction, SessionDetail, StepName } from "../shared/api/records";
import { shortHash } from "../shared/format";
import { stepTexts as t } from "./texts";

/** What holds a step fast: who signed it, over what, and where it stands on the ledger. */
export type Signed = { by?: string; organisation?: string; digest?: string; transaction?: LedgerTransaction };

/** By step, as far as the record and its evidence say; the agents' other messages are sealed with the session's keys. */
export function signed({ session, transactions, evidence, verdict, summary }: SessionDetail): Partial<Record<StepName, Signed>> {
  const of = (tx_id: string | undefined): Signed => {
    const transaction = transactions.find((each) => each.tx_id === tx_id);
    if (transaction === undefined) return {};
    const { creator } = transaction;
    return { transaction, ...(creator && { by: creator.name, organisation: creator.msp_id }) };
  };
  const request = of(summary.request_tx);
  const decided = of(summary.verdict_tx);
  const sealed = { digest: t("transcript", { digest: shortHash(session.transcript_sha256) }) };
  // The countersignature is made with the key whose certificate signed the request.
  const drone = request.transaction?.creator?.certificate_sha256 === session.uav.certificate_sha256 ? request.by : shortHash(session.uav.certificate_sha256);
  return {
    request,
    poll: sealed,
    reply: sealed,
    ...(evidence?.uav_signature !== undefined && { confirm: { by: drone ?? session.uav_id, organisation: session.uav.msp_id, digest: t("signature", { digest: shortHash(evidence.uav_signature) }) } }),
    verdict: { ...decided, ...(verdict && { digest: t("evidence", { digest: shortHash(verdict.evidence_sha256) }) }) },
    // The permission is the committed verdict: nobody signs it a second time.
    ...(decided.transaction && { permission: { transaction: decided.transaction } }),
  };
}

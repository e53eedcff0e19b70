import type { ReactElement } from "react";
import { suspendHref } from "../shared/address/registryLinks";
import { EvidenceButton } from "./EvidenceButton";
import { sessionTexts as t } from "./texts";

type Properties = {
  /** Undefined where there is no session, or nothing was decided in it: then there is no evidence. */
  session_id?: string | undefined;
  uav_id?: string | undefined;
  /** The pad's name, where something was refuted there: what a suspension would be for. */
  refutedAt?: string | undefined;
};

/** What an officer does about a proof, wherever it is shown: keep the evidence, suspend the drone. */
export function ProofActions({ session_id, uav_id, refutedAt }: Properties): ReactElement {
  const reason = refutedAt !== undefined && session_id !== undefined ? t("reasonRefuted", { pad: refutedAt, session: session_id.slice(0, 12) }) : undefined;
  return (
    <>
      {session_id !== undefined && <EvidenceButton session_id={session_id} />}
      {uav_id !== undefined && (
        <a className="button danger" href={suspendHref(uav_id, reason)}>
          {t("suspend")}
        </a>
      )}
    </>
  );
}

import type { ReactElement } from "react";
import { sharedTexts } from "../texts";
import { replayHash } from "../address/replayPlace";

/** A little before what is to be seen, so that one sees it happen. */
const BEFORE_MS = 5_000;
/** A verdict is on the ledger, and known, so long after it was reached. */
const KNOWN_AFTER_MS = 2_000;

/** `decided_ms`: of a verdict, which is what there is to see then. */
type Properties = { t_ms: number; decided_ms?: number | undefined; session?: string; drone?: string };

/** To the replay of something that happened, with it selected. */
export function ReplayLink({ t_ms, decided_ms, session, drone }: Properties): ReactElement {
  const selection = { ...(session !== undefined && { session }), ...(drone !== undefined && { drone }) };
  return (
    <a className="button" href={replayHash(decided_ms === undefined ? Math.max(0, t_ms - BEFORE_MS) : decided_ms + KNOWN_AFTER_MS, selection)}>
      {sharedTexts("replayThis")}
    </a>
  );
}

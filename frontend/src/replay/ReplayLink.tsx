import type { ReactElement } from "react";
import { sharedTexts } from "../shared/texts";
import { replayHash } from "./place";

/** A little before what is to be seen, so that one sees it happen. */
const BEFORE_MS = 5_000;

type Properties = { t_ms: number; session?: string; drone?: string };

/** To the replay of something that happened, with it selected. */
export function ReplayLink({ t_ms, session, drone }: Properties): ReactElement {
  const selection = { ...(session !== undefined && { session }), ...(drone !== undefined && { drone }) };
  return (
    <a className="button" href={replayHash(Math.max(0, t_ms - BEFORE_MS), selection)}>
      {sharedTexts("replayThis")}
    </a>
  );
}

import type { ReactElement } from "react";
import type { LiveSource } from "../shared/live/source";
import type { LiveStore, Topic } from "../shared/live/store";
import { age, duration } from "../shared/format";
import { useLive, useServerNow } from "../shared/live/useLive";
import { LAG_MS } from "./Header";

const TOPICS: readonly Topic[] = ["connection", "status", "tracks"];
/** A hiccup shorter than this is not worth a word. */
const PATIENCE_MS = 1_500;

export type Warning = { tone: "bad" | "maybe"; text: string; retry: boolean };

/** What keeps the page from being true at this moment; undefined where nothing does. The gravest comes first. */
export function warning(store: LiveStore, local_ms: number): Warning | undefined {
  const { connection, status } = store;
  if (connection.phase === "waiting" || (connection.phase === "connecting" && connection.attempt > 1)) {
    const silent_ms = store.lastFrame_ms === undefined ? undefined : local_ms - store.lastFrame_ms;
    if (silent_ms === undefined || silent_ms > PATIENCE_MS) {
      const since = silent_ms === undefined ? "" : ` What you see is ${age(Math.max(2_000, silent_ms))} old.`;
      const wait_ms = connection.phase === "waiting" ? connection.retry_ms - local_ms : 0;
      const next = wait_ms > 1_000 ? ` Trying again in ${Math.round(wait_ms / 1000)} s.` : " Trying again.";
      const reason = connection.phase === "waiting" ? `: ${connection.reason}` : "";
      return { tone: "bad", text: `Not connected${reason}.${since}${next}`, retry: wait_ms > 1_000 };
    }
  }
  if (status === undefined) return undefined;
  const { halted, lag_ms, connected, problem } = status.ledger;
  if (typeof halted === "string") {
    return { tone: "bad", text: `The ledger's mirror has halted: ${halted}. No new verdict appears here until somebody looks.`, retry: false };
  }
  if (!connected) {
    const why = typeof problem === "string" && problem !== "" ? `: ${problem}` : "";
    return { tone: "bad", text: `The server has no connection to the ledger${why}. Verdicts come late.`, retry: false };
  }
  if (lag_ms > LAG_MS) {
    return { tone: "maybe", text: `The mirror is ${duration(lag_ms)} behind the ledger. Verdicts come late.`, retry: false };
  }
  return undefined;
}

export function Banner({ source }: { source: LiveSource }): ReactElement | null {
  useServerNow();
  const shown = useLive(TOPICS, (store) => warning(store, Date.now()));
  if (shown === undefined) return null;
  return (
    <div className={`banner banner-${shown.tone}`} role="alert">
      <span className="num">{shown.text}</span>
      {shown.retry && (
        <button type="button" className="button" onClick={() => source.retry()}>
          Try now
        </button>
      )}
    </div>
  );
}

import type { ReactElement } from "react";
import type { LiveSource } from "../shared/live/source";
import type { LiveStore, Topic } from "../shared/live/store";
import { age, duration } from "../shared/format";
import { useLive, useServerNow } from "../shared/live/useLive";
import { LAG_MS } from "./Header";
import { appTexts as t } from "./texts";

const TOPICS: readonly Topic[] = ["connection", "status", "tracks"];
/** A hiccup shorter than this is not worth a word. */
const PATIENCE_MS = 1_500;

/** Frames that come this much later than they could tell that the way here is too narrow. */
const CONGESTED_MS = 3_000;

export type Warning = { tone: "bad" | "maybe"; text: string; retry: boolean };

/** What keeps the page from being true at this moment; undefined where nothing does. The gravest comes first. */
export function warning(store: LiveStore, local_ms: number): Warning | undefined {
  const { connection, status } = store;
  if (connection.phase === "waiting" || (connection.phase === "connecting" && connection.attempt > 1)) {
    const silent_ms = store.lastFrame_ms === undefined ? undefined : local_ms - store.lastFrame_ms;
    if (silent_ms === undefined || silent_ms > PATIENCE_MS) {
      const since = silent_ms === undefined ? "" : ` ${t("old", { age: age(Math.max(2_000, silent_ms)) })}`;
      const wait_ms = connection.phase === "waiting" ? connection.retry_ms - local_ms : 0;
      const next = wait_ms > 1_000 ? t("tryingIn", { seconds: Math.round(wait_ms / 1000) }) : t("trying");
      const reason = connection.phase === "waiting" ? `: ${connection.reason}` : "";
      return { tone: "bad", text: `${t("notConnected", { reason })}${since} ${next}`, retry: wait_ms > 1_000 };
    }
  }
  if (connection.phase === "open" && store.delay_ms > CONGESTED_MS) {
    return { tone: "maybe", text: t("congested", { age: age(store.delay_ms) }), retry: false };
  }
  if (status === undefined) return undefined;
  const { halted, lag_ms, connected, problem } = status.ledger;
  if (typeof halted === "string") {
    return { tone: "bad", text: t("halted", { why: halted }), retry: false };
  }
  if (!connected) {
    const why = typeof problem === "string" && problem !== "" ? `: ${problem}` : "";
    return { tone: "bad", text: t("noLedger", { why }), retry: false };
  }
  if (lag_ms > LAG_MS) {
    return { tone: "maybe", text: t("lagging", { duration: duration(lag_ms) }), retry: false };
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
          {t("tryNow")}
        </button>
      )}
    </div>
  );
}

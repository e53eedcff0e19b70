import type { ReactElement } from "react";
import type { Loss } from "../shared/live/connection";
import type { LiveSource } from "../shared/live/source";
import type { LiveStore, Topic } from "../shared/live/store";
import { age, ago, duration } from "../shared/format";
import { useLive, useServerNow } from "../shared/live/useLive";
import { LAG_MS } from "./Header";
import { appTexts as t } from "./texts";

const TOPICS: readonly Topic[] = ["connection", "status", "tracks"];
/** Frames that come this much later than they could tell that the way here is too narrow. */
const CONGESTED_MS = 3_000;

export type Warning = { tone: "bad" | "maybe"; text: string; retry: boolean };

function why(loss: Loss): string {
  return typeof loss === "string" ? t(loss) : loss.said;
}

/** What keeps the page from being true at this moment; undefined where nothing does. The gravest comes first. */
export function warning(store: LiveStore, local_ms: number): Warning | undefined {
  const { connection, status } = store;
  if (store.isCutOff(local_ms)) {
    const { lastFrame_ms } = store;
    const since = lastFrame_ms === undefined ? "" : ` ${t("old", { age: age(Math.max(2_000, local_ms - lastFrame_ms)) })}`;
    const wait_ms = connection.phase === "waiting" ? connection.retry_ms - local_ms : 0;
    const next = wait_ms > 1_000 ? t("tryingIn", { seconds: Math.round(wait_ms / 1000) }) : t("trying");
    const reason = connection.phase === "waiting" ? `: ${why(connection.reason)}` : "";
    return { tone: "bad", text: `${t("notConnected", { reason })}${since} ${next}`, retry: wait_ms > 1_000 };
  }
  if (connection.phase === "open" && store.delay_ms > CONGESTED_MS) {
    return { tone: "maybe", text: t("congested", { age: age(store.delay_ms) }), retry: false };
  }
  if (status === undefined) return undefined;
  const { stale_since_ms } = status.server;
  if (typeof stale_since_ms === "number") {
    const old_ms = Math.max(2_000, store.serverNow_ms(local_ms) - stale_since_ms);
    return { tone: "bad", text: t("stale", { age: age(old_ms) }), retry: false };
  }
  const { halted, halted_since_ms, lag_ms, connected, problem } = status.ledger;
  if (typeof halted === "string") {
    return { tone: "bad", text: t("halted", { why: halted, ago: ago(halted_since_ms === undefined ? 0 : store.serverNow_ms(local_ms) - halted_since_ms) }), retry: false };
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

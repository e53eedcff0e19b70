import { useEffect, useRef, useState, type ReactElement } from "react";
import { go } from "../shared/address/location";
import { useLiveStore } from "../shared/live/useLive";
import { announce } from "./notice";
import { alertTitles } from "./texts";
import { isAsleep, isWaiting, sentence } from "./words";

/** What was said before these is long read. */
const KEPT = 20;
/** The longest that a timer takes. */
const LONGEST_MS = 2 ** 31 - 1;

/** Says each new alert, and each that wakes: to screen readers always, by sound and desktop where that was asked for. */
export function Herald(): ReactElement {
  const store = useLiveStore();
  const [said, setSaid] = useState<readonly { key: string; text: string }[]>([]);
  const known = useRef<Set<string> | undefined>(undefined);
  useEffect(() => {
    let waking: ReturnType<typeof setTimeout> | undefined;
    const look = (): void => {
      if (!store.ready) return;
      const now_ms = store.serverNow_ms();
      const alerts = [...store.alerts.values()];
      const waiting = alerts.filter((alert) => isWaiting(alert, now_ms));
      const asleep = alerts.filter((alert) => isAsleep(alert, now_ms));
      clearTimeout(waking);
      const first_ms = Math.min(...asleep.map((alert) => alert.snoozed_until_ms ?? 0));
      if (asleep.length > 0) waking = setTimeout(look, Math.min(LONGEST_MS, first_ms - now_ms + 1));
      // What was there when the page opened is no news; what sleeps will be some when it wakes.
      const before = known.current;
      known.current = new Set([...(before ?? []), ...waiting.map(({ alert_id }) => alert_id)]);
      for (const { alert_id } of asleep) known.current.delete(alert_id);
      if (before === undefined) return;
      const news = waiting.filter(({ alert_id }) => !before.has(alert_id)).map((alert) => {
        const text = sentence(alert, store.pads)
          .map((part) => (typeof part === "string" ? part : part.strong))
          .join("");
        announce(alert, alertTitles(alert.kind), text, () =>
          go({ room: "alerts", path: [alert.alert_id], query: {} }),
        );
        return { key: `${alert.alert_id}/${alert.revision}`, text };
      });
      if (news.length > 0) setSaid((earlier) => [...earlier, ...news].slice(-Math.max(KEPT, news.length)));
    };
    look();
    const end = store.subscribe(["alerts", "connection"], look);
    return () => {
      clearTimeout(waking);
      end();
    };
  }, [store]);
  return (
    <div className="visually-hidden" role="log" aria-live="assertive">
      {said.map(({ key, text }) => (
        <p key={key}>{text}</p>
      ))}
    </div>
  );
}

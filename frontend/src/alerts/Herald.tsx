import { useEffect, useRef, useState, type ReactElement } from "react";
import { go } from "../app/location";
import { useLiveStore } from "../shared/live/useLive";
import { announce } from "./notice";
import { alertTexts } from "./texts";
import { isWaiting, sentence } from "./words";

/** Says each new alert once: to screen readers always, by sound and desktop where that was asked for. */
export function Herald(): ReactElement {
  const store = useLiveStore();
  const [said, setSaid] = useState("");
  const known = useRef<Set<string> | undefined>(undefined);
  useEffect(() => {
    const look = (): void => {
      if (!store.ready) return;
      const now_ms = store.serverNow_ms();
      const waiting = [...store.alerts.values()].filter((alert) => isWaiting(alert, now_ms));
      // What was there when the page opened is no news.
      const before = known.current;
      known.current = new Set([...(before ?? []), ...waiting.map(({ alert_id }) => alert_id)]);
      if (before === undefined) return;
      for (const alert of waiting) {
        if (before.has(alert.alert_id)) continue;
        const text = sentence(alert, store.pads, now_ms)
          .map((part) => (typeof part === "string" ? part : part.strong))
          .join("");
        setSaid(text);
        announce(alert, alertTexts("title", { kind: alert.kind }), text, () =>
          go({ room: "alerts", path: [alert.alert_id], query: {} }),
        );
      }
    };
    look();
    return store.subscribe(["alerts", "connection"], look);
  }, [store]);
  return (
    <p className="visually-hidden" role="log" aria-live="assertive">
      {said}
    </p>
  );
}

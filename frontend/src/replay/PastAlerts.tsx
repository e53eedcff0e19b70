import type { ReactElement } from "react";
import { lookOf, sentence } from "../alerts/words";
import { alertTitles, inboxTexts } from "../alerts/texts";
import { age, dotted } from "../shared/format";
import { useLive, useLiveStore } from "../shared/live/useLive";
import type { Topic } from "../shared/live/store";
import { Phrases } from "../shared/ui/Sentence";
import { Symbol } from "../shared/ui/Symbol";
import { replayTexts as t } from "./texts";

const TOPICS: readonly Topic[] = ["alerts", "pads"];

type Properties = { now_ms: number; onSelect: (selection: { drone?: string; session?: string }) => void };

/** The alerts that were open, as they stood: what somebody did about them later is not known here. */
export function PastAlerts({ now_ms, onSelect }: Properties): ReactElement {
  const store = useLiveStore();
  const alerts = useLive(TOPICS, (each) => [...each.alerts.values()].sort((a, b) => b.t_ms - a.t_ms));
  if (alerts.length === 0) return <p className="empty">{t("noAlerts")}</p>;
  return (
    <ul className="past-alerts">
      {alerts.map((alert) => (
        <li key={alert.alert_id}>
          <button
            type="button"
            className="past-alert"
            disabled={alert.session_id === undefined && alert.uav_id === undefined}
            onClick={() =>
              onSelect({
                ...(alert.session_id !== undefined ? { session: alert.session_id } : alert.uav_id !== undefined && { drone: alert.uav_id }),
              })
            }
          >
            <Symbol look={lookOf(alert)} />
            <b>{alertTitles(alert.kind)}</b>
            <span className="quiet num">{age(now_ms - alert.t_ms)}</span>
            <small>
              <Phrases phrases={sentence(alert, store.pads)} />
              {alert.assigned_to !== undefined && <em> · {inboxTexts("assigned", { who: dotted(alert.assigned_to) })}</em>}
            </small>
          </button>
        </li>
      ))}
    </ul>
  );
}

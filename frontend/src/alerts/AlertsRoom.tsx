import { useEffect, useState, type ReactElement } from "react";
import { go, placeHash, type Place, type PlainRoom } from "../shared/address/location";
import { useApi, type AlertFilters } from "../shared/api/api";
import type { Alert } from "../shared/api/records";
import { usePages } from "../shared/api/usePages";
import { age, dayAndTime, dotted } from "../shared/format";
import { useLive, useLiveStore, useServerNow } from "../shared/live/useLive";
import type { LiveStore, Topic } from "../shared/live/store";
import { usePhone } from "../shared/ui/useBox";
import { More } from "../shared/ui/More";
import { Phrases } from "../shared/ui/Sentence";
import { Symbol } from "../shared/ui/Symbol";
import { AlertPanel } from "./AlertPanel";
import "./alerts.css";
import { useWishes, wishNotify, wishSound } from "./notice";
import { Several, useName, type Chosen } from "./Several";
import { alertTitles, inboxTexts as t, severalTexts } from "./texts";
import { lookOf, sentence } from "./words";

const TOPICS: readonly Topic[] = ["alerts", "pads"];
const TABS = ["inbox", "snoozed", "acknowledged", "over", "all"] as const;
type Tab = (typeof TABS)[number];
const PAGE = 50;

function mark(store: LiveStore): string {
  let newest = 0;
  for (const alert of store.alerts.values()) newest = Math.max(newest, alert.changed_ms);
  return `${store.alerts.size}/${newest}`;
}

function Wishes(): ReactElement {
  const wishes = useWishes();
  const [refused, setRefused] = useState(false);
  return (
    <div className="wishes">
      <label title={t("soundHint")}>
        <input type="checkbox" checked={wishes.sound} onChange={(event) => wishSound(event.target.checked)} />
        {t("sound")}
      </label>
      <label title={t("notifyHint")}>
        <input
          type="checkbox"
          checked={wishes.notify}
          onChange={(event) => void wishNotify(event.target.checked).then((allowed) => setRefused(!allowed))}
        />
        {t("notify")}
      </label>
      {refused && (
        <span role="alert" className="look-inconclusive">
          {t("notifyRefused")}
        </span>
      )}
    </div>
  );
}

type RowProperties = { alert: Alert; selected: boolean; href: string; now_ms: number; chosen: boolean; onChoose: (chosen: boolean) => void };

function Row({ alert, selected, href, now_ms, chosen, onChoose }: RowProperties): ReactElement {
  const store = useLiveStore();
  const nameOf = useName(now_ms);
  return (
    <li className="alert-line">
      {(alert.state === "returned" || chosen) && (
        <input type="checkbox" checked={chosen} aria-label={severalTexts("choose", { what: nameOf(alert) })} onChange={(event) => onChoose(event.target.checked)} />
      )}
      <a className="alert-row" href={href} aria-current={selected ? "true" : undefined}>
        <Symbol look={lookOf(alert)} />
        <b>{alertTitles(alert.kind)}</b>
        <span className="quiet num">{age(now_ms - alert.t_ms)}</span>
        <small>
          <Phrases phrases={sentence(alert, store.pads)} />
          {alert.state === "returned" && (
            <em className="look-verified"> · {t("returned", { when: dayAndTime(alert.over_ms ?? alert.changed_ms, now_ms) })}</em>
          )}
          {alert.assigned_to !== undefined && <em> · {t("assigned", { who: dotted(alert.assigned_to) })}</em>}
        </small>
      </a>
    </li>
  );
}

/** The inbox, and the alert that is chosen. `#/alerts?state=snoozed`, `#/alerts/<id>`. */
export function AlertsRoom({ place }: { place: Place & { room: PlainRoom } }): ReactElement {
  const api = useApi();
  const store = useLiveStore();
  const now_ms = useServerNow(5_000);
  const tab: Tab = TABS.find((each) => each === place.query["state"]) ?? "inbox";
  const [selected] = place.path;
  const [chosen, setChosen] = useState<Chosen>(new Map());
  const choose = (alert: Alert, on: boolean): void => {
    const others = [...chosen].filter(([alert_id]) => alert_id !== alert.alert_id);
    setChosen(new Map(on ? [...others, [alert.alert_id, alert]] : others));
  };
  const fresh = useLive(TOPICS, mark);
  const filters: AlertFilters = tab === "all" ? {} : { state: tab };
  const { query, rows } = usePages(
    ["alerts", tab],
    (cursor) => api.alerts({ ...filters, limit: PAGE, ...(cursor !== undefined && { cursor }) }),
    { fresh: { mark: fresh, newest: () => mark(store) } },
  );
  // Beside the list there is room for one: the first, and it stays when newer ones come, for a note may be begun on it.
  const phone = usePhone();
  const first = rows[0]?.alert_id;
  useEffect(() => {
    if (!phone && selected === undefined && first !== undefined) go({ room: "alerts", path: [first], query: place.query }, true);
  }, [phone, selected, first, place.query]);
  const hrefOf = (path: readonly string[]): string =>
    placeHash({ room: "alerts", path, query: tab === "inbox" ? {} : { state: tab } });
  return (
    <div className="page">
      <div className="page-head">
        <h1>{t("alerts")}</h1>
        <Wishes />
      </div>
      <div className="alerts" data-open={selected !== undefined}>
        <section className="float alert-list" aria-label={t("list")}>
          <div className="tabs" role="group" aria-label={t("which")}>
            {TABS.map((each) => (
              <button
                key={each}
                type="button"
                className="tab"
                aria-pressed={each === tab}
                onClick={() => go({ room: "alerts", path: [], query: each === "inbox" ? {} : { state: each } })}
              >
                {t("tab", { state: each })}
              </button>
            ))}
          </div>
          <Several rows={rows} chosen={chosen} onChoose={setChosen} hrefOf={(alert_id) => hrefOf([alert_id])} now_ms={now_ms} />
          <ul>
            {rows.map((alert) => (
              <Row
                key={alert.alert_id}
                alert={alert}
                selected={alert.alert_id === selected}
                href={hrefOf([alert.alert_id])}
                now_ms={now_ms}
                chosen={chosen.has(alert.alert_id)}
                onChoose={(on) => choose(alert, on)}
              />
            ))}
          </ul>
          <More query={query} empty={t("empty", { state: tab })} count={rows.length} />
        </section>
        <section className="float alert-panel" aria-label={t("alerts")}>
          {selected === undefined ? (
            <p className="empty">{t("choose")}</p>
          ) : (
            <AlertPanel key={selected} alert_id={selected} back={hrefOf([])} now_ms={now_ms} />
          )}
        </section>
      </div>
    </div>
  );
}

import { useMutation, useQueryClient } from "@tanstack/react-query";
import { useState, type ReactElement } from "react";
import { useApi } from "../shared/api/api";
import type { Alert } from "../shared/api/records";
import { count, dayAndTime } from "../shared/format";
import { useLiveStore } from "../shared/live/useLive";
import { useDraft } from "../shared/useDraft";
import { acknowledgeEach, type Outcome } from "./acknowledgeEach";
import { alertTitles, severalTexts as t } from "./texts";
import { isWaiting } from "./words";

/** The most that one answer of the API holds. */
const MOST = 500;

/** As they were seen when they were chosen, by their id. */
export type Chosen = ReadonlyMap<string, Alert>;

/** What an alert is called where one of many is meant. */
export function useName(now_ms: number): (alert: Alert) => string {
  const store = useLiveStore();
  return ({ kind, pad_id, uav_id, t_ms }) =>
    [alertTitles(kind), pad_id === undefined ? undefined : (store.pads.get(pad_id)?.name ?? pad_id), uav_id, dayAndTime(t_ms, now_ms)]
      .filter((part) => part !== undefined)
      .join(" · ");
}

/** Pads of which several of these are over. */
function flapping(alerts: readonly Alert[]): string[] {
  const times = new Map<string, number>();
  for (const { pad_id, state } of alerts) {
    if (pad_id !== undefined && state === "returned") times.set(pad_id, (times.get(pad_id) ?? 0) + 1);
  }
  return [...times].filter(([, number]) => number > 1).map(([pad_id]) => pad_id);
}

type Properties = {
  rows: readonly Alert[];
  chosen: Chosen;
  onChoose: (chosen: Chosen) => void;
  hrefOf: (alert_id: string) => string;
  now_ms: number;
};

/** Acknowledges several alerts whose cause has ended, as of a pad that comes and goes. */
export function Several({ rows, chosen, onChoose, hrefOf, now_ms }: Properties): ReactElement | null {
  const api = useApi();
  const client = useQueryClient();
  const store = useLiveStore();
  const nameOf = useName(now_ms);
  const [note, setNote, clearNote] = useDraft("alerts/several/note", "");
  const [done, setDone] = useState(0);
  const choosePad = useMutation({
    mutationFn: (pad: string) => api.alerts({ state: "returned", pad, limit: MOST }),
    onSuccess: ({ items }) => {
      const now = store.serverNow_ms();
      onChoose(new Map([...chosen, ...items.filter((alert) => isWaiting(alert, now)).map((alert) => [alert.alert_id, alert] as const)]));
    },
  });
  const acknowledge = useMutation<Outcome, Error, readonly Alert[]>({
    mutationFn: (alerts) => {
      setDone(0);
      const said = note.trim();
      return acknowledgeEach(alerts, ({ alert_id, revision }) => api.act(alert_id, { act: "acknowledge", revision, ...(said !== "" && { note: said }) }), setDone);
    },
    onSuccess: ({ left }) => {
      onChoose(new Map(left.map((alert) => [alert.alert_id, alert])));
      if (left.length === 0) clearNote();
    },
    onSettled: async () => {
      await client.invalidateQueries({ queryKey: ["alerts"] });
      await client.invalidateQueries({ queryKey: ["alert"] });
    },
  });
  const pads = flapping(rows);
  const outcome = acknowledge.data;
  const problem = outcome?.problem ?? acknowledge.error ?? choosePad.error;
  if (pads.length === 0 && chosen.size === 0 && outcome === undefined) return null;
  return (
    <div className="several" role="group" aria-label={t("several")}>
      {pads.length > 0 && chosen.size === 0 && <p className="quiet">{t("hint")}</p>}
      <div className="alert-actions">
        {pads.map((pad_id) => (
          <button key={pad_id} type="button" className="button" disabled={choosePad.isPending || acknowledge.isPending} onClick={() => choosePad.mutate(pad_id)}>
            {t("allOf", { pad: store.pads.get(pad_id)?.name ?? pad_id })}
          </button>
        ))}
        {chosen.size > 0 && (
          <button type="button" className="button" disabled={acknowledge.isPending} onClick={() => onChoose(new Map())}>
            {t("chooseNone")}
          </button>
        )}
      </div>
      {chosen.size > 0 && (
        <>
          <label className="field">
            {t("note", { count: chosen.size })}
            <textarea rows={2} maxLength={2000} value={note} onChange={(event) => setNote(event.target.value)} />
          </label>
          <div className="alert-actions">
            <button type="button" className="button primary" disabled={acknowledge.isPending} onClick={() => acknowledge.mutate([...chosen.values()])}>
              {t("acknowledge", { count: chosen.size })}
            </button>
          </div>
        </>
      )}
      <p role="status" className="num quiet">
        {acknowledge.isPending ? t("doing", { done: count(done), all: count(acknowledge.variables.length) }) : outcome !== undefined && t("done", { count: outcome.done })}
      </p>
      {problem !== null && (
        <p role="alert" className="alert-problem">
          {problem.message}
        </p>
      )}
      {!acknowledge.isPending && outcome !== undefined && outcome.conflicts.length > 0 && (
        <div role="alert" className="alert-problem">
          <p>{t("conflicts", { count: outcome.conflicts.length })}</p>
          <ul className="num">
            {outcome.conflicts.map((alert) => (
              <li key={alert.alert_id}>
                <a href={hrefOf(alert.alert_id)}>{nameOf(alert)}</a>
              </li>
            ))}
          </ul>
        </div>
      )}
    </div>
  );
}

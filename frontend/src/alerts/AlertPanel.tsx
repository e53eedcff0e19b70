import { useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import type { ReactElement } from "react";
import { placeHash } from "../shared/address/location";
import { transactionHref } from "../shared/address/ledgerLinks";
import { registryHref } from "../shared/address/registryLinks";
import { ReplayLink } from "../shared/ui/ReplayLink";
import { ProofActions } from "../sessions/ProofActions";
import { ApiError, useApi, type AlertAction } from "../shared/api/api";
import type { Alert, AlertAct, AlertDetail } from "../shared/api/records";
import { dayAndTime, dotted } from "../shared/format";
import { useLiveStore } from "../shared/live/useLive";
import { sharedTexts } from "../shared/texts";
import { Sentence } from "../shared/ui/Sentence";
import { Symbol } from "../shared/ui/Symbol";
import { useDraft } from "../shared/useDraft";
import { zonesHref } from "../zones/links";
import { alertTitles, inboxTexts as t } from "./texts";
import { lookOf, sentence, wantsSomebody } from "./words";

const SNOOZE_MIN = [15, 60, 480, 1440] as const;

function done(act: AlertAct, now_ms: number): string {
  const detail = act.act === "snooze" && act.detail !== undefined ? dayAndTime(Number(act.detail), now_ms) : dotted(act.detail ?? "");
  return t("act", { act: act.act, detail });
}

function History({ detail, now_ms }: { detail: AlertDetail; now_ms: number }): ReactElement {
  return (
    <>
      <h3>{t("history")}</h3>
      {detail.acts.length === 0 && <p className="quiet">{t("nothingDone")}</p>}
      <ol className="acts num">
        {detail.acts.map((act) => (
          <li key={`${act.t_ms} ${act.act} ${act.person}`}>
            <span>
              <b>{dotted(act.person)}</b> {done(act, now_ms)} <span className="quiet">· {dayAndTime(act.t_ms, now_ms)}</span>
            </span>
            {act.note !== undefined && <p className="act-note">{dotted(act.note)}</p>}
          </li>
        ))}
      </ol>
      {detail.deliveries.length > 0 && (
        <>
          <h3>{t("told")}</h3>
          <ul className="acts num">
            {detail.deliveries.map((each) => (
              <li key={each.target}>
                <span className="mono wrap">{each.target}</span>{" "}
                <span className="quiet">
                  {each.delivered_ms !== undefined
                    ? t("delivered", { when: dayAndTime(each.delivered_ms, now_ms) })
                    : t("pending", { attempts: each.attempts, problem: each.problem ?? "–" })}
                </span>
              </li>
            ))}
          </ul>
        </>
      )}
    </>
  );
}

/** Of these the contract has refuted the drone's place. */
const REFUTED: readonly Alert["kind"][] = ["refuted", "broadcast_contradicts", "stamps_contradict", "leaving"];

function Links({ alert, padName }: { alert: Alert; padName: string | undefined }): ReactElement {
  return (
    <>
      {alert.session_id !== undefined && (
        <a className="button primary" href={placeHash({ room: "sessions", session: alert.session_id })}>
          {t("showSession")}
        </a>
      )}
      {alert.session_id !== undefined && (
        <a className="button" href={placeHash({ room: "live", session: alert.session_id })}>
          {t("showMap")}
        </a>
      )}
      {alert.session_id === undefined && alert.uav_id !== undefined && (
        <a className="button primary" href={placeHash({ room: "live", drone: alert.uav_id })}>
          {t("showMap")}
        </a>
      )}
      {alert.pad_id !== undefined && alert.kind.startsWith("closures_") && (
        <a className="button primary" href={zonesHref(["pads", alert.pad_id])}>
          {t("showZones")}
        </a>
      )}
      {alert.pad_id !== undefined && alert.kind.startsWith("pad_") && (
        <a className="button primary" href={registryHref(["pads", alert.pad_id])}>
          {t("showPad")}
        </a>
      )}
      <ReplayLink
        t_ms={alert.t_ms}
        {...(alert.session_id !== undefined ? { session: alert.session_id } : alert.uav_id !== undefined && { drone: alert.uav_id })}
      />
      {alert.tx_id !== undefined && (
        <a className="button" href={transactionHref(alert.tx_id)}>
          {t("showTransaction")}
        </a>
      )}
      <ProofActions session_id={alert.session_id} uav_id={alert.uav_id} refutedAt={REFUTED.includes(alert.kind) ? padName : undefined} />
    </>
  );
}

/** One alert: what it says, what it rests on, and what one can do about it. A note that is begun survives a conflict. */
export function AlertPanel({ alert_id, back, now_ms }: { alert_id: string; back: string; now_ms: number }): ReactElement {
  const api = useApi();
  const client = useQueryClient();
  const store = useLiveStore();
  const [note, setNote, clearNote] = useDraft(`alert/${alert_id}/note`, "");
  const [assignee, setAssignee, clearAssignee] = useDraft(`alert/${alert_id}/assignee`, "");
  const query = useQuery({ queryKey: ["alert", alert_id], queryFn: () => api.alert(alert_id) });
  const act = useMutation({
    mutationFn: (wanted: Omit<AlertAction, "revision">) =>
      api.act(alert_id, { ...wanted, revision: query.data?.alert.revision ?? 0, ...(note.trim() !== "" && { note: note.trim() }) }),
    onSuccess: () => {
      clearNote();
      clearAssignee();
    },
    onSettled: async () => {
      await client.invalidateQueries({ queryKey: ["alert", alert_id] });
      await client.invalidateQueries({ queryKey: ["alerts"] });
    },
  });
  const detail = query.data;
  if (detail === undefined) {
    return (
      <p className="empty" role={query.isError ? "alert" : "status"}>
        {query.isError ? query.error.message : sharedTexts("fetching")}
      </p>
    );
  }
  const { alert } = detail;
  const conflict = act.error instanceof ApiError && act.error.status === 409;
  const ground = { critical: "bad", warning: "maybe", notice: "none" }[alert.severity];
  return (
    <>
      <header className={`told told-${ground}`}>
        <div className="told-line">
          <h2 className={`look-${lookOf(alert)}`}>
            <Symbol look={lookOf(alert)} size={24} />
            {alertTitles(alert.kind)}
          </h2>
          <a className="icon-button" href={back} title={sharedTexts("close")} aria-label={sharedTexts("close")}>
            <svg viewBox="0 0 20 20" aria-hidden="true">
              <path d="M5 5l10 10M15 5L5 15" />
            </svg>
          </a>
        </div>
        <Sentence phrases={sentence(alert, store.pads)} />
      </header>
      <div className="alert-body">
        <p className="quiet num">
          {t("severity", { severity: alert.severity })} · {t("happened")} {dayAndTime(alert.t_ms, now_ms)} ·{" "}
          {t("state", { state: alert.state, who: dotted(alert.acknowledged_by ?? ""), when: dayAndTime(alert.over_ms ?? 0, now_ms) })}
          {alert.assigned_to !== undefined && ` · ${t("assigned", { who: dotted(alert.assigned_to) })}`}
          {(alert.snoozed_until_ms ?? 0) > now_ms && ` · ${t("asleep", { until: dayAndTime(alert.snoozed_until_ms ?? 0, now_ms) })}`}
        </p>
        <div className="alert-actions">
          <Links alert={alert} padName={alert.pad_id === undefined ? undefined : (store.pads.get(alert.pad_id)?.name ?? alert.pad_id)} />
        </div>
        {act.isError && (
          <p role="alert" className="alert-problem">
            {conflict ? t("conflict") : act.error.message}
          </p>
        )}
        <label className="field">
          {t("note")}
          <textarea rows={2} maxLength={2000} value={note} placeholder={t("noteHint")} onChange={(event) => setNote(event.target.value)} />
        </label>
        <div className="alert-actions">
          {wantsSomebody(alert) ? (
            <button type="button" className="button primary" disabled={act.isPending} onClick={() => act.mutate({ act: "acknowledge" })}>
              {t("acknowledge")}
            </button>
          ) : (
            <button type="button" className="button" disabled={act.isPending} onClick={() => act.mutate({ act: "reopen" })}>
              {t("reopen")}
            </button>
          )}
          <button type="button" className="button" disabled={act.isPending || note.trim() === ""} onClick={() => act.mutate({ act: "note" })}>
            {t("addNote")}
          </button>
          <button type="button" className="button" disabled={act.isPending} onClick={() => act.mutate({ act: "assign" })}>
            {t("assignMe")}
          </button>
          {wantsSomebody(alert) && (
            <label className="inline-field">
              {t("snooze")}
              <select
                value=""
                disabled={act.isPending}
                onChange={(event) => {
                  const minutes = Number(event.target.value);
                  if (minutes > 0) act.mutate({ act: "snooze", until_ms: Math.round(store.serverNow_ms()) + minutes * 60_000 });
                }}
              >
                <option value="">…</option>
                {SNOOZE_MIN.map((minutes) => (
                  <option key={minutes} value={minutes}>
                    {t("for", { minutes: String(minutes) })}
                  </option>
                ))}
              </select>
            </label>
          )}
          <form
            className="inline-field"
            onSubmit={(event) => {
              event.preventDefault();
              if (assignee.trim() !== "") act.mutate({ act: "assign", assignee: assignee.trim() });
            }}
          >
            <label>
              {t("assignTo")} <input value={assignee} maxLength={128} onChange={(event) => setAssignee(event.target.value)} />
            </label>
            <button className="button" disabled={act.isPending || assignee.trim() === ""}>
              {t("assign")}
            </button>
          </form>
        </div>
        <History detail={detail} now_ms={now_ms} />
      </div>
    </>
  );
}

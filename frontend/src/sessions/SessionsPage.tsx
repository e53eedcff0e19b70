import type { ReactElement } from "react";
import { go, placeHash, type Filters as Chosen } from "../shared/address/location";
import { useApi } from "../shared/api/api";
import { usePages } from "../shared/api/usePages";
import type { SessionSummary } from "../shared/api/records";
import { asOf, type Look } from "../shared/drones";
import { actionVerb, dayAndTime, duration } from "../shared/format";
import { useLive, useLiveStore, useServerNow } from "../shared/live/useLive";
import type { LiveStore, Topic } from "../shared/live/store";
import { lookTexts, sharedTexts } from "../shared/texts";
import { Hash } from "../shared/ui/Hash";
import { More } from "../shared/ui/More";
import { Symbol } from "../shared/ui/Symbol";
import { Scroll } from "../shared/ui/Scroll";
import { endText } from "./ends";
import { asked, Filters } from "./Filters";
import { proofTexts, rowTexts, sessionTexts as t } from "./texts";
import { stepNumber } from "./words";

const PADS: readonly Topic[] = ["pads"];
const SESSIONS: readonly Topic[] = ["sessions"];
const PAGE = 50;

export function sessionLook(session: SessionSummary): Look {
  if (session.state === "requested") return "proving";
  return session.outcome ?? "unproved";
}

function state(session: SessionSummary): string {
  switch (session.state) {
    case "requested":
      return rowTexts("step", { step: stepNumber(session) });
    case "cancelled":
      return t("cancelled", { why: session.end ? `: ${endText(session.end)}` : "" });
    case "decided":
      return session.permission === "granted" ? t("permitted") : t("refused");
    case "completed":
      return session.end === "aborted" ? t("aborted") : t("completed");
  }
}

/** From the request to the last step that is known. */
function took(session: SessionSummary): string {
  const decided = session.steps.find(({ step }) => step === "verdict")?.t_ms ?? session.decided_ms;
  return decided === undefined || decided <= session.requested_ms ? "–" : duration(decided - session.requested_ms);
}

function newestSession(store: LiveStore): string {
  return store.sessionsByTime()[0]?.session_id ?? "";
}

function show(filters: Chosen): void {
  go({ room: "sessions", filters }, true);
}

/** All sessions, or those that are asked for; the newest first. */
export function SessionsPage({ filters }: { filters: Chosen }): ReactElement {
  const api = useApi();
  const now_ms = useServerNow(10_000);
  const pads = useLive(PADS, (store) => new Map([...store.pads.values()].map((pad) => [pad.pad_id, pad.name])));
  const store = useLiveStore();
  const mark = useLive(SESSIONS, newestSession);
  const { query, rows: listed } = usePages(
    ["sessions", filters],
    (cursor) => api.sessions({ ...asked(filters), limit: PAGE, ...(cursor !== undefined && { cursor }) }),
    { keep: true, fresh: { mark: mark, newest: () => newestSession(store) } },
  );
  const rows = listed.map(
    // What is under way moves faster than the table is fetched.
    (session) => asOf(store.sessions.get(session.session_id) ?? session, now_ms),
  );
  return (
    <div className="page">
      <div className="page-head">
        <h1>{t("sessions")}</h1>
      </div>
      <Filters filters={filters} onFilters={show} states />
      <Scroll label={t("sessions")} className="table-frame float" busy={query.isPlaceholderData}>
        <table className="table num">
          <thead>
            <tr>
              <th scope="col">{t("verdict")}</th>
              <th scope="col">{t("drone")}</th>
              <th scope="col">{t("pad")}</th>
              <th scope="col">{t("askedTo")}</th>
              <th scope="col">{t("state")}</th>
              <th scope="col">{t("requested")}</th>
              <th scope="col" className="right">
                {t("untilVerdict")}
              </th>
              <th scope="col">{t("request")}</th>
            </tr>
          </thead>
          <tbody>
            {rows.map((session) => {
              const look = sessionLook(session);
              return (
                <tr key={session.session_id}>
                  <td>
                    <a className={`outcome look-${look}`} href={placeHash({ room: "sessions", session: session.session_id })}>
                      <Symbol look={look} size={18} />
                      {session.state === "cancelled" ? proofTexts("noVerdict") : lookTexts(look)}
                    </a>
                  </td>
                  <td>
                    <b>{session.uav_id}</b>
                  </td>
                  <td>{pads.get(session.pad_id) ?? session.pad_id}</td>
                  <td>{actionVerb(session.action)}</td>
                  <td>{state(session)}</td>
                  <td>{dayAndTime(session.requested_ms, now_ms)}</td>
                  <td className="right">{took(session)}</td>
                  <td>
                    <Hash value={session.request_tx} label={sharedTexts("transaction")} />
                  </td>
                </tr>
              );
            })}
          </tbody>
        </table>
        <More query={query} empty={t(Object.keys(filters).length === 0 ? "none" : "noneFits")} count={rows.length} />
      </Scroll>
    </div>
  );
}

import { useQuery } from "@tanstack/react-query";
import { useRef, type ReactElement } from "react";
import { placeHash } from "../shared/address/location";
import { transactionHref } from "../shared/address/ledgerLinks";
import { SitePlanCard } from "../plans/SitePlanCard";
import { ReplayLink } from "../shared/ui/ReplayLink";
import { useApi } from "../shared/api/api";
import { useFresh } from "../shared/api/useFresh";
import type { Evidence, LedgerTransaction, SessionDetail, SessionSummary, VerdictSummary } from "../shared/api/records";
import { asOf } from "../shared/drones";
import { droneOf } from "../shared/fleet";
import { coordinates, count, dayAndTime, decimal, length, timeOfDay } from "../shared/format";
import { useLive, useLiveStore, useServerNow } from "../shared/live/useLive";
import type { Topic } from "../shared/live/store";
import { refutedBy } from "../shared/refuted";
import { sharedTexts } from "../shared/texts";
import { Hash } from "../shared/ui/Hash";
import { Scroll } from "../shared/ui/Scroll";
import { Bearing } from "./Bearing";
import { Broadcasts } from "./Broadcasts";
import { CourseChart } from "./CourseChart";
import { courseTexts } from "./courseTexts";
import { ProofActions } from "./ProofActions";
import { Ranges } from "./Ranges";
import { Residuals } from "./Residuals";
import { Sequence } from "./Sequence";
import { SessionMap } from "./SessionMap";
import { SessionPanel } from "./SessionPanel";
import { sessionTexts as t } from "./texts";
import { refutedAt } from "./words";

const TOPICS: readonly Topic[] = ["sessions", "verdicts", "estimates", "tracks", "pads"];

function Transactions({ transactions }: { transactions: readonly LedgerTransaction[] }): ReactElement {
  return (
    <section className="float card card-wide">
      <h2>{t("onLedger")}</h2>
      <Scroll label={t("onLedger")}>
        <table className="table num">
          <thead>
            <tr>
              <th scope="col">{t("transaction")}</th>
              <th scope="col">{t("signedBy")}</th>
              <th scope="col">{t("endorsedBy")}</th>
              <th scope="col">{t("result")}</th>
              <th scope="col" className="right">
                {t("blockColumn")}
              </th>
              <th scope="col">{t("time")}</th>
              <th scope="col">{t("id")}</th>
            </tr>
          </thead>
          <tbody>
            {transactions.map((each) => (
              <tr key={each.tx_id}>
                <td>
                  <a href={transactionHref(each.tx_id)}>
                    <b>{each.function ?? "–"}</b>
                  </a>
                </td>
                <td>{each.creator ? `${each.creator.name} · ${each.creator.msp_id}` : "–"}</td>
                <td>{each.endorsers.join(", ")}</td>
                <td>{each.validation}</td>
                <td className="right">{count(each.block)}</td>
                <td>{timeOfDay(each.t_ms)}</td>
                <td>
                  <Hash value={each.tx_id} label={sharedTexts("transaction")} />
                </td>
              </tr>
            ))}
          </tbody>
        </table>
      </Scroll>
    </section>
  );
}

/** Where the drone said it was when it asked: apart from what was judged. */
export function Request({ session, verdict, now_ms }: { session: Pick<SessionDetail["session"], "claim">; verdict: VerdictSummary | undefined; now_ms: number }): ReactElement {
  const unjudged = verdict?.reasons.some(({ code }) => code === "request_unjudged") === true;
  return (
    <section className="float card">
      <h2>{t("theRequest")}</h2>
      <p className="quiet">{t("requestHint")}</p>
      <dl className="facts num">
        <div>
          <dt>{t("askedFrom", { unjudged: unjudged ? "yes" : "no" })}</dt>
          <dd>
            {coordinates(session.claim.lat_e7, session.claim.lon_e7)} ± {length(session.claim.accuracy_mm, true)}
          </dd>
        </div>
        <div>
          <dt>{t("claimedAt")}</dt>
          <dd>{dayAndTime(session.claim.t_ms, now_ms)}</dd>
        </div>
      </dl>
    </section>
  );
}

function Measured({ verdict, now_ms }: { verdict: VerdictSummary; now_ms: number }): ReactElement | null {
  const { estimate, estimate_ms } = verdict;
  if (estimate === undefined) return null;
  return (
    <>
      <div>
        <dt>{t("measuredPlace", { by: refutedBy(verdict) ?? "" })}</dt>
        <dd>{coordinates(estimate.lat_e7, estimate.lon_e7)}</dd>
      </div>
      {estimate_ms !== undefined && (
        <div>
          <dt>{t("measuredFor")}</dt>
          <dd>{dayAndTime(estimate_ms, now_ms)}</dd>
        </div>
      )}
    </>
  );
}

function Facts({ detail, verdict, now_ms }: { detail: SessionDetail; verdict: VerdictSummary | undefined; now_ms: number }): ReactElement {
  const { session } = detail;
  const evidence: Evidence | undefined = detail.evidence ?? undefined;
  return (
    <section className="float card">
      <h2>{t("restsOn")}</h2>
      <dl className="facts num">
        {verdict !== undefined && <Measured verdict={verdict} now_ms={now_ms} />}
        <div>
          <dt>{t("policy")}</dt>
          <dd>
            {t("policyIs", {
              buffer: length(session.policy.buffer_mm, true),
              verify: share(session.policy.verify_ppm),
              refute: share(session.policy.refute_ppm),
            })}
            {t("policyAlso", {
              height: length(session.policy.height_buffer_mm, true),
              proved: session.policy.height_required ? "yes" : "no",
              broadcast: session.policy.broadcast_required,
            })}
          </dd>
        </div>
        {evidence !== undefined && (
          <div>
            <dt>{t("rangingLabel")}</dt>
            <dd>
              {t("measuredBy", { by: evidence.radio.measured_by, sts: evidence.radio.sts })}
              {evidence.radio.firmware ? `, ${evidence.radio.firmware}` : ""}
            </dd>
          </div>
        )}
        <div>
          <dt>{t("droneCertificate")}</dt>
          <dd>
            {session.uav.msp_id} <Hash value={session.uav.certificate_sha256} label={t("shaCertificate")} />
          </dd>
        </div>
        <div>
          <dt>{t("padCertificate")}</dt>
          <dd>
            {session.pad.msp_id} <Hash value={session.pad.certificate_sha256} label={t("shaCertificate")} />
          </dd>
        </div>
        <div>
          <dt>{t("transcript")}</dt>
          <dd>
            <Hash value={session.transcript_sha256} label={t("shaTranscript")} />
          </dd>
        </div>
      </dl>
    </section>
  );
}

/** 990000 → "0.99", without zeros at the end. */
function share(ppm: number): string {
  return decimal(ppm / 1e6, 6).replace(/0+$/, "");
}

function sessionMark(session: SessionSummary | undefined): string {
  return `${session?.state ?? ""}/${session?.steps.length ?? 0}`;
}

/** One session: the proof, the sequence between the parties, the ranges, and its transactions. */
export function SessionPage({ session_id }: { session_id: string }): ReactElement {
  const api = useApi();
  const store = useLiveStore();
  const now_ms = useServerNow();
  const live = useLive(TOPICS, () => ({
    session: store.sessions.get(session_id),
    verdict: store.verdicts.get(session_id),
  }));
  const fetchedRef = useRef<string | undefined>(undefined);
  const query = useQuery({
    queryKey: ["session", session_id],
    queryFn: () => {
      fetchedRef.current = sessionMark(store.sessions.get(session_id));
      return api.session(session_id);
    },
  });
  useFresh(sessionMark(live.session), query, fetchedRef);
  const known = live.session ?? query.data?.summary;
  if (known === undefined) {
    return (
      <div className="page">
        <h1 className="visually-hidden">{t("sessions")}</h1>
        <p className="empty" role={query.isError ? "alert" : "status"}>
          {query.isError ? query.error.message : sharedTexts("fetching")} <a href={placeHash({ room: "sessions" })}>{t("all")}</a>
        </p>
      </div>
    );
  }
  const session = asOf(known, now_ms);
  const verdict = live.verdict ?? query.data?.verdict ?? undefined;
  const pad = store.pads.get(session.pad_id);
  const site_plan_sha256 = query.data?.session.site_plan_sha256;
  const drone = droneOf(store, session.uav_id, now_ms);
  return (
    <div className="page">
      <div className="page-head">
        <h1>
          <a href={placeHash({ room: "sessions" })}>{t("sessions")}</a> <span className="quiet">/</span>{" "}
          <Hash value={session_id} label={t("session")} />
        </h1>
        <div className="page-actions">
          <a className="button" href={placeHash({ room: "live", session: session_id })}>
            {t("showOnMap")}
          </a>
          <ReplayLink t_ms={session.requested_ms} decided_ms={verdict?.decided_ms} session={session_id} />
          <button type="button" className="button" onClick={() => print()}>
            {courseTexts("print")}
          </button>
          <ProofActions session_id={verdict?.session_id} uav_id={session.uav_id} refutedAt={refutedAt(verdict, pad)} />
        </div>
      </div>
      <div className="session-page">
        <section className="float session-card" aria-label={t("proof")}>
          <SessionPanel drone={drone} session={session} verdict={verdict} pad={pad} now_ms={now_ms} tools={null} place="page" />
        </section>
        <div className="session-rest">
          {verdict !== undefined && <SessionMap verdict={verdict} site_plan_sha256={site_plan_sha256} />}
          {site_plan_sha256 !== undefined && <SitePlanCard pad_id={session.pad_id} sha256={site_plan_sha256} anchors={pad?.commissioning?.anchors} then />}
          <Sequence session={session} detail={query.data} />
          {verdict !== undefined && <CourseChart session_id={session_id} />}
          {verdict !== undefined && <Residuals session_id={session_id} />}
          {query.data?.evidence && <Ranges evidence={query.data.evidence} />}
          {verdict !== undefined && <Bearing level={verdict.assurance} />}
          {query.data !== undefined && <Broadcasts detail={query.data} verdict={verdict} track={drone?.track} />}
          {query.data !== undefined && <Facts detail={query.data} verdict={verdict} now_ms={now_ms} />}
          {query.data !== undefined && <Request session={query.data.session} verdict={verdict} now_ms={now_ms} />}
          {query.data !== undefined && <Transactions transactions={query.data.transactions} />}
        </div>
      </div>
    </div>
  );
}

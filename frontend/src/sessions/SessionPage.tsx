import { useQuery } from "@tanstack/react-query";
import { useRef, type ReactElement } from "react";
import { placeHash } from "../app/location";
import { useApi } from "../shared/api/api";
import { useFresh } from "../shared/api/useFresh";
import type { Evidence, LedgerTransaction, SessionDetail, SessionState } from "../shared/api/records";
import { asOf, drones } from "../shared/drones";
import { count, dayAndTime, length, timeOfDay } from "../shared/format";
import { useLive, useLiveStore, useServerNow } from "../shared/live/useLive";
import type { Topic } from "../shared/live/store";
import { Hash } from "../shared/ui/Hash";
import { Ranges } from "./Ranges";
import { Sequence } from "./Sequence";
import { SessionPanel } from "./SessionPanel";

const TOPICS: readonly Topic[] = ["sessions", "verdicts", "estimates", "tracks", "pads"];

function Transactions({ transactions }: { transactions: readonly LedgerTransaction[] }): ReactElement {
  return (
    <section className="float card">
      <h2>On the ledger</h2>
      <div className="scroll">
        <table className="table num">
          <thead>
            <tr>
              <th scope="col">Transaction</th>
              <th scope="col">Signed by</th>
              <th scope="col">Endorsed by</th>
              <th scope="col">Result</th>
              <th scope="col" className="right">
                Block
              </th>
              <th scope="col">Time</th>
              <th scope="col">Id</th>
            </tr>
          </thead>
          <tbody>
            {transactions.map((each) => (
              <tr key={each.tx_id}>
                <td>
                  <b>{each.function ?? "–"}</b>
                </td>
                <td>{each.creator ? `${each.creator.name} · ${each.creator.msp_id}` : "–"}</td>
                <td>{each.endorsers.join(", ")}</td>
                <td>{each.validation}</td>
                <td className="right">{count(each.block)}</td>
                <td>{timeOfDay(each.t_ms)}</td>
                <td>
                  <Hash value={each.tx_id} label="transaction" />
                </td>
              </tr>
            ))}
          </tbody>
        </table>
      </div>
    </section>
  );
}

function Facts({ detail, now_ms }: { detail: SessionDetail; now_ms: number }): ReactElement {
  const { session } = detail;
  const evidence: Evidence | undefined = detail.evidence ?? undefined;
  return (
    <section className="float card">
      <h2>What it rests on</h2>
      <dl className="facts num">
        <div>
          <dt>Claim in the request</dt>
          <dd>
            {(session.claim.lat_e7 / 1e7).toFixed(7)}, {(session.claim.lon_e7 / 1e7).toFixed(7)} ± {length(session.claim.accuracy_mm, true)}
          </dd>
        </div>
        <div>
          <dt>Claimed at</dt>
          <dd>{dayAndTime(session.claim.t_ms, now_ms)}</dd>
        </div>
        <div>
          <dt>Policy</dt>
          <dd>
            buffer {length(session.policy.buffer_mm, true)}, verified from {session.policy.verify_ppm / 1e6}, refuted to{" "}
            {session.policy.refute_ppm / 1e6}
          </dd>
        </div>
        {evidence !== undefined && (
          <div>
            <dt>Ranging</dt>
            <dd>
              measured by the {evidence.radio.measured_by === "pad" ? "pad" : "drone"},{" "}
              {evidence.radio.sts === "provisioned" ? "time stamps keyed for this session" : "public time stamps"}
              {evidence.radio.firmware ? `, ${evidence.radio.firmware}` : ""}
            </dd>
          </div>
        )}
        <div>
          <dt>Drone’s certificate</dt>
          <dd>
            {session.uav.msp_id} <Hash value={session.uav.certificate_sha256} label="SHA-256 of the certificate" />
          </dd>
        </div>
        <div>
          <dt>Pad’s certificate</dt>
          <dd>
            {session.pad.msp_id} <Hash value={session.pad.certificate_sha256} label="SHA-256 of the certificate" />
          </dd>
        </div>
        <div>
          <dt>Transcript</dt>
          <dd>
            <Hash value={session.transcript_sha256} label="SHA-256 of the transcript" />
          </dd>
        </div>
      </dl>
    </section>
  );
}

function sessionMark(session: SessionState | undefined): string {
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
    drones: drones(store, now_ms),
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
        <p className="empty" role={query.isError ? "alert" : "status"}>
          {query.isError ? query.error.message : "Fetching…"} <a href={placeHash({ room: "sessions" })}>All sessions</a>
        </p>
      </div>
    );
  }
  const session = asOf(known, now_ms);
  const verdict = live.verdict ?? query.data?.verdict ?? undefined;
  const pad = store.pads.get(session.pad_id);
  const drone = live.drones.find(({ uav_id }) => uav_id === session.uav_id);
  return (
    <div className="page">
      <div className="page-head">
        <h1>
          <a href={placeHash({ room: "sessions" })}>Sessions</a> <span className="quiet">/</span>{" "}
          <Hash value={session_id} label="session" />
        </h1>
        <a className="button" href={placeHash({ room: "live", session: session_id })}>
          Show on the map
        </a>
      </div>
      <div className="session-page">
        <section className="float session-card" aria-label="Proof">
          <SessionPanel drone={drone} session={session} verdict={verdict} pad={pad} now_ms={now_ms} tools={null} place="page" />
        </section>
        <div className="session-rest">
          <Sequence session={session} />
          {query.data?.evidence && <Ranges evidence={query.data.evidence} />}
          {query.data !== undefined && <Transactions transactions={query.data.transactions} />}
          {query.data !== undefined && <Facts detail={query.data} now_ms={now_ms} />}
        </div>
      </div>
    </div>
  );
}

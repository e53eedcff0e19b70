import { useQuery } from "@tanstack/react-query";
import type { ReactElement, ReactNode } from "react";
import { placeHash } from "../app/location";
import { useApi } from "../shared/api/api";
import type { Judgement, Pad, SessionState, VerdictSummary } from "../shared/api/records";
import { LOOK_WORDS, TONE_OF } from "../shared/design/symbols";
import type { Drone, Look } from "../shared/drones";
import { age, count, length, likelihood } from "../shared/format";
import { frameOf, toLocal } from "../shared/geo/frame";
import { Hash } from "../shared/ui/Hash";
import { Symbol } from "../shared/ui/Symbol";
import { PadPlot, type PlotClaim, type PlotEstimate } from "./PadPlot";
import { Sentence } from "./Sentence";
import { Steps } from "./Steps";
import { account, progress, unproved, type Account } from "./words";

function Head({ told, tools }: { told: Account; tools: ReactNode }): ReactElement {
  const { look } = told;
  const ground = look === "verified" || look === "refuted" || look === "inconclusive" ? TONE_OF[look] : "none";
  return (
    <header className={`told told-${ground}`}>
      <div className="told-line">
        <h2 className={`look-${look}`} key={told.title}>
          <Symbol look={look} size={24} />
          {told.title}
        </h2>
        {tools}
      </div>
      <Sentence phrases={told.sentence} />
    </header>
  );
}

function Figure({ name, value, hint }: { name: string; value: string; hint?: string }): ReactElement {
  return (
    <div title={hint}>
      <dt>{name}</dt>
      <dd>{value}</dd>
    </div>
  );
}

function Judged({ title, judgement }: { title: string; judgement: Judgement }): ReactElement {
  return (
    <li>
      <Symbol look={judgement.outcome} size={16} />
      <span>
        <b>{title}</b> {LOOK_WORDS[judgement.outcome].toLowerCase()}, {length(judgement.error_mm)} off, likelihood{" "}
        {likelihood(judgement.likelihood_ppm)}.
        <span className="quiet"> The paper’s rule {judgement.paper_rule ? "accepts" : "refuses"} it.</span>
      </span>
    </li>
  );
}

/** Why: both claims apart, then the reasons of the contract, word for word. */
function Why({ verdict }: { verdict: VerdictSummary }): ReactElement {
  return (
    <section className="why">
      <h3>Claims</h3>
      <ul className="judged num">
        {verdict.signed ? <Judged title="Signed for the pad:" judgement={verdict.signed} /> : <li>No signed claim could be judged.</li>}
        {verdict.broadcast ? (
          <Judged title="Broadcast to the public:" judgement={verdict.broadcast} />
        ) : (
          <li className="quiet">No broadcast was heard during the session.</li>
        )}
      </ul>
      <h3>Why</h3>
      <ul className="reasons">
        {verdict.reasons.map((reason) => (
          <li key={reason.code + reason.text}>{reason.text}</li>
        ))}
      </ul>
      <p className="note num">
        Block {count(verdict.block)} · evidence <Hash value={verdict.evidence_sha256} label="SHA-256 of the evidence" />
        {verdict.within_mm ? ` · proven within ${length(verdict.within_mm, true)} of the pad` : ""}
      </p>
    </section>
  );
}

function figures(verdict: VerdictSummary): ReactElement {
  const worst = verdict.broadcast?.outcome === "refuted" && verdict.signed?.outcome !== "refuted" ? verdict.broadcast : verdict.signed;
  return (
    <dl className="figures num">
      <Figure name="Likelihood" value={worst ? likelihood(worst.likelihood_ppm) : "–"} hint="That the drone is within the buffer of its claim" />
      <Figure name="Error" value={worst ? length(worst.error_mm) : "–"} hint="From the claim to the measurement" />
      <Figure name="Rounds" value={count(verdict.rounds)} hint="Usable rounds of ranging" />
      <Figure
        name="Assurance"
        value={`${verdict.assurance} of 4`}
        hint="0 drone-reported ranges, 1 measured by the pad, 2 with keyed time stamps, 3 with time differences, 4 with a second pad"
      />
    </dl>
  );
}

function verdictPlot(verdict: VerdictSummary, pad: Pad): ReactElement {
  const { signed, broadcast, estimate, covariance } = verdict;
  const claims: PlotClaim[] = [];
  const differ = broadcast?.outcome === "refuted" && signed?.outcome !== "refuted";
  const buffer = `${length(verdict.buffer_mm, true)} buffer`;
  if (signed) {
    const tone = TONE_OF[signed.outcome === "verified" ? "verified" : verdict.outcome];
    claims.push({ at: signed.claim, tone, words: differ ? "signed claim" : `claim, ${buffer}` });
  }
  if (broadcast && differ) claims.push({ at: broadcast.claim, tone: "bad", words: `broadcast, ${buffer}` });
  const measured: PlotEstimate | undefined = estimate
    ? { at: estimate, covariance: covariance ?? undefined, tone: TONE_OF[verdict.outcome], verified: true }
    : undefined;
  return <PadPlot pad={pad} buffer_mm={verdict.buffer_mm} claims={claims} estimate={measured} />;
}

function livePlot(drone: Drone, pad: Pad, buffer_mm: number): ReactElement {
  const { track, estimate } = drone;
  const claims: PlotClaim[] = track ? [{ at: toLocal(frameOf(pad), track), tone: "accent", words: "broadcast" }] : [];
  return (
    <PadPlot
      pad={pad}
      buffer_mm={buffer_mm}
      claims={claims}
      estimate={estimate ? { at: estimate, covariance: estimate, tone: "accent", verified: false } : undefined}
    />
  );
}

type Properties = {
  drone: Drone | undefined;
  session: SessionState | undefined;
  verdict: VerdictSummary | undefined;
  pad: Pad | undefined;
  now_ms: number;
  tools: ReactNode;
  /** Beside the map, or on the session's own page, to which no link is needed there. */
  place?: "map" | "page";
};

const DEFAULT_BUFFER_MM = 1_000;

/** One drone's proof: the answer in words, the figures, the picture, the steps, and why. */
export function SessionPanel({ drone, session, verdict, pad, now_ms, tools, place = "map" }: Properties): ReactElement | null {
  const api = useApi();
  const running = session?.state === "requested";
  const detail = useQuery({
    queryKey: ["session", session?.session_id, "policy"],
    queryFn: () => api.session(session?.session_id ?? ""),
    enabled: running,
    staleTime: Infinity,
  });
  if (session === undefined) {
    if (drone === undefined) return null;
    return (
      <>
        <Head told={unproved(drone)} tools={tools} />
        <Unproved drone={drone} now_ms={now_ms} />
      </>
    );
  }
  const told = verdict !== undefined ? account(verdict, pad) : progress(session, drone, pad);
  const estimate = drone?.estimate?.session_id === session.session_id ? drone.estimate : undefined;
  const buffer_mm = detail.data?.session.policy.buffer_mm ?? DEFAULT_BUFFER_MM;
  return (
    <>
      <Head told={told} tools={tools} />
      <div className="panel-body">
        {verdict !== undefined && figures(verdict)}
        {running && estimate !== undefined && (
          <dl className="figures num">
            <Figure name="Likelihood" value={likelihood(estimate.likelihood_ppm)} />
            <Figure name="Rounds" value={count(estimate.rounds)} />
            <Figure name="Status" value="unverified" hint="A running estimate of the pad; only the contract's verdict counts" />
          </dl>
        )}
        {pad !== undefined && verdict !== undefined && verdictPlot(verdict, pad)}
        {pad !== undefined && verdict === undefined && running && drone !== undefined && livePlot(drone, pad, buffer_mm)}
        <Steps session={session} />
        {verdict !== undefined && <Why verdict={verdict} />}
      </div>
      <footer className="panel-foot">
        {place === "map" && (
          <a className="button primary" href={placeHash({ room: "sessions", session: session.session_id })}>
            Open session
          </a>
        )}
        <span className="quiet num">
          {running ? "asked" : "decided"} {ago(now_ms - (verdict?.decided_ms ?? session.requested_ms))}
        </span>
      </footer>
    </>
  );
}

function ago(ms: number): string {
  const text = age(ms);
  return text === "now" ? "just now" : `${text} ago`;
}

const HINTS: Partial<Record<Look, string>> = {
  unproved: "A proof begins when the drone asks a pad to land, take off or dock.",
  "out-of-range": "A proof begins when the drone comes within a pad’s range and asks.",
  silent: "Its last broadcast stays on the map until it is heard again.",
};

function Unproved({ drone, now_ms }: { drone: Drone; now_ms: number }): ReactElement {
  const { track } = drone;
  return (
    <div className="panel-body">
      {track !== undefined && (
        <dl className="facts num">
          <div>
            <dt>Last heard</dt>
            <dd>
              {ago(now_ms - track.t_ms)} by {track.pad_id}
            </dd>
          </div>
          <div>
            <dt>Position</dt>
            <dd>
              {(track.lat_e7 / 1e7).toFixed(5)}, {(track.lon_e7 / 1e7).toFixed(5)}
            </dd>
          </div>
          {track.height_mm !== undefined && (
            <div>
              <dt>Height</dt>
              <dd>{length(track.height_mm, true)} above the ellipsoid</dd>
            </div>
          )}
          {track.accuracy_mm !== undefined && (
            <div>
              <dt>Own accuracy</dt>
              <dd>{length(track.accuracy_mm, true)}</dd>
            </div>
          )}
          {track.speed_mm_s !== undefined && (
            <div>
              <dt>Speed</dt>
              <dd>{(track.speed_mm_s / 1000).toFixed(1)} m/s</dd>
            </div>
          )}
        </dl>
      )}
      <p className="note">
        <span className="tag">unverified</span> {HINTS[drone.look]}
      </p>
    </div>
  );
}

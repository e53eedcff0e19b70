import { useQuery } from "@tanstack/react-query";
import type { ReactElement, ReactNode } from "react";
import { placeHash } from "../shared/address/location";
import { ReplayLink } from "../shared/ui/ReplayLink";
import { useApi } from "../shared/api/api";
import type { BroadcastFinding, Estimate, HeightFinding, Judgement, Pad, SessionSummary, VerdictSummary } from "../shared/api/records";
import { TONE_OF } from "../shared/design/symbols";
import type { Drone, Look } from "../shared/drones";
import { ago, coordinates, count, length, likelihood, speed } from "../shared/format";
import { frameOf, toLocal, type Local } from "../shared/geo/frame";
import { broadcastApart, heightOff, refutedBy } from "../shared/refuted";
import { lookTexts } from "../shared/texts";
import { Hash } from "../shared/ui/Hash";
import { Sentence } from "../shared/ui/Sentence";
import { Symbol } from "../shared/ui/Symbol";
import { PadPlot, type PlotClaim, type PlotEstimate } from "./PadPlot";
import { ProofActions } from "./ProofActions";
import { reasonText } from "./reasons";
import { Steps } from "./Steps";
import { sessionTexts as t } from "./texts";
import { account, differing, progress, refutedAt, unproved, type Account } from "./words";

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

/** `despite`: refuted although the ranges fit, so that their error and likelihood explain nothing. */
function Judged({ title, judgement, despite = false }: { title: string; judgement: Judgement; despite?: boolean }): ReactElement {
  return (
    <li>
      <Symbol look={judgement.outcome} size={16} />
      <span>
        <b>{title}</b>{" "}
        {t(despite ? "byRanges" : "judged", {
          outcome: lookTexts(judgement.outcome).toLowerCase(),
          error: length(judgement.error_mm),
          likelihood: likelihood(judgement.likelihood_ppm),
        })}
        <span className="quiet">{t("paperRule", { accepts: judgement.paper_rule ? "yes" : "no" })}</span>
      </span>
    </li>
  );
}

const HEARD_LOOK: Readonly<Record<BroadcastFinding["outcome"], Look>> = {
  supported: "verified",
  own_contradicted: "refuted",
  // Nobody knows whose it is: no verdict, and none of the colours of verdicts.
  contradicted: "unproved",
  undecided: "unproved",
  not_heard: "unproved",
};

/** What was broadcast under the drone's number: a finding of its own, beside the verdict on what the drone signed. */
export function Heard({ finding }: { finding: BroadcastFinding }): ReactElement {
  const { outcome, messages, attributed, supported, error_mm, tolerance_mm } = finding;
  return (
    <ul className="judged num">
      <li>
        <Symbol look={HEARD_LOOK[outcome]} size={16} />
        <span>
          <b>{t("heardIs", { outcome })}</b>{" "}
          {error_mm !== undefined && tolerance_mm !== undefined && t("heardFrom", { error: length(error_mm), tolerance: length(tolerance_mm, true) })}{" "}
          {outcome === "contradicted" && t("heardBeside", { supported: supported ? "yes" : "no" })}
          {messages > 0 && <span className="quiet"> {t("heardCount", { messages, attributed })}</span>}
        </span>
      </li>
    </ul>
  );
}

const HEIGHT_LOOK: Readonly<Record<HeightFinding["outcome"], Look>> = { proved: "verified", contradicted: "refuted", claimed: "unproved" };

/** Whether the height is measured or the drone's word, and what the ranges leave open of it. */
export function HeightFound({ finding }: { finding: HeightFinding }): ReactElement {
  const { outcome, claimed_mm, measured_mm, lowest_mm, highest_mm, tolerance_mm } = finding;
  return (
    <ul className="judged num">
      <li>
        <Symbol look={HEIGHT_LOOK[outcome]} size={16} />
        <span>
          <b>{t("heightIs", { outcome })}</b> {t("heightMeasured", { measured: length(measured_mm), claimed: length(claimed_mm) })}
          <span className="quiet">
            {" "}
            {t("heightOpen", { low: length(lowest_mm), high: length(highest_mm) })}
            {outcome === "contradicted" && ` ${t("heightTolerated", { tolerance: length(tolerance_mm, true) })}`}
          </span>
        </span>
      </li>
    </ul>
  );
}

/** Why: what it signed and what was broadcast apart, then the reasons of the contract, word for word. */
function Why({ verdict }: { verdict: VerdictSummary }): ReactElement {
  return (
    <section className="why">
      <h3>{t("claims")}</h3>
      <ul className="judged num">
        {verdict.signed ? <Judged title={t("signedFor")} judgement={verdict.signed} despite={despiteRanges(verdict)} /> : <li>{t("noSigned")}</li>}
      </ul>
      <h3>{t("heightTitle")}</h3>
      {verdict.height ? <HeightFound finding={verdict.height} /> : <p className="quiet">{t(verdict.signed ? "noHeight" : "notJudged")}</p>}
      <h3>{t("publicTold")}</h3>
      {verdict.broadcast ? <Heard finding={verdict.broadcast} /> : <p className="quiet">{t(verdict.signed ? "noBroadcast" : "notJudged")}</p>}
      <h3>{t("why")}</h3>
      <ul className="reasons">
        {verdict.reasons.map((reason, i) => (
          <li key={i}>{reasonText(reason)}</li>
        ))}
      </ul>
      <p className="note num">
        {t("block", { block: count(verdict.block) })} <Hash value={verdict.evidence_sha256} label={t("shaEvidence")} />
        {verdict.within_mm ? t("provenWithin", { distance: length(verdict.within_mm, true) }) : ""}
      </p>
    </section>
  );
}

function despiteRanges(verdict: VerdictSummary): boolean {
  const by = refutedBy(verdict);
  return by === "stamps" || by === "leaving" || by === "height";
}

function shown(value_mm: number | undefined): string {
  return value_mm === undefined ? "–" : length(value_mm);
}

function figures(verdict: VerdictSummary): ReactElement {
  const by = refutedBy(verdict);
  const worst = by === "broadcast" ? verdict.broadcast : verdict.signed;
  const stamps_mm = by === "stamps" ? differing(verdict) : undefined;
  const height_mm = by === "height" ? heightOff(verdict) : undefined;
  if (height_mm !== undefined) {
    return (
      <dl className="figures num">
        <Figure name={t("heightError")} value={length(height_mm)} hint={t("heightErrorHint")} />
        <Figure name={t("rangesError")} value={shown(worst?.error_mm)} hint={t("rangesErrorHint")} />
        <Figure name={t("rounds")} value={count(verdict.rounds)} hint={t("roundsHint")} />
        <Figure name={t("assurance")} value={t("assuranceOf", { level: verdict.assurance })} hint={t("assuranceHint")} />
      </dl>
    );
  }
  return (
    <dl className="figures num">
      {stamps_mm === undefined ? (
        <Figure name={t("likelihood")} value={worst?.likelihood_ppm !== undefined && !despiteRanges(verdict) ? likelihood(worst.likelihood_ppm) : "–"} hint={t("likelihoodHint")} />
      ) : (
        <Figure name={t("stampsError")} value={length(stamps_mm, true)} hint={t("stampsErrorHint")} />
      )}
      {despiteRanges(verdict) ? (
        <Figure name={t("rangesError")} value={shown(worst?.error_mm)} hint={t("rangesErrorHint")} />
      ) : (
        <Figure name={t("error")} value={shown(worst?.error_mm)} hint={t("errorHint")} />
      )}
      <Figure name={t("rounds")} value={count(verdict.rounds)} hint={t("roundsHint")} />
      <Figure name={t("assurance")} value={t("assuranceOf", { level: verdict.assurance })} hint={t("assuranceHint")} />
    </dl>
  );
}

function verdictPlot(verdict: VerdictSummary, pad: Pad): ReactElement {
  const { signed, broadcast, estimate, covariance, buffer_mm } = verdict;
  const claims: PlotClaim[] = [];
  const apart = broadcastApart(verdict);
  if (signed) {
    const tone = TONE_OF[signed.outcome === "verified" ? "verified" : verdict.outcome];
    const words = apart !== undefined ? t("signedClaim") : t("claimBuffer", { buffer: length(buffer_mm, true) });
    claims.push({ at: signed.claim, tone, words, radius_mm: buffer_mm });
  }
  if (broadcast?.claim !== undefined && apart !== undefined) {
    const radius_mm = broadcast.tolerance_mm ?? buffer_mm;
    claims.push({ at: broadcast.claim, tone: apart === "own" ? "bad" : "none", words: t("broadcastBuffer", { buffer: length(radius_mm, true) }), radius_mm });
  }
  const measured: PlotEstimate | undefined = estimate
    ? { at: estimate, covariance: covariance ?? undefined, tone: TONE_OF[verdict.outcome], verified: true }
    : undefined;
  return <PadPlot pad={pad} claims={claims} estimate={measured} />;
}

function truthOf({ truth_east_mm, truth_north_mm }: Estimate): Local | undefined {
  return truth_east_mm === undefined || truth_north_mm === undefined ? undefined : { east_mm: truth_east_mm, north_mm: truth_north_mm };
}

function livePlot(drone: Drone, pad: Pad, buffer_mm: number): ReactElement {
  const { track, estimate } = drone;
  const claims: PlotClaim[] = track ? [{ at: toLocal(frameOf(pad), track), tone: "accent", words: t("broadcast"), radius_mm: buffer_mm }] : [];
  return (
    <PadPlot
      pad={pad}
      claims={claims}
      estimate={estimate ? { at: estimate, covariance: estimate, tone: "accent", verified: false } : undefined}
      truth={estimate ? truthOf(estimate) : undefined}
    />
  );
}

type Properties = {
  drone: Drone | undefined;
  session: SessionSummary | undefined;
  verdict: VerdictSummary | undefined;
  pad: Pad | undefined;
  now_ms: number;
  tools: ReactNode;
  /** Beside the map, live or past, or on the session's own page: what one is at needs no link. */
  place?: "map" | "past" | "page";
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
        {place === "map" && drone.track !== undefined && (
          <footer className="panel-foot">
            <ReplayLink t_ms={drone.track.t_ms} drone={drone.uav_id} />
          </footer>
        )}
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
            <Figure name={t("likelihood")} value={likelihood(estimate.likelihood_ppm)} />
            <Figure name={t("rounds")} value={count(estimate.rounds)} />
            <Figure name={t("status")} value={t("unverified")} hint={t("unverifiedHint")} />
          </dl>
        )}
        {pad !== undefined && verdict !== undefined && verdictPlot(verdict, pad)}
        {pad !== undefined && verdict === undefined && running && drone !== undefined && livePlot(drone, pad, buffer_mm)}
        {place === "map" && <Says track={drone?.track} />}
        <Steps session={session} />
        {verdict !== undefined && <Why verdict={verdict} />}
        <p className="note panel-when num">
          {t(running ? "asked" : "decided", { ago: ago(now_ms - (verdict?.decided_ms ?? session.requested_ms)) })}
        </p>
      </div>
      <footer className="panel-foot">
        {place !== "page" && (
          <a className="button primary" href={placeHash({ room: "sessions", session: session.session_id })}>
            {t("open")}
          </a>
        )}
        {place === "map" && (
          <>
            {!running && <ReplayLink t_ms={session.requested_ms} decided_ms={verdict?.decided_ms} session={session.session_id} />}
            <ProofActions session_id={verdict?.session_id} uav_id={session.uav_id} refutedAt={refutedAt(verdict, pad)} />
          </>
        )}
      </footer>
    </>
  );
}

function hint(look: Look): string {
  if (look === "silent") return t("hintSilent");
  return look === "out-of-range" ? t("hintFar") : t("hintUnproved");
}

/** What the operator's own text says (Self ID), and of how many drones: anybody's word, shown as text and nothing else. */
export function Says({ track }: { track: Drone["track"] }): ReactElement | null {
  if (track?.description === undefined && track?.area_count === undefined) return null;
  const emergency = track.description_type === "emergency";
  return (
    <dl className="facts">
      {track.description !== undefined && (
        <div>
          <dt>{t("says", { kind: track.description_type ?? "text" })}</dt>
          <dd>{emergency ? <strong>“{track.description}”</strong> : `“${track.description}”`}</dd>
        </div>
      )}
      {track.area_count !== undefined && (
        <div>
          <dt>{t("group")}</dt>
          <dd>{t("groupOf", { count: count(track.area_count), radius: length(track.area_radius_mm ?? 0, true) })}</dd>
        </div>
      )}
    </dl>
  );
}

function Unproved({ drone, now_ms }: { drone: Drone; now_ms: number }): ReactElement {
  const { track } = drone;
  return (
    <div className="panel-body">
      {track !== undefined && (
        <dl className="facts num">
          <div>
            <dt>{t("lastHeard")}</dt>
            <dd>
              {t("agoBy", { ago: ago(now_ms - track.t_ms), pad: track.pad_id })}
            </dd>
          </div>
          <div>
            <dt>{t("position")}</dt>
            <dd>
              {coordinates(track.lat_e7, track.lon_e7)}
            </dd>
          </div>
          {track.height_mm !== undefined && (
            <div>
              <dt>{t("height")}</dt>
              <dd>{t("aboveEllipsoid", { height: length(track.height_mm, true) })}</dd>
            </div>
          )}
          {track.accuracy_mm !== undefined && (
            <div>
              <dt>{t("ownAccuracy")}</dt>
              <dd>{length(track.accuracy_mm, true)}</dd>
            </div>
          )}
          {track.speed_mm_s !== undefined && (
            <div>
              <dt>{t("speed")}</dt>
              <dd>{speed(track.speed_mm_s)}</dd>
            </div>
          )}
        </dl>
      )}
      <Says track={track} />
      <p className="note">
        <span className="tag">{t("unverified")}</span> {hint(drone.look)}
      </p>
    </div>
  );
}

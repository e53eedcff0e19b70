import type { Page } from "../api/api";
import type { Course, SessionDetail, SessionSummary, VerdictSummary } from "../api/records";
import type { LiveStore } from "../live/store";
import { sessionOf } from "../drones";
import { FAKE_ME, FAKE_PERSON, FAKE_WAYS_IN } from "./people";
import { hex, noise, seeded } from "./random";

function json(value: unknown, status = 200): Response {
  return new Response(JSON.stringify(value), { status, headers: { "Content-Type": "application/json" } });
}

function page<T>(items: readonly T[], query: URLSearchParams, keep: (item: T) => boolean): Page<T> {
  const kept = items.filter(keep);
  const start = Number(query.get("cursor") ?? 0);
  const limit = Number(query.get("limit") ?? 50);
  const next = start + limit < kept.length ? { next: String(start + limit) } : {};
  return { items: kept.slice(start, start + limit), ...next };
}

const POLICY: SessionDetail["session"]["policy"] = {
  buffer_mm: 1_000,
  verify_ppm: 990_000,
  refute_ppm: 10_000,
  min_assurance: 1,
  min_rounds: 10,
  max_rounds: 160,
  max_claim_age_ms: 10_000,
  max_clock_skew_ms: 5_000,
  min_request_gap_ms: 0,
  cancel_hopeless: false,
  broadcast_required: "if_contradicted",
  height_buffer_mm: 1_000,
  height_required: false,
  session_ttl_ms: 60_000,
  max_claim_accuracy_mm: 20_000,
  require_authorisation: true,
  require_maintenance: true,
};

/** What the receiver of a pad that was lied to may have heard. */
function oddities(session: SessionSummary): SessionDetail["findings"] {
  const of = { uav_id: session.uav_id, pad_id: session.pad_id, verified: false } as const;
  return [
    { ...of, kind: "two_places", t_ms: session.requested_ms + 900, count: 1, distance_mm: 412_000, interval_ms: 300, transport: "ble4", other_transport: "wifi-nan" },
    { ...of, kind: "time_backwards", t_ms: session.requested_ms + 2_100, count: 4, interval_ms: 74_000, transport: "ble4" },
  ];
}

function detail(session: SessionSummary, verdict: VerdictSummary | undefined, store: LiveStore): SessionDetail {
  const pad = store.pads.get(session.pad_id);
  const anchors = pad?.commissioning?.anchors ?? [];
  const at = verdict?.signed?.claim ?? { lat_e7: pad?.lat_e7 ?? 0, lon_e7: pad?.lon_e7 ?? 0, east_mm: 0, north_mm: 0 };
  const rounds = session.rounds ?? 0;
  const random = seeded(session.requested_ms);
  const found = verdict?.estimate ?? at;
  const transaction = (tx_id: string, name: string, block: number, t_ms: number): SessionDetail["transactions"][number] => ({
    tx_id,
    block,
    tx_index: 0,
    type: "endorser",
    valid: true,
    validation: "VALID",
    t_ms,
    function: name,
    creator: { msp_id: name === "SubmitProof" ? "PadMSP" : "FleetMSP", name: session.uav_id, certificate_sha256: hex(session.uav_id) },
    endorsers: ["AuthorityMSP", "PadMSP"],
  });
  const base = verdict?.block ?? 18_001;
  return {
    summary: session,
    session: {
      session_id: session.session_id,
      state: session.state,
      pad_id: session.pad_id,
      uav_id: session.uav_id,
      action: session.action,
      prekey_id: "fake-1",
      pad_key: "",
      uav_key: "",
      contract_version: "1",
      commissioning_sha256: hex(`${session.pad_id}/commissioning`),
      requested_ms: session.requested_ms,
      claim: { lat_e7: at.lat_e7, lon_e7: at.lon_e7, height_mm: 45_000, accuracy_mm: 1_000, height_accuracy_mm: 1_500, t_ms: session.requested_ms },
      policy: POLICY,
      pad: { msp_id: "PadMSP", certificate_sha256: hex(session.pad_id) },
      uav: { msp_id: "FleetMSP", certificate_sha256: hex(session.uav_id) },
      transcript_sha256: hex(`${session.session_id}/transcript`),
      expires_ms: session.requested_ms + 60_000,
    },
    ...(verdict !== undefined && { verdict }),
    evidence: {
      ranges: {
        t_ms: Array.from({ length: rounds }, (_, i) => session.requested_ms + 1_700 + i * 40),
        anchors: anchors.map((anchor, a) => ({
          anchor_id: anchor.anchor_id,
          range_mm: Array.from({ length: rounds }, (_, i) =>
            (i * 7 + a * 3) % 23 === 0
              ? -1
              : Math.round(Math.hypot(found.east_mm - anchor.east_mm, found.north_mm - anchor.north_mm, 11_000) + 70 * noise(random)),
          ),
          nlos: [],
        })),
      },
      claims: [],
      clock: [],
      broadcast: [],
      attested: [],
      matched: "both",
      steps: [],
      radio: { measured_by: "pad", sts: "provisioned", firmware: "wonderland-uci 0.1" },
    },
    estimates: [],
    reported_ends: [],
    ...(verdict !== undefined && {
      signature: {
        state: verdict.outcome === "refuted" ? ("endorsed" as const) : ("verified" as const),
        format: verdict.outcome === "refuted" ? ("link" as const) : ("wrapper" as const),
        det: "2001:30:280:1405:a29b:3ff4:2226:c04e",
        t_ms: session.requested_ms + 3_000,
        signer: "Traficom",
        covers_location: verdict.outcome !== "refuted",
        bound: false,
        refused: verdict.outcome === "refuted" ? 2 : 0,
      },
    }),
    findings: verdict?.outcome === "refuted" ? oddities(session) : [],
    transactions: [
      transaction(session.request_tx, "RequestProof", base - 1, session.requested_ms),
      ...(session.verdict_tx === undefined ? [] : [transaction(session.verdict_tx, "SubmitProof", base, session.requested_ms + 6_100)]),
      ...(session.complete_tx === undefined ? [] : [transaction(session.complete_tx, "CompleteInteraction", base + 2, session.requested_ms + 20_000)]),
    ],
  };
}

/** The verdict alone, as where the survey that it rests on is not known. */
function heardAt(finding: VerdictSummary["broadcast"]): Pick<Course["points"][number], "broadcast"> {
  const { likelihood_ppm, error_mm } = finding ?? {};
  return likelihood_ppm === undefined || error_mm === undefined ? {} : { broadcast: { likelihood_ppm, error_mm } };
}

function course({ rounds, decided_ms, outcome, signed, broadcast }: VerdictSummary): Course {
  const points = rounds === 0 ? [] : [{ rounds, t_ms: decided_ms, outcome, ...(signed && { signed }), ...heardAt(broadcast) }];
  return { verify_ppm: POLICY.verify_ppm, refute_ppm: POLICY.refute_ppm, points, residuals: [] };
}

/** Answers the REST calls of the console from what the scripted world has told the live store. */
export function fakeFetch(store: LiveStore, flags: ReadonlySet<string>): (request: Request) => Promise<Response> {
  let signedIn = !flags.has("signed-out");
  return (request) => {
    const url = new URL(request.url);
    const path = url.pathname.replace(/^.*\/api\/v1/, "");
    const query = url.searchParams;
    const match = (item: { pad_id: string; uav_id: string; action: string; outcome?: string; state?: string }): boolean =>
      (query.get("pad") ?? item.pad_id) === item.pad_id &&
      (query.get("drone") ?? item.uav_id) === item.uav_id &&
      (query.get("action") ?? item.action) === item.action &&
      (query.get("outcome") ?? item.outcome) === item.outcome &&
      (query.get("state") ?? item.state) === item.state;
    if (path === "/session") {
      if (request.method === "POST") signedIn = true;
      if (request.method === "DELETE") {
        signedIn = false;
        return Promise.resolve(new Response(null, { status: 204 }));
      }
      return Promise.resolve(
        signedIn
          ? json({ ...FAKE_PERSON, method: "passkey", signed_in_ms: Date.now(), expires_ms: Date.now() + 3.6e6, idle_s: 14_400 })
          : json({ detail: "Sign in first." }, 401),
      );
    }
    if (path === "/session/use") return Promise.resolve(new Response(null, { status: 204 }));
    if (path === "/sign-in") return Promise.resolve(json(FAKE_WAYS_IN));
    if (!signedIn) return Promise.resolve(json({ detail: "Sign in first." }, 401));
    if (path === "/me") return Promise.resolve(json(FAKE_ME));
    if (path === "/status") return Promise.resolve(json(store.status));
    if (path === "/verdicts") return Promise.resolve(json(page(store.verdictsByTime(), query, match)));
    const known = [...store.sessionsByTime()];
    for (const verdict of store.verdictsByTime()) {
      if (!store.sessions.has(verdict.session_id)) known.push(sessionOf(verdict));
    }
    if (path === "/sessions") return Promise.resolve(json(page(known, query, match)));
    const decided = store.verdicts.get(/^\/sessions\/([^/]+)\/course$/.exec(path)?.[1] ?? "");
    if (decided !== undefined) return Promise.resolve(json(course(decided)));
    const id = /^\/sessions\/([^/]+)$/.exec(path)?.[1];
    const session = known.find(({ session_id }) => session_id === id);
    if (session !== undefined) {
      return Promise.resolve(json(detail(session, store.verdicts.get(session.session_id), store)));
    }
    return Promise.resolve(json({ detail: "There is nothing at this address." }, 404));
  };
}

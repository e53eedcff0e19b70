import createClient, { type Client } from "openapi-fetch";
import { createContext, useContext } from "react";
import { reading } from "../i18n/locale";
import type {
  Alert,
  AlertDetail,
  Course,
  Hit,
  LedgerBlock,
  LedgerBlockDetail,
  LedgerTransactionDetail,
  Pad,
  SessionDetail,
  SessionSummary,
  SignedIn,
  Statistics,
  Status,
  TransactionContents,
  VerdictSummary,
} from "./records";
import type { components, paths } from "./schema";

/** A problem that the server described (RFC 9457), or that kept it from answering. */
export class ApiError extends Error {
  override readonly name = "ApiError";

  constructor(
    message: string,
    /** HTTP status; 0 where there was no answer. */
    readonly status: number,
  ) {
    super(message);
  }
}

export type Page<T> = { items: T[]; next?: string };
export type SessionFilters = NonNullable<paths["/api/v1/sessions"]["get"]["parameters"]["query"]>;
export type AlertFilters = NonNullable<paths["/api/v1/alerts"]["get"]["parameters"]["query"]>;
export type AlertAction = components["schemas"]["Act"];
export type StatisticsFilters = paths["/api/v1/statistics"]["get"]["parameters"]["query"];
export type VerdictFilters = NonNullable<paths["/api/v1/verdicts"]["get"]["parameters"]["query"]>;

/** An answer takes no longer than this. */
export const TIMEOUT_MS = 15_000;

/** The server's word for "confirm this" (its other words are for people). */
const STEP_UP = "urn:wonderland:problem:step-up-required";

type Answer<T> = { data?: T; error?: unknown; response: Response };

/** One request, for which the server wants to know once more who is at the keys. */
export type Act = components["schemas"]["StepUpQuestion"];
/** Asks for that; the token to send with the request, or undefined where the person would rather not. */
export type StepUp = (act: Act) => Promise<string | undefined>;

/** The REST interface, as far as the console uses it. Each call throws `ApiError`. */
export class Api {
  /** For domains that have calls of their own; each through `answered`. */
  readonly client: Client<paths>;
  /** Without it such a request is refused as any other. */
  stepUp: StepUp | undefined;

  /** `origin` is where `/api/v1` lies; `fetch` is the browser's, or a fake one's. */
  constructor(origin: string, fetch: (request: Request) => Promise<Response> = (request) => globalThis.fetch(request)) {
    const inLanguage = async (request: Request): Promise<Response> => {
      request.headers.set("Accept-Language", reading().locale);
      const again = request.method === "GET" || this.stepUp === undefined ? undefined : request.clone();
      const answer = await fetch(request);
      return again === undefined ? answer : this.confirmed(answer, again, fetch);
    };
    this.client = createClient<paths>({ baseUrl: origin, fetch: inLanguage, credentials: "same-origin" });
  }

  /** The answer; where the server wants to know who is at the keys, that of the same request once this is confirmed. */
  private async confirmed(answer: Response, request: Request, fetch: (request: Request) => Promise<Response>): Promise<Response> {
    if (answer.status !== 403 || this.stepUp === undefined) return answer;
    const { type } = (await answer.clone().json().catch(() => ({}))) as { type?: unknown };
    if (type !== STEP_UP) return answer;
    const body = await request.arrayBuffer();
    const digest = new Uint8Array(await crypto.subtle.digest("SHA-256", body));
    const body_sha256 = Array.from(digest, (byte) => byte.toString(16).padStart(2, "0")).join("");
    const token = await this.stepUp({ method: request.method, path: new URL(request.url).pathname, body_sha256 });
    if (token === undefined) return answer;
    const headers = new Headers(request.headers);
    headers.set("Step-Up", token);
    const { url, method, credentials } = request;
    // A request of its own: the time for the first one ran while a person looked for a key.
    return fetch(new Request(url, { method, headers, credentials, signal: AbortSignal.timeout(TIMEOUT_MS), ...(body.byteLength > 0 && { body }) }));
  }

  signIn(token: string): Promise<SignedIn> {
    return answered((signal) => this.client.POST("/api/v1/session", { body: { token }, signal }));
  }

  whoAmI(): Promise<SignedIn> {
    return answered((signal) => this.client.GET("/api/v1/session", { signal }));
  }

  async signOut(): Promise<void> {
    await answered<unknown>((signal) => this.client.DELETE("/api/v1/session", { signal }));
  }

  /** Somebody is at the keys: only this keeps the sign-in from ending unused. */
  async use(): Promise<void> {
    await answered<unknown>((signal) => this.client.POST("/api/v1/session/use", { signal }));
  }

  status(): Promise<Status> {
    return answered((signal) => this.client.GET("/api/v1/status", { signal }));
  }

  sessions(query: SessionFilters): Promise<Page<SessionSummary>> {
    return answered((signal) => this.client.GET("/api/v1/sessions", { params: { query }, signal }));
  }

  session(session_id: string): Promise<SessionDetail> {
    return answered((signal) => this.client.GET("/api/v1/sessions/{session_id}", { params: { path: { session_id } }, signal }));
  }

  course(session_id: string): Promise<Course> {
    return answered((signal) => this.client.GET("/api/v1/sessions/{session_id}/course", { params: { path: { session_id } }, signal }));
  }

  verdicts(query: VerdictFilters): Promise<Page<VerdictSummary>> {
    return answered((signal) => this.client.GET("/api/v1/verdicts", { params: { query }, signal }));
  }

  statistics(query: StatisticsFilters): Promise<Statistics> {
    return answered((signal) => this.client.GET("/api/v1/statistics", { params: { query }, signal }));
  }

  /** The pads as they were known at a moment of the past. */
  async padsAt(at_ms: number): Promise<Pad[]> {
    const { pads } = await answered((signal) => this.client.GET("/api/v1/replay/state", { params: { query: { at_ms } }, signal }));
    return pads;
  }

  search(q: string): Promise<{ items: Hit[] }> {
    return answered((signal) => this.client.POST("/api/v1/search", { body: { q, limit: 12 }, signal }));
  }

  alerts(query: AlertFilters): Promise<Page<Alert>> {
    return answered((signal) => this.client.GET("/api/v1/alerts", { params: { query }, signal }));
  }

  /** How many wait in the inbox. */
  async alertCount(): Promise<number> {
    return (await answered((signal) => this.client.GET("/api/v1/alerts/count", { signal }))).inbox;
  }

  alert(alert_id: string): Promise<AlertDetail> {
    return answered((signal) => this.client.GET("/api/v1/alerts/{alert_id}", { params: { path: { alert_id } }, signal }));
  }

  /** Refused with status 409 where somebody else has acted since. */
  act(alert_id: string, body: AlertAction): Promise<Alert> {
    return answered((signal) =>
      this.client.POST("/api/v1/alerts/{alert_id}/acts", { params: { path: { alert_id } }, body, signal }),
    );
  }

  /** Blocks, newest first. */
  blocks(query: { limit: number; cursor?: string }): Promise<Page<LedgerBlock>> {
    return answered((signal) => this.client.GET("/api/v1/blocks", { params: { query }, signal }));
  }

  block(number: number): Promise<LedgerBlockDetail> {
    return answered((signal) => this.client.GET("/api/v1/blocks/{number}", { params: { path: { number } }, signal }));
  }

  /** The bytes whose SHA-256 is the header's `data_hash`, from the ledger itself. */
  blockData(number: number): Promise<ArrayBuffer> {
    return answered((signal) =>
      this.client.GET("/api/v1/blocks/{number}/data", { params: { path: { number } }, parseAs: "arrayBuffer", signal }),
    );
  }

  /** All that proves a session without this server (`wonderland-evidence/1`), byte for byte. */
  evidence(session_id: string): Promise<ArrayBuffer> {
    return answered((signal) =>
      this.client.GET("/api/v1/sessions/{session_id}/evidence", { params: { path: { session_id } }, parseAs: "arrayBuffer", signal }),
    );
  }

  transaction(tx_id: string): Promise<LedgerTransactionDetail> {
    return answered((signal) => this.client.GET("/api/v1/transactions/{tx_id}", { params: { path: { tx_id } }, signal }));
  }

  /** Arguments, reads, writes and endorsements, from the ledger itself. */
  transactionContents(tx_id: string): Promise<TransactionContents> {
    return answered((signal) => this.client.GET("/api/v1/transactions/{tx_id}/contents", { params: { path: { tx_id } }, signal }));
  }
}

/** The content of an answer. Throws `ApiError`. */
export async function answered<T>(ask: (signal: AbortSignal) => Promise<Answer<T>>): Promise<T> {
  let answer: Answer<T>;
  try {
    answer = await ask(AbortSignal.timeout(TIMEOUT_MS));
  } catch (cause) {
    if (cause instanceof SyntaxError) throw new ApiError("The server's answer is not JSON.", 200);
    throw new ApiError("The server cannot be reached.", 0);
  }
  const { response, data, error } = answer;
  if (!response.ok) throw new ApiError(problemText(error, response), response.status);
  return data as T;
}

function problemText(problem: unknown, response: Response): string {
  if (typeof problem === "object" && problem !== null) {
    const { detail, title } = problem as { detail?: unknown; title?: unknown };
    const text = detail ?? title;
    if (typeof text === "string" && text !== "") return text;
  }
  return `The server answered ${response.status} ${response.statusText}`.trim();
}

export const ApiContext = createContext<Api | undefined>(undefined);

export function useApi(): Api {
  const api = useContext(ApiContext);
  if (api === undefined) throw new Error("no ApiContext around this component");
  return api;
}

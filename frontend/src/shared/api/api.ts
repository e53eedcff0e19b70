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
  SessionState,
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

type Answer<T> = { data?: T; error?: unknown; response: Response };

/** The REST interface, as far as the console uses it. Each call throws `ApiError`. */
export class Api {
  /** For domains that have calls of their own; each through `answered`. */
  readonly client: Client<paths>;

  /** `origin` is where `/api/v1` lies; `fetch` is the browser's, or a fake one's. */
  constructor(origin: string, fetch: (request: Request) => Promise<Response> = (request) => globalThis.fetch(request)) {
    const inLanguage = (request: Request): Promise<Response> => {
      request.headers.set("Accept-Language", reading().locale);
      return fetch(request);
    };
    this.client = createClient<paths>({ baseUrl: origin, fetch: inLanguage, credentials: "same-origin" });
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

  sessions(query: SessionFilters): Promise<Page<SessionState>> {
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
    return answered((signal) => this.client.GET("/api/v1/search", { params: { query: { q } }, signal }));
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

import { createContext, useContext } from "react";
import type { SessionDetail, SessionState, SignedIn, Status, VerdictSummary } from "./records";

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

export type Page<T> = { items: T[]; next?: string | null };
export type Filters = Partial<Record<"pad" | "drone" | "outcome" | "state", string>> & {
  since_ms?: number;
  until_ms?: number;
  after_block?: number;
  limit?: number;
  cursor?: string;
};

export type Fetch = (input: string, init?: RequestInit) => Promise<Response>;

/** An answer takes no longer than this. */
export const TIMEOUT_MS = 15_000;

/** The REST interface under `/api/v1`, as far as the console uses it. Each call throws `ApiError`. */
export class Api {
  constructor(
    readonly base: string,
    private readonly fetch: Fetch = (input, init) => globalThis.fetch(input, init),
  ) {}

  signIn(token: string): Promise<SignedIn> {
    return this.request("POST", "/session", { body: { token } });
  }

  whoAmI(): Promise<SignedIn> {
    return this.request("GET", "/session");
  }

  signOut(): Promise<void> {
    return this.request("DELETE", "/session");
  }

  status(): Promise<Status> {
    return this.request("GET", "/status");
  }

  sessions(filters: Filters): Promise<Page<SessionState>> {
    return this.request("GET", "/sessions", { query: filters });
  }

  session(session_id: string): Promise<SessionDetail> {
    return this.request("GET", `/sessions/${encodeURIComponent(session_id)}`);
  }

  verdicts(filters: Filters): Promise<Page<VerdictSummary>> {
    return this.request("GET", "/verdicts", { query: filters });
  }

  private async request<T>(method: string, path: string, { body, query }: { body?: unknown; query?: Filters } = {}): Promise<T> {
    const parameters = new URLSearchParams();
    for (const [name, value] of Object.entries(query ?? {})) parameters.set(name, String(value));
    const url = `${this.base}${path}${parameters.size === 0 ? "" : `?${parameters.toString()}`}`;
    let response: Response;
    try {
      response = await this.fetch(url, {
        method,
        credentials: "same-origin",
        signal: AbortSignal.timeout(TIMEOUT_MS),
        headers: { Accept: "application/json", ...(body !== undefined && { "Content-Type": "application/json" }) },
        ...(body !== undefined && { body: JSON.stringify(body) }),
      });
    } catch {
      throw new ApiError("The server cannot be reached.", 0);
    }
    if (!response.ok) throw new ApiError(await problemText(response), response.status);
    if (response.status === 204) return undefined as T;
    try {
      return (await response.json()) as T;
    } catch {
      throw new ApiError("The server's answer is not JSON.", response.status);
    }
  }
}

async function problemText(response: Response): Promise<string> {
  try {
    const problem = (await response.json()) as { detail?: unknown; title?: unknown };
    const text = problem.detail ?? problem.title;
    if (typeof text === "string" && text !== "") return text;
  } catch {
    // Not a described problem (a proxy's page, say): its status has to do.
  }
  return `The server answered ${response.status} ${response.statusText}`.trim();
}

export const ApiContext = createContext<Api>(new Api("/api/v1"));

export function useApi(): Api {
  return useContext(ApiContext);
}

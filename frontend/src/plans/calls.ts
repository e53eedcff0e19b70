/** Site plans by REST. */
import { ApiError, answered, type Api } from "../shared/api/api";
import type { components } from "../shared/api/schema";

export type StoredSitePlan = components["schemas"]["StoredSitePlan"];
export type PlanProblem = { path: string; message: string };

/** A file that is no site plan, with all that is wrong with it. */
export class PlanRefused extends Error {
  override readonly name = "PlanRefused";

  constructor(
    message: string,
    readonly problems: readonly PlanProblem[],
  ) {
    super(message);
  }
}

const UPLOAD_MS = 60_000;

/** Has the server check a plan and keep it. Throws `PlanRefused`, `ApiError`. */
export async function keepPlan(api: Api, pad_id: string, text: string): Promise<StoredSitePlan> {
  let problems: readonly PlanProblem[] = [];
  try {
    return await answered<StoredSitePlan>(async () => {
      const answer = await api.client.POST("/api/v1/site-plans/{pad_id}", {
        params: { path: { pad_id } },
        headers: { "Content-Type": "application/geo+json" },
        // The file's own bytes: their hash goes on the ledger.
        body: text as never,
        bodySerializer: (body: unknown) => body as string,
        signal: AbortSignal.timeout(UPLOAD_MS),
      });
      problems = (answer.error as { errors?: PlanProblem[] } | undefined)?.errors ?? [];
      return answer;
    });
  } catch (error) {
    if (error instanceof ApiError && problems.length > 0) throw new PlanRefused(error.message, problems);
    throw error;
  }
}

async function sha256Of(text: string): Promise<string> {
  const digest = await crypto.subtle.digest("SHA-256", new TextEncoder().encode(text));
  return [...new Uint8Array(digest)].map((each) => each.toString(16).padStart(2, "0")).join("");
}

/** The file with this hash. Throws `ApiError`, also where the server gives another one than the ledger names. */
export async function fetchPlan(api: Api, pad_id: string, sha256: string): Promise<string> {
  const text = await answered<string>((signal) => api.client.GET("/api/v1/site-plans/{pad_id}/{sha256}", { params: { path: { pad_id, sha256 } }, parseAs: "text", signal }));
  if ((await sha256Of(text)) !== sha256) throw new ApiError("The server's site plan is not the one whose hash is on the ledger.", 200);
  return text;
}

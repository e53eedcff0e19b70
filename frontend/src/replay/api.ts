import { Api, ApiError, answered, TIMEOUT_MS } from "../shared/api/api";
import type { components } from "../shared/api/schema";
import type { PastMark, PastMarks, SessionDetail } from "../shared/api/records";
import { parseFrame } from "../shared/live/protocol";
import type { FilmLine, FilmQuery } from "./player";

export type Export = components["schemas"]["Export"];
export type ExportWish = components["schemas"]["ExportQuery"];
export type ExportFormat = ExportWish["format"];
export type Area = components["schemas"]["ExportArea"];

/** The past by REST. Each call throws `ApiError`. */
export class ReplayApi {
  constructor(private readonly api: Api) {}

  marks(query: { from_ms: number; until_ms: number; buckets: number }): Promise<PastMarks> {
    return answered((signal) => this.api.client.GET("/api/v1/replay/marks", { params: { query }, signal }));
  }

  async refusal(at_ms: number, direction: "next" | "previous"): Promise<PastMark | undefined> {
    const query = { at_ms, direction };
    const { found } = await answered((signal) => this.api.client.GET("/api/v1/replay/refusal", { params: { query }, signal }));
    return found;
  }

  session(session_id: string, at_ms: number): Promise<SessionDetail> {
    const params = { path: { session_id }, query: { at_ms } };
    return answered((signal) => this.api.client.GET("/api/v1/replay/sessions/{session_id}", { params, signal }));
  }

  /** The formats that this server's administrator has left on. */
  async exportFormats(): Promise<ExportFormat[]> {
    const { server } = await answered((signal) => this.api.client.GET("/api/v1/status", { signal }));
    return server.outputs?.exports ?? [];
  }

  prepareExport(body: ExportWish): Promise<Export> {
    return answered((signal) => this.api.client.POST("/api/v1/exports", { body, signal }));
  }

  readExport(export_id: string): Promise<Export> {
    return answered((signal) => this.api.client.GET("/api/v1/exports/{export_id}", { params: { path: { export_id } }, signal }));
  }

  /** Where its file is fetched, once. */
  exportFile(export_id: string): string {
    return `/api/v1/exports/${encodeURIComponent(export_id)}/file`;
  }

  /** The lines of a film as they come. */
  async *film(query: FilmQuery, signal: AbortSignal): AsyncGenerator<FilmLine> {
    const either = AbortSignal.any([signal, AbortSignal.timeout(4 * TIMEOUT_MS)]);
    const body = await answered<ReadableStream<BufferSource>>(() =>
      this.api.client.GET("/api/v1/replay/frames", { params: { query }, parseAs: "stream", signal: either }) as never,
    );
    const reader = body.pipeThrough(new TextDecoderStream()).getReader();
    let rest = "";
    for (;;) {
      const { done, value } = await reader.read();
      rest += value ?? "";
      const lines = rest.split("\n");
      rest = lines.pop() ?? "";
      for (const line of lines) yield parseLine(line);
      if (done) break;
    }
    if (rest !== "") throw new ApiError("The film broke off.", 200);
  }
}

function parseLine(line: string): FilmLine {
  if (!line.startsWith('{"type":"end"')) return parseFrame(line);
  const end = JSON.parse(line) as { t_ms: number; complete: boolean };
  return { type: "end", t_ms: end.t_ms, complete: end.complete };
}

/** The REST interface for what is shown beside a past map: a session's details are those of the time that is shown. */
export class PastApi extends Api {
  private readonly replay: ReplayApi;

  constructor(
    origin: string,
    present: Api,
    private readonly at_ms: () => number,
  ) {
    super(origin);
    this.replay = new ReplayApi(present);
  }

  override session(session_id: string): Promise<SessionDetail> {
    return this.replay.session(session_id, Math.round(this.at_ms()));
  }
}

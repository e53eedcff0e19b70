/** A list on its way to the ledger, line by line. It survives a reload: what was sent is not sent again. */
import { ApiError, answered, type Api } from "../shared/api/api";
import type { components } from "../shared/api/schema";
import { keepDraft, readDraft } from "../shared/drafts";
import type { JsonObject } from "../shared/signing/canonical";
import { Signing, type SignedTransaction } from "../shared/signing/flow";
import type { StoredKey } from "../shared/signing/keys";

export type ImportCheck = components["schemas"]["ImportCheck"];
export type ImportKind = "drones" | "authorisations" | "pads";
/** How a line ended; "open" means that it was not sent yet. */
export type LineState = "open" | "valid" | "refused" | "failed";
export type Line = { line: number; id: string; argument: JsonObject; registration?: string; state: LineState; tx_id?: string; text?: string };
export type Run = { name: string; kind: ImportKind; transaction: string; lines: Line[] };

/** A draft as others are: it may hold operators' numbers, and goes when its person signs out. */
const KEY = "import";
const SEPARATOR = /[",\n\r;]/;
/** A spreadsheet would take a cell that begins so for a formula. */
const FORMULA = /^[=+\-@\t\r]/;

export function checkFile(api: Api, kind: ImportKind, file: Blob): Promise<ImportCheck> {
  return answered((signal) =>
    api.client.POST("/api/v1/registry/imports/{kind}", {
      params: { path: { kind } },
      body: file as unknown as string,
      bodySerializer: (body) => body as unknown as Blob,
      headers: { "Content-Type": "text/csv" },
      signal,
    }),
  );
}

export function newRun(name: string, kind: ImportKind, check: ImportCheck): Run {
  const lines = check.rows
    .filter(({ exists }) => !exists)
    .map(({ line, id, argument, registration }): Line => ({ line, id, argument: argument as JsonObject, ...(registration !== undefined && { registration }), state: "open" }));
  return { name, kind, transaction: check.function, lines };
}

export function keptRun(): Run | undefined {
  const kept = readDraft(KEY);
  return typeof kept === "object" && kept !== null ? (kept as Run) : undefined;
}

export function keepRun(run: Run | undefined): void {
  keepDraft(KEY, run);
}

function ended(line: Line, transaction: SignedTransaction): Line {
  const { problem } = transaction;
  const text = problem === undefined ? transaction.validation : [problem.code, problem.text].filter(Boolean).join(": ");
  return { ...line, state: transaction.state === "valid" ? "valid" : "refused", tx_id: transaction.tx_id, ...(text !== undefined && { text }) };
}

/** Signs and sends the lines that are open, one after the other, until done, stopped, or the ledger is away. */
export async function send(api: Api, key: StoredKey, run: Run, stopped: () => boolean, onLine: (run: Run) => void): Promise<void> {
  let now = run;
  for (const line of run.lines) {
    if (stopped()) return;
    if (line.state !== "open" && line.state !== "failed") continue;
    let next: Line;
    try {
      const { argument, registration } = line;
      const signing = new Signing(api, key, { name: run.transaction, argument, ...(registration !== undefined && { registration }) }, () => undefined);
      next = ended(line, await signing.go());
    } catch (problem) {
      if (!(problem instanceof Error)) throw problem;
      next = { ...line, state: "failed", text: problem.message };
      // What is no answer about this line is one about all: go on when it is over.
      if (!(problem instanceof ApiError) || problem.status === 0 || problem.status === 401 || problem.status === 429 || problem.status >= 500) {
        onLine(replaced(now, next));
        throw problem;
      }
    }
    now = replaced(now, next);
    onLine(now);
  }
}

function replaced(run: Run, line: Line): Run {
  return { ...run, lines: run.lines.map((each) => (each.line === line.line ? line : each)) };
}

function cell(value: string): string {
  const safe = FORMULA.test(value) ? `'${value}` : value;
  return SEPARATOR.test(safe) ? `"${safe.replaceAll('"', '""')}"` : safe;
}

/** What became of each line, as CSV. */
export function report(run: Run): string {
  const rows = run.lines.map(({ line, id, state, tx_id, text }) => [String(line), id, state, tx_id ?? "", text ?? ""].map(cell).join(","));
  return ["line,id,state,transaction,message", ...rows, ""].join("\r\n");
}

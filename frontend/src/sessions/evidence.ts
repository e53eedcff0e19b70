import type { Api } from "../shared/api/api";
import type { SessionDetail } from "../shared/api/records";

/** What changes when the file's shape does. */
export const FORMAT = "wonderland-session/1";

type Block = { number: number; header_hash: string; previous_hash: string; data_hash: string; data_base64: string };
export type EvidenceFile = { format: typeof FORMAT; exported_ms: number; channel: string; session: SessionDetail; blocks: Block[] };

function base64(bytes: ArrayBuffer): string {
  let text = "";
  for (const byte of new Uint8Array(bytes)) text += String.fromCharCode(byte);
  return btoa(text);
}

/**
 * Everything about a session in one file: its records with the ranges as they were measured, and the bytes of the
 * ledger's blocks that hold its transactions, with all signatures. Whoever gets it has no need to believe the console.
 */
export async function evidenceFile(api: Api, session_id: string, now_ms: number): Promise<EvidenceFile> {
  const [session, status] = await Promise.all([api.session(session_id), api.status()]);
  const numbers = [...new Set(session.transactions.map(({ block }) => block))].sort((a, b) => a - b);
  const blocks = await Promise.all(
    numbers.map(async (number) => {
      const [block, data] = await Promise.all([api.block(number), api.blockData(number)]);
      const { header_hash, previous_hash, data_hash } = block;
      return { number, header_hash, previous_hash, data_hash, data_base64: base64(data) };
    }),
  );
  return { format: FORMAT, exported_ms: Math.round(now_ms), channel: status.ledger.channel, session, blocks };
}

/** Hands a file to the browser's downloads. */
export function save(name: string, content: unknown): void {
  const url = URL.createObjectURL(new Blob([JSON.stringify(content, undefined, 1)], { type: "application/json" }));
  const link = document.createElement("a");
  link.href = url;
  link.download = name;
  link.click();
  URL.revokeObjectURL(url);
}

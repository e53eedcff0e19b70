import type { Api } from "../api/api";
import type { LiveStore } from "./store";

/** The strip shows the last hour; a longer absence is not filled beyond this many pages. */
const HOUR_MS = 3_600_000;
const PAGE = 500;
const MAX_PAGES = 8;

/**
 * Fetches the last hour's verdicts, which the live snapshot may not all hold, into the store.
 *
 * Also what a client does that fell behind: verdicts are never lost, they are on the ledger. Throws `ApiError`.
 */
export async function fillHistory(api: Api, store: LiveStore): Promise<void> {
  const since_ms = Math.round(store.serverNow_ms() - HOUR_MS);
  let cursor: string | undefined;
  for (let page = 0; page < MAX_PAGES; page++) {
    const found = await api.verdicts({ since_ms, limit: PAGE, ...(cursor !== undefined && { cursor }) });
    store.merge({ verdicts: found.items });
    if (!found.next) return;
    cursor = found.next;
  }
}

import { placeHash } from "./location";

export function blockHref(number: number): string {
  return placeHash({ room: "ledger", path: ["block", String(number)], query: {} });
}

export function transactionHref(tx_id: string): string {
  return placeHash({ room: "ledger", path: ["transaction", tx_id], query: {} });
}

export const ledgerHref = placeHash({ room: "ledger", path: [], query: {} });

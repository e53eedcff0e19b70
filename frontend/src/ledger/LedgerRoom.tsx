import type { ReactElement } from "react";
import type { Place, PlainRoom } from "../shared/address/location";
import { BlockPage } from "./BlockPage";
import { BlocksPage } from "./BlocksPage";
import "./ledger.css";
import { TransactionPage } from "./TransactionPage";

/** `#/ledger`, `#/ledger/block/7`, `#/ledger/transaction/9f3c…`. */
export function LedgerRoom({ place }: { place: Place & { room: PlainRoom } }): ReactElement {
  const [kind, id] = place.path;
  if (kind === "block" && id !== undefined && /^\d{1,15}$/.test(id)) return <BlockPage number={Number(id)} />;
  if (kind === "transaction" && id !== undefined) return <TransactionPage tx_id={id} />;
  return <BlocksPage />;
}

import { useInfiniteQuery } from "@tanstack/react-query";
import { useRef, type ReactElement } from "react";
import { go, placeHash } from "../app/location";
import { useApi } from "../shared/api/api";
import { useFresh } from "../shared/api/useFresh";
import type { VerdictSummary } from "../shared/api/records";
import { LOOK_WORDS } from "../shared/design/symbols";
import { actionNoun, count, dayAndTime, length, likelihood } from "../shared/format";
import { useLive, useLiveStore, useServerNow } from "../shared/live/useLive";
import type { LiveStore, Topic } from "../shared/live/store";
import { Hash } from "../shared/ui/Hash";
import { More } from "../shared/ui/More";
import { Symbol } from "../shared/ui/Symbol";

const PADS: readonly Topic[] = ["pads"];
const VERDICTS: readonly Topic[] = ["verdicts"];
const PAGE = 50;

function worst(verdict: VerdictSummary): { error_mm: number; likelihood_ppm: number } | undefined {
  const { signed, broadcast } = verdict;
  const judged = broadcast?.outcome === "refuted" && signed?.outcome !== "refuted" ? broadcast : signed;
  return judged ?? undefined;
}

function Row({ verdict, padName, now_ms }: { verdict: VerdictSummary; padName: string; now_ms: number }): ReactElement {
  const judged = worst(verdict);
  return (
    <tr>
      <td>
        <a className={`outcome look-${verdict.outcome}`} href={placeHash({ room: "sessions", session: verdict.session_id })}>
          <Symbol look={verdict.outcome} size={18} />
          {LOOK_WORDS[verdict.outcome]}
        </a>
      </td>
      <td>
        <b>{verdict.uav_id}</b>
      </td>
      <td>{padName}</td>
      <td>
        {actionNoun(verdict.action)} {verdict.permission === "granted" ? "permitted" : "refused"}
      </td>
      <td className="right">{judged === undefined ? "–" : length(judged.error_mm)}</td>
      <td className="right">{judged === undefined ? "–" : likelihood(judged.likelihood_ppm)}</td>
      <td className="right">{count(verdict.rounds)}</td>
      <td className="right">{verdict.assurance}</td>
      <td>{dayAndTime(verdict.decided_ms, now_ms)}</td>
      <td className="right">{count(verdict.block)}</td>
      <td>
        <Hash value={verdict.tx_id} label="transaction" />
      </td>
    </tr>
  );
}

function newestVerdict(store: LiveStore): string {
  return store.verdictsByTime()[0]?.tx_id ?? "";
}

/** All verdicts as a table, the newest first: what the map shows, in words and figures. */
export function VerdictsPage({ filters }: { filters: Record<string, string> }): ReactElement {
  const api = useApi();
  const now_ms = useServerNow(10_000);
  const pads = useLive(PADS, (store) => [...store.pads.values()]);
  const store = useLiveStore();
  const mark = useLive(VERDICTS, newestVerdict);
  const fetchedRef = useRef<string | undefined>(undefined);
  const query = useInfiniteQuery({
    queryKey: ["verdicts", filters],
    queryFn: ({ pageParam }) => {
      fetchedRef.current = newestVerdict(store);
      return api.verdicts({ ...filters, limit: PAGE, ...(pageParam !== undefined && { cursor: pageParam }) });
    },
    initialPageParam: undefined as string | undefined,
    getNextPageParam: (last) => last.next ?? undefined,
  });
  useFresh(mark, query, fetchedRef);
  const set = (name: string, value: string): void => {
    const next = Object.fromEntries(Object.entries({ ...filters, [name]: value }).filter(([, each]) => each !== ""));
    go({ room: "verdicts", filters: next }, true);
  };
  const rows = query.data?.pages.flatMap((page) => page.items) ?? [];
  return (
    <div className="page">
      <div className="page-head">
        <h1>Verdicts</h1>
        <div className="filters">
          <label>
            Outcome
            <select value={filters["outcome"] ?? ""} onChange={(event) => set("outcome", event.target.value)}>
              <option value="">all</option>
              <option value="verified">verified</option>
              <option value="refuted">refuted</option>
              <option value="inconclusive">inconclusive</option>
            </select>
          </label>
          <label>
            Pad
            <select value={filters["pad"] ?? ""} onChange={(event) => set("pad", event.target.value)}>
              <option value="">all</option>
              {pads.map((pad) => (
                <option key={pad.pad_id} value={pad.pad_id}>
                  {pad.name}
                </option>
              ))}
            </select>
          </label>
          <label>
            Drone
            <input
              type="search"
              placeholder="serial number"
              defaultValue={filters["drone"] ?? ""}
              key={filters["drone"] ?? ""}
              maxLength={40}
              onKeyDown={(event) => {
                if (event.key === "Enter") set("drone", event.currentTarget.value.trim());
              }}
              onBlur={(event) => set("drone", event.currentTarget.value.trim())}
            />
          </label>
        </div>
      </div>
      <div className="table-frame float">
        <table className="table num">
          <thead>
            <tr>
              <th scope="col">Verdict</th>
              <th scope="col">Drone</th>
              <th scope="col">Pad</th>
              <th scope="col">Permission</th>
              <th scope="col" className="right">
                Error
              </th>
              <th scope="col" className="right">
                Likelihood
              </th>
              <th scope="col" className="right">
                Rounds
              </th>
              <th scope="col" className="right">
                Assurance
              </th>
              <th scope="col">Decided</th>
              <th scope="col" className="right">
                Block
              </th>
              <th scope="col">Transaction</th>
            </tr>
          </thead>
          <tbody>
            {rows.map((verdict) => (
              <Row
                key={verdict.tx_id}
                verdict={verdict}
                padName={pads.find(({ pad_id }) => pad_id === verdict.pad_id)?.name ?? verdict.pad_id}
                now_ms={now_ms}
              />
            ))}
          </tbody>
        </table>
        <More query={query} empty="No verdict fits." count={rows.length} />
      </div>
    </div>
  );
}

import { useCallback, type ReactElement } from "react";
import { withChange, type Filters as Chosen } from "../shared/address/location";
import { between } from "../shared/days";
import { actionNoun } from "../shared/format";
import { useLive } from "../shared/live/useLive";
import type { Topic } from "../shared/live/store";
import { lookTexts } from "../shared/texts";
import { Bar, Choice, Days, SearchBox } from "../shared/ui/Filters";
import { filterTexts as t } from "./texts";

const PADS: readonly Topic[] = ["pads"];
const OUTCOMES = ["verified", "refuted", "inconclusive"] as const;
const ACTIONS = ["land", "takeoff", "dock"] as const;
const STATES = ["requested", "decided", "completed", "cancelled"] as const;

/** As the API names them: it has times where the address has days. What it does not know it refuses, and says so. */
export function asked({ since, until, ...others }: Chosen): Record<string, string | number> {
  return { ...others, ...between(since, until) };
}

type Properties = { filters: Chosen; onFilters: (filters: Chosen) => void; states?: boolean };

/** What sessions and verdicts are filtered by; a session also by how far it has come (`states`). */
export function Filters({ filters, onFilters, states = false }: Properties): ReactElement {
  const pads = useLive(PADS, (store) => [...store.pads.values()].map(({ pad_id, name }) => ({ value: pad_id, name })).sort((a, b) => a.name.localeCompare(b.name)));
  const set = useCallback((change: Chosen) => onFilters(withChange(filters, change)), [filters, onFilters]);
  const findDrone = useCallback((drone: string) => set({ drone }), [set]);
  const findOperator = useCallback((operator: string) => set({ operator }), [set]);
  const chosen = (name: string): string => filters[name] ?? "";
  return (
    <Bar onClear={Object.keys(filters).length === 0 ? undefined : () => onFilters({})}>
      <Choice label={t("outcome")} value={chosen("outcome")} options={OUTCOMES.map((value) => ({ value, name: lookTexts(value).toLowerCase() }))} onChange={(outcome) => set({ outcome })} />
      {states && <Choice label={t("state")} value={chosen("state")} options={STATES.map((value) => ({ value, name: t("stateIs", { state: value }) }))} onChange={(state) => set({ state })} />}
      <Choice label={t("pad")} value={chosen("pad")} options={pads} onChange={(pad) => set({ pad })} />
      <Choice label={t("action")} value={chosen("action")} options={ACTIONS.map((value) => ({ value, name: actionNoun(value) }))} onChange={(action) => set({ action })} />
      <SearchBox label={t("drone")} value={chosen("drone")} hint={t("serial")} onSearch={findDrone} />
      <SearchBox label={t("operator")} value={chosen("operator")} hint={t("identifier")} onSearch={findOperator} />
      <Days since={chosen("since")} until={chosen("until")} onChange={set} />
    </Bar>
  );
}

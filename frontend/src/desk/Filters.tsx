import type { ReactElement } from "react";
import { LOOKS } from "../shared/drones";
import type { Filter } from "../shared/fleet";
import { actionNoun } from "../shared/format";
import { useLiveStore } from "../shared/live/useLive";
import { lookTexts } from "../shared/texts";
import { Choice } from "../shared/ui/Filters";
import { deskTexts as t } from "./texts";

const ACTIONS = ["land", "takeoff", "dock"] as const;
const MINUTES = [1, 5, 10, 30] as const;

/** What of all that is about the map, the list and the table show. */
export function Filters({ filter, onFilter }: { filter: Filter; onFilter: (filter: Filter) => void }): ReactElement {
  const store = useLiveStore();
  const operators = new Set<string>();
  for (const slot of store.tracks.slots()) {
    const operator = store.tracks.operatorAt(slot);
    if (operator !== undefined) operators.add(operator);
  }
  const without = (name: keyof Filter): Filter => Object.fromEntries(Object.entries(filter).filter(([each]) => each !== name));
  const choose =
    (name: keyof Filter, read: (value: string) => Filter) =>
    (value: string): void =>
      onFilter({ ...without(name), ...(value !== "" && read(value)) });
  const pads = [...store.pads.values()].map(({ pad_id, name }) => ({ value: pad_id, name })).sort((a, b) => a.name.localeCompare(b.name));
  return (
    <div className="filters" role="group" aria-label={t("filter")}>
      <Choice
        label={t("state")}
        any={t("anyState")}
        value={filter.look ?? ""}
        options={LOOKS.map((look) => ({ value: look, name: lookTexts(look) }))}
        onChange={choose("look", (value) => {
          const look = LOOKS.find((each) => each === value);
          return look === undefined ? {} : { look };
        })}
      />
      <Choice label={t("padLabel")} any={t("anyPad")} value={filter.pad ?? ""} options={pads} onChange={choose("pad", (pad) => ({ pad }))} />
      <Choice
        label={t("action")}
        any={t("anyAction")}
        value={filter.action ?? ""}
        options={ACTIONS.map((action) => ({ value: action, name: actionNoun(action) }))}
        onChange={choose("action", (value) => {
          const action = ACTIONS.find((each) => each === value);
          return action === undefined ? {} : { action };
        })}
      />
      <Choice
        label={t("operator")}
        any={t("anyOperator")}
        value={filter.operator ?? ""}
        options={[...operators].sort().map((each) => ({ value: each, name: each }))}
        onChange={choose("operator", (operator) => ({ operator }))}
      />
      <Choice
        label={t("time")}
        any={t("anyTime")}
        value={filter.minutes === undefined ? "" : String(filter.minutes)}
        options={MINUTES.map((minutes) => ({ value: String(minutes), name: t("minutes", { count: minutes }) }))}
        onChange={choose("minutes", (value) => ({ minutes: Number(value) }))}
      />
    </div>
  );
}

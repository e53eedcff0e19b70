import type { ReactElement } from "react";
import { LOOKS } from "../shared/drones";
import type { Filter } from "../shared/fleet";
import { actionNoun } from "../shared/format";
import { useLiveStore } from "../shared/live/useLive";
import { lookTexts } from "../shared/texts";
import { liveTexts as t } from "./texts";

const ACTIONS = ["land", "takeoff", "dock"] as const;
const MINUTES = [1, 5, 10, 30] as const;

type Choice = { name: string; any: string; value: string; options: readonly (readonly [value: string, words: string])[]; onChoose: (value: string) => void };

function Select({ name, any, value, options, onChoose }: Choice): ReactElement {
  // What an address names may not be there (any more): it is still what is filtered by.
  const known = value === "" || options.some(([each]) => each === value);
  return (
    <label>
      <span>{name}</span>
      <select value={value} onChange={(event) => onChoose(event.target.value)}>
        <option value="">{any}</option>
        {!known && <option value={value}>{value}</option>}
        {options.map(([each, words]) => (
          <option key={each} value={each}>
            {words}
          </option>
        ))}
      </select>
    </label>
  );
}

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
  const pads = [...store.pads.values()].map(({ pad_id, name }) => [pad_id, name] as const).sort(([, a], [, b]) => a.localeCompare(b));
  return (
    <div className="filters" role="group" aria-label={t("filter")}>
      <Select
        name={t("state")}
        any={t("anyState")}
        value={filter.look ?? ""}
        options={LOOKS.map((look) => [look, lookTexts(look)])}
        onChoose={choose("look", (value) => {
          const look = LOOKS.find((each) => each === value);
          return look === undefined ? {} : { look };
        })}
      />
      <Select name={t("padLabel")} any={t("anyPad")} value={filter.pad ?? ""} options={pads} onChoose={choose("pad", (pad) => ({ pad }))} />
      <Select
        name={t("action")}
        any={t("anyAction")}
        value={filter.action ?? ""}
        options={ACTIONS.map((action) => [action, actionNoun(action)])}
        onChoose={choose("action", (value) => {
          const action = ACTIONS.find((each) => each === value);
          return action === undefined ? {} : { action };
        })}
      />
      <Select
        name={t("operator")}
        any={t("anyOperator")}
        value={filter.operator ?? ""}
        options={[...operators].sort().map((each) => [each, each])}
        onChoose={choose("operator", (operator) => ({ operator }))}
      />
      <Select
        name={t("time")}
        any={t("anyTime")}
        value={filter.minutes === undefined ? "" : String(filter.minutes)}
        options={MINUTES.map((minutes) => [String(minutes), t("minutes", { count: minutes })])}
        onChoose={choose("minutes", (value) => ({ minutes: Number(value) }))}
      />
    </div>
  );
}

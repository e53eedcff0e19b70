import { memo, useEffect, useRef, type KeyboardEvent, type ReactElement } from "react";
import type { Pad } from "../shared/api/records";
import { countByGroup, type Drone, type Group, type Look } from "../shared/drones";
import { age, count } from "../shared/format";
import { Symbol } from "../shared/ui/Symbol";
import { rowText } from "../sessions/words";

export type Tab = "all" | Exclude<Group, "other">;

const TABS: readonly { tab: Tab; name: string }[] = [
  { tab: "needs-you", name: "Needs you" },
  { tab: "proving", name: "Proving" },
  { tab: "verified", name: "Verified" },
  { tab: "all", name: "All" },
];

const NOTHING: Record<Tab, string> = {
  "needs-you": "Nothing needs you.",
  proving: "Nothing is being proved just now.",
  verified: "No drone holds a verdict just now.",
  all: "No pad hears a drone.",
};

type Properties = {
  drones: readonly Drone[];
  pads: ReadonlyMap<string, Pad>;
  now_ms: number;
  tab: Tab;
  selected: string | undefined;
  ready: boolean;
  onTab: (tab: Tab) => void;
  onSelect: (uav_id: string | undefined) => void;
};

type RowProperties = {
  uav_id: string;
  look: Look;
  tone: Look;
  selected: boolean;
  right: string;
  second: string;
  old: string;
  onSelect: (uav_id: string) => void;
};

/** Remembered by what it shows: of a thousand rows few change at a time. */
const Row = memo(function Row({ uav_id, look, tone, selected, right, second, old, onSelect }: RowProperties): ReactElement {
  return (
    // Keys are the listbox's business: it has the focus, its options have not.
    // eslint-disable-next-line jsx-a11y/click-events-have-key-events, jsx-a11y/interactive-supports-focus
    <div id={`drone-${uav_id}`} className="row" role="option" aria-selected={selected} onClick={() => onSelect(uav_id)}>
      <Symbol look={look} named />
      <b>{uav_id}</b>
      <span className={`row-right num look-${tone}`}>{right}</span>
      <small className="row-second">{second}</small>
      <small className="row-age num">{old}</small>
    </div>
  );
});

/** The drones that are about, what needs the officer first. Arrow keys go through it. */
export function DroneList(properties: Properties): ReactElement {
  const { drones, pads, now_ms, tab, selected, ready, onTab, onSelect } = properties;
  const counts = countByGroup(drones);
  const shown = tab === "all" ? drones : drones.filter(({ group }) => group === tab);
  const list = useRef<HTMLDivElement>(null);
  const padName = (pad_id: string): string => pads.get(pad_id)?.name ?? pad_id;

  useEffect(() => {
    list.current?.querySelector('[aria-selected="true"]')?.scrollIntoView({ block: "nearest" });
  }, [selected]);

  const onKeyDown = (event: KeyboardEvent): void => {
    const index = shown.findIndex(({ uav_id }) => uav_id === selected);
    const target = {
      ArrowDown: Math.min(index + 1, shown.length - 1),
      ArrowUp: Math.max(index - 1, 0),
      Home: 0,
      End: shown.length - 1,
    }[event.key];
    if (target === undefined) return;
    event.preventDefault();
    const drone = shown[target];
    if (drone !== undefined) onSelect(drone.uav_id);
  };

  return (
    <>
      <div className="list-head">
        <h2>In the air</h2>
        <span className="quiet num">
          {count(drones.length)} {drones.length === 1 ? "drone" : "drones"} · {count(pads.size)}{" "}
          {pads.size === 1 ? "pad" : "pads"}
        </span>
      </div>
      <div className="tabs" role="group" aria-label="Which drones to list">
        {TABS.map(({ tab: each, name }) => (
          <button key={each} type="button" className="tab" aria-pressed={each === tab} onClick={() => onTab(each)}>
            {name}
            {each !== "all" && counts[each] > 0 && <span className="num"> {counts[each]}</span>}
          </button>
        ))}
      </div>
      {shown.length === 0 && <p className="empty">{ready ? NOTHING[tab] : "Waiting for the first picture…"}</p>}
      <div
        ref={list}
        className="rows"
        role="listbox"
        aria-label="Drones, what needs you first"
        aria-activedescendant={selected === undefined ? undefined : `drone-${selected}`}
        tabIndex={0}
        onKeyDown={onKeyDown}
      >
        {shown.map((drone) => {
          const { right, second } = rowText(drone, padName);
          return (
            <Row
              key={drone.uav_id}
              uav_id={drone.uav_id}
              look={drone.look}
              tone={drone.need === "not-authorised" ? "proving" : drone.look}
              selected={drone.uav_id === selected}
              right={right}
              second={second}
              old={age(now_ms - drone.t_ms)}
              onSelect={onSelect}
            />
          );
        })}
      </div>
    </>
  );
}

import { useEffect, useRef, type KeyboardEvent, type ReactElement } from "react";
import type { Pad } from "../shared/api/records";
import { countByGroup, type Drone, type Group } from "../shared/drones";
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
            // Keys are the listbox's business: it has the focus, its options have not.
            // eslint-disable-next-line jsx-a11y/click-events-have-key-events, jsx-a11y/interactive-supports-focus
            <div
              key={drone.uav_id}
              id={`drone-${drone.uav_id}`}
              className="row"
              role="option"
              aria-selected={drone.uav_id === selected}
              onClick={() => onSelect(drone.uav_id)}
            >
              <Symbol look={drone.look} named />
              <b>{drone.uav_id}</b>
              <span className={`row-right num look-${drone.need === "not-authorised" ? "proving" : drone.look}`}>{right}</span>
              <small className="row-second">{second}</small>
              <small className="row-age num">{age(now_ms - drone.t_ms)}</small>
            </div>
          );
        })}
      </div>
    </>
  );
}

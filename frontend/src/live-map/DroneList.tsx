import { memo, useEffect, useRef, type KeyboardEvent, type ReactElement } from "react";
import type { Pad } from "../shared/api/records";
import { countByGroup, type Drone, type Group, type Look } from "../shared/drones";
import { age } from "../shared/format";
import { Symbol } from "../shared/ui/Symbol";
import { rowText } from "../sessions/words";
import { liveTexts as t } from "./texts";

export type Tab = "all" | Exclude<Group, "other">;

const TABS: readonly Tab[] = ["needs-you", "proving", "verified", "all"];

/** Names of ICU's `select` have no hyphen. */
function selector(tab: Tab): string {
  return tab.replace("-", "");
}

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
        <h2>{t("inTheAir")}</h2>
        <span className="quiet num">
          {t("counts", { drones: drones.length, pads: pads.size })}
        </span>
      </div>
      <div className="tabs" role="group" aria-label={t("which")}>
        {TABS.map((each) => (
          <button key={each} type="button" className="tab" aria-pressed={each === tab} onClick={() => onTab(each)}>
            {t("tab", { tab: selector(each) })}
            {each !== "all" && counts[each] > 0 && <span className="num"> {counts[each]}</span>}
          </button>
        ))}
      </div>
      {shown.length === 0 && <p className="empty">{ready ? t("nothing", { tab: selector(tab) }) : t("waiting")}</p>}
      <div
        ref={list}
        className="rows"
        role="listbox"
        aria-label={t("listLabel")}
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

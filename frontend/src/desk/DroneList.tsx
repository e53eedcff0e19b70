import { memo, useCallback, useEffect, useRef, useState, type KeyboardEvent, type ReactElement } from "react";
import type { Pad } from "../shared/api/records";
import type { Drone, Look } from "../shared/drones";
import type { Fleet, Tab } from "../shared/fleet";
import { age } from "../shared/format";
import { Symbol } from "../shared/ui/Symbol";
import { reading } from "../shared/i18n/locale";
import { rowText } from "../sessions/words";
import { deskTexts as t } from "./texts";

type Properties = {
  fleet: Fleet;
  tab: Tab;
  pads: ReadonlyMap<string, Pad>;
  now_ms: number;
  selected: string | undefined;
  ready: boolean;
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
  position: number;
  total: number;
  onSelect: (uav_id: string) => void;
};

/** Rows of drones of which only what is heard is known are all as high as this, so that only those in view are made. */
const HEARD_HEIGHT = 57;
const FIRST_VIEW = 900;
const BEYOND = 6;

/** Names of ICU's `select` have no hyphen. */
export function selector(tab: string): string {
  return tab.replace("-", "");
}

/** Remembered by what it shows: of a thousand rows few change at a time. */
const Row = memo(function Row({ uav_id, look, tone, selected, right, second, old, position, total, onSelect }: RowProperties): ReactElement {
  return (
    // Keys are the listbox's business: it has the focus, its options have not.
    // eslint-disable-next-line jsx-a11y/click-events-have-key-events, jsx-a11y/interactive-supports-focus
    <div
      id={`drone-${uav_id}`}
      className="row"
      role="option"
      aria-selected={selected}
      aria-posinset={position}
      aria-setsize={total}
      onClick={() => onSelect(uav_id)}
    >
      <Symbol look={look} named />
      <b>{uav_id}</b>
      <span className={`row-right num look-${tone}`}>{right}</span>
      <small className="row-second" title={second}>
        {second}
      </small>
      <small className="row-age num">{old}</small>
    </div>
  );
});

/** The drones that are about, what needs the officer first. Arrow keys go through it. */
export function DroneList({ fleet, tab, pads, now_ms, selected, ready, onSelect }: Properties): ReactElement {
  const rows = fleet.rows(tab);
  const judged = tab === "all" ? fleet.judged.length : rows.length;
  const list = useRef<HTMLDivElement>(null);
  const heard = useRef<HTMLDivElement>(null);
  const [view, setView] = useState({ top: 0, height: FIRST_VIEW });
  const onScroll = useCallback((): void => {
    const element = list.current;
    if (element === null) return;
    const from = element.scrollTop - (heard.current?.offsetTop ?? 0);
    // Only as often as another row comes into view.
    const top = Math.floor(from / HEARD_HEIGHT) * HEARD_HEIGHT;
    setView((before) => (before.top === top && before.height === element.clientHeight ? before : { top, height: element.clientHeight }));
  }, []);
  useEffect(onScroll, [onScroll, judged]);

  const index = selected === undefined ? -1 : rows.indexOf(selected);
  const first = Math.max(0, Math.floor(view.top / HEARD_HEIGHT) - BEYOND);
  const last = Math.min(rows.length - judged, Math.ceil((view.top + Math.max(view.height, FIRST_VIEW)) / HEARD_HEIGHT) + BEYOND);

  const shown = useRef<string | undefined>(undefined);
  useEffect(() => {
    const element = list.current;
    if (element === null || selected === shown.current) return;
    shown.current = selected;
    if (index < 0) return;
    if (index < judged) element.querySelector('[aria-selected="true"]')?.scrollIntoView({ block: "nearest" });
    else if (heard.current !== null) {
      const top = heard.current.offsetTop + (index - judged) * HEARD_HEIGHT;
      if (top < element.scrollTop) element.scrollTop = top;
      else if (top + HEARD_HEIGHT > element.scrollTop + element.clientHeight) element.scrollTop = top + HEARD_HEIGHT - element.clientHeight;
    }
  }, [selected, index, judged]);

  const onKeyDown = (event: KeyboardEvent): void => {
    const target = {
      ArrowDown: Math.min(index + 1, rows.length - 1),
      ArrowUp: Math.max(index - 1, 0),
      Home: 0,
      End: rows.length - 1,
    }[event.key];
    if (target === undefined) return;
    event.preventDefault();
    const drone = rows.at(target);
    if (drone !== undefined) onSelect(drone.uav_id);
  };

  const row = (at: number): ReactElement | null => {
    const drone = rows.at(at);
    if (drone === undefined) return null;
    const { right, second } = rowText(drone, (pad_id) => pads.get(pad_id)?.name ?? pad_id);
    return (
      <Row
        key={`${reading().locale} ${drone.uav_id}`}
        uav_id={drone.uav_id}
        look={drone.look}
        tone={toneOf(drone)}
        selected={drone.uav_id === selected}
        right={right}
        second={second}
        old={age(now_ms - drone.t_ms)}
        position={at + 1}
        total={rows.length}
        onSelect={onSelect}
      />
    );
  };
  const range = (from: number, to: number): (ReactElement | null)[] => Array.from({ length: Math.max(0, to - from) }, (_, i) => row(from + i));
  const isMade = index >= 0 && (index < judged || (index - judged >= first && index - judged < last));

  return (
    <>
      {rows.length === 0 && <p className="empty">{empty(ready, fleet, tab)}</p>}
      <div
        ref={list}
        className="rows"
        role="listbox"
        aria-label={t("listLabel")}
        aria-activedescendant={isMade && selected !== undefined ? `drone-${selected}` : undefined}
        tabIndex={0}
        onKeyDown={onKeyDown}
        onScroll={onScroll}
      >
        {range(0, judged)}
        {rows.length > judged && (
          <div ref={heard} role="presentation" className="rows-heard" style={{ height: (rows.length - judged) * HEARD_HEIGHT }}>
            <div role="presentation" style={{ transform: `translateY(${first * HEARD_HEIGHT}px)` }}>
              {range(judged + first, judged + last)}
            </div>
          </div>
        )}
      </div>
    </>
  );
}

function toneOf(drone: Drone): Look {
  // The colours of verdicts are for verdicts: who broadcasts its number is not known.
  if (drone.need === "impersonation") return "unproved";
  return drone.need === "not-authorised" ? "proving" : drone.look;
}

function empty(ready: boolean, fleet: Fleet, tab: Tab): string {
  if (!ready) return t("waiting");
  return Object.keys(fleet.filter).length > 0 && fleet.total > 0 ? t("nothingFits") : t("nothing", { tab: selector(tab) });
}

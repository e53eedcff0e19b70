import { useState, type ReactElement } from "react";
import type { ListTab } from "../shared/address/location";
import type { Fleet, Filter } from "../shared/fleet";
import { count } from "../shared/format";
import { useLiveStore } from "../shared/live/useLive";
import { DroneList, selector } from "./DroneList";
import { Filters } from "./Filters";
import { PadList } from "./PadList";
import { padsByNeed } from "../map/padState";
import { deskTexts as t } from "./texts";

const TABS: readonly ListTab[] = ["needs-you", "proving", "verified", "all", "pads"];

type Properties = {
  fleet: Fleet;
  tab: ListTab;
  filter: Filter;
  now_ms: number;
  selected: string | undefined;
  onTab: (tab: ListTab) => void;
  onFilter: (filter: Filter) => void;
  onSelect: (uav_id: string | undefined) => void;
  onPad: (pad_id: string) => void;
};

/** Beside the map: who is about, or how the pads do, and what of it is shown. */
export function ListPanel({ fleet, tab, filter, now_ms, selected, onTab, onFilter, onSelect, onPad }: Properties): ReactElement {
  const store = useLiveStore();
  const [open, setOpen] = useState(false);
  const pads = padsByNeed(store.pads.values(), now_ms);
  const troubled = pads.filter(({ state }) => state.tone !== "ok").length;
  const active = Object.keys(filter).length > 0;
  const counts: Record<ListTab, number> = { ...fleet.counts, all: 0, pads: troubled };
  return (
    <>
      <div className="list-head">
        <h2>{t("inTheAir")}</h2>
        <span className="quiet num">{t("counts", { drones: fleet.total, pads: pads.length })}</span>
        <button
          type="button"
          className="icon-button filter-button"
          aria-expanded={open}
          aria-pressed={active}
          title={t("filter")}
          aria-label={t("filter")}
          onClick={() => setOpen(!open)}
        >
          <svg viewBox="0 0 20 20" aria-hidden="true">
            <path d="M3 4h14l-5.4 6.6V16l-3.2-1.8v-3.6z" />
          </svg>
        </button>
      </div>
      {open && <Filters filter={filter} onFilter={onFilter} />}
      {active && (
        <p className="filtered num">
          {t("filtered", { shown: count(fleet.counts.all), total: count(fleet.total) })}
          <button type="button" className="button" onClick={() => onFilter({})}>
            {t("clearFilter")}
          </button>
        </p>
      )}
      <div className="tabs" role="group" aria-label={t("which")}>
        {TABS.map((each) => (
          <button key={each} type="button" className="tab" aria-pressed={each === tab} onClick={() => onTab(each)}>
            {each === "pads" ? t("pads") : t("tab", { tab: selector(each) })}
            {counts[each] > 0 && <span className="num"> {counts[each]}</span>}
          </button>
        ))}
      </div>
      {tab === "pads" ? (
        <PadList pads={pads} onPad={onPad} />
      ) : (
        <DroneList fleet={fleet} tab={tab} pads={store.pads} now_ms={now_ms} selected={selected} ready={store.ready} onSelect={onSelect} />
      )}
    </>
  );
}

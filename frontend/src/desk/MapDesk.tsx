import { Suspense, lazy, useMemo, useState, type ComponentProps, type ReactElement, type ReactNode } from "react";
import { MapView } from "../map/MapView";
import type { Overlay } from "../map/overlays";
import { ZoomControls } from "../map/ZoomControls";
import type { LonLat } from "../shared/geo/frame";
import { ZoneCard, ZoneLegend } from "../zones/MapZones";
import { DroneTable } from "./DroneTable";
import { Legend } from "./Legend";
import { ListPanel } from "./ListPanel";
import { MeasureBar } from "./Measure";
import { PanelTools, SheetHandle } from "./PanelTools";
import { Resizer } from "./Resizer";
import type { Desk } from "./useMapDesk";

const SessionPanel = lazy(() => import("../sessions/SessionPanel").then(({ SessionPanel: Panel }) => ({ default: Panel })));

type Properties = {
  desk: Desk;
  names: { page: string; list: string; proof: string };
  /** Where the table leads from a drone. */
  hrefOf: (uav_id: string) => string;
  /** Over site plans and zones. */
  overlays?: readonly Overlay[];
  /** A place of the map was pressed where no drone and no pad is; by itself that opens its zones. */
  onGround?: (at: LonLat) => void;
  /** Above the list, and in its place. */
  listHead?: ReactNode;
  instead?: ReactNode;
  /** What the panel says where nothing is known of what is selected. */
  missing?: ReactNode;
  cards?: ReactNode;
  /** Beside the table, for the zones of the map. */
  tableTools?: ReactNode;
  controls?: Pick<ComponentProps<typeof ZoomControls>, "networked" | "onNetworked" | "onWall">;
  /** Above the map, and below it. */
  head?: ReactNode;
  children: ReactNode;
};

/** The map, or the table in its place, with the list beside it and the proof of what is selected. */
export function MapDesk({ desk, names, hrefOf, overlays, onGround, listHead, instead, missing, cards, tableTools, controls, head, children }: Properties): ReactElement {
  const { map, place, now_ms, past, filter, fleet, phone, table, deep, selected, measuring, zones, padding, grid_m, bearing } = desk;
  const { change, selectDrone, follow, toggleDeep, toggleTable, onCamera, openZones, listRef, panelRef, toolsRef } = desk;
  const { uav_id, drone, session, verdict, pad, pinned, open } = selected;
  const [sheetOpen, setSheetOpen] = useState(true);
  const selection = useMemo(() => ({ ...(uav_id !== undefined && { uav_id }), ...(pinned !== undefined && { verdict: pinned }) }), [uav_id, pinned]);
  const own = desk.overlays;
  const drawn = useMemo(() => (overlays === undefined ? own : [...own, ...overlays]), [own, overlays]);
  const opened = (place.zone ?? []).flatMap((id) => zones.find(({ properties }) => properties.zone_id === id) ?? []);
  const hidden = place.zones === "off";
  const handle = (name: "list" | "proof"): ReactNode => phone && <SheetHandle open={sheetOpen} onToggle={() => setSheetOpen(!sheetOpen)} name={name} />;
  const tools = (
    <PanelTools
      following={place.follow === true}
      onFollow={drone === undefined || (past && table) ? undefined : follow}
      onShow={() => map.current?.fitSelection()}
      onClose={() => selectDrone(undefined)}
    />
  );
  return (
    <div className={past ? "live replay" : "live"}>
      <h1 className="visually-hidden">{names.page}</h1>
      {table ? (
        <DroneTable fleet={fleet} hrefOf={hrefOf} now_ms={now_ms} />
      ) : (
        <MapView
          ref={map}
          fleet={fleet}
          camera={place.camera}
          selection={selection}
          padding={padding}
          follow={place.follow === true ? uav_id : undefined}
          measure={measuring.points}
          deep={deep}
          overlays={drawn}
          onGround={onGround ?? openZones}
          onSelect={selectDrone}
          onCamera={onCamera}
          onRelease={() => change({ follow: undefined }, true)}
          onMeasure={measuring.add}
        />
      )}
      {head}
      {(!phone || !open) && (
        <section className="float list" aria-label={names.list} ref={listRef} data-open={sheetOpen}>
          {handle("list")}
          {listHead}
          {instead ?? (
            <ListPanel
              fleet={fleet}
              tab={place.list ?? "all"}
              filter={filter}
              now_ms={now_ms}
              selected={uav_id}
              onTab={(next) => change({ list: next === "all" ? undefined : next })}
              onFilter={(next) => change({ filter: Object.keys(next).length === 0 ? undefined : next })}
              onSelect={selectDrone}
              onPad={(pad_id) => map.current?.fitPad(pad_id)}
            />
          )}
          {!phone && !past && <Resizer side="right" name="list" property="--list-width" initial={316} least={260} most={460} />}
        </section>
      )}
      {open && (
        <section className="float panel" aria-label={names.proof} ref={panelRef} data-open={sheetOpen}>
          {handle("proof")}
          <Suspense fallback={null}>
            <SessionPanel drone={drone} session={session} verdict={verdict} pad={pad} now_ms={now_ms} {...(past && { place: "past" as const })} tools={tools} />
          </Suspense>
          {!phone && !past && <Resizer side="left" name="proof" property="--panel-width" initial={404} least={340} most={620} />}
        </section>
      )}
      {!open && missing !== undefined && (
        <section className="float panel panel-missing" aria-label={names.proof} ref={panelRef}>
          <p className="empty">{missing}</p>
        </section>
      )}
      {!table && (
        <div className="map-cards">
          {cards}
          <ZoneCard zones={opened} now_ms={now_ms} past={past} onClose={() => change({ zone: undefined })} />
        </div>
      )}
      {measuring.points !== undefined && !table && <MeasureBar points={measuring.points} onUndo={measuring.undo} onEnd={measuring.toggle} />}
      <div ref={toolsRef} className={past ? "map-tools replay-tools" : "map-tools"} data-panel={open && !phone}>
        {table ? tableTools : <ZoneLegend zones={zones} shown={!hidden} onToggle={() => change({ zones: hidden ? undefined : "off", zone: undefined })} />}
        {!table && <Legend grid_m={grid_m} />}
        <ZoomControls
          table={table}
          measuring={place.measure !== undefined}
          onMeasure={measuring.toggle}
          onTable={toggleTable}
          onZoom={(levels) => map.current?.zoomBy(levels)}
          onAll={() => map.current?.fitAll()}
          deep={phone ? undefined : deep}
          bearing={bearing}
          onDeep={toggleDeep}
          onNorth={() => map.current?.turn()}
          {...controls}
        />
      </div>
      {children}
    </div>
  );
}

import { useCallback, useEffect, useLayoutEffect, useMemo, useRef, useState, type ReactElement } from "react";
import { roomTexts } from "../shared/roomTexts";
import { changed, sameView, type Change } from "../shared/address/livePlace";
import { currentPlace, go, placeHash, type Camera, type LivePlace } from "../shared/address/location";
import { asOf, sessionOf } from "../shared/drones";
import type { Filter } from "../shared/fleet";
import type { LonLat } from "../shared/geo/frame";
import { useFleet } from "../shared/live/useFleet";
import { useLiveStore, useServerNow } from "../shared/live/useLive";
import { useKeys } from "../shared/ui/useKeys";
import { SessionPanel } from "../sessions/SessionPanel";
import { NetworkedCard, useNetworked } from "../networked/NetworkedCard";
import { flightAt } from "../networked/overlay";
import type { Bounds } from "../networked/calls";
import { usePlanOverlays } from "../plans/usePlans";
import { useMapZones, ZoneCard, ZoneLegend } from "../zones/MapZones";
import { zonesAt } from "../zones/overlay";
import { Announcer } from "./Announcer";
import { DroneTable } from "../desk/DroneTable";
import { Legend } from "../desk/Legend";
import { ListPanel } from "../desk/ListPanel";
import { MapView, type MapHandle } from "../map/MapView";
import { MeasureBar } from "../desk/Measure";
import { PanelTools, SheetHandle } from "../desk/PanelTools";
import { Resizer } from "../desk/Resizer";
import { mapWishes, useMapWishes, wishMap } from "../map/mapWishes";
import { deskTexts } from "../desk/texts";
import { liveTexts as t } from "./texts";
import { Timeline } from "./Timeline";
import { useMeasure } from "../desk/useMeasure";
import { useBox, usePhone } from "../shared/ui/useBox";
import { WallPage } from "./WallPage";
import { ZoomControls } from "../map/ZoomControls";

const NO_FILTER: Filter = {};
const CAMERA_IN_URL_MS = 400;
const TURN = 15;
const CROWDED = 1_000;

/** The same filter is the same object, however often the address is read. */
function useFilter(filter: Filter | undefined): Filter {
  const key = JSON.stringify(filter ?? {});
  return useMemo(() => (key === "{}" ? NO_FILTER : (JSON.parse(key) as Filter)), [key]);
}

/** The main page: who is in the air, the map, and the proof of what is selected. */
export function LivePage({ place }: { place: LivePlace }): ReactElement {
  return place.as === "wall" ? <WallPage place={place} /> : <Desk place={place} />;
}

function Desk({ place }: { place: LivePlace }): ReactElement {
  const store = useLiveStore();
  const now_ms = useServerNow();
  const filter = useFilter(place.filter);
  const fleet = useFleet(filter);
  const [sheetOpen, setSheetOpen] = useState(true);
  const [grid_m, setGrid] = useState<number | undefined>();
  const [bearing, setBearing] = useState(0);
  const [view, setView] = useState<Bounds | undefined>();
  const [flight, setFlight] = useState<string | undefined>();
  const map = useRef<MapHandle>(null);
  const phone = usePhone();
  const [listRef, list] = useBox();
  const [panelRef, panel] = useBox();
  const [stripRef, strip] = useBox();
  const tab = place.list ?? "all";

  const pinned = place.session === undefined ? undefined : store.verdicts.get(place.session);
  const pinnedSession = place.session === undefined ? undefined : (store.sessions.get(place.session) ?? (pinned && sessionOf(pinned)));
  const uav_id = place.drone ?? pinnedSession?.uav_id;
  const drone = fleet.find(uav_id);
  const session = pinnedSession === undefined ? drone?.session : asOf(pinnedSession, now_ms);
  const verdict = session === undefined ? undefined : store.verdicts.get(session.session_id);
  const pad = session === undefined ? undefined : store.pads.get(session.pad_id);
  const open = drone !== undefined || session !== undefined;

  const camera = useRef<Camera | undefined>(place.camera);
  const written = useRef<Camera | undefined>(undefined);
  const latest = useRef(place);
  useLayoutEffect(() => {
    latest.current = place;
  });
  const change = useCallback((next: Change, replace = false) => {
    // Where the map looks now: the address follows it with a delay.
    const at = camera.current ?? latest.current.camera;
    written.current = at;
    go(changed(latest.current, { ...(at !== undefined && { camera: at }), ...next }), replace);
  }, []);
  const select = useCallback((next: { drone?: string; session?: string }) => change({ drone: undefined, session: undefined, follow: undefined, ...next }), [change]);
  const selectDrone = useCallback(
    (id: string | undefined) => {
      if (id === latest.current.drone && latest.current.session === undefined) return;
      select(id === undefined ? {} : { drone: id });
    },
    [select],
  );

  // A selection that the officer makes moves the camera; one that came with the address and a camera does not.
  const chosen = `${uav_id ?? ""}/${place.session ?? ""}`;
  const known = drone !== undefined || pinned !== undefined;
  const shownFor = useRef(place.camera === undefined ? "" : chosen);
  const panelWidth = panel.width;
  useEffect(() => {
    if (!known || shownFor.current === chosen) return undefined;
    // The panel that opens with the selection takes room from the map: fit once that is known.
    const timer = setTimeout(() => {
      shownFor.current = chosen;
      map.current?.fitSelection();
    }, 60);
    return () => clearTimeout(timer);
  }, [known, chosen, panelWidth]);

  // An address that is typed, or found by the back button, may look elsewhere than the map does.
  const addressed = place.camera;
  useEffect(() => {
    const shown = camera.current;
    if (addressed === undefined || shown === undefined || sameView(addressed, shown)) return;
    // What this page wrote itself may be a moment old.
    if (written.current !== undefined && sameView(addressed, written.current)) return;
    map.current?.lookAt(addressed);
  }, [addressed]);

  const urlTimer = useRef<ReturnType<typeof setTimeout> | undefined>(undefined);
  useEffect(
    () => () => {
      clearTimeout(urlTimer.current);
      urlTimer.current = undefined;
    },
    [],
  );
  const onCamera = useCallback((at: Camera, grid: number | undefined) => {
    camera.current = at;
    setGrid(grid);
    setBearing(at.bearing ?? 0);
    if (latest.current.networked === true) setView(map.current?.bounds());
    // Not put off by the next move: a camera that follows a drone never rests.
    urlTimer.current ??= setTimeout(() => {
      urlTimer.current = undefined;
      // The map moves once more while it goes away; by then the address may be another room's, or look elsewhere.
      const named = currentPlace();
      if (named.room !== "live" || JSON.stringify(named.camera) !== JSON.stringify(latest.current.camera)) return;
      written.current = camera.current;
      go(changed(latest.current, { camera: camera.current }), true);
    }, CAMERA_IN_URL_MS);
  }, []);

  const { measure } = place;
  const setMeasure = useCallback((next: LivePlace["measure"], replace: boolean) => change({ measure: next }, replace), [change]);
  const { flat } = useMapWishes();
  // A crowd is seen best from above, and a phone has no room for a horizon.
  const deep = !flat && !phone && fleet.counts.all < CROWDED;
  const measuring = useMeasure(measure, setMeasure, map);
  const { points } = measuring;

  const { zones, overlays: zoneOverlays } = useMapZones(place.zones !== "off");
  const networkedOn = place.networked === true && place.as === undefined;
  const networked = useNetworked(networkedOn, view, flight);
  const { overlays: flightOverlays } = networked;
  const planOverlays = usePlanOverlays([...store.pads.values()], place.as === undefined && (place.camera?.zoom ?? 0) > 15);
  const overlays = useMemo(() => [...planOverlays, ...zoneOverlays, ...flightOverlays], [planOverlays, zoneOverlays, flightOverlays]);
  const toggleNetworked = (): void => {
    setFlight(undefined);
    setView(map.current?.bounds());
    change({ networked: networkedOn ? undefined : true });
  };
  const onGround = (at: LonLat): void => {
    const told = flightAt(networked.shown?.flights ?? [], at, camera.current?.zoom ?? 0);
    if (networkedOn) setFlight(told?.flight_id);
    if (told !== undefined) return;
    const found = zonesAt(zones, at).map(({ properties }) => properties.zone_id);
    if (found.length > 0 || latest.current.zone !== undefined) change({ drone: undefined, session: undefined, follow: undefined, zone: found.length > 0 ? found : undefined });
  };
  const opened = (place.zone ?? []).flatMap((id) => zones.find(({ properties }) => properties.zone_id === id) ?? []);

  const rows = tab === "pads" ? undefined : fleet.rows(tab);
  const step = (by: number): void => {
    if (rows === undefined) return;
    const index = uav_id === undefined ? -1 : rows.indexOf(uav_id);
    const next = rows.at(Math.min(rows.length - 1, Math.max(0, index + by)));
    if (next !== undefined) selectDrone(next.uav_id);
  };
  const follow = (): void => {
    if (uav_id !== undefined) change({ drone: uav_id, session: undefined, follow: place.follow === true ? undefined : true });
  };
  useKeys({
    Escape: () => (measure === undefined ? selectDrone(undefined) : measuring.toggle()),
    f: () => map.current?.fitSelection(),
    c: follow,
    0: () => map.current?.fitAll(),
    "+": () => map.current?.zoomBy(1),
    "-": () => map.current?.zoomBy(-1),
    3: () => wishMap({ flat: !flat }),
    b: () => wishMap({ imagery: !mapWishes().imagery }),
    "[": () => map.current?.turn(-TURN),
    "]": () => map.current?.turn(TURN),
    j: () => step(1),
    k: () => step(-1),
    m: measuring.toggle,
    n: toggleNetworked,
    x: () => change({ as: place.as === "table" ? undefined : "table" }),
    w: () => change({ as: "wall" }),
    ...measuring.keys,
  });

  const padding = useMemo(() => {
    const gap = 12;
    // What stands at the edge has a symbol and a name, too.
    const room = 40;
    if (phone) return { top: 8, right: 8, left: 8, bottom: Math.max(list.height, panel.height) + 8 };
    return {
      room,
      top: gap + room,
      left: list.width + 2 * gap + room,
      right: room + (panel.width === 0 ? gap : panel.width + 2 * gap),
      // The legend stands above the strip.
      bottom: strip.height + 2 * gap + 40 + room,
    };
  }, [phone, list, panel, strip]);

  const selection = useMemo(
    () => ({
      ...(uav_id !== undefined && { uav_id }),
      ...(pinned !== undefined && { verdict: pinned }),
    }),
    [uav_id, pinned],
  );
  const tools = (
    <PanelTools following={place.follow === true} onFollow={drone === undefined ? undefined : follow} onShow={() => map.current?.fitSelection()} onClose={() => selectDrone(undefined)} />
  );
  const table = place.as === "table";

  return (
    <div className="live">
      <h1 className="visually-hidden">{roomTexts("live")}</h1>
      {table ? (
        <DroneTable fleet={fleet} hrefOf={(id) => placeHash(changed(place, { as: undefined, drone: id }))} now_ms={now_ms} />
      ) : (
        <MapView
          ref={map}
          fleet={fleet}
          camera={place.camera}
          selection={selection}
          padding={padding}
          follow={place.follow === true ? uav_id : undefined}
          measure={points}
          deep={deep}
          overlays={overlays}
          onGround={onGround}
          onSelect={selectDrone}
          onCamera={onCamera}
          onRelease={() => change({ follow: undefined }, true)}
          onMeasure={measuring.add}
        />
      )}
      {(!phone || !open) && (
        <section className="float list" aria-label={deskTexts("inTheAir")} ref={listRef} data-open={sheetOpen}>
          {phone && <SheetHandle open={sheetOpen} onToggle={() => setSheetOpen(!sheetOpen)} name="list" />}
          <ListPanel
            fleet={fleet}
            tab={tab}
            filter={filter}
            now_ms={now_ms}
            selected={uav_id}
            onTab={(next) => change({ list: next === "all" ? undefined : next })}
            onFilter={(next) => change({ filter: Object.keys(next).length === 0 ? undefined : next })}
            onSelect={selectDrone}
            onPad={(pad_id) => map.current?.fitPad(pad_id)}
          />
          {!phone && <Resizer side="right" name="list" property="--list-width" initial={316} least={260} most={460} />}
        </section>
      )}
      {open && (
        <section className="float panel" aria-label={t("proof")} ref={panelRef} data-open={sheetOpen}>
          {phone && <SheetHandle open={sheetOpen} onToggle={() => setSheetOpen(!sheetOpen)} name="proof" />}
          <SessionPanel drone={drone} session={session} verdict={verdict} pad={pad} now_ms={now_ms} tools={tools} />
          {!phone && <Resizer side="left" name="proof" property="--panel-width" initial={404} least={340} most={620} />}
        </section>
      )}
      {!open && uav_id !== undefined && store.ready && (
        <section className="float panel panel-missing" aria-label={t("proof")} ref={panelRef}>
          <p className="empty">
            {t("notInAir", { who: uav_id })} <a href={placeHash({ room: "verdicts", filters: { drone: uav_id } })}>{t("itsVerdicts")}</a>
          </p>
        </section>
      )}
      {!table && (
        <div className="map-cards">
          {networkedOn && <NetworkedCard networked={networked} selected={flight} now_ms={now_ms} onSelect={setFlight} onClose={toggleNetworked} />}
          <ZoneCard zones={opened} now_ms={now_ms} onClose={() => change({ zone: undefined })} />
        </div>
      )}
      {points !== undefined && !table && <MeasureBar points={points} onUndo={measuring.undo} onEnd={measuring.toggle} />}
      <div className="map-tools" data-panel={open && !phone}>
        {!table && <ZoneLegend zones={zones} shown={place.zones !== "off"} onToggle={() => change({ zones: place.zones === "off" ? undefined : "off", zone: undefined })} />}
        {table && (
          <a className="float button" href="#/zones/list">
            {roomTexts("zones")}
          </a>
        )}
        {!table && <Legend grid_m={grid_m} />}
        <ZoomControls
          table={table}
          measuring={measure !== undefined}
          networked={networkedOn}
          onMeasure={measuring.toggle}
          onNetworked={toggleNetworked}
          onTable={() => change({ as: table ? undefined : "table" })}
          onWall={() => change({ as: "wall" })}
          onZoom={(levels) => map.current?.zoomBy(levels)}
          onAll={() => map.current?.fitAll()}
          deep={phone ? undefined : deep}
          bearing={bearing}
          onDeep={() => wishMap({ flat: !flat })}
          onNorth={() => map.current?.turn()}
        />
      </div>
      {!phone && (
        <section className="float strip-panel" aria-label={t("lastHour")} ref={stripRef}>
          <Timeline now_ms={now_ms} onSelect={(each) => select({ session: each.session_id })} />
        </section>
      )}
      <Announcer />
    </div>
  );
}

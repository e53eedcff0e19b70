import { useCallback, useEffect, useLayoutEffect, useMemo, useRef, useState, type RefObject } from "react";
import { usePlanOverlays } from "../plans/usePlans";
import type { MapHandle } from "../map/MapView";
import { mapWishes, useMapWishes, wishMap } from "../map/mapWishes";
import { changed, type Change } from "../shared/address/livePlace";
import type { Camera, LivePlace } from "../shared/address/location";
import { asOf, sessionOf } from "../shared/drones";
import type { Filter, Fleet } from "../shared/fleet";
import type { LonLat } from "../shared/geo/frame";
import type { LiveStore } from "../shared/live/store";
import { useFleet } from "../shared/live/useFleet";
import { useLiveStore } from "../shared/live/useLive";
import { useBox, usePhone } from "../shared/ui/useBox";
import { useMapZones } from "../zones/MapZones";
import { zonesAt } from "../zones/overlay";
import { useMeasure } from "./useMeasure";

const NO_FILTER: Filter = {};
const TURN = 15;
const CROWDED = 1_000;
/** Between what floats over the map, and what a symbol and a name at the edge need besides. */
const GAP = 12;
const ROOM = 40;
/** Two lines of whose map it is. */
const CREDITS = 44;

type Selection = { drone?: string; session?: string };

type Options = {
  map: RefObject<MapHandle | null>;
  place: LivePlace;
  /** The moment that is shown. */
  now_ms: number;
  /** It is over, and a note above the map says so. */
  past?: boolean;
  /** Goes to the place. */
  write: (place: LivePlace, replace: boolean) => void;
  onCamera: (at: Camera) => void;
};

export type Desk = ReturnType<typeof useMapDesk>;

/** What the address selects, as far as it is known at that moment; `pinned` is the verdict of a session that it names. */
function selectedOf(store: LiveStore, fleet: Fleet, place: LivePlace, now_ms: number) {
  const pinned = place.session === undefined ? undefined : store.verdicts.get(place.session);
  const pinnedSession = place.session === undefined ? undefined : (store.sessions.get(place.session) ?? (pinned && sessionOf(pinned)));
  const uav_id = place.drone ?? pinnedSession?.uav_id;
  const drone = fleet.find(uav_id);
  const session = pinnedSession === undefined ? drone?.session : asOf(pinnedSession, now_ms);
  const verdict = session === undefined ? undefined : store.verdicts.get(session.session_id);
  const pad = session === undefined ? undefined : store.pads.get(session.pad_id);
  return { uav_id, drone, session, verdict, pad, pinned, open: drone !== undefined || session !== undefined };
}

/** The same filter is the same object, however often the address is read. */
function useFilter(filter: Filter | undefined): Filter {
  const key = JSON.stringify(filter ?? {});
  return useMemo(() => (key === "{}" ? NO_FILTER : (JSON.parse(key) as Filter)), [key]);
}

/** The state of a map desk, live or in the replay: what is selected and shown, by an address that holds it. */
export function useMapDesk({ map, place, now_ms, past = false, write, onCamera }: Options) {
  const store = useLiveStore();
  const filter = useFilter(place.filter);
  const fleet = useFleet(filter);
  const [grid_m, setGrid] = useState<number | undefined>();
  const [bearing, setBearing] = useState(0);
  const phone = usePhone();
  const { flat } = useMapWishes();
  const [listRef, list] = useBox();
  const [panelRef, panel] = useBox();
  const [barRef, bar] = useBox();
  const [toolsRef, tools] = useBox();
  const selected = selectedOf(store, fleet, place, now_ms);
  const { uav_id, drone, pinned } = selected;
  const table = place.as === "table";

  const camera = useRef<Camera | undefined>(place.camera);
  const latest = useRef({ place, write, onCamera });
  useLayoutEffect(() => {
    latest.current = { place, write, onCamera };
  });
  const placeWith = useCallback((next: Change) => {
    // Where the map looks now: the address follows it with a delay.
    const at = camera.current ?? latest.current.place.camera;
    return changed(latest.current.place, { ...(at !== undefined && { camera: at }), ...next });
  }, []);
  const change = useCallback((next: Change, replace = false) => latest.current.write(placeWith(next), replace), [placeWith]);
  const select = useCallback((next: Selection) => change({ drone: undefined, session: undefined, follow: undefined, ...next }), [change]);
  const selectDrone = useCallback(
    (id: string | undefined) => {
      const { drone: before, session } = latest.current.place;
      if (id === before && session === undefined) return;
      select(id === undefined ? {} : { drone: id });
    },
    [select],
  );
  const moved = useCallback((at: Camera, grid: number | undefined) => {
    camera.current = at;
    setGrid(grid);
    setBearing(at.bearing ?? 0);
    latest.current.onCamera(at);
  }, []);

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
  }, [map, known, chosen, panelWidth]);

  const setMeasure = useCallback((next: LivePlace["measure"], replace: boolean) => change({ measure: next }, replace), [change]);
  const measuring = useMeasure(place.measure, setMeasure, map);
  const { zones, overlays: zoneOverlays } = useMapZones(place.zones !== "off", past ? now_ms : undefined);
  const planOverlays = usePlanOverlays([...store.pads.values()], place.as === undefined && (place.camera?.zoom ?? 0) > 15);
  const overlays = useMemo(() => [...planOverlays, ...zoneOverlays], [planOverlays, zoneOverlays]);
  const openZones = (at: LonLat): void => {
    const found = zonesAt(zones, at).map(({ properties }) => properties.zone_id);
    if (found.length > 0 || place.zone !== undefined) change({ drone: undefined, session: undefined, follow: undefined, zone: found.length > 0 ? found : undefined });
  };

  const padding = useMemo(() => {
    // On a phone the tools stand in a column, beside whose map it is and, without a proof, below the legend.
    if (phone) return { top: CREDITS + (past ? 40 : panel.height > 0 ? 8 : 46), right: past ? 8 : 60, left: 8, bottom: Math.max(list.height, panel.height) + bar.height + 8 };
    return {
      room: ROOM,
      top: (past ? 52 : GAP) + ROOM,
      left: list.width + 2 * GAP + ROOM,
      right: ROOM + (panel.width === 0 ? GAP : panel.width + 2 * GAP),
      // Above the bar stands whose map it is, and the legend with the tools in a row or two.
      bottom: bar.height + 2 * GAP + 20 + tools.height + ROOM,
    };
  }, [phone, past, list, panel, bar, tools]);

  const follow = (): void => {
    if (uav_id !== undefined) change({ drone: uav_id, session: undefined, follow: place.follow === true ? undefined : true });
  };
  const toggleDeep = (): void => wishMap({ flat: !flat });
  const toggleTable = (): void => change({ as: table ? undefined : "table" });
  const keys = {
    Escape: () => (place.measure === undefined ? selectDrone(undefined) : measuring.toggle()),
    f: () => map.current?.fitSelection(),
    c: follow,
    0: () => map.current?.fitAll(),
    "+": () => map.current?.zoomBy(1),
    "-": () => map.current?.zoomBy(-1),
    3: toggleDeep,
    b: () => wishMap({ imagery: !mapWishes().imagery }),
    "[": () => map.current?.turn(-TURN),
    "]": () => map.current?.turn(TURN),
    m: measuring.toggle,
    x: toggleTable,
    ...measuring.keys,
  };
  // A crowd is seen best from above, and a phone has no room for a horizon.
  const deep = !flat && !phone && (past || fleet.counts.all < CROWDED);
  const sight = { filter, fleet, phone, table, deep, selected, measuring, zones, overlays, padding, grid_m, bearing };
  const acts = { placeWith, change, select, selectDrone, follow, toggleDeep, toggleTable, onCamera: moved, openZones, keys };
  return { map, place, now_ms, past, ...sight, ...acts, listRef, panelRef, barRef, toolsRef };
}

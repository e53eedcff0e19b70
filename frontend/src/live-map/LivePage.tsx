import { useCallback, useEffect, useLayoutEffect, useMemo, useRef, useState, type ReactElement } from "react";
import { currentPlace, go, placeHash, type Camera, type Place } from "../app/location";
import type { VerdictSummary } from "../shared/api/records";
import { asOf, drones, sessionOf } from "../shared/drones";
import { useLive, useLiveStore, useServerNow } from "../shared/live/useLive";
import type { Topic } from "../shared/live/store";
import { useKeys } from "../shared/ui/useKeys";
import { SessionPanel } from "../sessions/SessionPanel";
import { DroneList, type Tab } from "./DroneList";
import { Legend } from "./Legend";
import { MapView, type MapHandle } from "./map/MapView";
import { Resizer } from "./Resizer";
import { liveTexts as t } from "./texts";
import { Timeline } from "./Timeline";
import { ZoomControls } from "./ZoomControls";

const TOPICS: readonly Topic[] = ["tracks", "estimates", "sessions", "verdicts", "pads", "connection"];
/** Within what the address keeps of a camera. */
function sameView(one: Camera, other: Camera): boolean {
  return Math.abs(one.lat - other.lat) < 1e-6 && Math.abs(one.lon - other.lon) < 1e-6 && Math.abs(one.zoom - other.zoom) < 0.01;
}

const CAMERA_IN_URL_MS = 400;
export const PHONE = "(max-width: 760px)";

type Box = { width: number; height: number };

/** The size of an element as it changes; zero while it is not there. */
function useBox(): [(element: HTMLElement | null) => (() => void) | undefined, Box] {
  const [box, setBox] = useState<Box>({ width: 0, height: 0 });
  const observe = useCallback((element: HTMLElement | null) => {
    if (element === null) return undefined;
    const observer = new ResizeObserver(() => {
      setBox({ width: element.offsetWidth, height: element.offsetHeight });
    });
    observer.observe(element);
    return () => {
      observer.disconnect();
      setBox({ width: 0, height: 0 });
    };
  }, []);
  return [observe, box];
}

function usePhone(): boolean {
  const [phone, setPhone] = useState(() => matchMedia(PHONE).matches);
  useEffect(() => {
    const query = matchMedia(PHONE);
    const listen = (): void => setPhone(query.matches);
    query.addEventListener("change", listen);
    return () => query.removeEventListener("change", listen);
  }, []);
  return phone;
}

/** The main page: who is in the air, the map, and the proof of what is selected. */
export function LivePage({ place }: { place: Place & { room: "live" } }): ReactElement {
  const store = useLiveStore();
  const now_ms = useServerNow();
  const all = useLive(TOPICS, () => drones(store, now_ms));
  const [tab, setTab] = useState<Tab>("all");
  const [sheetOpen, setSheetOpen] = useState(true);
  const [grid_m, setGrid] = useState<number | undefined>();
  const map = useRef<MapHandle>(null);
  const phone = usePhone();
  const [listRef, list] = useBox();
  const [panelRef, panel] = useBox();
  const [stripRef, strip] = useBox();

  const pinned: VerdictSummary | undefined =
    place.session === undefined ? undefined : store.verdicts.get(place.session);
  const pinnedSession =
    place.session === undefined ? undefined : (store.sessions.get(place.session) ?? (pinned && sessionOf(pinned)));
  const uav_id = place.drone ?? pinnedSession?.uav_id;
  const drone = all.find((each) => each.uav_id === uav_id);
  const session = pinnedSession === undefined ? drone?.session : asOf(pinnedSession, now_ms);
  const verdict = session === undefined ? undefined : store.verdicts.get(session.session_id);
  const pad = session === undefined ? undefined : store.pads.get(session.pad_id);
  const open = drone !== undefined || session !== undefined;

  const camera = useRef<Camera | undefined>(place.camera);
  const latest = useRef(place);
  useLayoutEffect(() => {
    latest.current = place;
  });
  const select = useCallback((next: { drone?: string; session?: string }) => {
    // Where the map looks now: the address follows it with a delay.
    const at = camera.current ?? latest.current.camera;
    go({ room: "live", ...next, ...(at !== undefined && { camera: at }) });
  }, []);
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
    map.current?.lookAt(addressed);
  }, [addressed]);

  const urlTimer = useRef<ReturnType<typeof setTimeout> | undefined>(undefined);
  useEffect(() => () => clearTimeout(urlTimer.current), []);
  const onCamera = useCallback((at: Camera, grid: number | undefined) => {
    camera.current = at;
    setGrid(grid);
    clearTimeout(urlTimer.current);
    urlTimer.current = setTimeout(() => {
      // The map moves once more while it goes away; by then the address may be another room's.
      if (currentPlace().room === "live") go({ ...latest.current, camera: at }, true);
    }, CAMERA_IN_URL_MS);
  }, []);

  useKeys({
    Escape: () => selectDrone(undefined),
    f: () => map.current?.fitSelection(),
    0: () => map.current?.fitAll(),
    "+": () => map.current?.zoomBy(1),
    "-": () => map.current?.zoomBy(-1),
    j: () => step(1),
    k: () => step(-1),
  });
  const shown = tab === "all" ? all : all.filter(({ group }) => group === tab);
  const step = (by: number): void => {
    const index = shown.findIndex((each) => each.uav_id === uav_id);
    const next = shown[Math.min(shown.length - 1, Math.max(0, index + by))];
    if (next !== undefined) selectDrone(next.uav_id);
  };

  const padding = useMemo(() => {
    const gap = 12;
    if (phone) return { top: 8, right: 8, left: 8, bottom: Math.max(list.height, panel.height) + 8 };
    return {
      top: gap,
      left: list.width + 2 * gap,
      right: panel.width === 0 ? gap : panel.width + 2 * gap,
      // The legend stands above the strip.
      bottom: strip.height + 2 * gap + 40,
    };
  }, [phone, list, panel, strip]);

  const tools = (
    <span className="tools">
      <button type="button" className="icon-button" title={`${t("showOnMap")} (f)`} aria-label={t("showOnMap")} onClick={() => map.current?.fitSelection()}>
        <svg viewBox="0 0 20 20" aria-hidden="true">
          <circle cx="10" cy="10" r="5" />
          <path d="M10 1.5v4M10 14.5v4M1.5 10h4M14.5 10h4" />
        </svg>
      </button>
      <button type="button" className="icon-button" title={`${t("close")} (Esc)`} aria-label={t("close")} onClick={() => selectDrone(undefined)}>
        <svg viewBox="0 0 20 20" aria-hidden="true">
          <path d="M5 5l10 10M15 5L5 15" />
        </svg>
      </button>
    </span>
  );

  const selection = useMemo(
    () => ({
      ...(uav_id !== undefined && { uav_id }),
      ...(pinned !== undefined && { verdict: pinned }),
    }),
    [uav_id, pinned],
  );

  return (
    <div className="live">
      <MapView ref={map} camera={place.camera} selection={selection} padding={padding} onSelect={selectDrone} onCamera={onCamera} />
      {(!phone || !open) && (
        <section className="float list" aria-label={t("inTheAir")} ref={listRef} data-open={sheetOpen}>
          {phone && <SheetHandle open={sheetOpen} onToggle={() => setSheetOpen(!sheetOpen)} name="list" />}
          <DroneList
            drones={all}
            pads={store.pads}
            now_ms={now_ms}
            tab={tab}
            selected={uav_id}
            ready={store.ready}
            onTab={setTab}
            onSelect={selectDrone}
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
      <div className="map-tools" data-panel={open && !phone}>
        <Legend grid_m={grid_m} />
        <ZoomControls
          onZoom={(levels) => map.current?.zoomBy(levels)}
          onAll={() => map.current?.fitAll()}
        />
      </div>
      {!phone && (
        <section className="float strip-panel" aria-label={t("lastHour")} ref={stripRef}>
          <Timeline now_ms={now_ms} onSelect={(each) => select({ session: each.session_id })} />
        </section>
      )}
    </div>
  );
}

function SheetHandle({ open, onToggle, name }: { open: boolean; onToggle: () => void; name: "list" | "proof" }): ReactElement {
  return (
    <button type="button" className="sheet-handle" aria-expanded={open} aria-label={t(open ? "fold" : "unfold", { what: name })} onClick={onToggle}>
      <span />
    </button>
  );
}

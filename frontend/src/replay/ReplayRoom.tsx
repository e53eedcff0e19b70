import { QueryClient, QueryClientProvider, useQuery } from "@tanstack/react-query";
import { useCallback, useEffect, useLayoutEffect, useMemo, useRef, useState, useSyncExternalStore, type ReactElement } from "react";
import { changed, sameView, type Change } from "../shared/address/livePlace";
import { go, placeHash, type Camera, type LivePlace, type Place, type PlainRoom } from "../shared/address/location";
import { DroneTable } from "../desk/DroneTable";
import { Legend } from "../desk/Legend";
import { ListPanel } from "../desk/ListPanel";
import { MapView, type MapHandle } from "../map/MapView";
import { MeasureBar } from "../desk/Measure";
import { mapWishes, useMapWishes, wishMap } from "../map/mapWishes";
import { PanelTools, SheetHandle } from "../desk/PanelTools";
import { useMeasure } from "../desk/useMeasure";
import { ZoomControls } from "../map/ZoomControls";
import { useBox, usePhone } from "../shared/ui/useBox";
import { SessionPanel } from "../sessions/SessionPanel";
import { ApiContext, useApi } from "../shared/api/api";
import { asOf, sessionOf } from "../shared/drones";
import type { Filter } from "../shared/fleet";
import { day, timeOfDay } from "../shared/format";
import { LiveStore } from "../shared/live/store";
import { useFleet } from "../shared/live/useFleet";
import type { LonLat } from "../shared/geo/frame";
import { LiveContext, useLive, useLiveStore } from "../shared/live/useLive";
import type { Topic } from "../shared/live/store";
import { usePlanOverlays } from "../plans/usePlans";
import { useMapZones, ZoneCard, ZoneLegend } from "../zones/MapZones";
import { zonesAt } from "../zones/overlay";
import { PastApi, ReplayApi, type Area } from "./api";
import { Controls } from "./Controls";
import { ExportDialog } from "./ExportDialog";
import { PastAlerts } from "./PastAlerts";
import { replayAddress, replayPlace, SPANS, type ReplayPlace } from "../shared/address/replayPlace";
import { Player } from "./player";
import { Scrubber } from "./Scrubber";
import { replayTexts as t } from "./texts";
import { useOwnKeys } from "./useOwnKeys";
import "./replay.css";

/** Without a time in the address, the last two minutes are what one has probably just seen. */
const JUST_BEFORE_MS = 120_000;
const URL_MS = 1_000;
/** The address is another time than is shown when it differs by more than playing makes it. */
const SAME_MS = 1_500;
const BUCKETS = 240;
const TURN = 15;
const MARKS_MS = 15_000;
const NO_FILTER: Filter = {};
/** So many of a moment the server tells, the newest. */
const MOST_ALERTS = 500;
const ALERTS: readonly Topic[] = ["alerts"];
const TIME_TOPICS: readonly Topic[] = ["tracks", "sessions", "verdicts", "pads"];

/** What was, played on the live map: `#/replay?t=2026-11-21T14:00:00.000Z&drone=…`. */
export function ReplayRoom({ place }: { place: Place & { room: PlainRoom } }): ReactElement {
  const present = useApi();
  const live = useLiveStore();
  const [begun] = useState(() => replayPlace(place.query));
  const [parts] = useState(() => {
    const api = new ReplayApi(present);
    const store: LiveStore = new LiveStore(() => player.read().t_ms);
    const player: Player = new Player(
      {
        film: (query, signal) => api.film(query, signal),
        receive: (event) => store.receive(event),
        clear: () => store.clear(),
        elapsed_ms: () => performance.now(),
        end_ms: () => Math.round(live.serverNow_ms()),
      },
      begun.t_ms ?? Math.round(live.serverNow_ms()) - JUST_BEFORE_MS,
      begun.speed,
    );
    return { api, store, player, past: new PastApi(location.origin, present, () => player.read().t_ms), client: new QueryClient() };
  });
  useEffect(() => {
    parts.player.start();
    return () => parts.player.stop();
  }, [parts]);
  return (
    <QueryClientProvider client={parts.client}>
      <ApiContext value={parts.past}>
        <LiveContext value={parts.store}>
          <Desk place={replayPlace(place.query)} player={parts.player} api={parts.api} now_ms={() => live.serverNow_ms()} />
        </LiveContext>
      </ApiContext>
    </QueryClientProvider>
  );
}

/** The bounds of a view as an export wants them; undefined where it is round the whole globe. */
function areaOf(bounds: readonly [number, number, number, number] | undefined): Area | undefined {
  if (bounds === undefined) return undefined;
  const [west, south, east, north] = bounds;
  if (east - west >= 360) return undefined;
  const longitude = (degrees: number): number => Math.round((((degrees + 540) % 360) - 180) * 1e7);
  const latitude = (degrees: number): number => Math.round(Math.max(-90, Math.min(90, degrees)) * 1e7);
  return { south_e7: latitude(south), west_e7: longitude(west), north_e7: latitude(north), east_e7: longitude(east) };
}

type Properties = { place: ReplayPlace; player: Player; api: ReplayApi; now_ms: () => number };

/** The part of time that the scrubber shows: it moves on only when one comes near its end. */
function useWindow(t_ms: number, span_ms: number): [from_ms: number, until_ms: number] {
  const [middle, setMiddle] = useState(t_ms);
  const [shown, setShown] = useState(span_ms);
  if (shown !== span_ms || Math.abs(t_ms - middle) > span_ms * 0.45) {
    setShown(span_ms);
    setMiddle(t_ms);
  }
  return [Math.round(middle - span_ms / 2), Math.round(middle + span_ms / 2)];
}

function Desk({ place, player, api, now_ms }: Properties): ReactElement {
  const store = useLiveStore();
  const state = useSyncExternalStore(player.subscribe, player.read);
  const filterKey = JSON.stringify(place.live.filter ?? {});
  const filter = useMemo(() => (filterKey === "{}" ? NO_FILTER : (JSON.parse(filterKey) as Filter)), [filterKey]);
  const fleet = useFleet(filter);
  const openAlerts = useLive(ALERTS, (each) => each.alerts.size);
  useLive(TIME_TOPICS, (each) => each.sessions.size);
  const [tab, setTab] = useState<"drones" | "alerts">("drones");
  const [sheetOpen, setSheetOpen] = useState(true);
  const [said, setSaid] = useState<string | undefined>();
  const [exporting, setExporting] = useState(false);
  const [grid_m, setGrid] = useState<number | undefined>();
  const [bearing, setBearing] = useState(0);
  const map = useRef<MapHandle>(null);
  const phone = usePhone();
  const [listRef, list] = useBox();
  const [panelRef, panel] = useBox();
  const [barRef, bar] = useBox();

  const { t_ms } = state;
  const [from_ms, until_ms] = useWindow(t_ms, SPANS[place.span]);
  const marks = useQuery({
    queryKey: ["marks", from_ms, until_ms],
    queryFn: () => api.marks({ from_ms: Math.max(0, from_ms), until_ms, buckets: BUCKETS }),
    refetchInterval: until_ms > now_ms() ? MARKS_MS : false,
    placeholderData: (before) => before,
  });

  // What is selected stays selected, whatever the time; it may not have been there yet.
  const { live } = place;
  const pinned = live.session === undefined ? undefined : store.verdicts.get(live.session);
  const pinnedSession = live.session === undefined ? undefined : (store.sessions.get(live.session) ?? (pinned && sessionOf(pinned)));
  const uav_id = live.drone ?? pinnedSession?.uav_id;
  const drone = fleet.find(uav_id);
  const session = pinnedSession === undefined ? drone?.session : asOf(pinnedSession, t_ms);
  const verdict = session === undefined ? undefined : store.verdicts.get(session.session_id);
  const pad = session === undefined ? undefined : store.pads.get(session.pad_id);
  const open = drone !== undefined || session !== undefined;
  const chosen = live.drone ?? live.session;

  // What is selected is framed as soon as the film knows where it was; an address with a camera says itself where to look.
  const selectable = drone !== undefined || pinned !== undefined;
  const framed = useRef(live.camera === undefined ? "" : `${uav_id ?? ""}/${live.session ?? ""}`);
  const wanted = `${uav_id ?? ""}/${live.session ?? ""}`;
  useEffect(() => {
    if (!selectable || framed.current === wanted) return undefined;
    const timer = setTimeout(() => {
      framed.current = wanted;
      map.current?.fitSelection();
    }, 120);
    return () => clearTimeout(timer);
  }, [selectable, wanted]);

  const camera = useRef<Camera | undefined>(live.camera);
  const latest = useRef(place);
  useLayoutEffect(() => {
    latest.current = place;
  });
  const change = useCallback(
    (next: Partial<ReplayPlace>, liveNext: Change = {}, replace = false) => {
      const at = camera.current ?? latest.current.live.camera;
      const kept = changed(latest.current.live, { ...(at !== undefined && { camera: at }), ...liveNext });
      go(replayAddress({ ...latest.current, t_ms: player.read().t_ms, ...next, live: kept }), replace);
    },
    [player],
  );
  const seek = useCallback(
    (to_ms: number) => {
      setSaid(undefined);
      player.seek(Math.round(to_ms));
      change({ t_ms: player.read().t_ms });
    },
    [player, change],
  );
  const select = useCallback((next: { drone?: string; session?: string }) => change({}, { drone: undefined, session: undefined, follow: undefined, ...next }), [change]);
  const follow = (): void => {
    if (uav_id !== undefined) change({}, { drone: uav_id, session: undefined, follow: live.follow === true ? undefined : true });
  };
  const setMeasure = useCallback((measure: LivePlace["measure"], replace: boolean) => change({}, { measure }, replace), [change]);
  const { flat } = useMapWishes();
  const measuring = useMeasure(live.measure, setMeasure, map);
  const table = live.as === "table";
  const toggleTable = (): void => change({}, { as: table ? undefined : "table" });
  const { zones, overlays: zoneOverlays } = useMapZones(live.zones !== "off", t_ms);
  const planOverlays = usePlanOverlays([...store.pads.values()], !table);
  const overlays = useMemo(() => [...planOverlays, ...zoneOverlays], [planOverlays, zoneOverlays]);
  const opened = (live.zone ?? []).flatMap((id) => zones.find(({ properties }) => properties.zone_id === id) ?? []);
  const onGround = (at: LonLat): void => {
    const found = zonesAt(zones, at).map(({ properties }) => properties.zone_id);
    if (found.length > 0 || live.zone !== undefined) change({}, { drone: undefined, session: undefined, follow: undefined, zone: found.length > 0 ? found : undefined });
  };

  // The address follows the time and the camera; and where the back button, or somebody's typing, has changed it, the time follows.
  const addressed = place.t_ms;
  const known = useRef(addressed);
  useEffect(() => {
    if (addressed === known.current) return;
    known.current = addressed;
    if (addressed !== undefined && Math.abs(addressed - player.read().t_ms) > SAME_MS * player.read().speed) player.seek(addressed);
  }, [addressed, player]);
  useEffect(() => {
    const timer = setInterval(() => {
      const shown_ms = Math.round(player.read().t_ms);
      const [looks, said] = [camera.current, latest.current.live.camera];
      if (shown_ms === latest.current.t_ms && (looks === undefined || (said !== undefined && sameView(looks, said)))) return;
      known.current = shown_ms;
      change({ t_ms: shown_ms }, {}, true);
    }, URL_MS);
    return () => clearInterval(timer);
  }, [player, change]);

  const refusal = useCallback(
    (direction: "next" | "previous") => {
      setSaid(undefined);
      void api.refusal(Math.round(player.read().t_ms), direction).then(
        (found) => {
          if (found === undefined) setSaid(t("noRefusal", { direction }));
          else {
            player.pause();
            player.seek(found.t_ms);
            // Who has chosen nobody wants to see whom it was about.
            const selection = latest.current.live.drone === undefined && found.session_id !== undefined ? { session: found.session_id } : {};
            change({ t_ms: found.t_ms }, selection);
          }
        },
        (problem: unknown) => setSaid(problem instanceof Error ? problem.message : String(problem)),
      );
    },
    [api, player, change],
  );
  const toggle = (): void => (player.read().playing ? player.pause() : player.play());
  const faster = (by: 1 | -1): void => {
    player.faster(by);
    change({ speed: player.read().speed }, {}, true);
  };
  useOwnKeys({
    " ": toggle,
    k: toggle,
    j: () => faster(-1),
    l: () => faster(1),
    ArrowLeft: () => seek(t_ms - 10_000),
    ArrowRight: () => seek(t_ms + 10_000),
    ",": () => seek(t_ms - 1_000),
    ".": () => seek(t_ms + 1_000),
    p: () => refusal("previous"),
    n: () => refusal("next"),
    f: () => map.current?.fitSelection(),
    c: follow,
    m: measuring.toggle,
    x: toggleTable,
    3: () => wishMap({ flat: !flat }),
    b: () => wishMap({ imagery: !mapWishes().imagery }),
    "[": () => map.current?.turn(-TURN),
    "]": () => map.current?.turn(TURN),
    ...measuring.keys,
    0: () => map.current?.fitAll(),
    "+": () => map.current?.zoomBy(1),
    "-": () => map.current?.zoomBy(-1),
    Escape: () => (live.measure === undefined ? select({}) : measuring.toggle()),
  });

  const padding = useMemo(() => {
    const gap = 12;
    if (phone) return { top: 44, right: 8, left: 8, bottom: Math.max(list.height, panel.height) + bar.height + 8 };
    const room = 40;
    return {
      room,
      top: 52 + room,
      left: list.width + 2 * gap + room,
      right: room + (panel.width === 0 ? gap : panel.width + 2 * gap),
      bottom: bar.height + 2 * gap + 40 + room,
    };
  }, [phone, list, panel, bar]);
  const selection = useMemo(() => ({ ...(uav_id !== undefined && { uav_id }), ...(pinned !== undefined && { verdict: pinned }) }), [uav_id, pinned]);
  const goLive = placeHash({ room: "live", ...(live.drone !== undefined && { drone: live.drone }), ...(live.session !== undefined && { session: live.session }) });

  return (
    <div className="live replay">
      <h1 className="visually-hidden">{t("replay")}</h1>
      {table ? (
        <DroneTable fleet={fleet} hrefOf={(id) => placeHash(replayAddress({ ...place, live: changed(live, { as: undefined, drone: id }) }))} now_ms={t_ms} />
      ) : (
        <MapView
          ref={map}
          fleet={fleet}
          camera={live.camera}
          selection={selection}
          padding={padding}
          follow={live.follow === true ? uav_id : undefined}
          measure={measuring.points}
          deep={!flat && !phone}
          overlays={overlays}
          onGround={onGround}
          onSelect={(id) => select(id === undefined ? {} : { drone: id })}
          onCamera={(at, grid) => {
            camera.current = at;
            setGrid(grid);
            setBearing(at.bearing ?? 0);
          }}
          onRelease={() => change({}, { follow: undefined }, true)}
          onMeasure={measuring.add}
        />
      )}
      <p className="replay-badge" role="note">
        <b>{t("notLive")}</b>
        <span className="num">
          {day(t_ms)}, {timeOfDay(t_ms)}
        </span>
        <a className="button" href={goLive}>
          {t("goLive")}
        </a>
      </p>
      {(!phone || !open) && (
        <section className="float list" aria-label={t("list")} ref={listRef} data-open={sheetOpen}>
          {phone && <SheetHandle open={sheetOpen} onToggle={() => setSheetOpen(!sheetOpen)} name="list" />}
          <div className="tabs replay-tabs" role="group" aria-label={t("list")}>
            {(["drones", "alerts"] as const).map((each) => (
              <button key={each} type="button" className="tab" aria-pressed={tab === each} onClick={() => setTab(each)}>
                {each === "drones" ? t("drones") : t("alertsTab", { count: openAlerts, more: openAlerts >= MOST_ALERTS ? "yes" : "no" })}
              </button>
            ))}
          </div>
          {tab === "alerts" ? (
            <PastAlerts now_ms={t_ms} onSelect={select} />
          ) : (
            <ListPanel
              fleet={fleet}
              tab={live.list ?? "all"}
              filter={filter}
              now_ms={t_ms}
              selected={uav_id}
              onTab={(next) => change({}, { list: next === "all" ? undefined : next })}
              onFilter={(next) => change({}, { filter: Object.keys(next).length === 0 ? undefined : next })}
              onSelect={(id) => select(id === undefined ? {} : { drone: id })}
              onPad={(pad_id) => map.current?.fitPad(pad_id)}
            />
          )}
        </section>
      )}
      {open && (
        <section className="float panel" ref={panelRef} aria-label={t("replay")} data-open={sheetOpen}>
          {phone && <SheetHandle open={sheetOpen} onToggle={() => setSheetOpen(!sheetOpen)} name="proof" />}
          <SessionPanel
            drone={drone}
            session={session}
            verdict={verdict}
            pad={pad}
            now_ms={t_ms}
            place="past"
            tools={<PanelTools following={live.follow === true} onFollow={drone === undefined || table ? undefined : follow} onShow={() => map.current?.fitSelection()} onClose={() => select({})} />}
          />
        </section>
      )}
      {!open && chosen !== undefined && !state.waiting && (
        <section className="float panel panel-missing" ref={panelRef} aria-label={t("replay")}>
          <p className="empty">{t("nothing")}</p>
        </section>
      )}
      {!table && (
        <div className="map-cards">
          <ZoneCard zones={opened} now_ms={t_ms} past onClose={() => change({}, { zone: undefined })} />
        </div>
      )}
      {measuring.points !== undefined && !table && <MeasureBar points={measuring.points} onUndo={measuring.undo} onEnd={measuring.toggle} />}
      <div className="map-tools replay-tools" data-panel={open && !phone}>
        {!table && <ZoneLegend zones={zones} shown={live.zones !== "off"} onToggle={() => change({}, { zones: live.zones === "off" ? undefined : "off", zone: undefined })} />}
        {!table && <Legend grid_m={grid_m} />}
        <ZoomControls
          table={table}
          measuring={live.measure !== undefined}
          onMeasure={measuring.toggle}
          onTable={toggleTable}
          onZoom={(levels) => map.current?.zoomBy(levels)}
          onAll={() => map.current?.fitAll()}
          deep={phone ? undefined : !flat}
          bearing={bearing}
          onDeep={() => wishMap({ flat: !flat })}
          onNorth={() => map.current?.turn()}
        />
      </div>
      <section className="float replay-bar" aria-label={t("time")} ref={barRef}>
        <Controls
          state={state}
          now_ms={now_ms()}
          span={place.span}
          said={said ?? (!state.playing && t_ms >= now_ms() - 500 ? t("reachedNow") : undefined)}
          onPlay={toggle}
          onMove={(by_ms) => seek(t_ms + by_ms)}
          onRefusal={refusal}
          onSpeed={(speed) => {
            player.setSpeed(speed);
            change({ speed }, {}, true);
          }}
          onSpan={(span) => change({ span }, {}, true)}
          onGo={seek}
          onExport={() => setExporting(true)}
        />
        <Scrubber marks={marks.data} from_ms={from_ms} until_ms={until_ms} now_ms={now_ms()} t_ms={t_ms} onSeek={seek} onDrag={(to_ms) => player.seek(Math.round(to_ms))} />
      </section>
      {exporting && (
        <ExportDialog
          api={api}
          from_ms={from_ms}
          until_ms={until_ms}
          now_ms={now_ms()}
          drone={uav_id}
          pad={session?.pad_id}
          area={() => areaOf(map.current?.bounds())}
          onClose={() => setExporting(false)}
        />
      )}
    </div>
  );
}

import { QueryClient, QueryClientProvider, useQuery } from "@tanstack/react-query";
import { useCallback, useEffect, useLayoutEffect, useRef, useState, useSyncExternalStore, type ReactElement } from "react";
import { MapDesk } from "../desk/MapDesk";
import { useMapDesk } from "../desk/useMapDesk";
import type { MapHandle } from "../map/MapView";
import { changed, sameView, type Change } from "../shared/address/livePlace";
import { go, placeHash, type Camera, type Place, type PlainRoom } from "../shared/address/location";
import { replayAddress, replayPlace, SPANS, type ReplayPlace } from "../shared/address/replayPlace";
import { ApiContext, useApi } from "../shared/api/api";
import { day, timeOfDay } from "../shared/format";
import { LiveStore, type Topic } from "../shared/live/store";
import { LiveContext, useLive, useLiveStore } from "../shared/live/useLive";
import { PastApi, ReplayApi, type Area } from "./api";
import { Controls } from "./Controls";
import { ExportDialog } from "./ExportDialog";
import { PastAlerts } from "./PastAlerts";
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
const MARKS_MS = 15_000;
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
          <ReplayDesk place={replayPlace(place.query)} player={parts.player} api={parts.api} now_ms={() => live.serverNow_ms()} />
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

function ReplayDesk({ place, player, api, now_ms }: Properties): ReactElement {
  const state = useSyncExternalStore(player.subscribe, player.read);
  const openAlerts = useLive(ALERTS, (each) => each.alerts.size);
  useLive(TIME_TOPICS, (each) => each.sessions.size);
  const [tab, setTab] = useState<"drones" | "alerts">("drones");
  const [said, setSaid] = useState<string | undefined>();
  const [exporting, setExporting] = useState(false);
  const map = useRef<MapHandle>(null);
  const shown = useRef<Camera | undefined>(place.live.camera);
  const { t_ms } = state;
  const { live } = place;

  const latest = useRef(place);
  useLayoutEffect(() => {
    latest.current = place;
  });
  const write = useCallback((next: Partial<ReplayPlace>, replace: boolean) => go(replayAddress({ ...latest.current, t_ms: player.read().t_ms, ...next }), replace), [player]);
  const desk = useMapDesk({
    map,
    place: live,
    now_ms: t_ms,
    past: true,
    write: (next, replace) => write({ live: next }, replace),
    onCamera: (at) => {
      shown.current = at;
    },
  });
  const { placeWith, select, keys, barRef } = desk;
  const { uav_id, session } = desk.selected;
  const change = useCallback((next: Partial<ReplayPlace>, liveNext: Change = {}, replace = false) => write({ ...next, live: placeWith(liveNext) }, replace), [write, placeWith]);

  const [from_ms, until_ms] = useWindow(t_ms, SPANS[place.span]);
  const marks = useQuery({
    queryKey: ["marks", from_ms, until_ms],
    queryFn: () => api.marks({ from_ms: Math.max(0, from_ms), until_ms, buckets: BUCKETS }),
    refetchInterval: until_ms > now_ms() ? MARKS_MS : false,
    placeholderData: (before) => before,
  });

  const seek = useCallback(
    (to_ms: number) => {
      setSaid(undefined);
      player.seek(Math.round(to_ms));
      change({ t_ms: player.read().t_ms });
    },
    [player, change],
  );

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
      const [looks, said] = [shown.current, latest.current.live.camera];
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
    ...keys,
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
  });
  const goLive = placeHash({ room: "live", ...(live.drone !== undefined && { drone: live.drone }), ...(live.session !== undefined && { session: live.session }) });

  return (
    <MapDesk
      desk={desk}
      names={{ page: t("replay"), list: t("list"), proof: t("replay") }}
      hrefOf={(id) => placeHash(replayAddress({ ...place, live: changed(live, { as: undefined, drone: id }) }))}
      missing={(live.drone ?? live.session) !== undefined && !state.waiting ? t("nothing") : undefined}
      head={
        <p className="replay-badge" role="note">
          <b>{t("notLive")}</b>
          <span className="num">
            {day(t_ms)}, {timeOfDay(t_ms)}
          </span>
          <a className="button" href={goLive}>
            {t("goLive")}
          </a>
        </p>
      }
      listHead={
        <div className="tabs replay-tabs" role="group" aria-label={t("list")}>
          {(["drones", "alerts"] as const).map((each) => (
            <button key={each} type="button" className="tab" aria-pressed={tab === each} onClick={() => setTab(each)}>
              {each === "drones" ? t("drones") : t("alertsTab", { count: openAlerts, more: openAlerts >= MOST_ALERTS ? "yes" : "no" })}
            </button>
          ))}
        </div>
      }
      {...(tab === "alerts" && { instead: <PastAlerts now_ms={t_ms} onSelect={select} /> })}
    >
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
    </MapDesk>
  );
}

import { useEffect, useMemo, useRef, useState, type ReactElement } from "react";
import { go, type LivePlace } from "../shared/address/location";
import type { VerdictSummary } from "../shared/api/records";
import { age, count, timeOfDay } from "../shared/format";
import { useFleet } from "../shared/live/useFleet";
import { useLiveStore, useServerNow } from "../shared/live/useLive";
import { Sentence } from "../shared/ui/Sentence";
import { Symbol } from "../shared/ui/Symbol";
import { useKeys } from "../shared/ui/useKeys";
import { account } from "../sessions/words";
import { Legend } from "../desk/Legend";
import { MapView, type MapHandle } from "../map/MapView";
import { padsByNeed } from "../map/padState";
import { mapTexts } from "../map/texts";
import { deskTexts } from "../desk/texts";
import { liveTexts as t } from "./texts";

/** Each refusal has the wall for so long; after the last of them all pads have it. */
export const TURN_MS = 12_000;
const RECENT_MS = 30 * 60_000;
const MOST = 6;
const EMPTY_FILTER = {};

/** The refusals that the wall goes through, the newest first. */
export function refusals(verdicts: readonly VerdictSummary[], now_ms: number): VerdictSummary[] {
  return verdicts.filter((verdict) => now_ms - verdict.decided_ms < RECENT_MS && verdict.outcome === "refuted");
}

/** For a wall that nobody operates: the map, the time, how many of what, and each of the newest refusals in turn. */
export function WallPage({ place }: { place: LivePlace }): ReactElement {
  const store = useLiveStore();
  const now_ms = useServerNow();
  const fleet = useFleet(place.filter ?? EMPTY_FILTER);
  const map = useRef<MapHandle>(null);
  const all = refusals(store.verdictsByTime(), now_ms);
  const turns = all.slice(0, MOST);
  const newest = turns[0]?.session_id;
  const [turn, setTurn] = useState({ newest, index: 0 });
  // A new refusal has the wall at once.
  if (turn.newest !== newest) setTurn({ newest, index: 0 });
  const length = turns.length;
  useEffect(() => {
    const timer = setInterval(() => setTurn((before) => ({ ...before, index: (before.index + 1) % (length + 1) })), TURN_MS);
    return () => clearInterval(timer);
  }, [length, newest]);
  const verdict = turns[turn.index];

  const id = verdict?.session_id;
  useEffect(() => {
    const timer = setTimeout(() => (id === undefined ? map.current?.fitAll() : map.current?.fitSelection()), 100);
    return () => clearTimeout(timer);
  }, [id]);

  useKeys({
    Escape: () => {
      const { as: _as, ...rest } = place;
      go(rest);
    },
  });
  const selection = verdict === undefined ? {} : { uav_id: verdict.uav_id, verdict };
  const padding = useMemo(() => {
    const wide = matchMedia("(min-width: 900px)").matches;
    return wide ? { top: 24, right: 24, bottom: 70, left: Math.max(380, innerWidth * 0.3) } : { top: 8, right: 8, left: 8, bottom: innerHeight * 0.45 };
  }, []);
  const pad = verdict === undefined ? undefined : store.pads.get(verdict.pad_id);
  const troubled = padsByNeed(store.pads.values(), now_ms).filter(({ state }) => state.tone !== "ok");
  return (
    <div className="live wall">
      <h1 className="visually-hidden">{mapTexts("wall")}</h1>
      <MapView ref={map} fleet={fleet} camera={undefined} selection={selection} padding={padding} onSelect={() => undefined} onCamera={() => undefined} />
      <section className="wall-side" aria-label={mapTexts("wall")}>
        <p className="wall-time num">{timeOfDay(now_ms)}</p>
        <ul className="wall-counts num">
          {(["refuted", "inconclusive", "proving", "verified"] as const).map((look) => (
            <li key={look} className={`look-${look}`}>
              <Symbol look={look} size={40} named />
              {count(fleet.looking(look))}
            </li>
          ))}
        </ul>
        <p className="wall-all quiet num">{deskTexts("counts", { drones: fleet.total, pads: store.pads.size })}</p>
        {troubled.slice(0, 3).map(({ pad: each, state }) => (
          <p key={each.pad_id} className={`wall-pad tone-${state.tone}`}>
            <b>{each.name}</b>: {state.text}
          </p>
        ))}
        {verdict === undefined ? (
          <p className="wall-told wall-quiet">{all.length === 0 ? t("wallQuiet") : t("wallRefused", { count: all.length })}</p>
        ) : (
          <article className="wall-told told-bad" key={verdict.session_id}>
            <h2 className="look-refuted">
              <Symbol look="refuted" size={44} />
              {account(verdict, pad).title}
            </h2>
            <Sentence phrases={account(verdict, pad).sentence} />
            <p className="quiet num">
              {t("wallWhere", { who: verdict.uav_id, pad: pad?.name ?? verdict.pad_id })} · {age(now_ms - verdict.decided_ms)}
            </p>
          </article>
        )}
        <p className="wall-leave quiet">{t("wallLeave")}</p>
      </section>
      <div className="map-tools">
        <Legend grid_m={undefined} />
      </div>
    </div>
  );
}

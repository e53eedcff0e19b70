/** The address of the replay: the time, the speed, and what the live map's address says of selection and camera. */
import { livePlace, liveQuery } from "./livePlace";
import { placeHash, type LivePlace, type Place, type PlainRoom } from "./location";

/** How many times as fast as it was. */
export const SPEEDS = [1, 2, 5, 10, 30, 60] as const;
export type Speed = (typeof SPEEDS)[number];
export const SPANS = { tenMinutes: 600_000, hour: 3_600_000, sixHours: 21_600_000, day: 86_400_000, week: 604_800_000 } as const;
export type Span = keyof typeof SPANS;

export type ReplayPlace = {
  /** Missing where the address names none: then it begins a little before now. */
  t_ms: number | undefined;
  speed: Speed;
  span: Span;
  live: LivePlace;
};

/** What of the live map's address means something here. */
function kept(place: LivePlace): LivePlace {
  const { drone, session, camera, filter, list, follow, measure, zone, zones } = place;
  return {
    room: "live",
    ...(drone !== undefined && { drone }),
    ...(session !== undefined && { session }),
    ...(camera !== undefined && { camera }),
    ...(filter !== undefined && { filter }),
    ...(list !== undefined && { list }),
    ...(follow !== undefined && { follow }),
    ...(measure !== undefined && { measure }),
    ...(zone !== undefined && { zone }),
    ...(zones !== undefined && { zones }),
    ...(place.as === "table" && { as: "table" as const }),
  };
}

export function replayPlace(query: Readonly<Record<string, string>>): ReplayPlace {
  const t_ms = Date.parse(query["t"] ?? "");
  const speed = SPEEDS.find((each) => String(each) === query["speed"]) ?? 1;
  const span = (Object.keys(SPANS) as Span[]).find((each) => each === query["span"]) ?? "hour";
  return { t_ms: Number.isNaN(t_ms) || t_ms < 0 ? undefined : t_ms, speed, span, live: kept(livePlace(new URLSearchParams(query))) };
}

export function replayAddress(place: ReplayPlace): Place & { room: PlainRoom } {
  return {
    room: "replay",
    path: [],
    query: {
      ...(place.t_ms !== undefined && { t: new Date(place.t_ms).toISOString() }),
      ...(place.speed !== 1 && { speed: String(place.speed) }),
      ...(place.span !== "hour" && { span: place.span }),
      ...Object.fromEntries(liveQuery(place.live)),
    },
  };
}

/** The link to a moment, for other rooms: with what was selected there. */
export function replayHash(t_ms: number, selection: { drone?: string; session?: string } = {}): string {
  return placeHash(replayAddress({ t_ms, speed: 1, span: "hour", live: { room: "live", ...selection } }));
}

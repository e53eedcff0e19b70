/** What a zone says, in the user's words. */
import { count, dayAndTime } from "../shared/format";
import type { Zone } from "./calls";
import { zoneTexts as t } from "./texts";

type Layer = Zone["layers"][number];
type Daily = { day: string[]; startTime?: string; startEvent?: string; endTime?: string; endEvent?: string };
type Period = { startDateTime?: string; endDateTime?: string; schedule?: Daily[] };

export function nameOf(zone: Pick<Zone, "zone_id" | "name">): string {
  return zone.name ?? zone.zone_id;
}

function limit(of: Layer["lower"], missing: string): string {
  return of === undefined ? missing : t("limit", { metres: count(Math.round(of.metres)), reference: of.reference });
}

/** "0 m AGL to 120 m AGL", for each different layer. */
export function heights({ layers }: Pick<Zone, "layers">): string[] {
  return [...new Set(layers.map(({ lower, upper }) => t("span", { lower: limit(lower, t("ground")), upper: limit(upper, t("unlimited")) })))];
}

/** Whether it holds now, and until or from when. */
export function holding({ active, changes_ms }: Pick<Zone, "active"> & { changes_ms?: number }, now_ms: number): string {
  const word = t(active ? "active" : "inactive");
  return changes_ms === undefined ? word : `${word}, ${t(active ? "until" : "from", { when: dayAndTime(changes_ms, now_ms) })}`;
}

function edge(time: string | undefined, event: string | undefined): string {
  if (event !== undefined) return t("event", { event });
  if (time === undefined) return t("midnight");
  return time.replace(/^(\d\d:\d\d)(:00)?/, "$1").replace(/Z$/, " UTC").replace(/([+-]\d\d:\d\d)$/, " UTC$1");
}

/** Its times as its file has them: with their own offsets from UTC. */
export function times({ feature }: Pick<Zone, "feature">): string[] {
  const properties = (feature?.["properties"] ?? {}) as { limitedApplicability?: Period[] };
  const periods = properties.limitedApplicability ?? [];
  if (periods.length === 0) return [t("always")];
  return periods.flatMap(({ startDateTime, endDateTime, schedule = [] }) => {
    const bounds = startDateTime === undefined && endDateTime === undefined ? [] : [t("between", { start: startDateTime ?? t("open"), end: endDateTime ?? t("open") })];
    return [...bounds, ...schedule.map((daily) => t("daily", { days: daily.day.map((day) => t("day", { day })).join(", "), start: edge(daily.startTime, daily.startEvent), end: edge(daily.endTime, daily.endEvent) }))];
  });
}

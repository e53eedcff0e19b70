import type { Action, Pad, SessionSummary, VerdictSummary } from "./api/records";
import { byNeed, GONE_MS, heardDrone, judgedDrone, LOOKS, SILENT_MS, type Drone, type Group, type Look } from "./drones";
import { distance_mm } from "./geo/frame";
import type { LiveStore } from "./live/store";

/** What is shown of all that is about. Several hold at once. */
export type Filter = {
  look?: Look;
  pad?: string;
  /** As the drone broadcasts it. */
  operator?: string;
  action?: Action;
  /** Only what was decided in the last so many minutes; where nothing was, what was asked, or else heard. */
  minutes?: number;
};

export type Tab = "all" | Exclude<Group, "other">;

/** Rows in order, of which only those that somebody looks at are made. */
export type Rows = { length: number; at: (index: number) => Drone | undefined; indexOf: (uav_id: string) => number };

/** In a column of looks: not there, or not within the filter. */
export const HIDDEN = 255;
const CODE = new Map(LOOKS.map((look, code) => [look, code]));
const UNPROVED = CODE.get("unproved") ?? HIDDEN;
const FAR = CODE.get("out-of-range") ?? HIDDEN;
const SILENT = CODE.get("silent") ?? HIDDEN;
/** Those of which only what is heard is known, in the order of the list. */
const HEARD = [UNPROVED, FAR, SILENT];
/** Of a square of the globe, 10⁻⁷ degrees: 0.02° is two kilometres of latitude. */
const CELL_E7 = 200_000;
const CELLS_ROUND = 18_000;

/** Newest of each drone, of a list that is newest first. */
function newest<T extends { uav_id: string }>(list: readonly T[]): Map<string, T> {
  const found = new Map<string, T>();
  for (const each of list) if (!found.has(each.uav_id)) found.set(each.uav_id, each);
  return found;
}

const cell = (lat_e7: number, lon_e7: number): number => Math.floor(lat_e7 / CELL_E7) * CELLS_ROUND + Math.floor(lon_e7 / CELL_E7);

/** The pads that could range a drone in a square. */
function padsByCell(pads: Iterable<Pad>): Map<number, Pad[]> {
  const cells = new Map<number, Pad[]>();
  for (const pad of pads) {
    const reach_mm = pad.commissioning?.max_range_mm;
    if (pad.status === "retired" || reach_mm === undefined) continue;
    // Degrees of longitude are short in the north: two squares to each side hold two kilometres up to 60°, one up to 80°.
    const around = reach_mm > 2_000_000 ? 4 : 2;
    for (let i = -around; i <= around; i++) {
      for (let j = -around; j <= around; j++) {
        const key = cell(pad.lat_e7 + i * CELL_E7, pad.lon_e7 + j * CELL_E7);
        cells.set(key, [...(cells.get(key) ?? []), pad]);
      }
    }
  }
  return cells;
}

/**
 * Everybody who is about, at one moment: who needs the officer, and for all others only a column of looks, so that ten
 * thousand of them are looked through in milliseconds.
 */
export class Fleet {
  /** By the slots of the store's tracks: the number of the look, or `HIDDEN`. */
  readonly looks: Uint8Array;
  /** Those of which a session or verdict speaks, in the order of need; within the filter. */
  readonly judged: readonly Drone[];
  /** How many there are of each group, and in all, within the filter. */
  readonly counts: Readonly<Record<Tab, number>>;
  /** How many there are without the filter. */
  readonly total: number;
  /** The slots of those of which only what is heard is known, in the order of the list; within the filter. */
  readonly heard: Uint32Array;
  private readonly byId: ReadonlyMap<string, Drone>;

  constructor(
    private readonly store: LiveStore,
    readonly now_ms: number,
    readonly filter: Filter = {},
  ) {
    const all = judgedDrones(store, now_ms);
    this.byId = new Map(all.map((drone) => [drone.uav_id, drone]));
    this.judged = all.filter((drone) => this.shows(drone));
    this.looks = new Uint8Array(store.tracks.extent).fill(HIDDEN);
    for (const drone of this.judged) {
      const slot = store.tracks.slot(drone.uav_id);
      if (slot !== undefined) this.looks[slot] = CODE.get(drone.look) ?? HIDDEN;
    }
    const { order, total } = this.listen();
    this.heard = order;
    this.total = all.length + total;
    const count = (group: Group): number => this.judged.filter((drone) => drone.group === group).length;
    this.counts = {
      all: this.judged.length + order.length,
      "needs-you": count("needs-you"),
      proving: count("proving"),
      verified: count("verified"),
    };
  }

  /** How many of the judged have this symbol: what needs the officer is more than what was refuted. */
  looking(look: Drone["look"]): number {
    return this.judged.filter((drone) => drone.look === look).length;
  }

  /** A drone that is about, within the filter or not. */
  find(uav_id: string | undefined): Drone | undefined {
    if (uav_id === undefined) return undefined;
    return this.byId.get(uav_id) ?? heardNow(this.store, uav_id, this.now_ms);
  }

  rows(tab: Tab): Rows {
    const first = tab === "all" ? this.judged : this.judged.filter(({ group }) => group === tab);
    const rest = tab === "all" ? this.heard : new Uint32Array();
    return {
      length: first.length + rest.length,
      at: (index) => {
        const slot = rest[index - first.length];
        return first[index] ?? (slot === undefined ? undefined : heardDrone(this.store, slot, LOOKS[this.looks[slot] ?? 0] ?? "unproved"));
      },
      indexOf: (uav_id) => {
        const index = first.findIndex((drone) => drone.uav_id === uav_id);
        if (index >= 0) return index;
        const slot = this.store.tracks.slot(uav_id);
        const at = slot === undefined ? -1 : rest.indexOf(slot);
        return at < 0 ? -1 : first.length + at;
      },
    };
  }

  /** Looks through all that is only heard; their order in the list: by look, then by name. */
  private listen(): { order: Uint32Array; total: number } {
    const { store, now_ms, looks } = this;
    const { tracks } = store;
    const cells = padsByCell(store.pads.values());
    const shows = this.heardFilter();
    const slots = tracks.slots();
    const counts: [number, number, number] = [0, 0, 0];
    let total = 0;
    for (const slot of slots) {
      if (looks[slot] !== HIDDEN || this.byId.has(tracks.nameAt(slot))) continue;
      const age_ms = now_ms - (tracks.t_ms[slot] ?? 0);
      if (age_ms > GONE_MS) continue;
      total += 1;
      const code = age_ms > SILENT_MS ? SILENT : this.inReach(slot, cells) ? UNPROVED : FAR;
      if (!shows(slot, code, age_ms)) continue;
      looks[slot] = code;
      counts[HEARD.indexOf(code) as 0 | 1 | 2] += 1;
    }
    return { order: this.sorted(slots, counts), total };
  }

  private sorted(slots: Uint32Array, [unproved, far, silent]: readonly [number, number, number]): Uint32Array {
    const order = new Uint32Array(unproved + far + silent);
    const next = [0, unproved, unproved + far];
    for (const slot of slots) {
      const group = HEARD.indexOf(this.looks[slot] ?? HIDDEN);
      if (group < 0 || this.byId.has(this.store.tracks.nameAt(slot))) continue;
      const at = next[group] ?? 0;
      order[at] = slot;
      next[group] = at + 1;
    }
    return order;
  }

  private inReach(slot: number, cells: ReadonlyMap<number, readonly Pad[]>): boolean {
    const lat_e7 = this.store.tracks.lat_e7[slot] ?? 0;
    const lon_e7 = this.store.tracks.lon_e7[slot] ?? 0;
    const near = cells.get(cell(lat_e7, lon_e7));
    return near?.some((pad) => distance_mm(pad, { lat_e7, lon_e7 }) <= (pad.commissioning?.max_range_mm ?? 0)) ?? false;
  }

  private heardFilter(): (slot: number, code: number, age_ms: number) => boolean {
    const { look, pad, operator, action, minutes } = this.filter;
    const { tracks } = this.store;
    const wanted = look === undefined ? undefined : CODE.get(look);
    return (slot, code, age_ms) =>
      action === undefined &&
      (wanted === undefined || wanted === code) &&
      (pad === undefined || tracks.padAt(slot) === pad) &&
      (operator === undefined || tracks.operatorAt(slot) === operator) &&
      (minutes === undefined || age_ms <= minutes * 60_000);
  }

  private shows(drone: Drone): boolean {
    const { look, pad, operator, action, minutes } = this.filter;
    return (
      (look === undefined || drone.look === look) &&
      (pad === undefined || drone.session?.pad_id === pad) &&
      (operator === undefined || drone.track?.operator_id === operator) &&
      (action === undefined || drone.session?.action === action) &&
      (minutes === undefined || this.now_ms - drone.t_ms <= minutes * 60_000)
    );
  }
}

function heardNow(store: LiveStore, uav_id: string, now_ms: number): Drone | undefined {
  const slot = store.tracks.slot(uav_id);
  if (slot === undefined) return undefined;
  const age_ms = now_ms - (store.tracks.t_ms[slot] ?? 0);
  if (age_ms > GONE_MS) return undefined;
  const drone = heardDrone(store, slot, "unproved");
  const { nearest } = drone;
  const far = nearest === undefined || nearest.distance_mm > (nearest.pad.commissioning?.max_range_mm ?? 0);
  return { ...drone, look: age_ms > SILENT_MS ? "silent" : far ? "out-of-range" : "unproved" };
}

/** One drone that is about; undefined where nobody hears it and nothing speaks of it. */
export function droneOf(store: LiveStore, uav_id: string, now_ms: number): Drone | undefined {
  const its = (each: { uav_id: string }): boolean => each.uav_id === uav_id;
  const drone = judgedDrone(store, uav_id, store.sessionsByTime().find(its), store.verdictsByTime().find(its), now_ms);
  return drone ?? heardNow(store, uav_id, now_ms);
}

function judgedDrones(store: LiveStore, now_ms: number): Drone[] {
  const sessions: Map<string, SessionSummary> = newest(store.sessionsByTime());
  const verdicts: Map<string, VerdictSummary> = newest(store.verdictsByTime());
  const found: Drone[] = [];
  for (const uav_id of new Set([...sessions.keys(), ...verdicts.keys()])) {
    const drone = judgedDrone(store, uav_id, sessions.get(uav_id), verdicts.get(uav_id), now_ms);
    if (drone !== undefined) found.push(drone);
  }
  return found.sort(byNeed);
}

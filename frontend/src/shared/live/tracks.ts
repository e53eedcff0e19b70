import type { Track } from "../api/records";
import type { TrackColumns } from "./columns";
import { mercatorX, mercatorY } from "../geo/mercator";

export type TrailPoint = { lat_e7: number; lon_e7: number };

/** A trail shows the last minute, a point a second. */
export const TRAIL_S = 60;
const TRAIL_POINTS = 64;
const FIRST_CAPACITY = 1_024;
/** What a column has where the broadcast had nothing. */
export const ABSENT = -2_147_483_648;

const REST = ["operator_id", "status", "drip", "transports", "description", "description_type", "area_count", "area_radius_mm"] as const;
/** What of a track changes seldom and is shown seldom. */
export type TrackRest = Pick<Track, (typeof REST)[number]>;
type Numbers = "height_mm" | "accuracy_mm" | "speed_mm_s" | "track_cdeg" | "vertical_mm_s";

/**
 * The latest position of each drone, as columns: ten thousand of them ten times a second cost no objects.
 *
 * A drone has a slot as long as it is known; `slots` lists those in use. Columns are read, never written, from outside,
 * and only until the next change: they move when the table grows.
 */
export class TrackTable {
  lat_e7 = new Int32Array(FIRST_CAPACITY);
  lon_e7 = new Int32Array(FIRST_CAPACITY);
  /** Web Mercator, 0 to 1 from the west and from the north: what is drawn. */
  x = new Float64Array(FIRST_CAPACITY);
  y = new Float64Array(FIRST_CAPACITY);
  t_ms = new Float64Array(FIRST_CAPACITY);
  private numbers: Record<Numbers, Int32Array> = {
    height_mm: new Int32Array(FIRST_CAPACITY),
    accuracy_mm: new Int32Array(FIRST_CAPACITY),
    speed_mm_s: new Int32Array(FIRST_CAPACITY),
    track_cdeg: new Int32Array(FIRST_CAPACITY),
    vertical_mm_s: new Int32Array(FIRST_CAPACITY),
  };
  private trailLat = new Int32Array(FIRST_CAPACITY * TRAIL_POINTS);
  private trailLon = new Int32Array(FIRST_CAPACITY * TRAIL_POINTS);
  private trail_s = new Uint32Array(FIRST_CAPACITY * TRAIL_POINTS);
  private trailNext = new Uint16Array(FIRST_CAPACITY);

  private readonly names: (string | undefined)[] = [];
  private readonly pads: string[] = [];
  private readonly transports: string[] = [];
  private readonly rest: (TrackRest | undefined)[] = [];
  private readonly slotOf = new Map<string, number>();
  private readonly free: number[] = [];
  private sorted: Uint32Array | undefined;
  /** By the numbers of the worker's columns: who it is. */
  private numbered: string[] = [];
  /** And where each of those last was, to be found again without its name; −1: nowhere yet. */
  private numberedSlots: number[] = [];

  get size(): number {
    return this.slotOf.size;
  }

  /** One more than the highest slot in use: how long a column by slot must be. */
  get extent(): number {
    return this.names.length;
  }

  has(uav_id: string): boolean {
    return this.slotOf.has(uav_id);
  }

  slot(uav_id: string): number | undefined {
    return this.slotOf.get(uav_id);
  }

  keys(): IterableIterator<string> {
    return this.slotOf.keys();
  }

  nameAt(slot: number): string {
    return this.names[slot] ?? "";
  }

  padAt(slot: number): string {
    return this.pads[slot] ?? "";
  }

  /** Above the ellipsoid; undefined where the broadcast has none. */
  heightAt(slot: number): number | undefined {
    return this.numberAt("height_mm", slot);
  }

  /** Over the ground, and upwards. */
  speedAt(slot: number): number | undefined {
    return this.numberAt("speed_mm_s", slot);
  }

  climbAt(slot: number): number | undefined {
    return this.numberAt("vertical_mm_s", slot);
  }

  /** Clockwise from north, hundredths of a degree. */
  headingAt(slot: number): number | undefined {
    return this.numberAt("track_cdeg", slot);
  }

  private numberAt(name: Numbers, slot: number): number | undefined {
    const value = this.numbers[name][slot] ?? ABSENT;
    return value === ABSENT ? undefined : value;
  }

  operatorAt(slot: number): string | undefined {
    return this.rest[slot]?.operator_id;
  }

  /** The slots in use, by the drones' names. */
  slots(): Uint32Array {
    this.sorted ??= Uint32Array.from(
      [...this.slotOf].sort(([a], [b]) => (a < b ? -1 : 1)),
      ([, slot]) => slot,
    );
    return this.sorted;
  }

  get(uav_id: string): Track | undefined {
    const slot = this.slotOf.get(uav_id);
    return slot === undefined ? undefined : this.at(slot);
  }

  at(slot: number): Track {
    const number = (name: Numbers): Partial<Record<Numbers, number>> => {
      const value = this.numbers[name][slot] ?? ABSENT;
      return value === ABSENT ? {} : { [name]: value };
    };
    return {
      uav_id: this.nameAt(slot),
      lat_e7: this.lat_e7[slot] ?? 0,
      lon_e7: this.lon_e7[slot] ?? 0,
      t_ms: this.t_ms[slot] ?? 0,
      pad_id: this.padAt(slot),
      transport: this.transports[slot] ?? "",
      verified: false,
      ...number("height_mm"),
      ...number("accuracy_mm"),
      ...number("speed_mm_s"),
      ...number("track_cdeg"),
      ...number("vertical_mm_s"),
      ...this.rest[slot],
    };
  }

  /** Where it was in the last minute, oldest first, and where it is. */
  trail(uav_id: string): TrailPoint[] {
    const slot = this.slotOf.get(uav_id);
    if (slot === undefined) return [];
    const oldest_s = Math.floor((this.t_ms[slot] ?? 0) / 1000) - TRAIL_S;
    const points: TrailPoint[] = [];
    const next = this.trailNext[slot] ?? 0;
    for (let i = 0; i < TRAIL_POINTS; i++) {
      const at = slot * TRAIL_POINTS + ((next + i) % TRAIL_POINTS);
      const second = this.trail_s[at] ?? 0;
      if (second !== 0 && second >= oldest_s) points.push({ lat_e7: this.trailLat[at] ?? 0, lon_e7: this.trailLon[at] ?? 0 });
    }
    points.push({ lat_e7: this.lat_e7[slot] ?? 0, lon_e7: this.lon_e7[slot] ?? 0 });
    return points;
  }

  set(track: Track): void {
    const slot = this.slotFor(track.uav_id);
    this.move(slot, track.lat_e7, track.lon_e7, mercatorX(track.lon_e7 / 1e7), mercatorY(track.lat_e7 / 1e7), track.t_ms);
    for (const name of Object.keys(this.numbers) as Numbers[]) this.numbers[name][slot] = track[name] ?? ABSENT;
    this.pads[slot] = track.pad_id;
    this.transports[slot] = track.transport;
    this.rest[slot] = restOf(track);
  }

  /** What the worker packed. */
  take(columns: TrackColumns): void {
    if (columns.firstName === 0) {
      this.numbered = [];
      this.numberedSlots = [];
    }
    for (const name of columns.names) this.numberedSlots[this.numbered.push(name) - 1] = -1;
    const { number, lat_e7, lon_e7, x, y, t_ms, height_mm, accuracy_mm, speed_mm_s, track_cdeg, vertical_mm_s, pad, transport } = columns;
    for (let i = 0; i < number.length; i++) {
      const slot = this.numberedSlot(number[i] ?? -1);
      if (slot === undefined) continue;
      this.move(slot, lat_e7[i] ?? 0, lon_e7[i] ?? 0, x[i] ?? 0, y[i] ?? 0, t_ms[i] ?? 0);
      this.numbers.height_mm[slot] = height_mm[i] ?? ABSENT;
      this.numbers.accuracy_mm[slot] = accuracy_mm[i] ?? ABSENT;
      this.numbers.speed_mm_s[slot] = speed_mm_s[i] ?? ABSENT;
      this.numbers.track_cdeg[slot] = track_cdeg[i] ?? ABSENT;
      this.numbers.vertical_mm_s[slot] = vertical_mm_s[i] ?? ABSENT;
      this.pads[slot] = columns.words[pad[i] ?? -1] ?? "";
      this.transports[slot] = columns.words[transport[i] ?? -1] ?? "";
    }
    for (const [i, rest] of columns.rest) {
      const slot = this.slotOf.get(this.numbered[i] ?? "");
      if (slot !== undefined) this.rest[slot] = rest;
    }
  }

  delete(uav_id: string): void {
    const slot = this.slotOf.get(uav_id);
    if (slot === undefined) return;
    this.slotOf.delete(uav_id);
    this.names[slot] = undefined;
    this.rest[slot] = undefined;
    this.trail_s.fill(0, slot * TRAIL_POINTS, (slot + 1) * TRAIL_POINTS);
    this.t_ms[slot] = 0;
    this.free.push(slot);
    this.sorted = undefined;
  }

  /** Forgets drones that nobody heard since then; whether there were any. */
  forgetBefore(t_ms: number): boolean {
    const before = this.size;
    for (const [uav_id, slot] of this.slotOf) if ((this.t_ms[slot] ?? 0) < t_ms) this.delete(uav_id);
    return this.size < before;
  }

  clear(): void {
    for (const uav_id of [...this.slotOf.keys()]) this.delete(uav_id);
  }

  private numberedSlot(number: number): number | undefined {
    const name = this.numbered[number];
    if (name === undefined) return undefined;
    const known = this.numberedSlots[number] ?? -1;
    // It may have been forgotten meanwhile, and its slot another's.
    if (known >= 0 && this.names[known] === name) return known;
    const slot = this.slotFor(name);
    this.numberedSlots[number] = slot;
    return slot;
  }

  private slotFor(uav_id: string): number {
    const known = this.slotOf.get(uav_id);
    if (known !== undefined) return known;
    const slot = this.free.pop() ?? this.names.length;
    if (slot >= this.t_ms.length) this.grow();
    this.names[slot] = uav_id;
    this.slotOf.set(uav_id, slot);
    this.sorted = undefined;
    return slot;
  }

  private move(slot: number, lat_e7: number, lon_e7: number, x: number, y: number, t_ms: number): void {
    this.lat_e7[slot] = lat_e7;
    this.lon_e7[slot] = lon_e7;
    this.x[slot] = x;
    this.y[slot] = y;
    this.t_ms[slot] = t_ms;
    const second = Math.floor(t_ms / 1000);
    const next = this.trailNext[slot] ?? 0;
    const last = slot * TRAIL_POINTS + ((next + TRAIL_POINTS - 1) % TRAIL_POINTS);
    if (second <= (this.trail_s[last] ?? 0)) return;
    const at = slot * TRAIL_POINTS + next;
    this.trailLat[at] = lat_e7;
    this.trailLon[at] = lon_e7;
    this.trail_s[at] = second;
    this.trailNext[slot] = (next + 1) % TRAIL_POINTS;
  }

  private grow(): void {
    const size = this.t_ms.length * 2;
    const more = <T extends Int32Array | Uint32Array | Uint16Array | Float64Array>(old: T, length = size): T => {
      const made = new (old.constructor as new (length: number) => T)(length);
      made.set(old);
      return made;
    };
    this.lat_e7 = more(this.lat_e7);
    this.lon_e7 = more(this.lon_e7);
    this.x = more(this.x);
    this.y = more(this.y);
    this.t_ms = more(this.t_ms);
    for (const name of Object.keys(this.numbers) as Numbers[]) this.numbers[name] = more(this.numbers[name]);
    this.trailLat = more(this.trailLat, size * TRAIL_POINTS);
    this.trailLon = more(this.trailLon, size * TRAIL_POINTS);
    this.trail_s = more(this.trail_s, size * TRAIL_POINTS);
    this.trailNext = more(this.trailNext);
  }
}

export function restOf(track: Track): TrackRest | undefined {
  const said = REST.filter((name) => track[name] !== undefined);
  return said.length === 0 ? undefined : Object.fromEntries(said.map((name) => [name, track[name]]));
}

/** Whether a track says the same of what changes seldom. */
export function saysRest(track: Track, rest: TrackRest | undefined): boolean {
  return REST.every((name) => track[name] === rest?.[name] || (typeof track[name] === "object" && JSON.stringify(track[name]) === JSON.stringify(rest?.[name])));
}

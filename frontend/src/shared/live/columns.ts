import type { Track } from "../api/records";
import { mercatorX, mercatorY } from "../geo/mercator";
import { ABSENT, restOf, saysRest, type TrackRest } from "./tracks";

/** Many tracks as columns, which a worker hands over without copying. */
export type TrackColumns = {
  /** Names of the numbers from `firstName` on; a `firstName` of 0 begins the numbering anew. */
  firstName: number;
  names: string[];
  /** Names of pads and transports, which `pad` and `transport` point into. */
  words: string[];
  number: Uint32Array;
  lat_e7: Int32Array;
  lon_e7: Int32Array;
  /** The same in Web Mercator, as `TrackTable` has it. */
  x: Float64Array;
  y: Float64Array;
  t_ms: Float64Array;
  height_mm: Int32Array;
  accuracy_mm: Int32Array;
  speed_mm_s: Int32Array;
  track_cdeg: Int32Array;
  vertical_mm_s: Int32Array;
  pad: Uint16Array;
  transport: Uint16Array;
  /** What changes seldom, only where it did, by number. */
  rest: [number: number, rest: TrackRest | undefined][];
};

/** Packs tracks into columns; numbers drones as they come. One for each stream: the other end learns the names once. */
export class TrackPacker {
  private numbers = new Map<string, number>();
  private lastRest: (TrackRest | undefined)[] = [];

  /** Begins anew, as after a snapshot; the other end will, too. */
  reset(): void {
    this.numbers = new Map();
    this.lastRest = [];
  }

  pack(tracks: readonly Track[]): TrackColumns {
    const size = tracks.length;
    const words = new Map<string, number>();
    const word = (text: string): number => {
      const known = words.get(text);
      if (known !== undefined) return known;
      words.set(text, words.size);
      return words.size - 1;
    };
    const columns: TrackColumns = {
      firstName: this.numbers.size,
      names: [],
      words: [],
      number: new Uint32Array(size),
      lat_e7: new Int32Array(size),
      lon_e7: new Int32Array(size),
      x: new Float64Array(size),
      y: new Float64Array(size),
      t_ms: new Float64Array(size),
      height_mm: new Int32Array(size),
      accuracy_mm: new Int32Array(size),
      speed_mm_s: new Int32Array(size),
      track_cdeg: new Int32Array(size),
      vertical_mm_s: new Int32Array(size),
      pad: new Uint16Array(size),
      transport: new Uint16Array(size),
      rest: [],
    };
    tracks.forEach((track, i) => {
      const number = this.numberOf(track.uav_id, columns.names);
      columns.number[i] = number;
      columns.lat_e7[i] = track.lat_e7;
      columns.lon_e7[i] = track.lon_e7;
      columns.x[i] = mercatorX(track.lon_e7 / 1e7);
      columns.y[i] = mercatorY(track.lat_e7 / 1e7);
      columns.t_ms[i] = track.t_ms;
      columns.height_mm[i] = track.height_mm ?? ABSENT;
      columns.accuracy_mm[i] = track.accuracy_mm ?? ABSENT;
      columns.speed_mm_s[i] = track.speed_mm_s ?? ABSENT;
      columns.track_cdeg[i] = track.track_cdeg ?? ABSENT;
      columns.vertical_mm_s[i] = track.vertical_mm_s ?? ABSENT;
      columns.pad[i] = word(track.pad_id);
      columns.transport[i] = word(track.transport);
      if (!saysRest(track, this.lastRest[number])) {
        const rest = restOf(track);
        this.lastRest[number] = rest;
        columns.rest.push([number, rest]);
      }
    });
    columns.words = [...words.keys()];
    return columns;
  }

  private numberOf(uav_id: string, names: string[]): number {
    const known = this.numbers.get(uav_id);
    if (known !== undefined) return known;
    const number = this.numbers.size;
    this.numbers.set(uav_id, number);
    names.push(uav_id);
    return number;
  }
}

/** The buffers that may be handed over instead of copied. */
export function buffersOf(columns: TrackColumns): ArrayBuffer[] {
  return Object.values(columns).flatMap((column) => (ArrayBuffer.isView(column) ? [column.buffer as ArrayBuffer] : []));
}

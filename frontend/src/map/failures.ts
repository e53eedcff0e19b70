import type { Map as MapLibre, MapSourceDataEvent } from "maplibre-gl";
import { AWAY } from "./archiveSource";
import type { MissingMap } from "./missingTexts";
import { IMAGERY, TERRAIN } from "./place";
import { PLACE } from "./placeLayers";

/** A part of the map that could not be loaded; `damaged`: it came, and nobody can read it. */
export type Failing = { what: MissingMap["what"] | "base"; why: "away" | "damaged" };

type Tile = { x: number; y: number; z: number };
/** MapLibre's own, as far as it is needed. */
type Loaded = { state: string; tileID: { canonical: Tile } };
type Failed = Failing & { tiles: Map<string, Tile> };

/** What an archive that was replaced needs until the new one is known is no failure worth a word. */
const PATIENCE_MS = 1_500;
const AGAIN_MS = 10_000;
const SOURCES: Record<string, MissingMap["what"]> = { [PLACE]: "archive", [TERRAIN]: "terrain", [IMAGERY]: "imagery" };

/**
 * Away is what a network or a server fails to bring; all else that goes wrong with an archive is wrong in it, also where a
 * browser says "Failed to fetch": so it calls bytes that it cannot unpack.
 */
export function failingOf(source: string | undefined, message: string): Failing {
  const what = SOURCES[source ?? ""];
  const away = what === undefined || message.includes(AWAY) || (what === "imagery" && /Failed to fetch|AJAXError|NetworkError|Load failed/.test(message));
  return { what: what ?? "base", why: away ? "away" : "damaged" };
}

/** Watches what cannot be loaded, asks for it again, and says when it has come after all. */
export class Failures {
  private readonly failed = new Map<string, Failed>();
  private told = "[]";
  private timer: ReturnType<typeof setTimeout> | undefined;
  private readonly again: ReturnType<typeof setInterval>;

  constructor(
    private readonly map: MapLibre,
    private readonly tell: (failing: readonly Failing[]) => void,
    /** At the first failure of each: the archive may have been replaced. */
    private readonly onFirst: () => void,
  ) {
    map.on("error", (event) => {
      if ((event.error as Error).name !== "AbortError") this.add(event as unknown as { error: Error; sourceId?: string; tile?: { tileID: { canonical: Tile } } });
    });
    map.on("sourcedata", (event) => this.onData(event));
    this.again = setInterval(() => this.refresh(), AGAIN_MS);
  }

  remove(): void {
    clearTimeout(this.timer);
    clearInterval(this.again);
  }

  /** It is another ground now. */
  forget(): void {
    this.failed.clear();
    this.say();
  }

  private add({ error, sourceId = "", tile }: { error: Error; sourceId?: string; tile?: { tileID: { canonical: Tile } } }): void {
    const known = this.failed.get(sourceId);
    const tiles = known?.tiles ?? new Map<string, Tile>();
    if (tile !== undefined) {
      const { x, y, z } = tile.tileID.canonical;
      tiles.set(`${z}/${x}/${y}`, { x, y, z });
    }
    this.failed.set(sourceId, { ...failingOf(sourceId, error.message), tiles });
    if (known === undefined) this.onFirst();
    this.timer ??= setTimeout(() => this.say(), PATIENCE_MS);
  }

  private onData(event: MapSourceDataEvent): void {
    const { sourceId, sourceDataType } = event;
    const tile = event.tile as Loaded | undefined;
    const failed = this.failed.get(sourceId);
    if (failed === undefined || (tile?.state !== "loaded" && sourceDataType !== "content")) return;
    // One damaged part is damaged still when another has come.
    const { x, y, z } = tile?.tileID.canonical ?? { x: 0, y: 0, z: 0 };
    if (failed.why === "damaged" && !failed.tiles.delete(`${z}/${x}/${y}`)) return;
    if (failed.why === "damaged" && failed.tiles.size > 0) return;
    this.failed.delete(sourceId);
    if (failed.tiles.size > 0) this.ask(sourceId, failed);
    this.say();
  }

  private refresh(): void {
    for (const [source, failed] of this.failed) if (failed.why === "away") this.ask(source, failed);
  }

  private ask(source: string, { tiles }: Failed): void {
    if (tiles.size > 0 && this.map.getSource(source) !== undefined) this.map.refreshTiles(source, [...tiles.values()]);
  }

  private say(): void {
    clearTimeout(this.timer);
    this.timer = undefined;
    const failing = [...this.failed.values()].map(({ what, why }) => ({ what, why }));
    const key = JSON.stringify(failing);
    if (key === this.told) return;
    this.told = key;
    this.tell(failing);
  }
}

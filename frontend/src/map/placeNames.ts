import type { Map as MapLibre } from "maplibre-gl";
import { mercatorX, mercatorY } from "../shared/geo/mercator";
import type { Locale } from "../shared/i18n/locale";
import type { Line, Words } from "./labels";
import { NAME_LAYERS } from "./placeLayers";

/** After everything that flies, and in this order. */
const RANK = 1_000_000;
/** The longest line of a name, characters; it breaks between words. */
const LONGEST = 13;

/**
 * The names of the place that MapLibre found room for, as words like all others: one that would stand under a drone or its
 * name is left out. MapLibre itself draws only what runs along lines.
 */
export function placeNames(map: MapLibre, locale: Locale): Words[] {
  const layers = NAME_LAYERS.filter(({ id }) => map.getLayer(id) !== undefined);
  if (layers.length === 0) return [];
  const words = new Map<string, Words>();
  for (const { geometry, properties, layer } of map.queryRenderedFeatures({ layers: layers.map(({ id }) => id) })) {
    const order = layers.findIndex(({ id }) => id === layer.id);
    const look = layers[order]?.look;
    const name = String(properties[`name:${locale}`] ?? properties["name"] ?? "");
    if (geometry.type !== "Point" || look === undefined || name === "") continue;
    const [lon = 0, lat = 0] = geometry.coordinates;
    const [x, y] = [mercatorX(lon), mercatorY(lat)];
    // A place near the edge of a tile is in both.
    const id = `${layer.id} ${name} ${Math.round(x * 1e6)} ${Math.round(y * 1e6)}`;
    words.set(id, { id, x, y, lines: broken(name).map((text): Line => ({ text, look })), rank: RANK + order, clear: 0, sides: ["middle"] });
  }
  return [...words.values()];
}

function broken(name: string): string[] {
  const lines: string[] = [];
  for (const word of name.split(" ")) {
    const last = lines.at(-1);
    if (last !== undefined && last.length + word.length < LONGEST) lines[lines.length - 1] = `${last} ${word}`;
    else lines.push(word);
  }
  return lines;
}

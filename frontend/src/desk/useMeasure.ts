import { useCallback, useEffect, useMemo, useRef, type RefObject } from "react";
import type { LivePlace } from "../shared/address/location";
import type { LonLat } from "../shared/geo/frame";
import type { MapHandle } from "../map/MapView";

type Measure = LivePlace["measure"];

export type Measuring = {
  /** The same list as long as the places are the same; undefined where nothing is measured. */
  points: LonLat[] | undefined;
  add: (at: LonLat) => void;
  toggle: () => void;
  undo: () => void;
  /** Its keys, while something is measured. */
  keys: Record<string, () => void>;
};

/** The measure tool of a map whose address holds the places (`measure`). */
export function useMeasure(measure: Measure, onMeasure: (measure: Measure, replace: boolean) => void, map: RefObject<MapHandle | null>): Measuring {
  const key = measure === undefined ? "" : JSON.stringify(measure);
  const points = useMemo(() => (key === "" ? undefined : (JSON.parse(key) as LonLat[])), [key]);
  const latest = useRef(measure);
  useEffect(() => {
    latest.current = measure;
  });
  const add = useCallback((at: LonLat) => onMeasure([...(latest.current ?? []), at], true), [onMeasure]);
  const undo = (): void => onMeasure((measure ?? []).slice(0, -1), true);
  const toggle = (): void => {
    onMeasure(measure === undefined ? [] : undefined, false);
    if (measure === undefined) map.current?.focus();
  };
  const addCentre = (): void => {
    const centre = map.current?.centre();
    if (centre !== undefined) add(centre);
  };
  return { points, add, toggle, undo, keys: measure === undefined ? {} : { Enter: addCentre, Backspace: undo } };
}

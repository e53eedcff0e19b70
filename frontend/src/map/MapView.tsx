import { useEffect, useImperativeHandle, useRef, useState, type ReactElement, type Ref } from "react";
import "maplibre-gl/dist/maplibre-gl.css";
import type { Camera } from "../shared/address/location";
import { useReading } from "../shared/i18n/locale";
import { useTheme } from "../shared/design/theme";
import type { Fleet } from "../shared/fleet";
import type { LonLat } from "../shared/geo/frame";
import { useLiveStore } from "../shared/live/useLive";
import { mapTexts as t } from "./texts";
import { useBaseMap, useLookAgain } from "./baseMap";
import { mapWishes, useMapWishes } from "./mapWishes";
import { Credits } from "./Credits";
import type { Failing } from "./failures";
import { MapController } from "./controller";
import type { Overlay } from "./overlays";
import type { Selection } from "./picture";

export type MapHandle = {
  fitSelection: () => void;
  fitAll: () => void;
  fitPad: (pad_id: string) => void;
  zoomBy: (levels: number) => void;
  /** Turns by degrees, clockwise; back to north without. */
  turn: (by?: number) => void;
  lookAt: (camera: Camera) => void;
  /** Where the camera looks; undefined before there is a map. */
  centre: () => LonLat | undefined;
  /** What is shown, as [west, south, east, north] in degrees. */
  bounds: () => readonly [number, number, number, number] | undefined;
  focus: () => void;
};

/** What panels cover, pixels; `room`: how much of it is theirs no longer, but kept free of what the camera fits. */
export type Clear = { top: number; right: number; bottom: number; left: number; room?: number };

type Properties = {
  ref: Ref<MapHandle>;
  fleet: Fleet;
  camera: Camera | undefined;
  selection: Selection;
  padding: Clear;
  /** The drone that the camera stays with. */
  follow?: string | undefined;
  /** Places that are measured between; undefined where nobody measures. */
  measure?: readonly LonLat[] | undefined;
  /** Looked at aslant, where the place has buildings to see. */
  deep?: boolean | undefined;
  /** What else lies on the map; a constant, or remembered. */
  overlays?: readonly Overlay[];
  onSelect: (uav_id: string | undefined) => void;
  onCamera: (camera: Camera, grid_m: number | undefined) => void;
  onRelease?: () => void;
  onMeasure?: (place: LonLat) => void;
  onGround?: (place: LonLat) => void;
};

const FIRST_PADS_MS = 1_500;
const NONE: readonly Overlay[] = [];
const nothing = (): void => undefined;

/** MapLibre in React: made once; everything that moves goes past React, from the store in `LiveContext`. */
export function MapView(properties: Properties): ReactElement {
  const { locale, lengths, coordinates } = useReading();
  // Its labels are MapLibre's: in another language, or with other units, it is made anew.
  return <Made key={`${locale} ${lengths} ${coordinates}`} {...properties} />;
}

function Made(properties: Properties): ReactElement {
  const { ref, fleet, selection, padding, follow, measure, deep = false, overlays = NONE } = properties;
  const container = useRef<HTMLDivElement>(null);
  const controller = useRef<MapController | undefined>(undefined);
  const store = useLiveStore();
  const { theme } = useTheme();
  const { base, elsewhere } = useBaseMap();
  const lookAgain = useLookAgain();
  const [failure, setFailure] = useState<string | undefined>();
  const [failing, setFailing] = useState<readonly Failing[]>([]);
  const latest = useRef(properties);
  const baseNow = useRef({ base, elsewhere });
  useEffect(() => {
    latest.current = properties;
    baseNow.current = { base, elsewhere };
  });

  // Where to look first is known with the first pads: the world is not fetched on the way there.
  const [begun, setBegun] = useState(() => store.pads.size > 0);
  useEffect(() => {
    if (begun) return undefined;
    const timer = setTimeout(() => setBegun(true), FIRST_PADS_MS);
    const end = store.subscribe(["pads"], () => setBegun(true));
    return () => {
      clearTimeout(timer);
      end();
    };
  }, [store, begun]);

  useEffect(() => {
    const element = container.current;
    if (element === null || !begun) return undefined;
    const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
    const now = latest.current;
    let made: MapController;
    try {
      made = new MapController(
        element,
        store,
        now.fleet,
        {
          onSelect: (uav_id) => latest.current.onSelect(uav_id),
          onCamera: (at, grid_m) => latest.current.onCamera(at, grid_m),
          onFailure: setFailure,
          onFailing: setFailing,
          onLookAgain: lookAgain,
          onRelease: () => (latest.current.onRelease ?? nothing)(),
          onMeasure: (place) => (latest.current.onMeasure ?? nothing)(place),
          onGround: (place) => (latest.current.onGround ?? nothing)(place),
        },
        calm,
        now.camera,
      );
    } catch (error) {
      // No WebGL: the lists say the same in words.
      const reason = error instanceof Error ? error.message : String(error);
      queueMicrotask(() => setFailure(t("noMap", { why: reason })));
      return undefined;
    }
    controller.current = made;
    made.setPadding(now.padding, now.padding.room);
    if (now.camera === undefined) made.setDeep(now.deep === true, true);
    made.select(now.selection);
    made.setOverlays(now.overlays ?? NONE);
    made.describe(baseNow.current.base, baseNow.current.elsewhere);
    made.showImagery(mapWishes().imagery);
    made.measure(now.measure);
    made.follow(now.follow);
    return () => {
      controller.current = undefined;
      made.destroy();
    };
  }, [store, begun, lookAgain]);

  useEffect(() => controller.current?.retheme(), [theme]);
  useEffect(() => controller.current?.setFleet(fleet), [fleet]);
  const { top, right, bottom, left, room = 0 } = padding;
  useEffect(() => controller.current?.setPadding({ top, right, bottom, left }, room), [top, right, bottom, left, room]);
  const { uav_id, verdict } = selection;
  useEffect(
    () => controller.current?.select({ ...(uav_id !== undefined && { uav_id }), ...(verdict !== undefined && { verdict }) }),
    [uav_id, verdict],
  );
  useEffect(() => controller.current?.setOverlays(overlays), [overlays]);
  useEffect(() => controller.current?.describe(base, elsewhere), [base, elsewhere]);
  const { imagery } = useMapWishes();
  useEffect(() => controller.current?.showImagery(imagery), [imagery]);
  const deepNow = useRef(deep);
  useEffect(() => {
    if (deepNow.current !== deep) controller.current?.setDeep(deep);
    deepNow.current = deep;
  }, [deep]);
  useEffect(() => controller.current?.measure(measure), [measure]);
  useEffect(() => controller.current?.follow(follow), [follow]);
  useImperativeHandle(ref, () => ({
    fitSelection: () => controller.current?.fitSelection(),
    fitAll: () => controller.current?.fitAll(),
    fitPad: (pad_id) => controller.current?.fitPad(pad_id),
    zoomBy: (levels) => controller.current?.zoomBy(levels),
    turn: (by) => controller.current?.turn(by),
    lookAt: (at) => controller.current?.lookAt(at),
    centre: () => controller.current?.centre(),
    bounds: () => controller.current?.bounds(),
    focus: () => controller.current?.focus(),
  }));

  return (
    <>
      <div ref={container} className="map" data-testid="map" />
      {measure !== undefined && <div className="map-cross" aria-hidden="true" style={{ inset: `${top}px ${right}px ${bottom}px ${left}px` }} />}
      <Credits base={base} elsewhere={elsewhere} failing={failing} />
      {failure !== undefined && (
        <p className="map-failure" role="status">
          {failure} {t("listSame")}
        </p>
      )}
    </>
  );
}

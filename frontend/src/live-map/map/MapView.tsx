import { useEffect, useImperativeHandle, useRef, useState, type ReactElement, type Ref } from "react";
import "maplibre-gl/dist/maplibre-gl.css";
import type { Camera } from "../../app/location";
import { useTheme } from "../../app/theme";
import { useLiveStore } from "../../shared/live/useLive";
import { liveTexts as t } from "../texts";
import { MapController, type Selection } from "./controller";

export type MapHandle = {
  fitSelection: () => void;
  fitAll: () => void;
  zoomBy: (levels: number) => void;
  lookAt: (camera: Camera) => void;
};

type Properties = {
  ref: Ref<MapHandle>;
  camera: Camera | undefined;
  selection: Selection;
  padding: { top: number; right: number; bottom: number; left: number };
  onSelect: (uav_id: string | undefined) => void;
  onCamera: (camera: Camera, grid_m: number | undefined) => void;
};

const FIRST_PADS_MS = 1_500;

/** MapLibre in React: made once; everything that moves goes past React. */
export function MapView({ ref, camera, selection, padding, onSelect, onCamera }: Properties): ReactElement {
  const container = useRef<HTMLDivElement>(null);
  const controller = useRef<MapController | undefined>(undefined);
  const store = useLiveStore();
  const { theme } = useTheme();
  const [failure, setFailure] = useState<string | undefined>();
  const latest = useRef({ onSelect, onCamera, camera, selection, padding });
  useEffect(() => {
    latest.current = { onSelect, onCamera, camera, selection, padding };
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
    let made: MapController;
    try {
      made = new MapController(
        element,
        store,
        {
          onSelect: (uav_id) => latest.current.onSelect(uav_id),
          onCamera: (at, grid_m) => latest.current.onCamera(at, grid_m),
          onFailure: setFailure,
        },
        calm,
        latest.current.camera,
      );
    } catch (error) {
      // No WebGL: the lists say the same in words.
      const reason = error instanceof Error ? error.message : String(error);
      queueMicrotask(() => setFailure(t("noMap", { why: reason })));
      return undefined;
    }
    controller.current = made;
    made.setPadding(latest.current.padding);
    made.select(latest.current.selection);
    return () => {
      controller.current = undefined;
      made.destroy();
    };
  }, [store, begun]);

  useEffect(() => controller.current?.retheme(), [theme]);
  const { top, right, bottom, left } = padding;
  useEffect(() => controller.current?.setPadding({ top, right, bottom, left }), [top, right, bottom, left]);
  const { uav_id, verdict } = selection;
  useEffect(
    () => controller.current?.select({ ...(uav_id !== undefined && { uav_id }), ...(verdict !== undefined && { verdict }) }),
    [uav_id, verdict],
  );
  useImperativeHandle(ref, () => ({
    fitSelection: () => controller.current?.fitSelection(),
    fitAll: () => controller.current?.fitAll(),
    zoomBy: (levels) => controller.current?.zoomBy(levels),
    lookAt: (at) => controller.current?.lookAt(at),
  }));

  return (
    <>
      <div ref={container} className="map" data-testid="map" />
      {failure !== undefined && (
        <p className="map-failure" role="status">
          {failure} {t("listSame")}
        </p>
      )}
    </>
  );
}

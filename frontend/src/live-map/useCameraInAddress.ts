import { useCallback, useEffect, useLayoutEffect, useRef, type RefObject } from "react";
import type { MapHandle } from "../map/MapView";
import { changed, sameView } from "../shared/address/livePlace";
import { currentPlace, go, type Camera, type LivePlace } from "../shared/address/location";

const DELAY_MS = 400;

/** The address follows the camera with a delay, and the camera an address that says something else. */
export function useCameraInAddress(place: LivePlace, map: RefObject<MapHandle | null>): { write: (place: LivePlace, replace: boolean) => void; onCamera: (at: Camera) => void } {
  const shown = useRef<Camera | undefined>(place.camera);
  const written = useRef<Camera | undefined>(undefined);
  const latest = useRef(place);
  useLayoutEffect(() => {
    latest.current = place;
  });
  const write = useCallback((next: LivePlace, replace: boolean) => {
    written.current = next.camera;
    go(next, replace);
  }, []);

  // An address that is typed, or found by the back button, may look elsewhere than the map does.
  const addressed = place.camera;
  useEffect(() => {
    if (addressed === undefined || shown.current === undefined || sameView(addressed, shown.current)) return;
    // What this page wrote itself may be a moment old.
    if (written.current !== undefined && sameView(addressed, written.current)) return;
    map.current?.lookAt(addressed);
  }, [map, addressed]);

  const timer = useRef<ReturnType<typeof setTimeout> | undefined>(undefined);
  useEffect(
    () => () => {
      clearTimeout(timer.current);
      timer.current = undefined;
    },
    [],
  );
  const onCamera = useCallback(
    (at: Camera) => {
      shown.current = at;
      // Not put off by the next move: a camera that follows a drone never rests.
      timer.current ??= setTimeout(() => {
        timer.current = undefined;
        // The map moves once more while it goes away; by then the address may be another room's, or look elsewhere.
        const named = currentPlace();
        if (named.room !== "live" || JSON.stringify(named.camera) !== JSON.stringify(latest.current.camera)) return;
        write(changed(latest.current, { camera: shown.current }), true);
      }, DELAY_MS);
    },
    [write],
  );
  return { write, onCamera };
}

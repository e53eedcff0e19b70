import { useEffect, useState } from "react";
import { Fleet, type Filter } from "../fleet";
import type { Topic } from "./store";
import { UI_INTERVAL_MS, useLiveStore } from "./useLive";

const TOPICS: readonly Topic[] = ["tracks", "estimates", "sessions", "verdicts", "pads", "connection"];
const AGEING_MS = 1_000;

/** Who is about, looked through anew twice a second at most while anything changes, and each second as time passes. */
export function useFleet(filter: Filter): Fleet {
  const store = useLiveStore();
  const [fleet, setFleet] = useState(() => new Fleet(store, store.serverNow_ms(), filter));
  useEffect(() => {
    let timer: ReturnType<typeof setTimeout> | undefined;
    const look = (): void => {
      clearTimeout(timer);
      timer = undefined;
      setFleet(new Fleet(store, store.serverNow_ms(), filter));
    };
    const soon = setTimeout(look, 0);
    const end = store.subscribe(TOPICS, () => {
      timer ??= setTimeout(look, UI_INTERVAL_MS);
    });
    const ageing = setInterval(look, AGEING_MS);
    return () => {
      clearTimeout(soon);
      clearTimeout(timer);
      clearInterval(ageing);
      end();
    };
  }, [store, filter]);
  return fleet;
}

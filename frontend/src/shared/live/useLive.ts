import { createContext, useContext, useEffect, useState, useSyncExternalStore } from "react";
import { LiveStore, type Topic } from "./store";

export const LiveContext = createContext<LiveStore>(new LiveStore());

export function useLiveStore(): LiveStore {
  return useContext(LiveContext);
}

/** Tables and lists need no more than this often; the map has its own way to the store. */
export const UI_INTERVAL_MS = 500;

/**
 * A value computed from the live store, again when one of the topics changed, at most every half second.
 *
 * `topics` must be a constant of the module: a new list at each rendering would subscribe anew each time.
 */
export function useLive<T>(topics: readonly Topic[], compute: (store: LiveStore) => T): T {
  const store = useLiveStore();
  const [source] = useState(() => throttledSource(store, topics));
  useSyncExternalStore(source.subscribe, source.version);
  return compute(store);
}

type Source = { subscribe: (notify: () => void) => () => void; version: () => number };

function throttledSource(store: LiveStore, topics: readonly Topic[]): Source {
  let version = 0;
  return {
    version: () => version,
    subscribe(notify) {
      let timer: ReturnType<typeof setTimeout> | undefined;
      let last_ms = 0;
      const fire = (): void => {
        timer = undefined;
        last_ms = Date.now();
        version += 1;
        notify();
      };
      const end = store.subscribe(topics, () => {
        timer ??= setTimeout(fire, Math.max(0, last_ms + UI_INTERVAL_MS - Date.now()));
      });
      // Whatever came between rendering and subscribing was not heard.
      version += 1;
      return () => {
        clearTimeout(timer);
        end();
      };
    },
  };
}

/** The server's clock, ticking once a second, for ages. */
export function useServerNow(interval_ms = 1000): number {
  const store = useLiveStore();
  const [now, setNow] = useState(() => store.serverNow_ms());
  useEffect(() => {
    const timer = setInterval(() => setNow(store.serverNow_ms()), interval_ms);
    return () => clearInterval(timer);
  }, [store, interval_ms]);
  return now;
}

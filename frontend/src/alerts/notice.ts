/** Sound and desktop notifications, each only where its user has asked for it. Kept in this browser. */
import { useSyncExternalStore } from "react";

export type Wishes = { sound: boolean; notify: boolean };

const KEY = "wonderland.notice";
const listeners = new Set<() => void>();

function stored(): Wishes {
  try {
    const kept: unknown = JSON.parse(localStorage.getItem(KEY) ?? "{}");
    const fields = typeof kept === "object" && kept !== null ? (kept as Record<string, unknown>) : {};
    return { sound: fields["sound"] === true, notify: fields["notify"] === true };
  } catch {
    return { sound: false, notify: false };
  }
}

let wishes = stored();

function set(change: Partial<Wishes>): void {
  wishes = { ...wishes, ...change };
  try {
    localStorage.setItem(KEY, JSON.stringify(wishes));
  } catch {
    // It holds until the page is closed.
  }
  for (const listener of listeners) listener();
}

export function useWishes(): Wishes {
  return useSyncExternalStore(
    (listener) => {
      listeners.add(listener);
      return () => listeners.delete(listener);
    },
    () => wishes,
  );
}

export function wishSound(sound: boolean): void {
  set({ sound });
  if (sound) tone();
}

/** Asks the browser where need be; false where it refuses. */
export async function wishNotify(notify: boolean): Promise<boolean> {
  if (notify && !("Notification" in globalThis && (await Notification.requestPermission()) === "granted")) {
    set({ notify: false });
    return false;
  }
  set({ notify });
  return true;
}

/** Two soft notes; a browser that forbids sound stays quiet. */
function tone(): void {
  try {
    const context = new AudioContext();
    for (const [start, frequency] of [
      [0, 660],
      [0.18, 880],
    ] as const) {
      const oscillator = new OscillatorNode(context, { frequency });
      const gain = new GainNode(context, { gain: 0 });
      gain.gain.setTargetAtTime(0.12, context.currentTime + start, 0.01);
      gain.gain.setTargetAtTime(0, context.currentTime + start + 0.12, 0.04);
      oscillator.connect(gain).connect(context.destination);
      oscillator.start(context.currentTime + start);
      oscillator.stop(context.currentTime + start + 0.5);
    }
    setTimeout(() => void context.close(), 1_500);
  } catch {
    // No sound device, or none allowed.
  }
}

/** Tells of a new alert in the ways that were asked for. */
export function announce(alert: { alert_id: string; severity: string }, title: string, text: string, open: () => void): void {
  if (wishes.sound && alert.severity === "critical") tone();
  if (wishes.notify && "Notification" in globalThis && Notification.permission === "granted") {
    const shown = new Notification(title, { body: text, tag: alert.alert_id });
    shown.onclick = () => {
      window.focus();
      open();
    };
  }
}

// @vitest-environment happy-dom
import { act, cleanup, render, screen } from "@testing-library/react";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import type { Alert } from "../shared/api/records";
import { LiveStore } from "../shared/live/store";
import { LiveContext } from "../shared/live/useLive";
import { Herald } from "./Herald";

const NOW_MS = 1_800_000_000_000;

function alert(name: string, more: Partial<Alert> = {}): Alert {
  return { alert_id: name, kind: "refuted", severity: "critical", t_ms: NOW_MS, pad_id: "pad-1", uav_id: name, facts: {}, state: "open", revision: 0, changed_ms: NOW_MS, ...more };
}

let store: LiveStore;
const tell = (...alerts: Alert[]): void => act(() => store.merge({ alerts }));
const pass = (ms: number): void =>
  act(() => {
    vi.advanceTimersByTime(ms);
  });
const said = (): (string | undefined)[] => [...screen.getByRole("log").children].map((each) => /^\S+/.exec(each.textContent)?.[0]);

beforeEach(() => {
  vi.useFakeTimers({ now: NOW_MS });
  store = new LiveStore();
  store.merge({ alerts: [alert("uav-0")] });
  store.ready = true;
  render(
    <LiveContext value={store}>
      <Herald />
    </LiveContext>,
  );
});

afterEach(() => {
  cleanup();
  vi.useRealTimers();
});

describe("the herald", () => {
  it("says each of several alerts that come at once, and none twice", () => {
    tell(alert("uav-1"), alert("uav-2"), alert("uav-3"));
    tell(alert("uav-2", { revision: 1 }));
    expect(said()).toEqual(["uav-1", "uav-2", "uav-3"]);
  });

  it("says an alert again when it wakes", () => {
    const until_ms = NOW_MS + 900_000;
    tell(alert("uav-0", { snoozed_until_ms: until_ms }), alert("uav-1", { snoozed_until_ms: until_ms + 1_000 }));
    pass(899_000);
    expect(said()).toEqual([]);
    pass(2_000);
    expect(said()).toEqual(["uav-0"]);
    pass(2_000);
    expect(said()).toEqual(["uav-0", "uav-1"]);
  });

  it("says nothing anew when the connection is made anew", () => {
    tell(alert("uav-1"));
    act(() => {
      store.receive({ kind: "frame", frame: { type: "hello", epoch: "e", seq: 1, t_ms: NOW_MS, resumed: false }, received_ms: NOW_MS });
      store.receive({ kind: "frame", frame: { type: "snapshot", part: 1, of: 1, alerts: [alert("uav-0"), alert("uav-1")] }, received_ms: NOW_MS });
    });
    expect(said()).toEqual(["uav-1"]);
  });
});

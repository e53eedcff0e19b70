import { lazy, type ReactElement } from "react";
import { LivePage } from "../live-map/LivePage";
import { SessionPage } from "../sessions/SessionPage";
import { SessionsPage } from "../sessions/SessionsPage";
import { VerdictsPage } from "../verdicts/VerdictsPage";
import type { Place, PlainRoom } from "./location";

const AlertsRoom = lazy(() => import("../alerts/AlertsRoom").then(({ AlertsRoom: Room }) => ({ default: Room })));
const StatisticsRoom = lazy(() => import("../statistics/StatisticsRoom").then(({ StatisticsRoom: Room }) => ({ default: Room })));
const LedgerRoom = lazy(() => import("../ledger/LedgerRoom").then(({ LedgerRoom: Room }) => ({ default: Room })));

export type RoomName = Place["room"];

/** A room of the console: its place in the rail, the key that leads there, its picture. */
export type Room = { name: RoomName; place: Place; key: string; icon: string };

function plain(room: PlainRoom): Place {
  return { room, path: [], query: {} };
}

/** In the order of the rail. */
export const ROOMS: readonly Room[] = [
  { name: "live", place: { room: "live" }, key: "l", icon: "M2 5l5-2 6 2 5-2v12l-5 2-6-2-5 2zM7 3v12M13 5v12" },
  { name: "sessions", place: { room: "sessions" }, key: "s", icon: "M4 4h12M4 10h12M4 16h8" },
  {
    name: "verdicts",
    place: { room: "verdicts", filters: {} },
    key: "v",
    icon: "M10 2.2l6.2 2.3v4.7c0 4-2.6 7-6.2 8.6-3.6-1.6-6.2-4.6-6.2-8.6V4.5zM7 9.8l2.2 2.2L13.2 8",
  },
  {
    name: "alerts",
    place: plain("alerts"),
    key: "a",
    icon: "M10 3a5 5 0 0 1 5 5v4l1.5 2h-13L5 12V8a5 5 0 0 1 5-5zM8 17h4",
  },
  { name: "ledger", place: plain("ledger"), key: "e", icon: "M3 6l7-3 7 3-7 3zM3 10l7 3 7-3M3 14l7 3 7-3" },
  { name: "statistics", place: plain("statistics"), key: "i", icon: "M3 17V8M8 17V3M13 17v-6M18 17H2" },
];

/** What stands in the room that the address names. */
export function RoomPage({ place }: { place: Place }): ReactElement | null {
  switch (place.room) {
    case "live":
      return <LivePage place={place} />;
    case "sessions":
      return place.session === undefined ? <SessionsPage /> : <SessionPage session_id={place.session} />;
    case "verdicts":
      return <VerdictsPage filters={place.filters} />;
    case "ledger":
      return <LedgerRoom place={place} />;
    case "alerts":
      return <AlertsRoom place={place} />;
    case "statistics":
      return <StatisticsRoom place={place} />;
    case "replay":
    case "registry":
    case "people":
    case "settings":
      return null;
  }
}

import { lazy, type ReactElement } from "react";
import { LivePage } from "../live-map/LivePage";
import type { Place, PlainRoom } from "../shared/address/location";

const SessionsPage = lazy(() => import("../sessions/SessionsPage").then(({ SessionsPage: Page }) => ({ default: Page })));
const VerdictsPage = lazy(() => import("../verdicts/VerdictsPage").then(({ VerdictsPage: Page }) => ({ default: Page })));
const SessionPage = lazy(() => import("../sessions/SessionPage").then(({ SessionPage: Page }) => ({ default: Page })));
const AlertsRoom = lazy(() => import("../alerts/AlertsRoom").then(({ AlertsRoom: Room }) => ({ default: Room })));
const StatisticsRoom = lazy(() => import("../statistics/StatisticsRoom").then(({ StatisticsRoom: Room }) => ({ default: Room })));
const PeopleRoom = lazy(() => import("../people/PeopleRoom").then(({ PeopleRoom: Room }) => ({ default: Room })));
const RegistryRoom = lazy(() => import("../registry/RegistryRoom").then(({ RegistryRoom: Room }) => ({ default: Room })));
const LedgerRoom = lazy(() => import("../ledger/LedgerRoom").then(({ LedgerRoom: Room }) => ({ default: Room })));
const ReplayRoom = lazy(() => import("../replay/ReplayRoom").then(({ ReplayRoom: Room }) => ({ default: Room })));
const SettingsRoom = lazy(() => import("../settings/SettingsRoom").then(({ SettingsRoom: Room }) => ({ default: Room })));
const ZonesRoom = lazy(() => import("../zones/ZonesRoom").then(({ ZonesRoom: Room }) => ({ default: Room })));

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
  { name: "replay", place: plain("replay"), key: "r", icon: "M4 5v4h4M4.5 9a6.2 6.2 0 1 1-.4 3M10 7v3.5l2.5 1.5" },
  { name: "registry", place: plain("registry"), key: "g", icon: "M3 6.5h14v10H3zM7 6.5V4h6v2.5M3 10.5h14M9 10.5v2h2v-2" },
  { name: "zones", place: plain("zones"), key: "z", icon: "M3.5 6l6-3 7 3.5v7l-6 3.5-7-3.5zM5 13l7-9M8.5 15l7.5-9" },
  { name: "ledger", place: plain("ledger"), key: "e", icon: "M3 6l7-3 7 3-7 3zM3 10l7 3 7-3M3 14l7 3 7-3" },
  { name: "people", place: plain("people"), key: "o", icon: "M7 9.5a3 3 0 1 0 0-6 3 3 0 0 0 0 6zM2 17c0-3 2.2-5 5-5s5 2 5 5M13 9a2.5 2.5 0 1 0-.6-4.9M14 12.2c2.3.3 4 2.1 4 4.8" },
  { name: "statistics", place: plain("statistics"), key: "i", icon: "M3 17V8M8 17V3M13 17v-6M18 17H2" },
  { name: "settings", place: plain("settings"), key: ",", icon: "M3 6h8M15 6h2M13 4v4M3 14h2M9 14h8M7 12v4" },
];

/** What stands in the room that the address names. */
export function RoomPage({ place }: { place: Place }): ReactElement | null {
  switch (place.room) {
    case "live":
      return <LivePage place={place} />;
    case "sessions":
      return place.session === undefined ? <SessionsPage filters={place.filters ?? {}} /> : <SessionPage session_id={place.session} />;
    case "verdicts":
      return <VerdictsPage filters={place.filters} />;
    case "ledger":
      return <LedgerRoom place={place} />;
    case "alerts":
      return <AlertsRoom place={place} />;
    case "statistics":
      return <StatisticsRoom place={place} />;
    case "people":
      return <PeopleRoom place={place} />;
    case "zones":
      return <ZonesRoom place={place} />;
    case "replay":
      return <ReplayRoom place={place} />;
    case "settings":
      return <SettingsRoom />;
    case "registry":
      return <RegistryRoom place={place} />;
  }
}

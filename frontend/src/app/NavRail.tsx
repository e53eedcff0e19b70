import type { ReactElement } from "react";
import { placeHash, type Place } from "./location";
import { appTexts as t, roomTexts } from "./texts";

const ROOMS: readonly { place: Place; name: "live" | "sessions" | "verdicts"; path: string }[] = [
  { place: { room: "live" }, name: "live", path: "M2 5l5-2 6 2 5-2v12l-5 2-6-2-5 2zM7 3v12M13 5v12" },
  { place: { room: "sessions" }, name: "sessions", path: "M4 4h12M4 10h12M4 16h8" },
  {
    place: { room: "verdicts", filters: {} },
    name: "verdicts",
    path: "M10 2.2l6.2 2.3v4.7c0 4-2.6 7-6.2 8.6-3.6-1.6-6.2-4.6-6.2-8.6V4.5zM7 9.8l2.2 2.2L13.2 8",
  },
];

export function NavRail({ room }: { room: Place["room"] }): ReactElement {
  return (
    <nav className="rail" aria-label={t("pages")}>
      {ROOMS.map(({ place, name, path }) => (
        <a key={name} href={placeHash(place)} aria-current={place.room === room ? "page" : undefined}>
          <svg viewBox="0 0 20 20" aria-hidden="true">
            <path d={path} />
          </svg>
          {roomTexts(name)}
        </a>
      ))}
    </nav>
  );
}

import type { ReactElement } from "react";
import { placeHash } from "../shared/address/location";
import { ROOMS, type RoomName } from "./rooms";
import { roomTexts } from "../shared/roomTexts";
import { appTexts as t } from "./texts";

export function NavRail({ room }: { room: RoomName }): ReactElement {
  return (
    <nav className="rail" aria-label={t("pages")}>
      {ROOMS.map(({ place, name, icon }) => (
        <a key={name} href={placeHash(place)} aria-current={name === room ? "page" : undefined}>
          <svg viewBox="0 0 20 20" aria-hidden="true">
            <path d={icon} />
          </svg>
          {roomTexts(name)}
        </a>
      ))}
    </nav>
  );
}

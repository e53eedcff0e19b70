import { useRef, useState, type ReactElement } from "react";
import { MapDesk } from "../desk/MapDesk";
import { deskTexts } from "../desk/texts";
import { useMapDesk } from "../desk/useMapDesk";
import type { MapHandle } from "../map/MapView";
import { NetworkedCard, useNetworked } from "../networked/NetworkedCard";
import type { Bounds } from "../networked/calls";
import { flightAt } from "../networked/overlay";
import { changed } from "../shared/address/livePlace";
import { placeHash, type LivePlace } from "../shared/address/location";
import type { LonLat } from "../shared/geo/frame";
import { useLiveStore, useServerNow } from "../shared/live/useLive";
import { roomTexts } from "../shared/roomTexts";
import { useKeys } from "../shared/ui/useKeys";
import { Announcer } from "./Announcer";
import { liveTexts as t } from "./texts";
import { Timeline } from "./Timeline";
import { useCameraInAddress } from "./useCameraInAddress";
import { WallPage } from "./WallPage";

/** The main page: who is in the air, the map, and the proof of what is selected. */
export function LivePage({ place }: { place: LivePlace }): ReactElement {
  return place.as === "wall" ? <WallPage place={place} /> : <LiveDesk place={place} />;
}

function LiveDesk({ place }: { place: LivePlace }): ReactElement {
  const store = useLiveStore();
  const now_ms = useServerNow();
  const map = useRef<MapHandle>(null);
  const [view, setView] = useState<Bounds | undefined>();
  const [flight, setFlight] = useState<string | undefined>();
  const { write, onCamera } = useCameraInAddress(place, map);
  const desk = useMapDesk({
    map,
    place,
    now_ms,
    write,
    onCamera: (at) => {
      if (place.networked === true) setView(map.current?.bounds());
      onCamera(at);
    },
  });
  const { change, selectDrone, select, fleet, phone, barRef, keys, openZones, placeWith } = desk;
  const { uav_id } = desk.selected;

  const networkedOn = place.networked === true && place.as === undefined;
  const networked = useNetworked(networkedOn, view, flight);
  const toggleNetworked = (): void => {
    setFlight(undefined);
    setView(map.current?.bounds());
    change({ networked: networkedOn ? undefined : true });
  };
  const onGround = (at: LonLat): void => {
    const told = flightAt(networked.shown?.flights ?? [], at, placeWith({}).camera?.zoom ?? 0);
    if (networkedOn) setFlight(told?.flight_id);
    if (told === undefined) openZones(at);
  };
  const toWall = (): void => change({ as: "wall" });

  const tab = place.list ?? "all";
  const rows = tab === "pads" ? undefined : fleet.rows(tab);
  const step = (by: number): void => {
    if (rows === undefined) return;
    const index = uav_id === undefined ? -1 : rows.indexOf(uav_id);
    const next = rows.at(Math.min(rows.length - 1, Math.max(0, index + by)));
    if (next !== undefined) selectDrone(next.uav_id);
  };
  useKeys({ ...keys, j: () => step(1), k: () => step(-1), n: toggleNetworked, w: toWall });

  return (
    <MapDesk
      desk={desk}
      names={{ page: roomTexts("live"), list: deskTexts("inTheAir"), proof: t("proof") }}
      hrefOf={(id) => placeHash(changed(place, { as: undefined, drone: id }))}
      overlays={networked.overlays}
      onGround={onGround}
      missing={
        uav_id !== undefined && store.ready ? (
          <>
            {t("notInAir", { who: uav_id })} <a href={placeHash({ room: "verdicts", filters: { drone: uav_id } })}>{t("itsVerdicts")}</a>
          </>
        ) : undefined
      }
      cards={networkedOn && <NetworkedCard networked={networked} selected={flight} now_ms={now_ms} onSelect={setFlight} onClose={toggleNetworked} />}
      tableTools={
        <a className="float button" href="#/zones/list">
          {roomTexts("zones")}
        </a>
      }
      controls={{ networked: networkedOn, onNetworked: toggleNetworked, onWall: toWall }}
    >
      {!phone && (
        <section className="float strip-panel" aria-label={t("lastHour")} ref={barRef}>
          <Timeline now_ms={now_ms} onSelect={(each) => select({ session: each.session_id })} />
        </section>
      )}
      <Announcer />
    </MapDesk>
  );
}

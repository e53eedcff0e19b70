import { useQuery } from "@tanstack/react-query";
import type { ReactElement } from "react";
import { placeHash } from "../shared/address/location";
import { useApi } from "../shared/api/api";
import { useServerNow } from "../shared/live/useLive";
import { Fact } from "../shared/ui/Fact";
import { More } from "../shared/ui/More";
import { zone as fetchZone, type Zone } from "./calls";
import { zonesHref } from "./links";
import { TypeTag } from "./looks";
import { zoneTexts as t } from "./texts";
import { heights, holding, nameOf, times } from "./words";

type Authority = { name?: { text?: string }[]; service?: { text?: string }[]; email?: string; phone?: string; siteURL?: string; purpose: string };

function AuthorityLine({ of }: { of: Authority }): ReactElement {
  const said = [...(of.name ?? []), ...(of.service ?? [])].map(({ text }) => text).filter((text) => text !== undefined);
  return (
    <p>
      {said.join(", ")} <span className="quiet">· {t("purpose", { purpose: of.purpose })}</span>{" "}
      {of.email !== undefined && <a href={`mailto:${of.email}`}>{of.email}</a>} {of.phone}{" "}
      {/* The server took nothing but http and https. */}
      {of.siteURL !== undefined && (
        <a href={of.siteURL} rel="noreferrer noopener" target="_blank">
          {of.siteURL}
        </a>
      )}
    </p>
  );
}

/** All that a zone says, in the user's words where its file has them. */
export function ZoneFacts({ zone, now_ms }: { zone: Zone; now_ms: number }): ReactElement {
  return (
    <dl className="zone-facts">
      <Fact name={t("typeName")}>
        <TypeTag type={zone.type} active={zone.active} />
      </Fact>
      <Fact name={t("now")}>{holding(zone, now_ms)}</Fact>
      <Fact name={t("heights")}>
        {heights(zone).map((each) => (
          <p key={each}>{each}</p>
        ))}
      </Fact>
      {zone.feature !== undefined && (
        <Fact name={t("times")}>
          {times(zone).map((each) => (
            <p key={each}>{each}</p>
          ))}
        </Fact>
      )}
      {zone.message !== undefined && <Fact name={t("message")}>{zone.message}</Fact>}
      {zone.reasons.length > 0 && <Fact name={t("reason")}>{zone.reasons.map((reason) => t("reasonName", { reason })).join(", ")}</Fact>}
      {zone.conditions !== undefined && <Fact name={t("conditions")}>{zone.conditions}</Fact>}
      <Fact name={t("authority")}>
        {(zone.authorities as Authority[]).map((each, i) => (
          <AuthorityLine key={i} of={each} />
        ))}
      </Fact>
    </dl>
  );
}

/** A camera that shows the whole zone on a desk. */
function mapHref(zone: Zone): string {
  const [west = 0, south = 0, east = 0, north = 0] = zone.bbox;
  const degrees = Math.max(east - west, (north - south) * 2, 1e-4);
  const camera = { lat: (south + north) / 2, lon: (west + east) / 2, zoom: Math.min(17, Math.max(1, Math.log2(360 / degrees) + 0.4)) };
  return placeHash({ room: "live", camera, zone: [zone.zone_id] });
}

export function ZonePage({ zone_id }: { zone_id: string }): ReactElement {
  const api = useApi();
  const now_ms = useServerNow(30_000);
  const query = useQuery({ queryKey: ["zones", "zone", zone_id], queryFn: () => fetchZone(api, zone_id) });
  const zone = query.data;
  return (
    <>
      <p className="zones-bar">
        <a href={zonesHref(["list"])}>← {t("all")}</a>
      </p>
      {zone === undefined ? (
        <div className="float">
          <More query={{ ...query, hasNextPage: false, isFetchingNextPage: false, fetchNextPage: () => undefined }} empty={t("noneThere")} count={0} />
        </div>
      ) : (
        <section className="float card">
          <div className="zones-head">
            <h2>
              {nameOf(zone)} <span className="quiet num">{zone.zone_id} · {zone.source}</span>
            </h2>
            <a className="button" href={mapHref(zone)}>
              {t("onMap")}
            </a>
          </div>
          <ZoneFacts zone={zone} now_ms={now_ms} />
        </section>
      )}
    </>
  );
}

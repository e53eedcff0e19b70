import type { ReactElement } from "react";
import type { Place, PlainRoom } from "../shared/address/location";
import { ImportPage } from "./ImportPage";
import { TABS, zonesHref, type Tab } from "./links";
import { ListPage } from "./ListPage";
import { PadPage } from "./PadPage";
import { PadsPage } from "./PadsPage";
import { zoneTexts as t } from "./texts";
import { ZonePage } from "./ZonePage";
import "./zones.css";

function Content({ tab, place }: { tab: Tab; place: Place & { room: PlainRoom } }): ReactElement {
  const id = place.path[1];
  switch (tab) {
    case "list":
      return id === undefined ? <ListPage type={place.query["type"]} /> : <ZonePage key={id} zone_id={id} />;
    case "import":
      return <ImportPage />;
    case "pads":
      return id === undefined ? <PadsPage /> : <PadPage key={id} pad_id={id} />;
  }
}

/** `#/zones/pads/aurajoki-2`, `#/zones/list?type=PROHIBITED`, `#/zones/list/FIN:P20`, `#/zones/import`. */
export function ZonesRoom({ place }: { place: Place & { room: PlainRoom } }): ReactElement {
  const tab = TABS.find((each) => each === place.path[0]) ?? "pads";
  return (
    <div className="page zones">
      <div className="page-head">
        <h1>{t("zones")}</h1>
        <nav className="tabs" aria-label={t("sections")}>
          {TABS.map((each) => (
            <a key={each} className="tab" href={zonesHref([each])} aria-current={each === tab ? "page" : undefined}>
              {t("tab", { tab: each })}
            </a>
          ))}
        </nav>
      </div>
      <Content tab={tab} place={place} />
    </div>
  );
}

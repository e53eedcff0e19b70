import type { ReactElement } from "react";
import type { Place, PlainRoom } from "../shared/address/location";
import { useOfficer } from "../shared/api/who";
import { KeyPage } from "../shared/signing/KeyPage";
import { ChangeForm } from "./ChangeForm";
import { CertificatesPage } from "./CertificatesPage";
import { DronePage } from "./DronePage";
import { DronesPage } from "./DronesPage";
import { formKey, type FormName } from "./forms";
import { ImportPage } from "./ImportPage";
import { registryHref, TABS, toRegistry, type Tab } from "../shared/address/registryLinks";
import { OperatorsPage } from "./OperatorsPage";
import { PadPage } from "./PadPage";
import { PadsPage } from "./PadsPage";
import { ProposalsPage } from "./ProposalsPage";
import "./registry.css";
import { registryTexts as t } from "./texts";

type Registry = Place & { room: PlainRoom };

function isTab(name: string | undefined): name is Tab {
  return TABS.some((each) => each === name);
}

function New({ form, tab }: { form: FormName; tab: Tab }): ReactElement {
  return (
    <section className="float card">
      <h2>{t("form", { form: formKey(form) })}</h2>
      <ChangeForm name={form} about={{}} onDone={() => undefined} onCancel={() => toRegistry([tab])} />
    </section>
  );
}

function Content({ tab, place }: { tab: Tab; place: Registry }): ReactElement {
  const [, id, form, part] = place.path;
  switch (tab) {
    case "drones":
      if (id === "new") return <New form="register-drone" tab={tab} />;
      return id === undefined ? <DronesPage place={place} /> : <DronePage key={id} uav_id={id} form={form} part={part} reason={place.query["reason"]} />;
    case "pads":
      if (id === "new") return <New form="register-pad" tab={tab} />;
      return id === undefined ? <PadsPage place={place} /> : <PadPage key={id} pad_id={id} form={form} part={part} />;
    case "operators":
      return <OperatorsPage />;
    case "certificates":
      return <CertificatesPage place={place} />;
    case "proposals":
      return <ProposalsPage id={id} form={form} />;
    case "import":
      return <ImportPage />;
    case "key":
      return <KeyPage />;
  }
}

/** `#/registry/drones/OH-DRN-0417/suspend`, `#/registry/pads/aurajoki-2`, `#/registry/certificates?expiring=1`, … */
export function RegistryRoom({ place }: { place: Registry }): ReactElement {
  const officer = useOfficer();
  const tab: Tab = isTab(place.path[0]) ? place.path[0] : "drones";
  return (
    <div className="page registry">
      <div className="page-head">
        <h1>{t("registry")}</h1>
        <nav className="tabs" aria-label={t("sections")}>
          {TABS.filter((each) => each !== "proposals" || officer).map((each) => (
            <a key={each} className="tab" href={registryHref([each])} aria-current={each === tab ? "page" : undefined}>
              {t("tab", { tab: each })}
            </a>
          ))}
        </nav>
      </div>
      <Content tab={tab} place={place} />
    </div>
  );
}


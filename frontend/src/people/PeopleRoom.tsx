import type { ReactElement } from "react";
import { placeHash, type Place, type PlainRoom } from "../shared/address/location";
import { usePerson } from "../shared/api/who";
import { AccountPage } from "./AccountPage";
import { AuditPage } from "./AuditPage";
import { ClientsPage } from "./ClientsPage";
import { clientTexts } from "./clientTexts";
import { InvitePage } from "./InvitePage";
import { PeoplePage } from "./PeoplePage";
import { PersonPage } from "./PersonPage";
import "./people.css";
import { peopleTexts as t } from "./texts";

const PARTS = ["list", "clients", "audit", "me"] as const;
const PATHS: Record<(typeof PARTS)[number], readonly string[]> = { list: [], clients: ["clients"], audit: ["audit"], me: ["me"] };

/** `#/people`, `#/people/me`, `#/people/clients`, `#/people/audit`, `#/people/invite`, `#/people/<id>`. Others than administrators have their account. */
export function PeopleRoom({ place }: { place: Place & { room: PlainRoom } }): ReactElement {
  const administrator = usePerson()?.roles.includes("admin") ?? false;
  const [asked = "list"] = place.path;
  const part = administrator ? asked : "me";
  return (
    <div className="page">
      <div className="page-head">
        <h1>{t("people")}</h1>
        {administrator && (
          <nav className="people-tabs" aria-label={t("parts")}>
            {PARTS.map((each) => (
              <a key={each} className="tab" href={placeHash({ room: "people", path: PATHS[each], query: {} })} aria-current={each === part ? "page" : undefined}>
                {each === "clients" ? clientTexts("clients") : t(each === "me" ? "account" : each)}
              </a>
            ))}
          </nav>
        )}
      </div>
      {part === "me" ? (
        <AccountPage />
      ) : part === "audit" ? (
        <AuditPage filters={place.query} />
      ) : part === "clients" ? (
        <ClientsPage />
      ) : part === "invite" ? (
        <InvitePage />
      ) : part === "list" ? (
        <PeoplePage />
      ) : (
        <PersonPage key={part} person_id={part} />
      )}
    </div>
  );
}

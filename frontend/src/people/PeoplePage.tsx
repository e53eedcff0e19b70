import { useQuery } from "@tanstack/react-query";
import type { ReactElement } from "react";
import { placeHash } from "../shared/address/location";
import { dayAndTime } from "../shared/format";
import { useServerNow } from "../shared/live/useLive";
import { usePeopleApi, type PersonShown } from "./api";
import { Fetching, rolesInWords } from "./parts";
import { peopleTexts as t } from "./texts";

/** How somebody signs in, in a few words. */
export function signInMethodWords(person: PersonShown): string {
  const keys = t("passkeys", { count: person.passkeys });
  return person.oidc ? (person.passkeys === 0 ? t("oidc") : `${keys}, ${t("oidc")}`) : keys;
}

export function personHref(person_id: string): string {
  return placeHash({ room: "people", path: [person_id], query: {} });
}

/** Everybody who may sign in, or has been invited to. */
export function PeoplePage(): ReactElement {
  const api = usePeopleApi();
  const now_ms = useServerNow(10_000);
  const people = useQuery({ queryKey: ["people"], queryFn: () => api.people() });
  if (people.data === undefined) return <Fetching query={people} />;
  return (
    <>
      <p className="people-actions people-head">
        <a className="button primary" href={placeHash({ room: "people", path: ["invite"], query: {} })}>
          {t("invite")}
        </a>
      </p>
      <div className="table-frame float">
        <table className="table people-table num">
          <thead>
            <tr>
              <th scope="col">{t("name")}</th>
              <th scope="col">{t("roles")}</th>
              <th scope="col">{t("organisation")}</th>
              <th scope="col">{t("ways")}</th>
              <th scope="col">{t("lastSeen")}</th>
            </tr>
          </thead>
          <tbody>
            {people.data.items.map((person) => (
              <tr key={person.person_id}>
                <td>
                  <a href={personHref(person.person_id)}>
                    <b>{person.name}</b>
                  </a>
                  {person.state !== "active" && <span className={`people-state-${person.state}`}> · {t("state", { state: person.state })}</span>}
                </td>
                <td>{rolesInWords(person.roles)}</td>
                <td>{person.msp_id ?? "–"}</td>
                <td>{signInMethodWords(person)}</td>
                <td>{person.last_seen_ms === undefined ? t("never") : dayAndTime(person.last_seen_ms, now_ms)}</td>
              </tr>
            ))}
          </tbody>
        </table>
      </div>
    </>
  );
}

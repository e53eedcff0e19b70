import { useMutation, useQueryClient } from "@tanstack/react-query";
import type { SyntheticEvent, ReactElement } from "react";
import { go, placeHash } from "../shared/address/location";
import { useLive, useServerNow } from "../shared/live/useLive";
import type { Topic } from "../shared/live/store";
import { useDraft } from "../shared/useDraft";
import { usePeopleApi, type Role } from "./api";
import { Card, MadeLink, needsOrganisation, OrganisationField, Problem, RoleBoxes } from "./parts";
import { peopleTexts as t } from "./texts";

const STATUS: readonly Topic[] = ["status"];
const NONE: readonly string[] = [];
const NOBODY = { name: "", email: "", roles: ["viewer"] as Role[], msp_id: "" };

/** The organisations on the ledger, as this server knows them. */
export function useOrganisations(): readonly string[] {
  return useLive(STATUS, (store) => store.status?.ledger.organisations ?? NONE);
}

/** Somebody gets an account: who, as what; then the link to send. */
export function InvitePage(): ReactElement {
  const api = usePeopleApi();
  const client = useQueryClient();
  const now_ms = useServerNow(10_000);
  const organisations = useOrganisations();
  const [draft, setDraft, clear] = useDraft("invite", NOBODY);
  const { name, email, roles, msp_id } = draft;
  const change = (part: Partial<typeof draft>): void => setDraft({ ...draft, ...part });
  const invite = useMutation({
    mutationFn: () => api.invite({ name, roles, msp_id: needsOrganisation(roles) ? msp_id : "", ...(email !== "" && { email }) }),
    onSuccess: () => {
      clear();
      return client.invalidateQueries({ queryKey: ["people"] });
    },
  });
  const back = { room: "people", path: [], query: {} } as const;
  if (invite.data !== undefined) {
    return (
      <div className="people-grid">
        <MadeLink made={invite.data} now_ms={now_ms} onDone={() => go(back)} />
      </div>
    );
  }
  const submit = (event: SyntheticEvent): void => {
    event.preventDefault();
    invite.mutate();
  };
  const complete = roles.length > 0 && (!needsOrganisation(roles) || msp_id !== "");
  return (
    <div className="people-grid">
      <Card title={t("invite")}>
        <p className="quiet">{t("inviteHint")}</p>
        <form className="people-form" onSubmit={submit}>
          <label className="people-field">
            {t("name")}
            <input value={name} onChange={(event) => change({ name: event.target.value })} maxLength={100} required />
          </label>
          <label className="people-field">
            {t("email")}
            <input type="email" value={email} onChange={(event) => change({ email: event.target.value })} maxLength={254} />
            <small>{t("emailHint")}</small>
          </label>
          <RoleBoxes roles={roles} onChange={(wanted) => change({ roles: wanted })} />
          {needsOrganisation(roles) && <OrganisationField value={msp_id} known={organisations} onChange={(wanted) => change({ msp_id: wanted })} />}
          <Problem error={invite.error} />
          <div className="people-actions">
            <button type="submit" className="button primary" disabled={!complete || invite.isPending}>
              {t("makeInvitation")}
            </button>
            <a className="button" href={placeHash(back)}>
              {t("back")}
            </a>
          </div>
        </form>
      </Card>
    </div>
  );
}

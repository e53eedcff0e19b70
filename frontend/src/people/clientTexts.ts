import { texts } from "../shared/i18n/texts";

/** The scopes in plain words; by their names, with dots and dashes as underscores. */
const SCOPE_EN =
  "{scope, select, wonderland_pads_read {Landing pads and their health} wonderland_drones_read {Drones and authorisations} wonderland_proofs_read {Proofs, sessions and verdicts} wonderland_proofs_request {Ask that a drone proves where it is} wonderland_tracks_read {What drones broadcast: positions, flights, oddities} wonderland_alerts_read {Alerts} wonderland_ledger_read {Blocks and transactions} wonderland_zones_read {Zones and when they hold} wonderland_exports {Windows of the past as files} wonderland_subscriptions {Webhooks of its own} wonderland_traffic_authority {Traffic as the authority gets it} wonderland_traffic_ats {Traffic as air traffic services get it} wonderland_traffic_ussp {Traffic as U-space service providers get it} wonderland_traffic_public {Traffic as the public gets it, without identities} rid_display_provider {Network Remote ID: a display provider} rid_service_provider {Network Remote ID: a service provider} other {}}";
const SCOPE_FI =
  "{scope, select, wonderland_pads_read {Laskeutumisalustat ja niiden kunto} wonderland_drones_read {Droonit ja luvat} wonderland_proofs_read {Todistukset, istunnot ja päätökset} wonderland_proofs_request {Pyytää droonia todistamaan, missä se on} wonderland_tracks_read {Droonien lähetykset: sijainnit, lennot, oudot havainnot} wonderland_alerts_read {Hälytykset} wonderland_ledger_read {Lohkot ja tapahtumat} wonderland_zones_read {Vyöhykkeet ja niiden ajat} wonderland_exports {Menneitä jaksoja tiedostoina} wonderland_subscriptions {Omat webhookit} wonderland_traffic_authority {Liikenne viranomaiselle} wonderland_traffic_ats {Liikenne ilmaliikennepalveluille} wonderland_traffic_ussp {Liikenne U-space-palveluntarjoajille} wonderland_traffic_public {Liikenne yleisölle, ilman tunnuksia} rid_display_provider {Verkon etätunnistus: näyttöpalvelu} rid_service_provider {Verkon etätunnistus: palveluntarjoaja} other {}}";

/** Machines that read the API. */
export const clientTexts = texts({
  en: {
    clients: "Machines",
    hint: "Programs that read the API with tokens of their own (OAuth 2.0 client credentials). Who registers or disables one stands in the audit log.",
    none: "No machine is registered.",
    name: "Name",
    nameHint: "Whose program it is, and what for",
    may: "May",
    mayRead: "What it may do",
    sees: "Sees",
    role: "{role, select, viewer {no personal data} inspector {everything} pad_operator {one organisation’s pads} fleet_operator {one organisation’s drones} other {{role}}}",
    asRole: "What it sees",
    authenticates: "Identifies itself by",
    method: "{method, select, client_secret_basic {a secret} private_key_jwt {signed assertions} other {its TLS certificate}}",
    used: "Last token",
    never: "never",
    created: "{when} by {who}",
    registered: "Registered",
    disabled: "disabled {when}",
    register: "Register a machine",
    back: "Back",
    secretOf: "The secret of {name}",
    secretHint: "It is shown this once: nobody can read it later, not even here. Keep it where the program runs.",
    id: "Client id",
    secret: "Secret",
    copy: "Copy the secret",
    copied: "Copied",
    done: "I have it",
    rotate: "New secret…",
    rotateHint: "This registers a successor of {name} with the same rights. Hand its secret over, then disable the old one; until then both work.",
    disable: "Disable…",
    disableSure: "Disable for good: its tokens are worth nothing from now on",
    keep: "Keep it",
    scope: SCOPE_EN,
  },
  fi: {
    clients: "Koneet",
    hint: "Ohjelmat, jotka lukevat rajapintaa omilla tunnisteillaan (OAuth 2.0 client credentials). Rekisteröijä ja käytöstä poistaja jäävät tapahtumalokiin.",
    none: "Yhtään konetta ei ole rekisteröity.",
    name: "Nimi",
    nameHint: "Kenen ohjelma se on ja mihin sitä käytetään",
    may: "Saa",
    mayRead: "Mitä se saa tehdä",
    sees: "Näkee",
    role: "{role, select, viewer {ei henkilötietoja} inspector {kaiken} pad_operator {yhden organisaation alustat} fleet_operator {yhden organisaation droonit} other {{role}}}",
    asRole: "Mitä se näkee",
    authenticates: "Tunnistautuu",
    method: "{method, select, client_secret_basic {salaisuudella} private_key_jwt {allekirjoitetuin vakuutuksin} other {TLS-varmenteellaan}}",
    used: "Viimeisin tunniste",
    never: "ei koskaan",
    created: "{when}, {who}",
    registered: "Rekisteröity",
    disabled: "poistettu käytöstä {when}",
    register: "Rekisteröi kone",
    back: "Takaisin",
    secretOf: "Koneen {name} salaisuus",
    secretHint: "Se näytetään vain nyt: kukaan ei voi lukea sitä myöhemmin, ei täältäkään. Säilytä se siellä, missä ohjelma toimii.",
    id: "Koneen tunnus",
    secret: "Salaisuus",
    copy: "Kopioi salaisuus",
    copied: "Kopioitu",
    done: "Otin talteen",
    rotate: "Uusi salaisuus…",
    rotateHint: "Tämä rekisteröi koneelle {name} seuraajan samoin oikeuksin. Luovuta sen salaisuus ja poista sitten vanha käytöstä; siihen asti molemmat toimivat.",
    disable: "Poista käytöstä…",
    disableSure: "Poista pysyvästi: sen tunnisteet eivät kelpaa enää mihinkään",
    keep: "Jätä käyttöön",
    scope: SCOPE_FI,
  },
});

/** A scope as people read it; by its own name where it has no words yet. */
export function scopeWord(scope: string): string {
  return clientTexts("scope", { scope: scope.replaceAll(/[.-]/g, "_") }) || scope;
}

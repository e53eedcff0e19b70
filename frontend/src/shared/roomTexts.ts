import { texts } from "./i18n/texts";

/** The names of the rooms. */
export const roomTexts = texts({
  en: {
    live: "Live",
    sessions: "Sessions",
    verdicts: "Verdicts",
    alerts: "Alerts",
    replay: "Replay",
    registry: "Registry",
    zones: "Zones",
    ledger: "Ledger",
    statistics: "Statistics",
    people: "People",
    settings: "Settings",
  },
  fi: {
    live: "Nyt",
    sessions: "Istunnot",
    verdicts: "Päätökset",
    alerts: "Hälytykset",
    replay: "Toisto",
    registry: "Rekisteri",
    zones: "Alueet",
    ledger: "Tilikirja",
    statistics: "Tilastot",
    people: "Henkilöt",
    settings: "Asetukset",
  },
});

import { texts } from "../shared/i18n/texts";

/** Site plans: what stands and is marked around a pad. */
export const planTexts = texts({
  en: {
    plan: "Site plan",
    none: "No plan of this site is on the ledger. Its operator can add one.",
    missing: "The ledger names a plan that this server does not have: {why}",
    drawing: "Plan of the site from above: {count, plural, one {# thing} other {# things}} within {reach} of the pad",
    north: "N",
    kind: "{kind, select, surface {Surface} fato {FATO} tlof {TLOF} safety_area {Safety area} approach_sector {Approach} departure_sector {Departure} obstacle {Obstacle} fence {Fence} charger {Charger} other {Marking}}",
    file: "Plan (GeoJSON in metres from the pad)",
    hint: "The server checks the file and keeps it; nothing holds before you have looked at it here and signed its hash.",
    checking: "Checking…",
    refused: "The file cannot be drawn. Mend these and choose it again:",
    look: "As it will be shown:",
    remove: "Remove the plan",
    heldThen: "The plan that held at the request",
  },
  fi: {
    plan: "Asemakuva",
    none: "Tästä paikasta ei ole asemakuvaa tilikirjalla. Alustan toimija voi lisätä sen.",
    missing: "Tilikirja nimeää asemakuvan, jota tällä palvelimella ei ole: {why}",
    drawing: "Paikka ylhäältä: {count, plural, one {# kohde} other {# kohdetta}} enintään {reach} alustasta",
    north: "P",
    kind: "{kind, select, surface {Pinta} fato {FATO} tlof {TLOF} safety_area {Turva-alue} approach_sector {Lähestyminen} departure_sector {Lähtö} obstacle {Este} fence {Aita} charger {Latauslaite} other {Merkintä}}",
    file: "Asemakuva (GeoJSON, metreinä alustasta)",
    hint: "Palvelin tarkistaa tiedoston ja säilyttää sen; mikään ei ole voimassa ennen kuin olet katsonut sitä tässä ja allekirjoittanut sen tiivisteen.",
    checking: "Tarkistetaan…",
    refused: "Tiedostoa ei voi piirtää. Korjaa nämä ja valitse se uudelleen:",
    look: "Näin se näytetään:",
    remove: "Poista asemakuva",
    heldThen: "Pyynnön aikaan voimassa ollut asemakuva",
  },
});

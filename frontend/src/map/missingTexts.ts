import { texts } from "../shared/i18n/texts";
import type { BaseMap } from "./place";

export type MissingMap = BaseMap["missing"][number];

/** What of the map's ground is missing, and why. */
export const missingTexts = texts({
  en: {
    setBy: "Set by",
    missing: "{what, select, imagery {Aerial images are} terrain {The heights of the ground are} other {The map of the place is}} missing: {why}.",
    elsewhere: "The map of the place does not cover the pads, so coasts and borders are shown, from above.",
    away: "{what, select, imagery {Aerial images cannot be loaded now} terrain {The heights of the ground cannot be loaded now} archive {Parts of the map of the place cannot be loaded now} other {Coasts and borders cannot be loaded now}}. They are asked for again.",
    damaged: "{what, select, imagery {Some aerial images are damaged} terrain {Some of the heights of the ground are damaged} other {A part of the map of the place is damaged}}.",
  },
  fi: {
    setBy: "Asetus:",
    missing: "{what, select, imagery {Ilmakuvat puuttuvat} terrain {Maaston korkeudet puuttuvat} other {Paikan kartta puuttuu}}: {why}.",
    elsewhere: "Paikan kartta ei ulotu alustoille, joten näkyvissä ovat rannikot ja rajat ylhäältä katsottuina.",
    away: "{what, select, imagery {Ilmakuvia ei voi nyt ladata} terrain {Maaston korkeuksia ei voi nyt ladata} archive {Osia paikan kartasta ei voi nyt ladata} other {Rannikoita ja rajoja ei voi nyt ladata}}. Niitä pyydetään uudelleen.",
    damaged: "{what, select, imagery {Osa ilmakuvista on vioittunut} terrain {Osa maaston korkeuksista on vioittunut} other {Osa paikan kartasta on vioittunut}}.",
  },
});

/** By the server's codes. */
const whyTexts = texts({
  en: {
    unreadable: "the file cannot be read",
    no_file: "it is no file",
    no_pmtiles: "it is no PMTiles archive of version 3",
    cut_off: "it is cut off: it has {size} bytes and needs {needed}",
    packing: "it is packed in a way that browsers cannot undo; gzip is fine",
    kind: "its tiles are {kind, select, vector {vector tiles} unknown {of an unknown kind} other {{kind}}}, not {wanted, select, vector {vector tiles} other {images}}",
    bounds: "its bounds or zooms make no sense",
    metadata: "its metadata cannot be read",
    layers: "it has no layers {layers}: the map is drawn from the Protomaps schema",
    wmts_elsewhere: "the WMTS sends its readers elsewhere; set the address that it leads to",
    wmts_answer: "the WMTS answers with {status} and {kind}",
    wmts_packed: "the WMTS packs its images, which it was asked not to do",
    wmts_large: "the WMTS sends images of more than {limit} MB",
    wmts_slow: "the WMTS does not answer within {limit} s",
    wmts_away: "the WMTS cannot be reached ({error})",
  },
  fi: {
    unreadable: "tiedostoa ei voi lukea",
    no_file: "se ei ole tiedosto",
    no_pmtiles: "se ei ole PMTiles-arkisto, versio 3",
    cut_off: "se on katkennut: siinä on {size} tavua, ja siinä pitäisi olla {needed}",
    packing: "se on pakattu tavalla, jota selaimet eivät pura; gzip kelpaa",
    kind: "sen ruudut ovat {kind, select, vector {vektoriruutuja} unknown {tuntematonta lajia} other {{kind}-kuvia}}, eivät {wanted, select, vector {vektoriruutuja} other {kuvia}}",
    bounds: "sen rajoissa tai zoomeissa ei ole järkeä",
    metadata: "sen metatietoja ei voi lukea",
    layers: "siitä puuttuvat tasot {layers}: kartta piirretään Protomaps-skeemasta",
    wmts_elsewhere: "WMTS ohjaa muualle; aseta osoite, johon se ohjaa",
    wmts_answer: "WMTS vastaa {status} ja {kind}",
    wmts_packed: "WMTS pakkaa kuvansa, vaikka sitä pyydettiin olemaan pakkaamatta",
    wmts_large: "WMTS lähettää yli {limit} megatavun kuvia",
    wmts_slow: "WMTS ei vastaa {limit} sekunnissa",
    wmts_away: "WMTS ei ole tavoitettavissa ({error})",
  },
});

function isKnown(code: string): code is keyof typeof whyTexts.all.en {
  return Object.hasOwn(whyTexts.all.en, code);
}

/** In the reader's language; a reason that this console does not know yet in the server's words. */
export function whyMissing({ code, facts, why }: MissingMap): string {
  return isKnown(code) ? whyTexts(code, facts) : why;
}

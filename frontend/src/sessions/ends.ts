import { reading } from "../shared/i18n/locale";
import { texts } from "../shared/i18n/texts";

/** Why sessions end, and why steps fail, by the codes that the agents give (`end`, and the first word of a `detail`). */
export const endTexts = texts({
  en: {
    aborted: "aborted",
    authority: "ended by the authority",
    cannot_settle: "no further ranging would settle it",
    challenge_unanswered: "the drone did not answer the challenge",
    claims_out_of_order: "the drone’s claims came out of order",
    code_mismatch: "the session codes do not match",
    done: "done",
    drone_aborted: "the drone gave up",
    echo_mismatch: "the drone’s echo does not match",
    expired: "it took too long",
    granted: "granted",
    ledger_lost: "the ledger could not be reached",
    no_echo: "the drone gave no echo",
    no_identity: "the drone did not say who it is",
    no_poll: "the pad did not poll",
    no_reply: "the drone did not answer",
    no_verdict: "no verdict came",
    not_countersigned: "the drone did not countersign",
    out_of_time: "it took too long",
    out_of_turn: "a message came out of turn",
    permission_expired: "the drone did not use its permission in time",
    radios_lost: "the pad lost its anchors",
    radios_unavailable: "the radios are not available",
    refused: "refused",
    session_mismatch: "the session is another one",
  },
  fi: {
    aborted: "keskeytetty",
    authority: "viranomainen päätti sen",
    cannot_settle: "lisämittaus ei ratkaisisi sitä",
    challenge_unanswered: "drooni ei vastannut haasteeseen",
    claims_out_of_order: "droonin ilmoitukset tulivat väärässä järjestyksessä",
    code_mismatch: "istunnon koodit eivät täsmää",
    done: "tehty",
    drone_aborted: "drooni luopui",
    echo_mismatch: "droonin kaiku ei täsmää",
    expired: "aika loppui",
    granted: "myönnetty",
    ledger_lost: "tilikirjaan ei saatu yhteyttä",
    no_echo: "drooni ei antanut kaikua",
    no_identity: "drooni ei kertonut, kuka se on",
    no_poll: "alusta ei kysynyt",
    no_reply: "drooni ei vastannut",
    no_verdict: "päätöstä ei tullut",
    not_countersigned: "drooni ei allekirjoittanut",
    out_of_time: "aika loppui",
    out_of_turn: "viesti tuli väärällä vuorolla",
    permission_expired: "drooni ei käyttänyt lupaansa ajoissa",
    radios_lost: "alusta menetti ankkurinsa",
    radios_unavailable: "radiot eivät ole käytettävissä",
    refused: "evätty",
    session_mismatch: "istunto on toinen",
  },
});

type Code = keyof typeof endTexts.all.en;

function isKnown(code: string): code is Code {
  return Object.hasOwn(endTexts.all.en, code);
}

/** A code in words; one that this console does not know loses its underscores. */
export function endText(code: string): string {
  return isKnown(code) ? endTexts(code) : code.replaceAll("_", " ");
}

/** "no_reply: the drone did not answer over UWB": the agent's own words in English, the catalogue's in other languages. */
export function detailText(detail: string): string {
  const [, code, said] = /^([a-z0-9_]+)(?:: (.*))?$/s.exec(detail) ?? [];
  if (code === undefined) return detail;
  return said === undefined || (reading().locale !== "en" && isKnown(code)) ? endText(code) : said;
}

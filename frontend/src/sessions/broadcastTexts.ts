import { duration, length } from "../shared/format";
import { texts } from "../shared/i18n/texts";

/** What was odd about a drone's broadcasts, and who signed them. */
export const broadcastTexts = texts({
  en: {
    title: "Broadcasts",
    hint: "As the pad’s receiver heard them. What is odd is for people to look at; the verdict does not rest on it.",
    signature: "Signature",
    verified: "Signed by a drone of {signer}. It says who sent it, not that it is true.",
    unknown: "Signed, but nobody known to the pad vouches for the key.",
    refused: "Signature refused: {reason}.",
    nothing: "Nothing odd was heard.",
    kind: "{kind, select, two_places {The same identity from two places, {distance} apart} impossible_speed {{distance} in {interval}: nothing flies so fast} time_stuck {Its own time stood still for {interval}} time_backwards {Its own time went back by {interval}: a replay} time_off {Its own time differs from the pad’s by {interval}} several_identities {One transmitter, also under the name {other}} rate_high {More positions than a drone sends} signature_bad {A signature that does not hold} other {Something odd}}",
    times: "{count} times",
  },
  fi: {
    title: "Lähetykset",
    hint: "Niin kuin alustan vastaanotin ne kuuli. Outo on ihmisten katsottavaksi; päätös ei perustu siihen.",
    signature: "Allekirjoitus",
    verified: "Allekirjoittaja on rekisterin {signer} drooni. Se kertoo, kuka lähetti, ei että se on totta.",
    unknown: "Allekirjoitettu, mutta kukaan alustan tuntema ei takaa avainta.",
    refused: "Allekirjoitus hylättiin: {reason}.",
    nothing: "Mitään outoa ei kuultu.",
    kind: "{kind, select, two_places {Sama tunnus kahdesta paikasta, väliä {distance}} impossible_speed {{distance} ajassa {interval}: mikään ei lennä niin nopeasti} time_stuck {Sen oma aika seisoi: {interval}} time_backwards {Sen oma aika palasi taaksepäin: {interval}, toisto} time_off {Sen oma aika poikkeaa alustan ajasta: {interval}} several_identities {Yksi lähetin, myös nimellä {other}} rate_high {Enemmän sijainteja kuin drooni lähettää} signature_bad {Allekirjoitus, joka ei pidä} other {Jotain outoa}}",
    times: "{count} kertaa",
  },
});

type Odd = { kind: string; distance_mm?: number | undefined; interval_ms?: number | undefined; other_uav_id?: string | undefined };

/** One finding of a receiver in words. */
export function oddity({ kind, distance_mm, interval_ms, other_uav_id }: Odd): string {
  return broadcastTexts("kind", {
    kind,
    distance: length(distance_mm ?? 0),
    interval: duration(interval_ms ?? 0),
    other: other_uav_id ?? "",
  });
}

import type { Track } from "../shared/api/records";
import { duration, length } from "../shared/format";
import { texts } from "../shared/i18n/texts";

/** What was odd about a drone's broadcasts, and who signed them. */
export const broadcastTexts = texts({
  en: {
    title: "Broadcasts",
    hint: "As the pad’s receiver heard them. What is odd is for people to look at; what the verdict makes of the broadcasts is told under its claims.",
    signature: "Who said it",
    signed:
      "{state, select, verified {{position, select, true {Positions signed} other {Signed, but no position}} by a drone of {signer}. It says who sent it, not that it is true.{bound, select, true {} other { The signature is not tied to this serial number: they were only heard together.}}} endorsed {{signer} vouches for a key, but nothing was signed by it. Anybody can repeat that.} refused {Signature refused: {reason}.} other {Signed, but nobody known to the pad vouches for the key.}}",
    besides: "{count} more with a signature that does not hold.",
    nothing: "Nothing odd was heard.",
    contradicted: "The receiver found nothing odd. One of the broadcasts contradicts the measurement: the verdict’s finding is impersonation or lie.",
    kind: "{kind, select, two_places {The same identity from two places, {distance} apart} impossible_speed {{distance} in {interval}: nothing flies so fast} time_stuck {Its own time stood still for {interval}} time_backwards {Its own time went back by {interval}: a replay} time_off {Its own time differs from the pad’s by {interval}} several_identities {One transmitter, also under the name {other}} rate_high {More positions than a drone sends} signature_bad {A signature that does not hold} other {Something odd}}",
    times: "{count} times",
  },
  fi: {
    title: "Lähetykset",
    hint: "Niin kuin alustan vastaanotin ne kuuli. Outo on ihmisten katsottavaksi; mitä päätös lähetyksistä sanoo, kerrotaan sen ilmoitusten kohdalla.",
    signature: "Kuka sanoi",
    signed:
      "{state, select, verified {{position, select, true {Sijainnit on allekirjoittanut} other {Allekirjoittaja (sijaintia ei ole allekirjoitettu) on}} rekisterin {signer} drooni. Se kertoo, kuka lähetti, ei että se on totta.{bound, select, true {} other { Allekirjoitus ei ole sidottu tähän sarjanumeroon: ne vain kuultiin yhdessä.}}} endorsed {{signer} takaa avaimen, mutta sillä ei ole allekirjoitettu mitään. Kuka tahansa voi toistaa takauksen.} refused {Allekirjoitus hylättiin: {reason}.} other {Allekirjoitettu, mutta kukaan alustan tuntema ei takaa avainta.}}",
    besides: "Lisäksi {count}, joiden allekirjoitus ei pidä.",
    nothing: "Mitään outoa ei kuultu.",
    contradicted: "Vastaanotin ei havainnut outoa. Yksi lähetyksistä on ristiriidassa mittauksen kanssa: päätöksen havainto on toisena esiintyjä tai valhe.",
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

/** Who signed a drone's broadcasts in words: an endorsement alone, or a signature over no position, says less. */
export function signature(drip: NonNullable<Track["drip"]>): string {
  return broadcastTexts("signed", {
    state: drip.state,
    signer: drip.signer ?? drip.det,
    reason: drip.reason ?? "",
    position: String(drip.covers_location),
    bound: String(drip.bound),
  });
}

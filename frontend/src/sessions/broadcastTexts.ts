import findingsEn from "../../../libraries/core/wonderland/messages/en/findings.json";
import findingsFi from "../../../libraries/core/wonderland/messages/fi/findings.json";
import type { Track } from "../shared/api/records";
import { shownFacts, type Facts } from "../shared/i18n/facts";
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
    times: "{count} kertaa",
  },
});

const findings = texts({ en: findingsEn, fi: findingsFi });

/** One finding of a receiver in words, as part of a sentence; a kind that is not known by its name. */
export function oddity(kind: string, facts: Facts): string {
  return kind in findings.all.en ? findings(kind as keyof typeof findingsEn, shownFacts(findingsEn[kind as keyof typeof findingsEn], facts, true)) : kind;
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

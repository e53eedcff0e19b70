import { describe, expect, it } from "vitest";
import type { Alert, Pad } from "../shared/api/records";
import { setReading } from "../shared/i18n/locale";
import type { Phrase } from "../shared/i18n/texts";
import { alertTexts, alertTitles } from "./texts";
import { lookOf, sentence } from "./words";

const NOW_MS = 1_800_000_000_000;
const PADS: ReadonlyMap<string, Pad> = new Map([["pad-1", { pad_id: "pad-1", name: "Aurajoki 2" } as Pad]]);

function alert(kind: Alert["kind"], facts: Alert["facts"], severity: Alert["severity"] = "warning"): Alert {
  return { alert_id: "0", kind, severity, t_ms: NOW_MS, pad_id: "pad-1", uav_id: "uav-1", facts, state: "open", revision: 0, changed_ms: NOW_MS };
}

function say(which: Alert): string {
  const phrases: Phrase[] = sentence(which, PADS);
  return phrases.map((phrase) => (typeof phrase === "string" ? phrase : phrase.strong)).join("").replaceAll("\u00a0", " ");
}

describe("an alert in words", () => {
  it("says what a receiver found odd, in both languages", () => {
    const odd = alert("identity_odd", { finding: "two_places", distance_mm: 412_000, interval_ms: 300 });
    expect(say(odd)).toBe("Aurajoki 2 hears something odd under the name uav-1: the same identity from two places, 412 m apart.");
    const unattributed = alert("broadcast_unattributed", { error_mm: 36_060, supported: "yes" }, "warning");
    expect(say(unattributed)).toBe(
      "Somebody broadcasts under uav-1 36 m from where Aurajoki 2 measured it: an impostor, or its own lie. Another broadcast under this number is where it was measured.",
    );
    expect(lookOf(unattributed)).toBe("inconclusive");
    expect(say(alert("broadcast_odd", { finding: "rate_high" }, "notice"))).toBe("Aurajoki 2 hears something odd of uav-1: more positions than a drone sends.");
    expect(say(alert("broadcasts_flooded", { drones: 1_204 }))).toContain("under 1,204 names at once");
    setReading({ locale: "fi" });
    expect(say(odd)).toBe("Aurajoki 2 kuulee outoa nimellä uav-1: sama tunnus kahdesta paikasta, väliä 412 m.");
    setReading({ locale: "en" });
  });

  it("says how closures differ from the zones", () => {
    expect(say(alert("closures_differ", { state: "missing" }))).toContain("a zone closes it, and nothing is published. Publish anew.");
    expect(say(alert("closures_differ", { state: "differs" }))).toContain("they have changed since. Publish anew.");
  });

  it("says what closes a pad", () => {
    const closed = alert("zone_closed", { action: "land", code: "zone_active", zone_id: "FIN:P20" });
    expect(say(closed)).toBe("uav-1 asked to land at Aurajoki 2, which the zone FIN:P20 closes.");
    setReading({ locale: "fi" });
    expect(say(closed)).toBe("uav-1 pyysi saada laskeutua alustalla Aurajoki 2, jonka vyöhyke FIN:P20 sulkee.");
    expect(say(alert("zone_closed", { action: "land", code: "closures_outdated" }))).toContain("sulkuajat vyöhykkeiden vuoksi ovat vanhentuneet");
    setReading({ locale: "en" });
  });

  it("says how a pad drifts, in the user's language and units", () => {
    const moved = alert("pad_drifting", { state: "moved", anchor_id: "A3", off_mm: 114, extra_sigma_mm: 0 });
    const all = alert("pad_drifting", { state: "widened", anchor_id: "all", off_mm: 0, extra_sigma_mm: 180 });
    expect(say(moved)).toContain("anchor A3 stands about 0.11 m from its place");
    expect(say(all)).toContain("its anchors together; 0.18 m of uncertainty are added.");
    setReading({ locale: "fi" });
    expect(say(moved)).toContain("ankkuri A3 on noin 0,11 m päässä paikaltaan");
    expect(say(all)).toContain("sen ankkurit yhdessä; epävarmuutta lisätään 0,18 m.");
    setReading({ locale: "en" });
  });

  it("quotes what only another said", () => {
    expect(say(alert("ledger_away", { state: "problem", why: "connection refused" }))).toContain("ended with: “connection refused”");
    expect(say(alert("ledger_away", { state: "no_answer", why: "" }))).toBe("The ledger cannot be reached; it does not answer.");
    expect(say(alert("ledger_halted", { why: "a gap" }, "critical"))).toContain("it said: “a gap”");
  });

  it("says since when a pad is silent", () => {
    expect(say(alert("pad_silent", { since_ms: Date.UTC(2026, 0, 31, 12) }))).toMatch(/^Aurajoki 2 has not reported since 31 Jan 2026, \d\d:\d\d:\d\d\.$/);
  });

  it("has no distance for a drone that was leaving", () => {
    expect(say(alert("leaving", { action: "land" }, "critical"))).toBe("uav-1 was leaving the place that it claims at Aurajoki 2 while it was ranged.");
    expect(lookOf(alert("leaving", {}, "critical"))).toBe("refuted");
  });

  it("has a title of its own for each kind", () => {
    const kinds = Object.keys(alertTexts.all.en) as (keyof typeof alertTexts.all.en)[];
    expect(Object.keys(alertTitles.all.en)).toEqual(kinds);
    for (const locale of ["en", "fi"] as const) {
      setReading({ locale });
      const titles = kinds.map((kind) => alertTitles(kind));
      expect(new Set(titles).size).toBe(kinds.length);
    }
    setReading({ locale: "en" });
  });
});

// @vitest-environment happy-dom
import { afterEach, describe, expect, it } from "vitest";
import { readingFrom, setReading } from "./locale";
import { texts } from "./texts";

afterEach(() => setReading({ locale: "en" }));

const t = texts({
  en: { drones: "{count, plural, one {# drone} other {# drones}}", off: "<b>{who}</b> is {distance} off" },
  fi: { drones: "{count, plural, one {# drooni} other {# droonia}}", off: "<b>{who}</b> on {distance} sivussa" },
});

describe("texts", () => {
  it("speaks the chosen language", () => {
    expect([t("drones", { count: 1 }), t("drones", { count: 3 })]).toEqual(["1 drone", "3 drones"]);
    setReading({ locale: "fi" });
    expect([t("drones", { count: 1 }), t("drones", { count: 3 })]).toEqual(["1 drooni", "3 droonia"]);
    expect(document.documentElement.lang).toBe("fi");
  });

  it("keeps emphasis, and shows hostile values as text", () => {
    expect(t.rich("off", { who: "<i>x</i>{a}", distance: "4 m" })).toEqual([{ strong: "<i>x</i>{a}" }, " is 4 m off"]);
    expect(t("off", { who: "OH-1", distance: "4 m" })).toBe("OH-1 is 4 m off");
  });

  it("takes what the browser asks for until somebody chooses", () => {
    expect(readingFrom(null, ["sv-SE", "fi-FI", "en"]).locale).toBe("fi");
    expect(readingFrom('{"locale":"en"}', ["fi"]).locale).toBe("en");
    expect(readingFrom('{"locale":"xx","lengths":7}', ["fi"])).toEqual({ locale: "fi", lengths: "metric", coordinates: "degrees" });
    expect(readingFrom("{broken", []).locale).toBe("en");
  });
});

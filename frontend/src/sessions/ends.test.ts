import { afterEach, expect, it } from "vitest";
import { setReading } from "../shared/i18n/locale";
import { detailText, endText } from "./ends";

afterEach(() => setReading({ locale: "en" }));

it("tells why a session ended in the reader's language", () => {
  expect(endText("permission_expired")).toBe("the drone did not use its permission in time");
  setReading({ locale: "fi" });
  expect(endText("permission_expired")).toBe("drooni ei käyttänyt lupaansa ajoissa");
  expect(endText("some_new_code")).toBe("some new code");
});

it("leaves an agent's own words only to who reads their language", () => {
  expect(detailText("no_reply: the drone did not answer over UWB")).toBe("the drone did not answer over UWB");
  expect(detailText("Own words: kept")).toBe("Own words: kept");
  setReading({ locale: "fi" });
  expect(detailText("no_reply: the drone did not answer over UWB")).toBe("drooni ei vastannut");
  expect(detailText("unheard_of: something new")).toBe("something new");
});

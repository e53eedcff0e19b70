import { afterEach, describe, expect, it } from "vitest";
import { goToStop, STOPS } from "../shared/tourStops";
import { tourTexts } from "./tourTexts";

afterEach(() => goToStop(-1));

describe("the tour", () => {
  it("has a title and a text for every stop, in every language", () => {
    for (const messages of Object.values(tourTexts.all)) {
      for (const { name } of STOPS) {
        expect(messages[`${name}Title`].length).toBeGreaterThan(5);
        expect(messages[name].length).toBeGreaterThan(40);
      }
    }
  });
});

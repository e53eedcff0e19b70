// @vitest-environment happy-dom
import { afterEach, describe, expect, it } from "vitest";
import { age, bytes, coordinates, count, countWord, decimal, duration, length, likelihood, shortHash, speed } from "./format";
import { setReading } from "./i18n/locale";

afterEach(() => setReading({ locale: "en", lengths: "metric", coordinates: "degrees" }));

const plain = (text: string): string => text.replaceAll("\u00a0", " ");

describe("format", () => {
  it.each([
    [0, "0.00 m"],
    [123, "0.12 m"],
    [4_214, "4.21 m"],
    [9_996, "10.0 m"],
    [31_040, "31.0 m"],
    [410_400, "410 m"],
    [999_600, "1.0 km"],
    [12_345_678, "12 km"],
    [-1_500, "−1.50 m"],
  ])("says %d mm as %s", (mm, text) => expect(plain(length(mm))).toBe(text));

  it.each([
    [4_214, "4.2 m"],
    [1_000, "1 m"],
    [400, "0.40 m"],
    [12_900, "13 m"],
    [2_000_000, "2 km"],
  ])("says %d mm in words as %s", (mm, text) => expect(plain(length(mm, true))).toBe(text));

  it("never rounds a likelihood to a certainty, nor across a threshold", () => {
    expect(plain(likelihood(1_000_000))).toBe("> 0.9999");
    expect(plain(likelihood(0))).toBe("< 0.0001");
    expect(likelihood(989_999)).toBe("0.98");
    expect(likelihood(990_000)).toBe("0.99");
    expect(likelihood(998_299)).toBe("0.9982");
    expect(likelihood(9_999)).toBe("0.0099");
  });

  it("says durations and ages in the coarsest unit that says enough", () => {
    expect(plain(duration(31))).toBe("31 ms");
    expect(plain(duration(1_204))).toBe("1.20 s");
    expect(plain(duration(14_300))).toBe("14 s");
    expect(plain(duration(125_000))).toBe("2 min 5 s");
    expect(plain(duration(7_260_000))).toBe("2 h 1 min");
    expect(plain(duration(-40))).toBe("−40 ms");
    expect([age(0), age(8_900), age(200_000), age(7_300_000), age(9e8)].map(plain)).toEqual(["now", "8 s", "3 min", "2 h", "10 d"]);
  });

  it("groups thousands, counts in words to twelve, shortens hashes", () => {
    expect(plain(count(1_234_567))).toBe("1 234 567");
    expect(countWord(4)).toBe("Four");
    expect(countWord(160)).toBe("160");
    expect(shortHash("9f3c00000000000000000000e1")).toBe("9f3c…e1");
    expect(shortHash("short")).toBe("short");
  });

  it("says sizes", () => {
    expect([812, 14_240, 999_949, 3_100_000].map(bytes).map(plain)).toEqual(["812 B", "14.2 kB", "1000 kB", "3.1 MB"]);
  });

  it("writes decimals as the language does", () => {
    setReading({ locale: "fi" });
    expect([length(4_214), likelihood(998_299), duration(1_204), age(0)].map(plain)).toEqual(["4,21 m", "0,9982", "1,20 s", "nyt"]);
    expect(decimal(-0.0001, 2)).toBe("0,00");
  });

  it("says lengths in feet and nautical miles where the user reads those", () => {
    expect(speed(10_000)).toBe("10.0\u00a0m/s");
    setReading({ lengths: "feet" });
    expect(speed(10_000)).toBe("19.4\u00a0kt");
    expect([length(304.8), length(1_000), length(100_000), length(1_852_000 * 1.5), length(1_852_000 * 20)].map(plain)).toEqual(
      ["1.00 ft", "3.28 ft", "328 ft", "1.5 NM", "20 NM"],
    );
  });

  it("says places in degrees, minutes or seconds, and never sixty of them", () => {
    expect(coordinates(604_514_812, -222_686_812)).toBe("60.4514812, −22.2686812");
    setReading({ coordinates: "minutes" });
    expect(plain(coordinates(604_514_812, -222_686_812))).toBe("60° 27.0889′ N 22° 16.1209′ W");
    expect(plain(coordinates(599_999_999, 0))).toBe("60° 00.0000′ N 0° 00.0000′ E");
    setReading({ coordinates: "seconds", locale: "fi" });
    expect(plain(coordinates(604_514_812, 222_686_812))).toBe("60° 27′ 05,33″ N 22° 16′ 07,25″ E");
  });
});

import { expect, test } from "vitest";
import {
  freeTitle,
  isUsual,
  orderOf,
  usualWishes,
  wayOf,
  waysOf,
  type Wishes,
} from "../src/places/scan/plan";

const wishes: Wishes = { ...usualWishes, title: " Mug ", quality: "draft" };

test("a quality says how many stops, unless they were set by hand", () => {
  expect(orderOf(wishes, ["left", "right"])).toMatchObject({
    title: "Mug",
    steps: 60,
    lasers: ["left", "right"],
  });
  expect(orderOf({ ...wishes, steps: 77, without: ["left"] }, ["left", "right"])).toMatchObject({
    steps: 77,
    lasers: ["right"],
  });
});

test("what was changed is not as usual", () => {
  expect(isUsual(wishes)).toBe(true);
  expect(isUsual({ ...wishes, without: ["left"] })).toBe(false);
});

test("a title that is taken gets a number", () => {
  expect(freeTitle("Scan", [])).toBe("Scan");
  expect(freeTitle("Scan", ["Scan", "Scan 2"])).toBe("Scan 3");
});

const adjusted = { detector: "centroid", threshold: 40, channel: "difference", polygon: [] };

test("the line is found as under Adjust, if that is wished", () => {
  const order = orderOf(wishes, ["left"], "step", { ...adjusted, channel: "green" });
  expect(order).toMatchObject({ detector: "centroid", threshold: 40, channel: "green" });
  // A scan compares with its own pictures without laser.
  expect(orderOf(wishes, ["left"], "step", adjusted).channel).toBeNull();
  expect(orderOf({ ...wishes, asAdjusted: false }, ["left"], "step", adjusted)).not.toHaveProperty(
    "detector",
  );
});

test("the part of the picture that was drawn goes into the scan, and limits in millimetres", () => {
  const polygon: [number, number][] = [
    [0, 0],
    [1, 0],
    [1, 1],
  ];
  const limited = { ...wishes, hasLimits: true, radiusMm: 60, aboveMm: 1, belowMm: 90 };
  expect(orderOf(limited, ["left"], "step", { ...adjusted, polygon })).toMatchObject({
    polygon,
    radius_mm: 60,
    above_mm: 1,
    below_mm: 90,
  });
  expect(orderOf(wishes, ["left"], "step", adjusted)).not.toHaveProperty("polygon");
  expect(orderOf(wishes, ["left"])).not.toHaveProperty("radius_mm");
});

test("exposures and colour pictures belong to stops only", () => {
  const rich: Wishes = { ...wishes, exposuresMs: [2, 8, 8], colours: "texture", together: true };
  expect(orderOf(rich, ["left", "right"])).toMatchObject({
    exposures_us: [2000, 8000],
    texture_every: 4,
    together: true,
  });
  expect(orderOf(rich, ["left"], "continuous")).toMatchObject({
    exposures_us: [],
    texture_every: 0,
    together: false,
  });
  expect(orderOf({ ...wishes, colours: "none" }, ["left"]).with_colour).toBe(false);
});

test("a table says how it can be turned", () => {
  const motor = { driver: "horus", turns_by_itself: false, can_turn_steadily: true };
  expect(waysOf(motor)).toEqual(["step", "continuous"]);
  expect(waysOf({ ...motor, can_turn_steadily: false })).toEqual(["step"]);
  const hand = { ...motor, driver: "manual", can_turn_steadily: false };
  expect(waysOf(hand)).toEqual(["hand"]);
  expect(waysOf({ ...hand, turns_by_itself: true })).toEqual(["continuous"]);
  expect(wayOf({ ...wishes, mode: "continuous" }, waysOf(hand))).toBe("hand");
  expect(orderOf(wishes, ["left"], "hand")).toMatchObject({ mode: "step", steps: 12 });
});

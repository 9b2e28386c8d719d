import { expect, test } from "vitest";
import { freeTitle, isUsual, orderOf, usualWishes, type Wishes } from "../src/places/scan/plan";

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

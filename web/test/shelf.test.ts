import { expect, test } from "vitest";
import type { DeviationOut, ScanOut } from "../src/api/schema.gen";
import { found, ordered, statusOf, stillThere } from "../src/places/library/shelf";
import { verdictOf } from "../src/places/library/verdict";

function scan(name: string, facts: Partial<ScanOut> = {}): ScanOut {
  return {
    name,
    title: name,
    note: "",
    created: "2026-11-01T10:00:00Z",
    status: "finished",
    reason: "",
    pictures: 4,
    points: 10,
    size_bytes: 100,
    clouds: [],
    calibration: null,
    has_thumbnail: false,
    ...facts,
  };
}

const scans = [
  scan("mug", { title: "Mug 10", points: 5, created: "2026-11-03T10:00:00Z" }),
  scan("mug-2", { title: "Müg 9", note: "with a chip", size_bytes: 900 }),
  scan("vase", { created: "2026-11-02T10:00:00Z", points: 70 }),
];
const names = (list: readonly ScanOut[]) => list.map((each) => each.name);

test("every word that is searched for must occur, in title, note or name, accents or not", () => {
  expect(names(found(scans, "MUG"))).toEqual(["mug", "mug-2"]);
  expect(names(found(scans, " chip  mug "))).toEqual(["mug-2"]);
  expect(names(found(scans, "chip vase"))).toEqual([]);
  expect(found(scans, "")).toHaveLength(3);
});

test("scans stand in the order that was asked for, numbers in titles as numbers", () => {
  expect(names(ordered(scans, "newest"))).toEqual(["mug", "vase", "mug-2"]);
  expect(names(ordered(scans, "oldest"))[0]).toBe("mug-2");
  expect(names(ordered(scans, "title"))).toEqual(["mug-2", "mug", "vase"]);
  expect(names(ordered(scans, "points"))[0]).toBe("vase");
  expect(names(ordered(scans, "size"))[0]).toBe("mug-2");
});

test("what was chosen and is gone is no longer chosen", () => {
  expect(names(stillThere(new Set(["vase", "erased"]), scans))).toEqual(["vase"]);
});

test("a status of a newer server is shown as a recording", () => {
  expect(statusOf(scan("new", { status: "dreaming" }))).toBe("recording");
});

test("clouds agree when they lie no farther apart than neighbours do", () => {
  const apart = (median_mm: number, p95_mm: number): DeviationOut => {
    const way = { asked: 100, median_mm, rms_mm: median_mm, p95_mm };
    return { there: way, back: way, spacing_mm: 0.5 };
  };
  expect(verdictOf(apart(0.3, 1.0))).toBe("same");
  expect(verdictOf(apart(0.3, 9.0))).toBe("close");
  expect(verdictOf(apart(4.0, 9.0))).toBe("apart");
});

import { expect, test } from "vitest";
import type { JobOut } from "../src/api/schema.gen";
import { choiceOf, emptyDraft, exchanged, lacks, withPreset } from "../src/places/settings/draft";
import { examined, unitOf, worst, type Finding } from "../src/places/settings/findings";

function finding(check: string, state: Finding["state"]): Finding {
  return { check, state, sentence: check, advice: "", numbers: {} };
}

function checkup(ended: string, findings: Finding[], bench = "mine"): JobOut {
  return { kind: "checkup", state: "done", ended, result: { bench, findings } } as unknown as JobOut;
}

test("a group that was checked alone takes the place of what the whole checkup said of it", () => {
  const jobs = [
    checkup("2026-11-21T11:00:00Z", [finding("camera.rate", "ok")]),
    checkup("2026-11-21T10:00:00Z", [finding("camera.rate", "bad"), finding("board.step", "attention")]),
    checkup("2026-11-21T12:00:00Z", [finding("machine.disk", "bad")], "another bench"),
  ];
  const list = examined(jobs, "mine");
  const of = (group: string) => list.find((each) => each.group === group)!;
  expect(worst(of("camera").findings)).toBe("ok");
  expect(worst(of("board").findings)).toBe("attention");
  expect(of("machine")).toEqual({ group: "machine", findings: [], at: "" });
  expect(worst([])).toBeNull();
});

test("numbers of the doctor carry their units in their names", () => {
  expect(unitOf("latency_ms")).toBe("ms");
  expect(unitOf("fastest_deg_s")).toBe("°/s");
  expect(unitOf("written_bytes_s")).toBe("B/s");
  expect(unitOf("rows_share")).toBe("%");
  expect(unitOf("scans")).toBe("");
});

test("what a bench still lacks depends on its board and its camera", () => {
  const ciclop = { name: "ciclop", title: "", board: "horus", camera: "uvc", note: "" } as const;
  const simulated = { ...ciclop, name: "simulated", board: "simulated", camera: "simulated" } as const;
  expect(lacks(emptyDraft)).toBe("preset");
  const draft = withPreset(emptyDraft, ciclop);
  expect(lacks(draft)).toBe("device");
  expect(lacks({ ...draft, device: "0" })).toBe("port");
  expect(lacks({ ...draft, device: "0", port: "/dev/ttyUSB0" })).toBe("");
  expect(lacks(withPreset(draft, simulated))).toBe("");
  expect(choiceOf(withPreset({ ...draft, port: "left over" }, simulated), "Simulated")).toEqual({
    name: "Simulated",
    board: "simulated",
    camera: "simulated",
    direction: "ccw",
    rotation: 0,
    mirror: false,
    lasers: [],
  });
});

test("lasers that are mixed up exchange their outputs and nothing else", () => {
  const lasers = [
    { name: "left", channel: 1, colour: "red" as const },
    { name: "right", channel: 2, colour: "green" as const },
    { name: "third", channel: 5, colour: "red" as const },
  ];
  expect(exchanged(lasers, "left", "right").map((each) => each.channel)).toEqual([2, 1, 5]);
  expect(exchanged(lasers, "left", "nobody")).toEqual(lasers);
});

import { expect, test } from "vitest";
import type { CalibrationState, Step } from "../src/api/schema.gen";
import * as de from "../src/i18n/de";
import { boardOf, isUnusual, measuredMm, printAddress, spacingOf } from "../src/places/calibrate/boards";
import { boardIn } from "../src/places/calibrate/marks";
import { methods } from "../src/places/calibrate/methods";
import { ninth, squares, tilted, upright } from "../src/places/calibrate/poses";
import { markerShare } from "../src/places/calibrate/scale";
import {
  findingName,
  instructionKey,
  methodKey,
  reasonKey,
  redoable,
  shownSteps,
  stepNumber,
} from "../src/places/calibrate/wording";

const steps: Step[] = ["camera", "board", "proof", "table", "solving", "proving", "done"];
const run = {
  steps,
  step: "board",
  done: 0,
  instruction: { code: "wait", words: "Wait." },
} as CalibrationState;
const told = (code: string) => instructionKey({ ...run, instruction: { code, words: "" } });

test("what is to be done is said by its code, and by its words where the code is new", () => {
  expect(told("tilt-top")).toBe("calibrate.do-tilt-top");
  expect(told("place-board-again")).toBe("calibrate.do-place-board-again");
  expect(told("stand-on-your-head")).toBeUndefined();
});

test("while the scanner works it is said at what, and the search for the board before the pictures of it", () => {
  expect(told("wait")).toBe("calibrate.doing-search");
  expect(instructionKey({ ...run, done: 0.2 })).toBe("calibrate.doing-board");
  expect(instructionKey({ ...run, step: "proving" })).toBe("calibrate.doing-proving");
});

test("computing and proving are one step, and only what was begun can be done again", () => {
  expect(shownSteps(run)).toEqual(["camera", "board", "proof", "table", "solving"]);
  expect(stepNumber({ steps, step: "proving" })).toBe(4);
  expect(stepNumber({ steps, step: "done" })).toBe(5);
  expect(redoable(run)).toEqual(["camera", "board"]);
  expect(redoable({ steps, step: "done" })).toEqual(["camera", "board", "proof", "table"]);
});

test("every way to calibrate has its sentences", () => {
  for (const { kind } of methods) {
    expect(de.calibrate).toHaveProperty([`kind-${kind}`]);
    expect(de.calibrate).toHaveProperty([`kindText-${kind}`]);
  }
});

test("reasons, findings and methods that are known are translated, others are not guessed", () => {
  expect(reasonKey({ reason: "struck out by hand" })).toBe("calibrate.reasonByHand");
  expect(reasonKey({ reason: "off by 3 px" })).toBeUndefined();
  expect(findingName("wobble")).toBe("wobble");
  expect(findingName("mood")).toBeUndefined();
  expect(methodKey("Horus")).toBe("calibrate.method-horus");
  expect(methodKey("")).toBeUndefined();
});

test("the printed ruler says how large the squares came out", () => {
  const board = boardOf("chessboard", 11, 8, 12);
  expect(measuredMm(board, 99)).toBeCloseTo(11.88);
  expect(isUnusual(99)).toBe(false);
  expect(isUnusual(94)).toBe(true);
});

test("the printer is asked for the board that is chosen", () => {
  const board = boardOf("charuco", 9, 6, 20);
  expect(spacingOf(board)).toBe(20);
  const query = new URLSearchParams(printAddress(board, "letter").split("?")[1]);
  expect(Object.fromEntries(query)).toMatchObject({
    kind: "charuco",
    columns: "9",
    spacing_mm: "20",
    marker_mm: "15",
    paper: "letter",
  });
});

test("a good number lies in the first third of its scale, a bad one in the last", () => {
  expect(markerShare(0.05, 0.1, 0.3)).toBeCloseTo(1 / 6);
  expect(markerShare(0.2, 0.1, 0.3)).toBeCloseTo(1 / 2);
  expect(markerShare(0.3, 0.1, 0.3)).toBeCloseTo(2 / 3);
  expect(markerShare(30, 0.1, 0.3)).toBeGreaterThan(0.99);
  expect(markerShare(3000, 0.1, 0.3)).toBeLessThan(1);
});

test("a side that is to be tilted away is drawn shorter than the other", () => {
  const [[left], [right], [rightBelow], [leftBelow]] = tilted("top");
  expect(right - left).toBeLessThan(rightBelow - leftBelow);
  expect(ninth("move-bottom-left")).toEqual([52, 102]);
  expect(ninth("move-nearer")).toBeUndefined();
  expect(squares(upright([0, 0], 60)).split("M")).toHaveLength(13);
});

test("corners of the board are taken from the marks of a live picture, where there are any", () => {
  const facts = {
    frame: 1,
    exposed_s: 0,
    size: [640, 480] as [number, number],
    is_stale: false,
    problem: "",
    numbers: null,
  };
  expect(boardIn(facts)).toEqual([]);
  const marks = { board: [[0, 10.5, 20]] };
  expect(boardIn({ ...facts, marks } as typeof facts)).toEqual([[10.5, 20]]);
});

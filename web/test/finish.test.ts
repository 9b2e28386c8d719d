import { expect, test } from "vitest";
import type { FinishPresetOut, MeshOut, StepKindOut } from "../src/api/schema.gen";
import { begun, changed, redone, undone } from "../src/places/library/finish/history";
import {
  changedStep,
  documentsOf,
  fieldsOf,
  movedStep,
  planOf,
  withStep,
  withStepAt,
  withoutStep,
} from "../src/places/library/finish/plan";
import { formsOf, stateOf } from "../src/places/library/finish/result";

const preset: FinishPresetOut = {
  preset: "print",
  steps: [{ kind: "quality" }, { kind: "table" }],
  mesh: { is_closed: true },
};
const kinds = (plan: ReturnType<typeof planOf>) => documentsOf(plan).map((step) => step.kind);

test("every change is taken back and done again, and a new change forgets what was taken back", () => {
  const second = changed(changed(begun(1), 2), 3);
  expect(undone(second).now).toBe(2);
  expect(redone(undone(second)).now).toBe(3);
  expect(undone(undone(undone(second))).now).toBe(1);
  expect(redone(changed(undone(second), 9)).now).toBe(9);
});

test("typing on in one field is one change", () => {
  const typed = changed(changed(changed(begun(0), 1, "size"), 12, "size"), 5, "edge");
  expect(undone(typed).now).toBe(12);
  expect(undone(undone(typed)).now).toBe(0);
});

test("steps are switched off, moved, taken out and added, what cuts before what cleans", () => {
  const plan = planOf(preset);
  expect(kinds(plan)).toEqual(["quality", "table"]);
  expect(kinds(changedStep(plan, 1, { isOn: false }))).toEqual(["table"]);
  expect(kinds(movedStep(plan, 2, -1))).toEqual(["table", "quality"]);
  expect(movedStep(plan, 1, -1)).toBe(plan);
  expect(kinds(withoutStep(plan, 1))).toEqual(["table"]);
  const added = withStep(withoutStep(plan, 1), { kind: "smooth" });
  expect(kinds(withStepAt(added, plan.steps[0]!, 0))).toEqual(["quality", "table", "smooth"]);
  expect(kinds(withStep(withStep(plan, { kind: "smooth" }), { kind: "box" }))).toEqual([
    "box",
    "quality",
    "table",
    "smooth",
  ]);
});

test("settings become fields: numbers with their limits, choices and corners; an outline is none", () => {
  const kind: StepKindOut = {
    kind: "made-up",
    words: "",
    settings: {
      properties: {
        radius_mm: { type: "number", default: 1.5, exclusiveMinimum: 0, maximum: 10 },
        noise_mm: { anyOf: [{ type: "number", maximum: 2 }, { type: "null" }], default: null },
        keep: { type: "string", enum: ["inside", "outside"], default: "inside" },
        low: { type: "array", prefixItems: [{ type: "number" }, { type: "number" }], default: [1, 2] },
        polygon: { type: "array", items: { type: "array" }, default: [] },
      },
    },
  };
  const fields = fieldsOf(kind);
  expect(fields.map((field) => field.name)).toEqual(["radius_mm", "noise_mm", "keep", "low"]);
  expect(fields[0]).toMatchObject({ type: "number", isOptional: false, low: 0.001, high: 10 });
  expect(fields[1]).toMatchObject({ type: "number", isOptional: true, usual: null, high: 2 });
});

test("a surface is called printable only when every check is good, and each form has its size", () => {
  const finding = { check: "walls", state: "good" as const, sentence: "", advice: "" };
  const mesh = (states: ("good" | "doubt" | "bad")[]): MeshOut => ({
    name: "a.ply",
    path: "/a.ply",
    vertices: 3,
    triangles: 10,
    size_bytes: 700,
    created: "2026-11-21T10:00:00Z",
    has_texture: false,
    made: {
      order: { preset: "print", steps: [], mesh: null },
      cloud: "cloud.ply",
      points: 9,
      used_points: 8,
      notes: [],
      doubts: [],
      guessed_share: 0,
      printing: {
        findings: states.map((state) => ({ ...finding, state })),
        size_mm: [1, 1, 1],
        volume_cm3: 1,
        area_cm2: 1,
        pla_g: 1,
        wall_mm: null,
      },
      sizes: { "3mf": 123 },
    },
  });
  expect(stateOf(mesh(["good", "good"]))).toBe("printable");
  expect(stateOf(mesh(["good", "doubt"]))).toBe("doubtful");
  expect(stateOf(mesh(["doubt", "bad"]))).toBe("unprintable");
  expect(formsOf(mesh([])).map((form) => form.bytes)).toEqual([584, 123, null, null, 700]);
  const painted = formsOf({ ...mesh([]), has_texture: true }).map((form) => form.name);
  expect(painted).toEqual(["stl", "3mf", "obj-zip", "glb", "ply"]);
});

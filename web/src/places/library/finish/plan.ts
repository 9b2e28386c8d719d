/** What is to be made of a cloud: a preset, the steps that clean it, and the mesh. Pure; see `finishing.svelte.ts`. */
import type { FinishPresetOut, MeshOptions, MeshOrderOut, StepKindOut } from "../../../api/schema.gen";

export type Preset = FinishPresetOut["preset"];
export type StepDocument = Record<string, unknown>;

export interface PlannedStep {
  readonly id: number;
  readonly isOn: boolean;
  /** As the server takes it: `kind`, and settings that differ from the usual. */
  readonly document: StepDocument;
}

export interface Plan {
  readonly preset: Preset;
  readonly steps: readonly PlannedStep[];
  readonly mesh: Required<MeshOptions>;
  /** Sides of a picture with the colours, at most; null for none. */
  readonly texturePx: number | null;
  readonly keepsCloud: boolean;
}

/** The preset as it is, for a certain cloud. */
export function planOf(preset: FinishPresetOut): Plan {
  return {
    preset: preset.preset,
    steps: preset.steps.map((document, at) => ({ id: at + 1, isOn: true, document })),
    mesh: preset.mesh as Required<MeshOptions>,
    texturePx: null,
    keepsCloud: false,
  };
}

/** What a surface was made with, to go on from there. */
export function planFrom(order: MeshOrderOut, plan: Plan): Plan {
  return {
    ...plan,
    preset: order.preset,
    steps: (order.steps ?? []).map((document, at) => ({ id: at + 1, isOn: true, document })),
    mesh: { ...plan.mesh, ...order.mesh },
    texturePx: order.texture_px ?? null,
  };
}

/** The steps that are switched on, as the server takes them. */
export function documentsOf(plan: Plan): StepDocument[] {
  return plan.steps.filter((step) => step.isOn).map((step) => step.document);
}

export function withStep(plan: Plan, document: StepDocument): Plan {
  const id = 1 + Math.max(0, ...plan.steps.map((step) => step.id));
  // A part alone is cut out first: what follows then has less to do.
  const isCut = ["box", "cylinder", "lasso"].includes(kindOf(document));
  const step = { id, isOn: true, document };
  return { ...plan, steps: isCut ? [step, ...plan.steps] : [...plan.steps, step] };
}

/** With a step that was taken out, where it was, or as near to it as there is a place. */
export function withStepAt(plan: Plan, step: PlannedStep, at: number): Plan {
  const others = plan.steps.filter((each) => each.id !== step.id);
  return { ...plan, steps: others.toSpliced(at, 0, step) };
}

export function withoutStep(plan: Plan, id: number): Plan {
  return { ...plan, steps: plan.steps.filter((step) => step.id !== id) };
}

export function changedStep(plan: Plan, id: number, change: Partial<PlannedStep>): Plan {
  return { ...plan, steps: plan.steps.map((step) => (step.id === id ? { ...step, ...change } : step)) };
}

/** The step one place further up (-1) or down (1). */
export function movedStep(plan: Plan, id: number, by: -1 | 1): Plan {
  const from = plan.steps.findIndex((step) => step.id === id);
  const to = from + by;
  if (from < 0 || to < 0 || to >= plan.steps.length) return plan;
  const steps = [...plan.steps];
  [steps[from], steps[to]] = [steps[to]!, steps[from]!];
  return { ...plan, steps };
}

export const kindOf = (document: StepDocument) => String(document.kind);

/** A setting of a step, as a form shows it. */
export type StepField =
  | {
      name: string;
      type: "number";
      usual: number | null;
      isOptional: boolean;
      low: number;
      high: number;
      step: number;
    }
  | { name: string; type: "choice"; usual: string; options: readonly string[] }
  | { name: string; type: "corner"; usual: readonly number[] };

interface Property {
  default?: unknown;
  type?: string;
  enum?: string[];
  anyOf?: Property[];
  prefixItems?: Property[];
  minimum?: number;
  maximum?: number;
  exclusiveMinimum?: number;
  exclusiveMaximum?: number;
}

/** The settings of a kind of step that a person can type in; an outline is drawn, not typed. */
export function fieldsOf(kind: StepKindOut): StepField[] {
  const properties = (kind.settings.properties ?? {}) as Record<string, Property>;
  return Object.entries(properties).flatMap(([name, given]) => {
    const property = given.anyOf?.find((each) => each.type !== "null") ?? given;
    const usual = given.default;
    if (property.enum)
      return [{ name, type: "choice" as const, usual: String(usual), options: property.enum }];
    if (property.type === "number" || property.type === "integer")
      return [numberField(name, property, usual as number | null, property !== given)];
    if (property.type === "array" && property.prefixItems?.every((each) => each.type === "number"))
      return [{ name, type: "corner" as const, usual: usual as number[] }];
    return [];
  });
}

function numberField(name: string, property: Property, usual: number | null, isOptional: boolean): StepField {
  const step = property.type === "integer" ? 1 : stepFor(usual ?? 0.1);
  const low =
    property.minimum ?? (property.exclusiveMinimum === undefined ? -1e4 : property.exclusiveMinimum + 0.001);
  const high =
    property.maximum ?? (property.exclusiveMaximum === undefined ? 1e4 : property.exclusiveMaximum - 0.1);
  return { name, type: "number", usual, isOptional, low, high, step };
}

/** How far a press on plus goes: about a tenth of what is usual. */
function stepFor(usual: number): number {
  return usual === 0
    ? 1
    : 10 ** Math.min(1, Math.floor(Math.log10(Math.abs(usual) + 1e-9)) - (Math.abs(usual) < 5 ? 1 : 0));
}

export function valueOf(document: StepDocument, field: StepField): unknown {
  return document[field.name] ?? field.usual;
}

/** The document with another value of a setting. */
export function withValue(document: StepDocument, name: string, value: unknown): StepDocument {
  return { ...document, [name]: value };
}

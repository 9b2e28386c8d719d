/** What was planned for each cloud: kept until the page is closed, so that one can leave and come back. */
import { api, asked } from "../../../api/client";
import type { FinishPresetOut, StepKindOut } from "../../../api/schema.gen";
import { begun, changed, redone, undone, type History } from "./history";
import { planOf, type Plan, type Preset } from "./plan";

/** The plan for one cloud. */
export class Finishing {
  history: History<Plan>;

  constructor(
    readonly scan: string,
    readonly cloud: string,
    readonly presets: readonly FinishPresetOut[],
    readonly kinds: readonly StepKindOut[],
  ) {
    this.history = $state.raw(begun(this.#kept() ?? planOf(this.usual("print"))));
  }

  get plan(): Plan {
    return this.history.now;
  }

  change(plan: Plan, of = ""): void {
    this.#become(changed(this.history, plan, of));
  }

  undo(): void {
    this.#become(undone(this.history));
  }

  redo(): void {
    this.#become(redone(this.history));
  }

  choose(preset: Preset): void {
    const { texturePx, keepsCloud } = this.plan;
    this.change({ ...planOf(this.usual(preset)), texturePx, keepsCloud });
  }

  usual(preset: Preset): FinishPresetOut {
    return this.presets.find((each) => each.preset === preset)!;
  }

  kind(name: string): StepKindOut | undefined {
    return this.kinds.find((each) => each.kind === name);
  }

  get #key(): string {
    return `turnscan.finish/${this.scan}/${this.cloud}`;
  }

  #become(history: History<Plan>) {
    this.history = history;
    try {
      sessionStorage.setItem(this.#key, JSON.stringify(this.plan));
    } catch {
      // A browser that keeps nothing.
    }
  }

  /** As it was before the page was loaded again. */
  #kept(): Plan | null {
    try {
      return JSON.parse(sessionStorage.getItem(this.#key) ?? "null") as Plan | null;
    } catch {
      return null;
    }
  }
}

const begunOnes: Record<string, Finishing | undefined> = {};

/** That of a cloud; begun with what the preset for printing does. */
export async function finishingOf(scan: string, cloud: string): Promise<Finishing> {
  const key = `${scan}/${cloud}`;
  const known = begunOnes[key];
  if (known) return known;
  const params = { path: { scan }, query: { cloud } };
  const [presets, kinds] = await Promise.all([
    asked(api.GET("/api/v1/surface/presets/{scan}", { params })),
    asked(api.GET("/api/v1/surface/steps")),
  ]);
  const made = new Finishing(scan, cloud, presets, kinds);
  begunOnes[key] = made;
  return made;
}

/** The ways to calibrate that a person can choose, best first. */
import type { Kind } from "./choices.svelte";

export interface Method {
  kind: Kind;
  isRecommended?: boolean;
  /** A scan needs more than what comes of it. */
  isPart?: boolean;
  /** Needs a calibration whose camera it takes. */
  needsCamera?: boolean;
}

export const methods: readonly Method[] = [
  { kind: "automatic", isRecommended: true },
  { kind: "full" },
  { kind: "table", needsCamera: true },
  { kind: "camera", isPart: true },
  { kind: "paper" },
];

export function methodOf(kind: string | undefined): Method | undefined {
  return methods.find((each) => each.kind === kind);
}

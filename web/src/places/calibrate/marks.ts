/** What the server has marked in a live picture. Pure. */
import type { LiveFacts } from "../../api/live";

export type Corner = readonly [x: number, y: number];

/** Corners of the calibration board in pixels of the camera's picture; none where it was not found. */
export function boardIn(facts: LiveFacts): Corner[] {
  return (facts.marks?.board ?? []).map(([, x, y]) => [x, y]);
}

/** What the distances between two clouds come to. */
import type { DeviationOut } from "../../api/schema.gen";

export type Verdict = "same" | "close" | "apart";

/** As near as neighbours in one cloud, nearly so, or farther apart: half of the points, and nearly all of them. */
export function verdictOf({ there, back, spacing_mm }: DeviationOut): Verdict {
  const median = Math.max(there.median_mm, back.median_mm);
  const most = Math.max(there.p95_mm, back.p95_mm);
  if (median <= spacing_mm && most <= 3 * spacing_mm) return "same";
  return median <= 3 * spacing_mm ? "close" : "apart";
}

/** The ways of finding the laser's line, as the server has them. */
import { api, asked } from "./api/client";
import type { DetectorOut } from "./api/schema.gen";
import { t, type Key } from "./i18n/index.svelte";

let known = $state.raw<readonly DetectorOut[]>([]);
const NAMED: Record<string, Key> = {
  "zero-crossing": "adjust.detector_zero-crossing",
  centroid: "adjust.detector_centroid",
  threshold: "adjust.detector_threshold",
};

/** To choose from; those that this page has no words for go by their own name. */
export function detectorChoices(chosen: string): { value: string; label: string }[] {
  const names = known.map((each) => each.name);
  return (names.includes(chosen) ? names : [chosen, ...names]).map((value) => ({
    value,
    label: detectorName(value),
  }));
}

export function detectorName(name: string): string {
  const key = NAMED[name];
  return key ? t(key) : name;
}

export async function readDetectors(): Promise<void> {
  if (!known.length) known = await asked(api.GET("/api/v1/live/detectors"));
}

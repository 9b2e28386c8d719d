/** What the doctor said, put together from checkups of everything and of single groups. Pure. */
import type { JobOut } from "../../api/schema.gen";

export type FindingState = "ok" | "attention" | "bad" | "skipped";

export interface Finding {
  /** Such as `turntable.direction`; the part before the dot is its group. */
  check: string;
  state: FindingState;
  sentence: string;
  advice: string;
  numbers: Record<string, number | string | null>;
  /** Names the sentence; absent where an older server said it. */
  code?: string;
  /** What else the sentence names. */
  values?: Record<string, number | string>;
}

export const GROUPS = ["board", "camera", "machine", "lasers", "picture", "turntable"] as const;
export type Group = (typeof GROUPS)[number];

export interface Examined {
  group: Group;
  findings: readonly Finding[];
  /** When; empty where it never was. */
  at: string;
}

export function groupOf(finding: Finding): string {
  return finding.check.split(".", 1)[0] ?? "";
}

/** Each group as it was found last. */
export function examined(jobs: readonly JobOut[], bench: string): Examined[] {
  const done = jobs.filter(
    (job) => job.kind === "checkup" && job.state === "done" && job.result.bench === bench,
  );
  const told = done.map((job) => ({
    at: job.ended ?? job.created,
    findings: (job.result.findings as Finding[] | undefined) ?? [],
  }));
  return GROUPS.map((group) => {
    const newest = told.find(({ findings }) => findings.some((each) => groupOf(each) === group));
    const findings = newest?.findings.filter((each) => groupOf(each) === group) ?? [];
    return { group, findings, at: newest?.at ?? "" };
  });
}

const WORST: readonly FindingState[] = ["bad", "attention", "ok", "skipped"];

export function worst(findings: readonly Finding[]): FindingState | null {
  return WORST.find((state) => findings.some((each) => each.state === state)) ?? null;
}

const UNITS: readonly [ending: string, unit: string][] = [
  ["deg_s", "°/s"],
  ["bytes_s", "B/s"],
  ["bytes", "B"],
  ["share", "%"],
  ["deg", "°"],
  ["px", "px"],
  ["mm", "mm"],
  ["ms", "ms"],
  ["us", "µs"],
  ["s", "s"],
];

/** In which unit a number is: `latency_ms` in ms; none for what is counted. */
export function unitOf(key: string): string {
  return UNITS.find(([ending]) => key.endsWith(`_${ending}`))?.[1] ?? "";
}

const YES_OR_NO = new Set(["told", "tells_position", "can_stop"]);

/** Whether a number answers a question: 1 for yes. */
export const isAnswer = (key: string) => YES_OR_NO.has(key);

/** Of `left_on_right`: how much of laser left lies in the plane of laser right. */
export function laserInPlane(key: string): { laser: string; plane: string } | null {
  const [, laser, plane] = /^(.+)_on_(.+)$/.exec(key) ?? [];
  return laser && plane ? { laser, plane } : null;
}

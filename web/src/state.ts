/** Everything that the page knows of the scanner, and how each event changes it. Pure; see `store.svelte.ts`. */
import type { AnyEventOut, BenchOut, CalibrationState, CountersOut, JobOut, ScanOut } from "./api/schema.gen";

export interface AppState {
  /** The line to the server. */
  link: "connecting" | "up" | "lost";
  /** null until it was asked for the first time. */
  bench: BenchOut | null;
  /** What is counted, a few times a second; null until the first came. */
  counters: CountersOut | null;
  /** The calibration that is being made, or was made last; null until there was news of one. */
  calibration: CalibrationState | null;
  /** Newest first. */
  jobs: readonly JobOut[];
  /** Points of a running scan, by its job's id. */
  points: Readonly<Record<string, number>>;
  /** The last lines of each job's log, by its id. */
  lines: Readonly<Record<string, readonly string[]>>;
  /** Newest first; null until it was asked for the first time. */
  scans: readonly ScanOut[] | null;
}

/** What the server says; described in `app/api/news_models.py`. */
export type News = AnyEventOut;

export type AppEvent =
  | News
  | { type: "link-found" }
  | { type: "link-lost" }
  | { type: "bench-read"; bench: BenchOut }
  | { type: "scans-read"; scans: readonly ScanOut[] };

export const nothingKnown: AppState = {
  link: "connecting",
  bench: null,
  counters: null,
  calibration: null,
  jobs: [],
  points: {},
  lines: {},
  scans: null,
};

const LINES_KEPT = 200;

export function reduce(state: AppState, event: AppEvent): AppState {
  switch (event.type) {
    case "link-found":
      return { ...state, link: "up" };
    case "link-lost":
      return { ...state, link: "lost" };
    case "bench-read":
    case "bench-changed":
      return { ...state, bench: event.bench };
    case "state":
      return { ...state, bench: event.bench, jobs: event.jobs, counters: event.counters };
    case "scans-read":
      return { ...state, scans: event.scans };
    case "job-changed":
      return { ...state, jobs: withJob(state.jobs, event.job) };
    case "job-said": {
      const before = state.lines[event.job_id] ?? [];
      const lines = [...before.slice(1 - LINES_KEPT), event.line];
      return { ...state, lines: { ...state.lines, [event.job_id]: lines } };
    }
    case "points-added":
      return { ...state, points: { ...state.points, [event.job_id]: event.points } };
    case "calibration-changed":
      return { ...state, calibration: event.calibration };
    case "counters":
      return { ...state, counters: event };
    case "notice":
      // Told at the edge of the page; see shell/news.ts.
      return state;
    default:
      return unreachable(event);
  }
}

/** Whether a job is over, however. */
export function hasEnded(job: JobOut): boolean {
  return job.state === "done" || job.state === "failed" || job.state === "cancelled";
}

/** The job that people think of: what runs or rests, else what waits for its turn. */
export function currentJob(state: AppState): JobOut | undefined {
  const open = state.jobs.filter((job) => !hasEnded(job));
  return open.find((job) => job.state !== "queued") ?? open[open.length - 1];
}

/** The newest job of a kind, ended or not. */
export function newestJob(state: AppState, kind: string): JobOut | undefined {
  return state.jobs.find((job) => job.kind === kind);
}

function withJob(jobs: readonly JobOut[], job: JobOut): readonly JobOut[] {
  const at = jobs.findIndex((each) => each.id === job.id);
  return at < 0 ? [job, ...jobs] : jobs.with(at, job);
}

function unreachable(event: never): never {
  throw new Error(`there is no event like ${JSON.stringify(event)}`);
}

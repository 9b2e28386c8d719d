import { expect, test } from "vitest";
import type { JobOut } from "../src/api/schema.gen";
import { currentJob, nothingKnown, reduce, type AppEvent } from "../src/state";

function job(id: string, changes: Partial<JobOut> = {}): JobOut {
  const usual = {
    id,
    kind: "scan",
    title: id,
    state: "running",
    created: "2026-11-21T10:00:00Z",
    ended: null,
    done: 0,
    total: 10,
    note: "",
    seconds: 0,
    seconds_left: null,
    waits_for: "",
    problem: null,
    result: {},
  };
  return { ...usual, scan: "", can_resume: false, ...changes } as JobOut;
}

const after = (...events: AppEvent[]) => events.reduce(reduce, nothingKnown);

test("a new job comes first, and a known one stays where it is", () => {
  const state = after(
    { type: "job-changed", job: job("a") },
    { type: "job-changed", job: job("b") },
    { type: "job-changed", job: job("a", { done: 5 }) },
  );
  expect(state.jobs.map((each) => [each.id, each.done])).toEqual([
    ["b", 0],
    ["a", 5],
  ]);
});

test("what runs comes before what waits for its turn", () => {
  const state = after(
    { type: "job-changed", job: job("runs") },
    { type: "job-changed", job: job("waits", { state: "queued" }) },
    { type: "job-changed", job: job("over", { state: "done" }) },
  );
  expect(currentJob(state)?.id).toBe("runs");
});

test("of a job's log only the last lines are kept", () => {
  const lines = Array.from({ length: 500 }, (_, at) => ({
    type: "job-said" as const,
    job_id: "a",
    line: `line ${at}`,
  }));
  const kept = after(...lines).lines.a ?? [];
  expect(kept).toHaveLength(200);
  expect(kept.at(-1)).toBe("line 499");
});

test("a lost line keeps what was known", () => {
  const state = after({ type: "job-changed", job: job("a") }, { type: "link-lost" });
  expect(state.link).toBe("lost");
  expect(state.jobs).toHaveLength(1);
});

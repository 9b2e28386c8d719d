/** The calibration that is being made, or was made last: read from the server at every coming and reconnecting. */
import { api, asked } from "../../api/client";
import type { CalibrationState, JobOut } from "../../api/schema.gen";
import { hasEnded, newestJob, type AppState } from "../../state";
import { app, dispatch, onNews } from "../../store.svelte";

export const KIND = "calibrate";

export function calibrationJob(state: AppState): JobOut | undefined {
  return newestJob(state, KIND);
}

/** Its state, where it is known of this job. */
export function stateOf(job: JobOut | undefined): CalibrationState | null {
  const known = app.now.calibration;
  return job && known?.job_id === job.id ? known : null;
}

/** Asks how it goes; news that came meanwhile are newer and stay. Of an older run the server knows nothing. */
export async function readState(): Promise<void> {
  const before = app.now.calibration;
  const calibration = await asked(api.GET("/api/v1/calibrate/latest"));
  if (calibration && app.now.calibration === before) tellState(calibration);
}

/** Takes in an answer as if it were news. */
export function tellState(answer: unknown): void {
  // The client's types call pairs of numbers lists of them.
  dispatch({ type: "calibration-changed", calibration: answer as CalibrationState });
}

/** Resolves when the job has ended, however. */
export function ended(jobId: string): Promise<void> {
  const isOver = () => app.now.jobs.some((job) => job.id === jobId && hasEnded(job));
  if (isOver()) return Promise.resolve();
  return new Promise((resolve) => {
    const stop = onNews(() => {
      if (!isOver()) return;
      stop();
      resolve();
    });
  });
}

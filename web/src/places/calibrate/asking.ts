/** What can be asked of a calibration; each tells by itself what went wrong. */
import { api, asked } from "../../api/client";
import type { CalibrateIn, JobOut, Standing, Step } from "../../api/schema.gen";
import { t } from "../../i18n/index.svelte";
import { attempt, confirm } from "../../notices.svelte";
import { go } from "../../router.svelte";
import { tellJob } from "../../shell/actions";
import { hasEnded } from "../../state";
import { dispatch } from "../../store.svelte";
import { ended, tellState } from "./following.svelte";
import { mayOpenAudio } from "./signals";

export function begin(order: CalibrateIn): Promise<boolean> {
  mayOpenAudio();
  return attempt(async () => {
    const job = await asked(api.POST("/api/v1/calibrate", { body: order }));
    dispatch({ type: "job-changed", job });
    // Its end is shown here, and not how to begin another.
    await go("/calibrate", { replace: true });
  });
}

export function resume(session: string, redo: Step | null = null): Promise<boolean> {
  mayOpenAudio();
  return attempt(async () => {
    const job = await asked(api.POST("/api/v1/calibrate/resume", { body: { session, redo } }));
    dispatch({ type: "job-changed", job });
  });
}

function answered(call: Promise<unknown>): Promise<boolean> {
  return attempt(async () => tellState(await call));
}

export function goOn(jobId: string): Promise<boolean> {
  mayOpenAudio();
  const params = { path: { job_id: jobId } };
  return attempt(() => asked(api.POST("/api/v1/calibrate/{job_id}/continue", { params })));
}

export function takeNow(jobId: string): Promise<boolean> {
  mayOpenAudio();
  const params = { path: { job_id: jobId } };
  return attempt(() => asked(api.POST("/api/v1/calibrate/{job_id}/take", { params })));
}

export function strike(jobId: string, number: number, isStruck: boolean): Promise<boolean> {
  const params = { path: { job_id: jobId, number } };
  return answered(
    isStruck
      ? asked(api.POST("/api/v1/calibrate/{job_id}/views/{number}/strike", { params }))
      : asked(api.POST("/api/v1/calibrate/{job_id}/views/{number}/restore", { params })),
  );
}

const STANDINGS: Record<string, Standing> = {
  "place-board": "board",
  "place-board-again": "board-again",
  "clear-table": "nothing",
  "show-lasers": "held-across",
};

/** What hands would do about an instruction, on the simulated bench. */
export function putThere(code: string): Promise<boolean> {
  const body = { stage: STANDINGS[code] ?? "held" };
  return attempt(() => asked(api.POST("/api/v1/bench/simulated/stage", { body })));
}

export async function cancel(job: JobOut): Promise<boolean> {
  const isSure = await confirm({
    title: t("calibrate.cancelTitle"),
    text: t("calibrate.cancelText"),
    yes: t("calibrate.cancelYes"),
    isDangerous: true,
  });
  return isSure && (await tellJob(job, "cancel"));
}

/** A step once more; what runs is cancelled first, and its pictures stay. */
export async function redo(job: JobOut, session: string, step: Step): Promise<boolean> {
  const isSure = await confirm({
    title: t("calibrate.redoTitle", { step: t(`calibrate.step-${step}`) }),
    text: t("calibrate.redoText"),
    yes: t("calibrate.redoYes"),
  });
  if (!isSure) return false;
  if (!hasEnded(job)) {
    if (!(await tellJob(job, "cancel"))) return false;
    await ended(job.id);
  }
  return resume(session, step);
}

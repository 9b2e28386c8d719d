/** What can be asked of the scanner from everywhere. */
import { api, asked } from "../api/client";
import type { JobOut } from "../api/schema.gen";
import { t } from "../i18n/index.svelte";
import { attempt, tell } from "../notices.svelte";

/** Emergency stop: lasers off, table stopped; the job that used them ends. */
export async function stopEverything(): Promise<void> {
  const isDone = await attempt(() => asked(api.POST("/api/v1/bench/stop")));
  if (isDone) tell({ tone: "warning", sentence: t("shell.stopped"), hint: t("shell.stoppedHint") });
}

type Verb = "pause" | "resume" | "cancel";

export function tellJob(job: JobOut, verb: Verb): Promise<boolean> {
  const params = { params: { path: { job_id: job.id } } };
  if (verb === "pause") return attempt(() => asked(api.POST("/api/v1/jobs/{job_id}/pause", params)));
  if (verb === "resume") return attempt(() => asked(api.POST("/api/v1/jobs/{job_id}/resume", params)));
  return attempt(() => asked(api.POST("/api/v1/jobs/{job_id}/cancel", params)));
}

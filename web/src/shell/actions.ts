/** What can be asked of every job. */
import { api, asked } from "../api/client";
import type { JobOut } from "../api/schema.gen";
import { attempt } from "../notices.svelte";

type Verb = "pause" | "resume" | "cancel";

export function tellJob(job: JobOut, verb: Verb): Promise<boolean> {
  const params = { params: { path: { job_id: job.id } } };
  if (verb === "pause") return attempt(() => asked(api.POST("/api/v1/jobs/{job_id}/pause", params)));
  if (verb === "resume") return attempt(() => asked(api.POST("/api/v1/jobs/{job_id}/resume", params)));
  return attempt(() => asked(api.POST("/api/v1/jobs/{job_id}/cancel", params)));
}

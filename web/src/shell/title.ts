/** What a job is called: what a person named it, else its kind in their own language. */
import type { JobOut } from "../api/schema.gen";
import { told } from "../i18n/server.svelte";

const NAMED_BY_KIND = ["calibrate", "checkup"];

export function titleOf({ kind, title }: Pick<JobOut, "kind" | "title">): string {
  return NAMED_BY_KIND.includes(kind) ? told(title).sentence : title;
}

/** What is done with scans from more than one part of the library. */
import { api, asked } from "../../api/client";
import type { ScanOut } from "../../api/schema.gen";
import { t } from "../../i18n/index.svelte";
import { attempt, tellUndo } from "../../notices.svelte";
import { readScans } from "../../store.svelte";
import { chosen } from "./shelf.svelte";

/** Into the bin, with the offer to take them back. Returns whether all went. */
export async function throwAway(scans: readonly ScanOut[]): Promise<boolean> {
  const keys: string[] = [];
  const isDone = await attempt(async () => {
    for (const { name } of scans) {
      const params = { path: { name } };
      keys.push((await asked(api.DELETE("/api/v1/scans/{name}", { params }))).key);
      chosen.delete(name);
    }
  });
  await readScans();
  if (keys.length) {
    const sentence =
      keys.length === 1
        ? t("library.thrownAway", { title: scans[0]!.title })
        : t("library.severalThrownAway", { count: keys.length });
    tellUndo(sentence, () => restore(keys));
  }
  return isDone;
}

/** Back from the bin. */
export async function restore(keys: readonly string[]): Promise<void> {
  try {
    for (const key of keys) {
      await asked(api.POST("/api/v1/scans/bin/{key}/restore", { params: { path: { key } } }));
    }
  } finally {
    await readScans();
  }
}

/** Goes on with a scan that ended early. */
export function goOn(scan: ScanOut): Promise<boolean> {
  return attempt(() => asked(api.POST("/api/v1/jobs/resume-scan", { body: { scan: scan.name } })));
}

/** The five places: the first comes with the page, each other is fetched when it is first gone to. */
import type { Component } from "svelte";
import type { JobOut } from "./api/schema.gen";
import type { Key } from "./i18n/index.svelte";
import ScanPlace from "./places/scan/ScanPlace.svelte";
import type { PlaceName } from "./router.svelte";
import type { IconName } from "./ui/icons";

export interface Place {
  name: PlaceName;
  label: Key;
  icon: IconName;
  load: () => Promise<{ default: Component }>;
}

export const places: readonly Place[] = [
  { name: "scan", label: "shell.scan", icon: "scan", load: () => Promise.resolve({ default: ScanPlace }) },
  {
    name: "adjust",
    label: "shell.adjust",
    icon: "adjust",
    load: () => import("./places/adjust/AdjustPlace.svelte"),
  },
  {
    name: "calibrate",
    label: "shell.calibrate",
    icon: "calibrate",
    load: () => import("./places/calibrate/CalibratePlace.svelte"),
  },
  {
    name: "library",
    label: "shell.library",
    icon: "library",
    load: () => import("./places/library/LibraryPlace.svelte"),
  },
  {
    name: "settings",
    label: "shell.settings",
    icon: "settings",
    load: () => import("./places/settings/SettingsPlace.svelte"),
  },
];

/** Where a job is looked after. */
export function placeOfJob({ kind, scan }: Pick<JobOut, "kind" | "scan">): string {
  if (kind === "checkup") return "/settings/doctor";
  if (kind.startsWith("calibrat")) return "/calibrate";
  if (kind === "surface" || kind === "join") return `/library/${encodeURIComponent(scan)}/finish`;
  return kind === "scan" || kind === "texture" ? "/scan" : "/library";
}

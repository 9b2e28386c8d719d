/** What the 3D view shows, as it was last heard; the same for every page that looks. */
import { api, asked } from "./api/client";
import type { ViewOut } from "./api/schema.gen";
import { t } from "./i18n/index.svelte";
import { tell } from "./notices.svelte";

interface Box {
  low: number[];
  high: number[];
}

/** As an answer brings it: the client makes lists of what has a certain length. */
export type View = Omit<ViewOut, "crop" | "extent" | "measured"> & {
  crop: Box | null;
  extent: Box | null;
  measured: number[][];
};

let known = $state.raw<View | null>(null);

export const cloud = {
  /** null until it was asked for the first time. */
  get now(): View | null {
    return known;
  },
};

/** Takes in what the server answered about the view; a refusal is passed on. */
export async function seen(answer: Promise<View>): Promise<void> {
  known = await answer;
}

/** Asks what is shown now. */
export function readCloud(): Promise<void> {
  return seen(asked(api.GET("/api/v1/view"))).catch(() => {
    // The line is lost: it is asked again with the next press.
  });
}

/** Opens a scan in the view; its newest cloud where none is named. */
export async function showInView(scan: string, name?: string): Promise<void> {
  await seen(asked(api.POST("/api/v1/view/show", { body: { scan, cloud: name ?? null } })));
  if (known?.nowhere) tell({ tone: "info", sentence: t("library.nowhere", { count: known.nowhere }) });
}

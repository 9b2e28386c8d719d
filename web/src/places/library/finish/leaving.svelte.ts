/** Surfaces that somebody threw away: out of sight at once, erased when they can no longer be wanted back. */
import { SvelteMap } from "svelte/reactivity";
import { api, asked } from "../../../api/client";
import { attempt, tellUndo, UNDO_MS } from "../../../notices.svelte";

interface Leaving {
  scan: string;
  name: string;
  /** Undefined once it is being erased. */
  timer: ReturnType<typeof setTimeout> | undefined;
}

const leaving = new SvelteMap<string, Leaving>();

export const isLeaving = (path: string) => leaving.has(path);

export function throwSurfaceAway(scan: string, mesh: { name: string; path: string }, sentence: string): void {
  const { name, path } = mesh;
  const timer = setTimeout(() => void attempt(() => erase(path)), UNDO_MS);
  leaving.set(path, { scan, name, timer });
  tellUndo(sentence, async () => {
    clearTimeout(timer);
    leaving.delete(path);
  });
}

async function erase(path: string, keepalive = false): Promise<void> {
  const { scan, name, timer } = leaving.get(path)!;
  clearTimeout(timer);
  leaving.set(path, { scan, name, timer: undefined });
  const params = { path: { name: scan, mesh: name } };
  try {
    await asked(api.DELETE("/api/v1/scans/{name}/meshes/{mesh}", { params, keepalive }));
  } catch (error) {
    leaving.delete(path);
    throw error;
  }
}

// Whoever leaves the page wants nothing back.
addEventListener("pagehide", () => {
  for (const [path, { timer }] of leaving) if (timer !== undefined) void erase(path, true).catch(() => {});
});

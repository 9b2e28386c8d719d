/** Files on their way into the library, one after the other; they go on wherever in the page one is. */
import { API } from "../../api/addresses";
import { sendFile } from "../../api/client";
import type { ScanOut } from "../../api/schema.gen";
import { wordsOf } from "../../notices.svelte";
import { readScans } from "../../store.svelte";

export interface Upload {
  id: number;
  file: File;
  state: "waits" | "goes" | "done" | "failed";
  /** 0..1 of it has gone; at 1 the server looks through it. */
  share: number;
  problem?: ReturnType<typeof wordsOf>;
  /** What became of it. */
  scan?: ScanOut;
  breaker: AbortController;
}

let list = $state.raw<readonly Upload[]>([]);
let last = 0;
let isSending = false;

export const uploads = {
  get now(): readonly Upload[] {
    return list;
  },
};

/** Puts files in the line. */
export function upload(files: Iterable<File>): void {
  const added = [...files].map((file): Upload => ({
    id: ++last,
    file,
    state: "waits",
    share: 0,
    breaker: new AbortController(),
  }));
  list = [...list, ...added];
  void sendAll();
}

/** Takes one out of the list; one that is on its way is broken off. */
export function drop(id: number): void {
  list.find((each) => each.id === id)?.breaker.abort();
  list = list.filter((each) => each.id !== id);
}

export function again(id: number): void {
  change(id, { state: "waits", share: 0, problem: undefined });
  void sendAll();
}

function change(id: number, changes: Partial<Upload>) {
  list = list.map((each) => (each.id === id ? { ...each, ...changes } : each));
}

async function sendAll() {
  if (isSending) return;
  isSending = true;
  for (let next = waiting(); next; next = waiting()) await send(next);
  isSending = false;
}

const waiting = () => list.find((each) => each.state === "waits");

async function send({ id, file, breaker }: Upload) {
  change(id, { state: "goes" });
  const path = `${API}/scans/upload?file=${encodeURIComponent(file.name)}`;
  try {
    const scan = await sendFile("POST", path, file, (share) => change(id, { share }), breaker.signal);
    change(id, { state: "done", share: 1, scan: scan as ScanOut });
    await readScans();
  } catch (error) {
    change(id, { state: "failed", problem: wordsOf(error) });
  }
}

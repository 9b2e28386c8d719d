/** Which scans are listed, and in which order. */
import type { ScanOut } from "../../api/schema.gen";

export const orders = ["newest", "oldest", "title", "points", "size"] as const;
export type Order = (typeof orders)[number];

const STATUSES = ["running", "paused", "finished", "recording", "cloud", "damaged"] as const;
export type Status = (typeof STATUSES)[number];

/** The status as the page knows it; what a newer server says is taken for a recording. */
export function statusOf(scan: ScanOut): Status {
  return STATUSES.find((each) => each === scan.status) ?? "recording";
}

export const tones = {
  running: "accent",
  paused: "warning",
  finished: "success",
  recording: "plain",
  cloud: "plain",
  damaged: "danger",
} as const;

/** Those in whose title, note or name every word occurs. */
export function found(scans: readonly ScanOut[], words: string): ScanOut[] {
  const wanted = plain(words).split(/\s+/).filter(Boolean);
  return scans.filter((scan) => {
    const text = plain(`${scan.title} ${scan.note} ${scan.name}`);
    return wanted.every((word) => text.includes(word));
  });
}

export function ordered(scans: readonly ScanOut[], order: Order): ScanOut[] {
  const compare: Record<Order, (a: ScanOut, b: ScanOut) => number> = {
    newest: (a, b) => b.created.localeCompare(a.created),
    oldest: (a, b) => a.created.localeCompare(b.created),
    title: (a, b) => a.title.localeCompare(b.title, undefined, { numeric: true, sensitivity: "base" }),
    points: (a, b) => b.points - a.points,
    size: (a, b) => b.size_bytes - a.size_bytes,
  };
  return scans.toSorted(compare[order]);
}

/** What was chosen and is still there. */
export function stillThere(chosen: ReadonlySet<string>, scans: readonly ScanOut[]): ScanOut[] {
  return scans.filter((scan) => chosen.has(scan.name));
}

/** Without capitals and accents: "mug" finds "Müg". */
function plain(text: string): string {
  return text.normalize("NFD").replace(/\p{M}/gu, "").toLowerCase();
}

/** A path below the place. */
export const pathOf = (name: string) => `/library/${encodeURIComponent(name)}`;

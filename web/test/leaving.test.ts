import { afterEach, expect, test, vi } from "vitest";
import { UNDO_MS } from "../src/notices.svelte";

const erased: string[] = [];
const undos: (() => Promise<unknown>)[] = [];
vi.stubGlobal("addEventListener", () => {});
vi.mock("../src/api/client", () => ({
  api: { DELETE: (_: string, { params }: { params: { path: { mesh: string } } }) => params.path.mesh },
  asked: async (mesh: string) => {
    if (mesh === "held.ply") throw new Error("held");
    erased.push(mesh);
  },
}));
vi.mock("../src/notices.svelte", () => ({
  UNDO_MS: 11_000,
  attempt: (work: () => Promise<unknown>) => work().catch(() => false),
  tellUndo: (_: string, undo: () => Promise<unknown>) => undos.push(undo),
}));
const { isLeaving, throwSurfaceAway } = await import("../src/places/library/finish/leaving.svelte");

afterEach(() => {
  vi.useRealTimers();
  erased.length = undos.length = 0;
});

test("a surface goes out of sight at once, and comes back as long as that is offered", async () => {
  vi.useFakeTimers();
  throwSurfaceAway("mug", { name: "a.ply", path: "/a" }, "");
  expect(isLeaving("/a")).toBe(true);
  await vi.advanceTimersByTimeAsync(UNDO_MS - 1);
  await undos[0]!();
  expect(isLeaving("/a")).toBe(false);
  await vi.advanceTimersByTimeAsync(UNDO_MS);
  expect(erased).toEqual([]);
});

test("one that nobody wants back is erased, and one that cannot be erased is seen again", async () => {
  vi.useFakeTimers();
  throwSurfaceAway("mug", { name: "b.ply", path: "/b" }, "");
  throwSurfaceAway("mug", { name: "held.ply", path: "/held" }, "");
  await vi.advanceTimersByTimeAsync(UNDO_MS);
  expect(erased).toEqual(["b.ply"]);
  expect([isLeaving("/b"), isLeaving("/held")]).toEqual([true, false]);
});

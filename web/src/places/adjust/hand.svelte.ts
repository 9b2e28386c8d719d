/** Moving the scanner by hand. */
import { api, asked } from "../../api/client";
import type { Move } from "../../api/schema.gen";
import { t } from "../../i18n/index.svelte";
import { announce, attempt, tellUndo } from "../../notices.svelte";
import { degrees } from "../../format";
import { app } from "../../store.svelte";

let busy = $state("");

export const hand = $state({
  /** 0: as fast as the board usually goes. */
  speedDegS: 0,
  get isBusy(): boolean {
    return busy !== "";
  },
  /** Which press is being done; empty for none. */
  get busy(): string {
    return busy;
  },
});

async function doing(what: string, work: () => Promise<unknown>): Promise<boolean> {
  if (busy) return false;
  busy = what;
  const isDone = await attempt(work);
  busy = "";
  return isDone;
}

async function turn(what: string, move: Move): Promise<void> {
  const isDone = await doing(what, () => asked(api.POST("/api/v1/bench/table", { body: move })));
  if (isDone) announce(t("adjust.standsAt", { angle: degrees(app.now.bench?.angle_deg ?? 0) }));
}

export function turnBy(byDeg: number): Promise<void> {
  const speed = hand.speedDegS;
  return turn(`${byDeg}`, speed ? { by_deg: byDeg, speed_deg_s: speed } : { by_deg: byDeg });
}

export function turnToZero(): Promise<void> {
  return turn("zero", { angle_deg: 0 });
}

export async function callZero(): Promise<void> {
  const before = app.now.bench?.angle_deg ?? 0;
  const zero = (angle_deg: number) => asked(api.POST("/api/v1/bench/zero", { body: { angle_deg } }));
  if (await doing("here", () => zero(0))) tellUndo(t("adjust.isZero"), () => zero(before));
}

export function hold(on: boolean): Promise<boolean> {
  return doing(on ? "hold" : "loose", () => asked(api.POST("/api/v1/bench/motor", { body: { on } })));
}

export function switchLaser(name: string, on: boolean): Promise<boolean> {
  return attempt(() =>
    asked(api.POST("/api/v1/bench/lasers/{name}", { params: { path: { name } }, body: { on } })),
  );
}

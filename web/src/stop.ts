/** Emergency stop: lasers off, table stopped; the job that used them ends. */
import { api, asked } from "./api/client";
import { t } from "./i18n/index.svelte";
import { attempt, tell } from "./notices.svelte";

const TWICE_MS = 600;

export async function stopEverything(): Promise<void> {
  const isDone = await attempt(() => asked(api.POST("/api/v1/bench/stop")));
  if (isDone) tell({ tone: "warning", sentence: t("shell.stopped"), hint: t("shell.stoppedHint") });
}

/** Ctrl with the full stop, or Escape twice, until the returned function is called. */
export function listenForStopKeys(): () => void {
  let escaped = -Infinity;

  function onkeydown(event: KeyboardEvent) {
    if (event.key === "." && event.ctrlKey) {
      event.preventDefault();
      void stopEverything();
    }
    if (event.key !== "Escape" || event.repeat) return;
    if (event.timeStamp - escaped < TWICE_MS) {
      escaped = -Infinity;
      void stopEverything();
    } else escaped = event.timeStamp;
  }

  window.addEventListener("keydown", onkeydown, { capture: true });
  return () => window.removeEventListener("keydown", onkeydown, { capture: true });
}

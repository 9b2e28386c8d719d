/** What is told wherever in the page one is: what the server wants said, and how jobs ended. */
import { language, t } from "../i18n/index.svelte";
import { told, toldProblem } from "../i18n/server.svelte";
import { announce, tell } from "../notices.svelte";
import { preferences } from "../preferences.svelte";
import { hasEnded } from "../state";
import { onNews } from "../store.svelte";
import { allowChime, chime } from "./chime";
import { tellInTitle } from "./ended.svelte";
import { titleOf } from "./title";

export function tellOfEnds(): () => void {
  const ends = [allowChime(), listen()];
  return () => ends.forEach((end) => end());
}

function listen(): () => void {
  return onNews((news, before) => {
    if (news.type === "notice") {
      tell({ tone: "warning", ...told(news.text, news.hint) });
    }
    if (news.type !== "job-changed" || !hasEnded(news.job)) return;
    const known = before.jobs.find((each) => each.id === news.job.id);
    if (!known || hasEnded(known)) return;
    const { problem, state } = news.job;
    const title = titleOf(news.job);
    if (state === "done") {
      const sentence = t("shell.done", { title });
      tell({ tone: "success", sentence });
      announce(sentence);
      notify(sentence);
    } else if (problem) {
      tell({ tone: "danger", ...toldProblem(problem) });
      notify(t("shell.failed", { title }));
    }
  });
}

/** A tone, the title, and beside the page where it is not looked at, the person wants it and the browser can. */
function notify(sentence: string) {
  if (preferences.now.sounds) chime();
  tellInTitle(sentence);
  if (!preferences.now.notify || document.visibilityState === "visible") return;
  if (!("Notification" in window) || Notification.permission !== "granted") return;
  try {
    const shown = new Notification("Turnscan", {
      body: sentence,
      icon: "/icons/icon-192.png",
      lang: language.now,
    });
    shown.onclick = () => window.focus();
  } catch {
    // Browsers of phones have the name of it, but want a worker for it.
  }
}

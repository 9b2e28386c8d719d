/** The one AppState, kept true by the server's news. Read `app.now` in a component and it follows. */
import { api, asked } from "./api/client";
import { listen } from "./api/events";
import { hasEnded, nothingKnown, reduce, type AppEvent, type AppState, type News } from "./state";

let state = $state.raw<AppState>(nothingKnown);

export const app = {
  get now(): AppState {
    return state;
  },
};

export function dispatch(event: AppEvent): void {
  state = reduce(state, event);
}

type Ear = (news: News, before: AppState) => void;
let ears: readonly Ear[] = [];

/** Be told each piece of news after it was taken in; returns what ends it. For what is no state: a sound, a notice. */
export function onNews(ear: Ear): () => void {
  ears = [...ears, ear];
  return () => {
    ears = ears.filter((each) => each !== ear);
  };
}

/** Runs at most one at a time, and once more when it was wanted meanwhile. */
function oneAtATime(work: () => Promise<void>): () => Promise<void> {
  let running: Promise<void> | undefined;
  let isWanted = false;
  return () => {
    isWanted = true;
    running ??= (async () => {
      try {
        while (isWanted) {
          isWanted = false;
          await work();
        }
      } catch {
        // The line is lost: all is asked again when it is found.
      } finally {
        running = undefined;
      }
    })();
    return running;
  };
}

export const readScans = oneAtATime(async () =>
  dispatch({ type: "scans-read", scans: await asked(api.GET("/api/v1/scans")) }),
);

/** Follow the server until the returned function is called. */
export function follow(): () => void {
  // Asked for while the line is still being made.
  void readScans();
  return listen({
    onFound() {
      dispatch({ type: "link-found" });
      void readScans();
    },
    onLost() {
      dispatch({ type: "link-lost" });
    },
    onNews(news) {
      const before = state;
      dispatch(news);
      if (news.type === "job-changed" && mayChangeScans(before, news.job)) void readScans();
      for (const ear of ears) ear(news, before);
    },
  });
}

function mayChangeScans(before: AppState, job: AppState["jobs"][number]): boolean {
  const known = before.jobs.find((each) => each.id === job.id);
  return (
    known?.state !== job.state || (hasEnded(job) && !hasEnded(known)) || (known.done === 0 && job.done > 0)
  );
}

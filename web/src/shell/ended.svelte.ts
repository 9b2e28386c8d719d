/** A job that ended while nobody looked: the page's title says so until somebody does. */
let title = $state("");

export const ended = {
  get title(): string {
    return title;
  },
};

export function tellInTitle(words: string): void {
  if (document.visibilityState === "hidden") title = words;
}

document.addEventListener("visibilitychange", () => {
  if (document.visibilityState === "visible") title = "";
});

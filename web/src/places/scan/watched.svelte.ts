/** The scan that this tab saw running: of it the result is shown, until another is wanted. */
const KEY = "turnscan.watched";

let job = $state(sessionStorage.getItem(KEY) ?? "");

export const watched = {
  get job(): string {
    return job;
  },
  set job(id: string) {
    job = id;
    sessionStorage.setItem(KEY, id);
  },
};

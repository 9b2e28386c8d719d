/** The result that was seen: the order comes in its place. */
const KEY = "turnscan.dismissed";

let job = $state(sessionStorage.getItem(KEY) ?? "");

export const dismissed = {
  get job(): string {
    return job;
  },
  set job(id: string) {
    job = id;
    sessionStorage.setItem(KEY, id);
  },
};

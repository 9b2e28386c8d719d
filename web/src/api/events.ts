/** The only WebSocket for news: comes back by itself, and says when it was lost and found. */
import { API, NOT_LOGGED_IN, socketAddress } from "./addresses";
import { enterAgain } from "./entry";
import type { AnyEventOut } from "./schema.gen";

export interface Ears {
  onNews(news: AnyEventOut): void;
  /** Also after every loss; the first news is then how everything stands. */
  onFound(): void;
  onLost(): void;
}

const FIRST_WAIT_MS = 300;
const LONGEST_WAIT_MS = 5000;

/** Listen until the returned function is called. */
export function listen(ears: Ears): () => void {
  let socket: WebSocket | undefined;
  let timer: ReturnType<typeof setTimeout> | undefined;
  let wait = FIRST_WAIT_MS;
  let isOver = false;

  function open() {
    timer = undefined;
    const mine = (socket = new WebSocket(socketAddress(`${API}/events`)));
    mine.onopen = () => {
      wait = FIRST_WAIT_MS;
      ears.onFound();
    };
    mine.onmessage = (message) => ears.onNews(JSON.parse(message.data as string) as AnyEventOut);
    mine.onclose = (event) => {
      if (isOver || socket !== mine) return;
      if (event.code === NOT_LOGGED_IN) return void enterAgain(() => !isOver && open());
      ears.onLost();
      timer = setTimeout(open, wait * (0.75 + Math.random() / 2));
      wait = Math.min(2 * wait, LONGEST_WAIT_MS);
    };
  }

  /** A person who comes back to the page, or a network that does, is not kept waiting. */
  function hurry() {
    if (timer === undefined || document.visibilityState !== "visible") return;
    clearTimeout(timer);
    wait = FIRST_WAIT_MS;
    open();
  }

  open();
  document.addEventListener("visibilitychange", hurry);
  window.addEventListener("online", hurry);
  return () => {
    isOver = true;
    clearTimeout(timer);
    document.removeEventListener("visibilitychange", hurry);
    window.removeEventListener("online", hurry);
    socket?.close();
  };
}

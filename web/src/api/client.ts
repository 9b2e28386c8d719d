/** The only fetch of the page. Answers are typed by the API's own description. */
import createClient, { type Middleware } from "openapi-fetch";
import { toLogin } from "./addresses";
import type { paths, Problem } from "./schema.gen";

/** What the server refused, or could not do: a sentence and a way out. */
export class Refusal extends Error {
  override readonly name = "Refusal";

  constructor(
    readonly code: string,
    readonly sentence: string,
    readonly hint: string,
    readonly status: number,
  ) {
    super([sentence, hint].filter(Boolean).join(" "));
  }
}

/** `code` of a refusal that no server gave: none was reached. */
export const OFFLINE = "offline";

const loggedOut: Middleware = {
  onResponse({ response }) {
    if (response.status === 401) toLogin();
  },
};

export const api = createClient<paths>({ baseUrl: "", credentials: "same-origin" });
api.use(loggedOut);

type Answer<T> = { data?: T; error?: unknown; response: Response };

/** The body of an answer; a Refusal where there is none: `await asked(api.GET("/api/v1/bench"))`. */
export async function asked<T>(answer: Promise<Answer<T>>): Promise<T> {
  let got: Answer<T>;
  try {
    got = await answer;
  } catch {
    throw new Refusal(OFFLINE, "", "", 0);
  }
  if (got.response.ok) return got.data as T;
  const said = asProblem(got.error);
  const code = said.type.replace("turnscan:", "");
  throw new Refusal(code, said.title, said.hint ?? "", got.response.status);
}

/** Sends a file as the body of a request, and tells how much has gone. */
export function sendFile(
  method: "POST" | "PUT",
  path: string,
  file: Blob,
  onProgress: (share: number) => void = () => {},
  breakOff?: AbortSignal,
): Promise<unknown> {
  // The one thing that fetch cannot tell: how far a body has got.
  return new Promise((done, fail) => {
    const request = new XMLHttpRequest();
    request.open(method, path);
    request.responseType = "json";
    request.upload.onprogress = (event) => onProgress(event.total ? event.loaded / event.total : 0);
    request.onerror = () => fail(new Refusal(OFFLINE, "", "", 0));
    request.onload = () => {
      if (request.status < 300) return done(request.response);
      const said = asProblem(request.response);
      fail(new Refusal(said.type.replace("turnscan:", ""), said.title, said.hint ?? "", request.status));
    };
    request.onabort = () => fail(new DOMException("broken off", "AbortError"));
    breakOff?.addEventListener("abort", () => request.abort());
    request.send(file);
  });
}

function asProblem(body: unknown): Problem {
  if (body && typeof body === "object" && "title" in body) return body as Problem;
  return { type: "turnscan:http", title: String(body ?? ""), status: 0, hint: "" };
}

/** Addresses that the browser itself opens: downloads, pictures, sockets. */
export const API = "/api/v1";

const scan = (name: string) => `${API}/scans/${encodeURIComponent(name)}`;

export const cloudFile = (name: string) => `${scan(name)}/cloud.ply`;
export const recordingFile = (name: string) => `${scan(name)}/recording.zip`;
/** `version` changes when the picture does, so that the browser asks again. */
export const thumbnail = (name: string, version: string | number) =>
  `${scan(name)}/thumbnail.png?v=${encodeURIComponent(version)}`;

export function socketAddress(path: string): string {
  return `${location.protocol === "https:" ? "wss:" : "ws:"}//${location.host}${path}`;
}

/** The server's close code of a socket for who is not, or no more, logged in. */
export const NOT_LOGGED_IN = 4401;

export function toLogin(): void {
  if (location.pathname === "/login") return;
  location.assign(`/login?next=${encodeURIComponent(location.pathname + location.search)}`);
}

/** When a socket was closed for want of a login: a new password ends the old right, but may have given a new one. */
import { toLogin } from "./addresses";
import { api, asked } from "./client";

/** Goes on where one is let in after all, else to the login. */
export async function enterAgain(goOn: () => void): Promise<void> {
  try {
    if ((await asked(api.GET("/api/v1/access"))).is_let_in) return goOn();
  } catch {
    // The server is away; the login waits for it.
  }
  toLogin();
}

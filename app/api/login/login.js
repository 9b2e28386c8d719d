// The login page: password, or the one-time key of a code that was scanned, and on to where one wanted to go.
const at = (id) => document.getElementById(id);
const sentences = at("sentences").dataset;
const form = at("login"), field = at("password"), enter = at("enter"), show = at("show");

function wantedPath() {
  const next = new URLSearchParams(location.search).get("next") ?? "/";
  const isLocal = next.startsWith("/") && new URL(next, location.origin).origin === location.origin;
  return isLocal ? next : "/";
}

function sentence(kind, wait) {
  const name = kind.replace(/-(.)/g, (_, letter) => letter.toUpperCase());
  return (sentences[name] ?? sentences.other).replace("{wait}", wait);
}

// What the server says, or that it says nothing: always an object with `kind` where it went wrong.
async function ask(path, body) {
  const options = body && {
    method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body),
  };
  let answer;
  try {
    answer = await fetch(`/api/v1/access${path}`, options);
  } catch {
    return { kind: "unreachable" };
  }
  const said = await answer.json().catch(() => ({}));
  if (answer.ok) return said;
  return { kind: (said.type ?? "").replace("turnscan:", ""), wait: answer.headers.get("Retry-After") };
}

function tell(said) {
  at("said").textContent = said ? sentence(said.kind, said.wait) : "";
  field.setAttribute("aria-invalid", String(said?.kind === "wrong-password"));
}

let isBusy = false;
const idle = enter.textContent;

async function logIn(shown) {
  if (isBusy) return;
  isBusy = true;
  tell(null);
  enter.textContent = enter.dataset.busy;
  enter.setAttribute("aria-disabled", "true");
  const said = await ask("/login", shown);
  if (said.is_let_in) {
    location.replace(wantedPath());
    return;
  }
  isBusy = false;
  enter.textContent = idle;
  enter.removeAttribute("aria-disabled");
  tell(said);
  field.focus();
  field.select();
}

form.addEventListener("submit", (event) => {
  event.preventDefault();
  logIn({ password: field.value });
});

show.addEventListener("click", () => {
  const isShown = field.type === "text";
  field.type = isShown ? "password" : "text";
  show.setAttribute("aria-pressed", String(!isShown));
  show.textContent = isShown ? show.dataset.show : show.dataset.hide;
});

const key = new URLSearchParams(location.hash.slice(1)).get("key");
if (location.hash) history.replaceState(null, "", location.pathname + location.search);
const stands = await ask("");
if (stands.is_let_in) location.replace(wantedPath());
else if (key) logIn({ key });
else if (stands.kind) tell(stands);

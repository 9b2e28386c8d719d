// The page that the server brings along: scan, watch, download.
const api = "/api/v1";
const at = (id) => document.getElementById(id);

async function ask(method, path, body) {
  const options = { method, headers: body ? { "Content-Type": "application/json" } : {} };
  if (body) options.body = JSON.stringify(body);
  const answer = await fetch(api + path, options);
  const said = await answer.json();
  if (!answer.ok) throw new Error([said.title, said.hint].filter(Boolean).join(" "));
  return said;
}

async function attempt(work) {
  at("problem").textContent = "";
  try {
    await work();
  } catch (error) {
    at("problem").textContent = error.message;
  }
}

function element(name, text, more = {}) {
  const made = Object.assign(document.createElement(name), more);
  made.textContent = text;
  return made;
}

function button(text, work) {
  const made = element("button", text, { type: "button", className: "plain" });
  made.addEventListener("click", () => attempt(work));
  return made;
}

function jobLine(job) {
  const line = document.createElement("li");
  const left = job.seconds_left ? `, ${Math.ceil(job.seconds_left)} s left` : "";
  const said = job.problem ? `${job.problem.message} ${job.problem.hint}` : job.ended ? "" : job.waits_for || job.note;
  line.append(element("span", `${job.title}: ${job.state}. ${said}${left}`));
  const act = (verb) => button(verb[0].toUpperCase() + verb.slice(1), () => ask("POST", `/jobs/${job.id}/${verb}`));
  if (job.state === "running") line.append(act("pause"), act("cancel"));
  if (job.state === "paused") line.append(act("resume"), act("cancel"));
  if (!job.ended && job.total) line.append(Object.assign(document.createElement("progress"), { value: job.done, max: job.total }));
  return line;
}

function scanLine(scan) {
  const line = document.createElement("li");
  const points = scan.clouds.length ? `, ${scan.clouds.at(-1).points.toLocaleString()} points` : "";
  line.append(element("span", `${scan.title}: ${scan.status}, ${scan.pictures} pictures${points}`));
  const path = `${api}/scans/${encodeURIComponent(scan.name)}`;
  if (scan.clouds.length) line.append(element("a", "PLY", { href: `${path}/cloud.ply` }));
  line.append(element("a", "Recording", { href: `${path}/recording.zip` }));
  if (scan.status === "paused") {
    line.append(button("Go on", () => ask("POST", "/jobs/resume-scan", { scan: scan.name })));
  }
  return line;
}

async function showBench() {
  const bench = await ask("GET", "/bench");
  const board = bench.turntable || "no board";
  const pace = bench.camera.fps ? `camera at ${bench.camera.fps.toFixed(0)} pictures/s` : "camera connected";
  const camera = bench.camera.connected ? pace : "no camera";
  at("bench").textContent = [`${bench.name}: ${board}, ${camera}`, ...bench.problems].join(". ");
}

async function showJobs() {
  at("jobs").replaceChildren(...(await ask("GET", "/jobs")).slice(0, 5).map(jobLine));
}

async function showScans() {
  const scans = await ask("GET", "/scans");
  const lines = scans.length ? scans.map(scanLine) : [element("li", "None yet. Put something on the table and press Scan.")];
  at("scans").replaceChildren(...lines);
}

const showAll = () => attempt(() => Promise.all([showBench(), showJobs(), showScans()]));

function listen() {
  const news = new EventSource(`${api}/events/stream`);
  news.onopen = showAll;
  news.onerror = () => { at("bench").textContent = "The server does not answer. Waiting for it…"; };
  news.onmessage = (message) => {
    const event = JSON.parse(message.data);
    if (event.type === "bench-changed") showBench();
    if (event.type === "job-changed") {
      showJobs();
      if (event.job.ended || event.job.done <= 1) showScans();
    }
  };
}

at("scan").addEventListener("submit", (event) => {
  event.preventDefault();
  const form = new FormData(event.target);
  attempt(() => ask("POST", "/jobs/scan", { title: form.get("title"), steps: Number(form.get("steps")) }));
});
at("stop").addEventListener("click", () => attempt(() => ask("POST", "/bench/stop")));
listen();

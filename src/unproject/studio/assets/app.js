// The page: which panel is open, what the address bar holds, and how panels ask the server.
import { collectionsPanel } from "/assets/collections.js";
import { explorePanel } from "/assets/explore.js";
import { fitPanel } from "/assets/fit.js";
import { materialsPanel } from "/assets/materials.js";
import { runsPanel } from "/assets/runs.js";

const PANELS = {
  runs: ["Runs", runsPanel], explore: ["Explore", explorePanel], materials: ["Materials", materialsPanel],
  collections: ["Collections", collectionsPanel], fit: ["Fit", fitPanel],
};
const trouble = document.getElementById("trouble");
let close = () => {};

// An element: make("p.small", "text"), make("button", { onclick }, child, ...). Text is never markup.
export function make(kind, ...parts) {
  const [tag, ...classes] = kind.split(".");
  const made = document.createElement(tag);
  if (classes.length) made.className = classes.join(" ");
  for (const part of parts) {
    if (part && part.constructor === Object) {
      for (const [name, value] of Object.entries(part)) {
        if (name.startsWith("on") || name in made) made[name] = value;
        else made.setAttribute(name, value);
      }
    } else if (part !== null && part !== undefined) made.append(part);
  }
  return made;
}

// What the server's own report says is escaped there.
export function markup(text) {
  const made = document.createElement("div");
  made.innerHTML = text;
  return made;
}

export function address(path, query = {}) {
  const given = Object.entries(query).filter(([, value]) => value !== undefined && value !== null && value !== "");
  return path + (given.length ? `?${new URLSearchParams(given)}` : "");
}

// The server's answer; what goes wrong is an Error with its words. A full queue is waited for, ten seconds at most.
export async function answerTo(path, query, options) {
  const { signal } = open.left; // what a panel has asked for is not waited for once it is left
  for (let left = 20; ; left--) {
    let answer;
    try {
      answer = await fetch(address(path, query), { signal, ...options });
    } catch (error) {
      if (error.name === "AbortError") throw error;
      throw new Error("The studio does not answer; is it still running?");
    }
    if (answer.ok) return answer;
    const { error } = await answer.json();
    if (answer.status !== 503 || (options && options.method) || !left) throw Object.assign(new Error(error || answer.statusText), { status: answer.status });
    await new Promise((done) => setTimeout(done, 500));
  }
}

export const ask = async (...asked) => (await answerTo(...asked)).json();

const LIMIT = 40000000; // bytes, as the server has it

// A file that may be sent; what is too large is said before it is.
export function sendable(file, remedy) {
  if (file.size > LIMIT) throw new Error(`${file.name} is ${Math.round(file.size / 1e6)} MB; give at most ${LIMIT / 1e6} MB, ${remedy}.`);
  return file;
}

export function say(error) {
  if (error && error.name === "AbortError") return;
  trouble.textContent = error ? error.message || String(error) : "";
  trouble.hidden = !error;
}

export function here() {
  const [panel, query] = location.hash.replace(/^#\/?/, "").split("?");
  return { panel: panel in PANELS ? panel : "runs", query: Object.fromEntries(new URLSearchParams(query || "")) };
}

export const link = (panel, query) => address(`#/${panel}`, query);
export function go(panel, query) { location.hash = link(panel, query); }

// Keeps what is on screen in the address bar, without a new entry in the history. Nothing is kept of a panel once the
// address has moved on: between that and hashchange a timer may fire, and would send the reader back.
export function keep(changes) {
  if (location.hash !== open.hash) return;
  const { panel, query } = here();
  history.replaceState(null, "", link(panel, { ...query, ...changes }));
  open.hash = location.hash;
}

// Calls work() now and every so many seconds while the panel is open and seen; returns what stops it.
export function repeatedly(seconds, work) {
  let going = true, failed = false, timer;
  async function next() {
    if (!going) return;
    if (!document.hidden) {
      try {
        await work();
        if (failed && going) say(null); // the studio answers again
        failed = false;
      } catch (error) { if (going) { say(error); failed = true; } }
    }
    if (going) timer = setTimeout(next, 1000 * seconds);
  }
  next();
  return () => { going = false; clearTimeout(timer); };
}

// Calls work(value) with the newest value only, one call at a time: a slider moves faster than meshes are made.
export function latest(work) {
  let waiting = null, busy = false, failed = false;
  const { signal } = open.left;
  return async function call(value) {
    waiting = [value];
    if (busy) return;
    busy = true;
    while (waiting && !signal.aborted) {
      const [one] = waiting;
      waiting = null;
      try {
        await work(one);
        if (failed) say(null); // what others have said stays
        failed = false;
      } catch (error) { say(error); failed = true; }
    }
    busy = false;
  };
}

function open() {
  close();
  if (open.left) open.left.abort();
  open.left = new AbortController();
  open.hash = location.hash;
  say(null);
  const { panel, query } = here();
  for (const tab of document.querySelectorAll("#panels a")) {
    if (tab.dataset.panel === panel) tab.setAttribute("aria-current", "page");
    else tab.removeAttribute("aria-current");
  }
  document.title = `${PANELS[panel][0]} – unproject studio`;
  const root = document.getElementById("panel");
  root.replaceChildren();
  root.className = panel;
  close = PANELS[panel][1](root, query) || (() => {});
}

const tabs = document.getElementById("panels");
Object.entries(PANELS).forEach(([panel, [title]], k) => {
  const tab = make("a", title, { href: `#/${panel}`, title: `${title} (key ${k + 1})` });
  tab.dataset.panel = panel;
  tab.addEventListener("click", (event) => { // the run stays chosen from panel to panel
    event.preventDefault();
    const { run } = here().query;
    go(panel, panel === "runs" ? {} : { run });
  });
  tabs.append(tab);
});
const keys = document.getElementById("keys");
keys.querySelector("button").onclick = () => keys.close();
document.getElementById("help").onclick = () => keys.showModal();

// A button that says which key it has is pressed by it.
function press(key) {
  const button = [...document.querySelectorAll("#panel [data-key]")].find((one) => one.dataset.key === key && one.offsetParent);
  if (button) button.click();
}

addEventListener("hashchange", () => { open(); document.getElementById("panel").focus({ preventScroll: true }); });
// A file that no panel takes would be opened by the browser in place of the studio.
for (const kind of ["dragover", "drop"]) addEventListener(kind, (event) => {
  if (event.defaultPrevented || !event.dataTransfer || !event.dataTransfer.types.includes("Files")) return;
  event.preventDefault();
  if (kind === "drop") say(new Error("This panel takes no file: drop a picture on Fit, a light on Materials."));
});
addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("input:not([type=range], [type=checkbox]), select, textarea")) return;
  if (event.key === "?") { keys.open ? keys.close() : keys.showModal(); return; }
  if (keys.open) return;
  const panel = Object.keys(PANELS)[Number(event.key) - 1];
  if (panel) go(panel, panel === "runs" ? {} : { run: here().query.run });
  else press(event.key.toLowerCase());
});
open();

// Fit: a picture is dropped, and the sample behind it is found while one watches.
import { ask, keep, make, say, sendable } from "/assets/app.js";
import { title, withRun } from "/assets/choose.js";
import { stageView } from "/assets/explore.js";
import { exportBar } from "/assets/export.js";

const WANTED = {
  volumes: "a mask, a cut-out, or a photograph on a plain backdrop",
  maps: "a photograph of a flat material, as the run was trained on",
  images: "an .npz of line integrals (array lines or sinograms, and angle if it is known)",
  "": "what the run was trained on",
};
const EVERY = 400; // milliseconds between looks

export const fitPanel = (root, query) => withRun(root, query, "fit", ["volumes", "images", "maps"], fits);

function fits(root, query) {
  let closed = false, failed = false, shown = null, chosen = 0, facing = query.azimuth === undefined; // until a hand turns the shape
  const file = make("input", { type: "file", "aria-label": "picture" }), wanted = make("span");
  const zone = make("label.zone", file, make("strong", "Drop a picture here"), make("span", "or choose a file: ", wanted));
  const observation = make("select", { "aria-label": "kind of picture" }), which = make("label.field", make("span", "kind of picture"), observation);
  const view = make("input", { type: "text", placeholder: "unknown", "aria-label": "view in degrees" });
  const scale = make("input", { type: "number", min: 0, step: "any", placeholder: "as in training", "aria-label": "scale" }), unit = make("label.field", { hidden: true }, make("span", "scale"), scale);
  unit.title = "What the readings are divided by, so that a row of ones in a picture gives 1";
  const search = make("select", { "aria-label": "search" }), novelty = make("input", { type: "checkbox", checked: true });
  const own = make("button", { type: "button", hidden: true }, "Take one of its own pictures");
  const stage = make("div.stage"), note = make("p.small"), remarks = make("ul.remarks", { hidden: true }), bar = make("progress", { max: 1, value: 0, "aria-label": "done" });
  const stop = make("button", { type: "button" }, "Stop"), watch = make("section", { hidden: true }, stage, make("div.bar.watch", bar, stop), note, remarks);
  const found = make("section", { hidden: true });
  const intro = make("section.intro", make("h2", "The object behind a picture"),
    make("p", "The run has learned what objects of a kind look like. Of all that it can make, this looks for the one whose projection is the picture, from whatever view it was taken, and shows it on its way."),
    make("p", "One picture leaves much open: several explanations come with their weights, and the probability of each view. If the picture is of another kind than those the run has seen, the page says so."),
    make("p.small", "The picture stays on this machine, and is not stored."));
  const options = make("details", make("summary", "What is known of it, and how to search"), which,
    make("label.field", make("span", "view, degrees"), view), unit, make("label.field", make("span", "search"), search),
    make("label.check", novelty, "compare it with the pictures of training (half a minute, once)"));
  root.append(title(query.run), make("div.fitter", make("section.give", zone, make("div.bar", own), options), intro, watch, found));
  let drawing = null;

  ask("/api/kinds", { run: query.run }).then((kinds) => {
    wanted.textContent = `${WANTED[kinds.kind]}.`;
    file.accept = kinds.suffixes.join(",");
    which.hidden = !kinds.observations.length;
    unit.hidden = kinds.kind !== "images";
    observation.append(...kinds.observations.map((name) => make("option", { value: name }, name)));
    if (kinds.observations.includes("flash")) observation.value = "flash";
    search.append(...kinds.searches.map((name) => make("option", { value: name }, name)));
    own.hidden = !kinds.own;
    if (kinds.observations.length) options.open = true; // never closed: a reader may have opened it by now
  }).catch(say);

  async function give(name, content, own = {}) {
    say(null);
    const asked = { run: query.run, name, ...own, observation: observation.value, view: view.value, scale: scale.value, search: search.value || "quick", novelty: novelty.checked ? 1 : 0 };
    const { fit } = await ask("/api/fit", asked, { method: "POST", body: content && sendable(content, "such as a picture of fewer pixels") });
    facing = true;
    begin(fit);
    if (!content || /\.npz$/i.test(name)) return;
    const url = URL.createObjectURL(content), image = make("img", { src: url, alt: "given", onload: () => URL.revokeObjectURL(url) });
    seen("What was given", figure("given", image));
  }
  const figure = (name, image) => make("figure", image, make("figcaption.small", name));
  const picture = (name, uri) => figure(name, make("img", { src: uri, alt: name }));
  function seen(heading, ...figures) {
    found.replaceChildren(make("h2", heading), make("div.pair", ...figures));
    found.hidden = false;
  }
  function begin(fit) {
    if (shown && shown !== fit) ask("/api/stop", { fit: shown }, { method: "POST", body: "" }).catch(() => {}); // nobody looks at it any more
    [shown, chosen] = [fit, 0];
    intro.hidden = found.hidden = true;
    [note.textContent, bar.value, remarks.hidden] = ["", 0, true]; // not what was said of the fit before
    keep({ fit });
    if (drawing) drawing.close();
    stage.replaceChildren();
    drawing = stageView(stage, query);
    stage.onpointerdown = stage.onkeydown = () => { facing = false; };
    follow(fit, -1);
  }
  // Looks again and again until the fit has ended; each look draws what has changed since.
  async function follow(fit, moves) {
    if (closed || fit !== shown) return;
    try {
      const now = await ask("/api/fit", { fit });
      if (closed || fit !== shown) return;
      if (failed) say(null); // the studio answers again
      failed = false;
      watch.hidden = false;
      tell(now);
      // On its way it may be at a shape of which nothing is to be seen: that ends nothing.
      if (now.drawable && now.moves !== moves) await draw(fit, chosen).catch((error) => { if (now.ended) say(error); });
      if (now.explanations && (moves < 0 || now.moves !== moves)) show(now, fit);
      else if (now.picture && now.projection && now.moves !== moves) seen("On its way", picture("given", now.picture), picture("so far", now.projection));
      if (!now.ended) setTimeout(() => follow(fit, now.moves), EVERY);
    } catch (error) {
      say(error);
      failed = !error.status && error.name !== "AbortError"; // no answer at all, as after a laptop's sleep
      if (failed) setTimeout(() => follow(fit, moves), 5 * EVERY);
    }
  }
  function tell(now) {
    const waits = { done: `Done in ${now.seconds} s.`, stopped: "Stopped.", failed: "It could not be done." };
    note.textContent = `${now.name}: ${waits[now.stage] || `${now.stage} …`}`;
    remarks.hidden = !now.remarks.length;
    remarks.replaceChildren(...now.remarks.map((remark) => make("li", `${remark}.`)));
    if (now.error) say(new Error(now.error));
    bar.value = now.ended ? 1 : now.done;
    stage.hidden = now.stage === "failed" && !now.drawable; // there is nothing to turn
    bar.parentNode.hidden = now.ended;
    stop.onclick = () => ask("/api/stop", { fit: shown }, { method: "POST", body: "" }).catch(say);
  }
  async function draw(fit, number) {
    const drawn = await ask("/api/fit/drawn", { fit, which: number });
    if (!closed && fit === shown) drawing.show(drawn);
  }
  function show(now, fit) {
    const word = now.ended || !now.explained ? make(`span.word.${now.explained ? "good" : "doubtful"}`, now.explained ? "explained" : "not explained") : make("span.word", "found");
    const far = `Its projection is at distance ${now.distances[chosen].toFixed(2)} from the picture: 0 is equal, 1 unrelated, and from ${now.levels.distance} on it does not count as explained.`;
    const strange = now.p === null ? [] : [make("p.small", `Beside the pictures of training this one is ${now.p < now.levels.p ? "of another kind" : "nothing strange"} (p ${now.p.toFixed(2)}; below ${now.levels.p} it counts as another kind).`)];
    const pair = make("div.pair", picture("given", now.picture), picture("found", now.projections[chosen]));
    const cells = make("div.cells", ...now.explanations.map((uri, k) => {
      const share = Math.round(100 * now.weights[k]);
      const cell = make("button", { type: "button", "aria-pressed": String(k === chosen), title: `explanation ${k + 1}, weight ${share} %` }, make("img", { src: uri, alt: `explanation ${k + 1}` }), make("span.small", `${share} %`));
      cell.onclick = () => {
        chosen = k;
        show(now, fit);
        found.querySelectorAll(".cells button")[k].focus();
        draw(fit, k).catch(say);
      };
      return cell;
    }));
    const [view] = now.views[chosen], named = Object.entries(view).map(([name, value]) => `${name.replace("_", " ")} ${value}°`).join(", ");
    const face = make("button", { type: "button" }, "Turn it to the picture's view");
    face.onclick = () => drawing.face(view);
    face.hidden = view.azimuth === undefined;
    if (facing && !face.hidden) drawing.face(view);
    found.replaceChildren(make("h2", "What was found"), make("p", word, " ", now.explained ? "" : `${now.why}. `, far), ...strange, pair,
      make("h3", now.explained ? "Explanations, by how well each does" : "The nearest, by how well each does"), cells,
      make("h3", "View"), make("p.small", named ? `${named}${alike(now.posterior)}.` : "There is none to be found."), face, ...(now.posterior.length > 1 ? [histogram(now)] : []),
      make("h3", "Download"), exportBar(now.formats, now.format, "/api/fit/file", () => ({ fit, which: chosen })));
    found.hidden = false;
  }

  const take = (chosen) => { if (chosen) give(chosen.name, chosen).catch(say); };
  file.onchange = () => { take(file.files[0]); file.value = ""; };
  own.onclick = async () => {
    own.disabled = true;
    try { await give("", "", { own: Math.floor(1e6 * Math.random()) }); } catch (error) { say(error); }
    own.disabled = false;
  };
  const over = (event) => { event.preventDefault(); zone.classList.add("over"); };
  const leave = () => zone.classList.remove("over");
  const drop = (event) => { event.preventDefault(); leave(); take(event.dataTransfer.files[0]); };
  document.addEventListener("dragover", over);
  document.addEventListener("dragleave", leave);
  document.addEventListener("drop", drop);
  if (query.fit) begin(query.fit);
  return () => {
    closed = true;
    if (drawing) drawing.close();
    document.removeEventListener("dragover", over);
    document.removeEventListener("dragleave", leave);
    document.removeEventListener("drop", drop);
  };
}

// How many further views are nearly as probable: peaks of at least half the highest.
function alike(posterior) {
  const n = posterior.length, most = Math.max(...posterior);
  const peaks = posterior.filter((share, k) => share >= most / 2 && share >= posterior[(k + 1) % n] && share > posterior[(k + n - 1) % n]);
  return peaks.length > 1 ? `; ${peaks.length} views are about as probable` : "";
}

// The probability of each view, as columns.
function histogram(now) {
  const most = Math.max(...now.posterior);
  return make("figure", make("div.histogram", ...now.posterior.map((share, k) => {
    const column = make("i", { title: `${now.labels[k]}: ${Math.round(100 * share)} %` });
    column.style.height = `${Math.max((100 * share) / most, 1)}%`;
    return column;
  })), make("figcaption.small", `probability of each view, ${now.labels[0]} to ${now.labels.at(-1)} (${now.unit})`));
}

// Runs: a list with pictures; one run as it trains, or two side by side.
import { address, ask, go, keep, link, make, markup, repeatedly } from "/assets/app.js";
import { comingSoon } from "/assets/choose.js";
import { downloadButton } from "/assets/export.js";

const LIST_EVERY = 5, RUN_EVERY = 3; // seconds

export function runsPanel(root, query) {
  return query.run ? showRuns(root, query) : showList(root);
}

export function budget(run) {
  const minutes = run.minutes ? `${(run.seconds / 60).toFixed(1)} of ${run.minutes} minutes` : `${(run.seconds / 60).toFixed(1)} minutes`;
  const steps = run.steps ? `${run.trained.toLocaleString("en")} of ${run.steps.toLocaleString("en")} steps` : `${run.trained.toLocaleString("en")} steps`;
  return `${steps}, ${minutes}`;
}

const readable = (run) => run.step !== undefined;

export function badge(run) {
  if (run.verdict) return make(`span.word.${run.verdict}`, run.verdict);
  if (run.training) return make("span.word.training", "training");
  return make("span.word", readable(run) ? (run.complete ? "no verdict" : "unfinished") : "broken");
}

function showList(root) {
  const heading = make("h1", "Runs"), compare = make("button", { type: "button", disabled: true }, "Compare two");
  const list = make("div.cards"), chosen = new Set();
  let before = "", drawn = [];
  root.append(make("div.bar.title", heading, compare), list);
  compare.onclick = () => { const [run, other] = chosen; go("runs", { run, other }); };

  function card(run) {
    const box = make("input", { type: "checkbox", checked: chosen.has(run.name), "aria-label": `compare ${run.name}` });
    box.onchange = () => {
      if (box.checked) chosen.add(run.name); else chosen.delete(run.name);
      compare.disabled = chosen.size !== 2;
    };
    const seen = run.picture === null ? make("div.blank", readable(run) ? "no picture yet" : "cannot be read")
      : make("img", { src: address("/api/picture", { run: run.name, small: 1, at: run.changed }), alt: `samples of ${run.name}`, width: 240, height: 240, loading: "lazy" });
    const bar = make("progress", { max: 1, value: run.progress || 0, "aria-label": "budget spent" });
    const about = readable(run) ? [make("p.small", `${run.recipe.split(":").pop() || "own recipe"} · ${budget(run)}`), ...(run.complete ? [] : [bar])] : [];
    const words = run.said || (run.training && !run.step ? comingSoon(run) : run.training ? "" : run.unfinished) || run.line.replace(/^\w+: /, "");
    return make("article.card", make("a.seen", { href: link("runs", { run: run.name }) }, seen),
      make("div.about", make("h2", make("a", { href: link("runs", { run: run.name }) }, run.name)),
        make("p", badge(run), make("label.pick", box, "compare")), ...about, make("p.small.says-so", words)));
  }

  return repeatedly(LIST_EVERY, async () => {
    const found = await ask("/api/runs");
    const now = JSON.stringify(found);
    if (now === before) return; // leaves the focus and the scroll where they are
    before = now;
    heading.textContent = `${found.runs.length} ${found.runs.length === 1 ? "run" : "runs"} in ${found.folder}`;
    const same = drawn.length === found.runs.length && drawn.every((run, k) => run.name === found.runs[k].name);
    if (!same) list.replaceChildren(...found.runs.map(card));
    else found.runs.forEach((run, k) => { if (JSON.stringify(run) !== JSON.stringify(drawn[k])) list.children[k].replaceWith(card(run)); });
    drawn = found.runs;
    if (!found.runs.length) list.append(make("p", `There is no run in ${found.folder} yet. unproject train shapes --data my_masks/ --out ${found.folder}/mine makes one.`));
  });
}

function showRuns(root, query) {
  const names = [query.run, query.other].filter(Boolean);
  const columns = make(names.length > 1 ? "div.side-by-side" : "div");
  root.append(make("p.back", make("a", { href: "#/runs" }, "← all runs")), columns);
  const stops = names.map((name, k) => {
    const column = make("div.run");
    columns.append(column);
    return showRun(column, name, k ? "otherstep" : "step", query);
  });
  return () => stops.forEach((stop) => stop());
}

function showRun(column, name, key, query) {
  const title = make("div.bar.title", make("h1", name)), facts = make("p.facts"), links = make("p.links");
  const image = make("img.sheet", { alt: `samples of ${name}` }), label = make("output");
  const slider = make("input", { type: "range", min: 0, step: 1, "aria-label": "step of training" });
  const remark = make("p.remarks", { hidden: true });
  const samples = make("section", make("h2", "Samples over time"), image, make("div.bar", slider, label));
  const report = downloadButton("Download its report", "/api/report.html", () => ({ run: name }));
  const parts = make("div");
  let before = "", steps = [], drawn = [], follow = !query[key];
  column.append(title, facts, make("div.bar.actions", links, report), remark, samples, parts);
  const draw = () => {
    const step = steps[Number(slider.value)];
    samples.hidden = step === undefined;
    if (step === undefined) return;
    image.src = address("/api/picture", { run: name, step });
    label.textContent = `step ${step.toLocaleString("en")}`;
  };
  slider.oninput = () => {
    follow = Number(slider.value) === steps.length - 1;
    keep({ [key]: follow ? "" : steps[Number(slider.value)] });
    draw();
  };
  return repeatedly(RUN_EVERY, async () => {
    const run = await ask("/api/run", { run: name });
    const now = JSON.stringify(run);
    if (now === before) return;
    before = now;
    title.replaceChildren(make("h1", name), badge(run));
    remark.textContent = run.unreadable || (run.training && !run.step ? comingSoon(run) : "");
    remark.hidden = !remark.textContent;
    facts.textContent = `recipe ${run.recipe || "of its own"} · ${budget(run)}`;
    links.replaceChildren(...linksOf(run));
    const at = follow ? run.pictures.length - 1 : run.pictures.indexOf(steps[Number(slider.value)] ?? Number(query[key]));
    steps = run.pictures;
    slider.max = Math.max(steps.length - 1, 0);
    slider.value = at < 0 ? steps.length - 1 : at;
    draw();
    const { verdict, curves, views, commands, environment } = run.sections;
    const sections = [verdict, curves, views, commands, environment];
    sections.forEach((text, k) => { // what has not changed keeps its focus and what is marked in it
      if (text === drawn[k]) return;
      const section = markup(text);
      section.querySelectorAll("button.copy").forEach(copies);
      if (parts.children[k]) parts.children[k].replaceWith(section); else parts.append(section);
    });
    drawn = sections;
  });
}

function copies(button) {
  button.hidden = !navigator.clipboard; // as on a page that another machine serves
  button.onclick = async () => {
    await navigator.clipboard.writeText(button.previousElementSibling.textContent);
    button.textContent = "copied";
  };
}

const FOR = { volumes: ["explore", "collections", "fit"], images: ["explore", "collections", "fit"], maps: ["explore", "materials", "collections", "fit"] };
const SAYS = { explore: "Explore its samples", collections: "Its pictures and views", materials: "Light its materials", fit: "Fit a picture" };

function linksOf(run) {
  return run.step ? (FOR[run.kind] || ["explore"]).map((panel) => make("a", { href: link(panel, { run: run.name }) }, SAYS[panel])) : [];
}

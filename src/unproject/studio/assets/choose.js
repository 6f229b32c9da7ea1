// A run to choose, where a panel needs one, and to wait for, until it has something to show.
import { address, ask, go, here, link, make, repeatedly, say } from "/assets/app.js";

const EVERY = 3; // seconds

export function title(run, more) {
  return make("div.bar.title", make("h1", run === "." ? "This run" : run), make("span", make("a", { href: `#/runs?run=${encodeURIComponent(run)}` }, "about this run"), more));
}

// What a run that is not finished has to say of itself.
export function comingSoon(run) {
  const first = `its first weights come at step ${(run.first || 0).toLocaleString("en")}`;
  return run.training ? `It is training, and has made ${run.trained.toLocaleString("en")} steps; ${first}.` : run.unfinished;
}

const MAKES = { volumes: "shapes", images: "images", maps: "materials", "": "samples of its own kind" };

// Opens a panel once its run has weights: show(root, query) is called then. `kinds` are those that the panel can show.
export function withRun(root, query, panel, kinds, show) {
  if (!query.run) return chooseRun(root, panel, (run) => kinds.includes(run.kind));
  const said = make("p.facts", "opening …");
  root.append(title(query.run), said);
  let close = () => {}, stop = () => {};
  stop = repeatedly(EVERY, async () => {
    const run = await ask("/api/newest", { run: query.run });
    if (!kinds.includes(run.kind)) {
      said.replaceChildren(`This run makes ${MAKES[run.kind]}, which this panel does not show. `, make("a", { href: link("explore", { run: query.run }) }, "Explore its samples"));
      stop();
    } else if (run.step) {
      stop();
      root.replaceChildren();
      close = show(root, query, run.title) || close;
    } else said.textContent = `Nothing can be shown yet. ${comingSoon(run)}`;
  });
  return () => { stop(); close(); };
}

// Says that a run has newer weights than those on screen, and shows them when asked to.
export function newerWeights(run, shown) {
  const says = make("span"), button = make("button", { type: "button" }, "Show them"), bar = make("p.newer", { hidden: true, role: "status" }, says, button);
  button.onclick = () => { const { panel, query } = here(); go(panel, { ...query, step: "" }); };
  const stop = repeatedly(EVERY, async () => {
    const { step } = await ask("/api/newest", { run });
    bar.hidden = shown() === null || step <= shown();
    says.textContent = `This is of step ${(shown() || 0).toLocaleString("en")}; there are weights of step ${step.toLocaleString("en")} by now. `;
  });
  return { bar, stop };
}

export function chooseRun(root, panel, fits) {
  const list = make("div.cards");
  root.append(make("h1", "Choose a run"), list);
  ask("/api/runs").then(({ runs, folder }) => {
    const fitting = runs.filter((run) => run.step && fits(run));
    list.replaceChildren(...fitting.map((run) => make("article.card",
      make("a.seen", { href: link(panel, { run: run.name }) }, run.picture === null ? make("div.blank", "no picture yet")
        : make("img", { src: address("/api/picture", { run: run.name, small: 1, at: run.changed }), alt: `samples of ${run.name}` })),
      make("div.about", make("h2", make("a", { href: link(panel, { run: run.name }) }, run.name)), make("p.small", run.recipe)))));
    if (!fitting.length) list.append(make("p", `No run in ${folder} has what this panel shows.`));
  }).catch(say);
}

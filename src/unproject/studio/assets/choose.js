// A run to choose, where a panel needs one.
import { address, ask, link, make, say } from "/assets/app.js";

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
